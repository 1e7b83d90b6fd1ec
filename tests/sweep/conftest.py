"""A small campaign: three chunks, two scenarios, three controllers."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from codegen.sweep import plan as planning
from codegen.sweep.plan import Plan

ROOT = Path(__file__).resolve().parents[2]

SPEC = """
samples = {samples}
seed = 5
scenarios = ["step-steer", "sine-with-dwell"]
lead_s = 0.2
length_s = 3.9

[controllers]
pi = "{root}/generated/4ws2"
tracking = "{root}/generated/4ws2-tracking"
passive = ""

[factors]
mass_percent = {{ uniform = [-15, 25] }}
friction = {{ uniform = [0.4, 1.0] }}
speed_km_h = {{ uniform = [40, 110] }}
rear_stiffness_percent = {{ normal = [0, 10], within = [-20, 20] }}
yaw_rate_noise_deg_s = 0.1
delay_samples = [0, 1, 2]
"""
SAMPLES = 200
"""Of six runs each: three chunks, the last one short."""


def write_spec(at: Path, samples: int = SAMPLES, more: str = "") -> Path:
    path = at / "sweep.toml"
    path.write_text(SPEC.format(samples=samples, root=ROOT) + more, encoding="utf-8")
    return path


def damage(path: Path, column: int) -> None:
    """Change a bit in the last page of a column of a Parquet file."""
    found = pq.read_metadata(path).row_group(0).column(column)
    begin = found.dictionary_page_offset if found.has_dictionary_page else found.data_page_offset
    content = bytearray(path.read_bytes())
    content[begin + found.total_compressed_size - 1] ^= 0x10
    path.write_bytes(content)


@pytest.fixture(scope="session")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_spec(tmp_path_factory.mktemp("spec"))


@pytest.fixture(scope="session")
def plan(spec: Path) -> Plan:
    return planning.read(spec)

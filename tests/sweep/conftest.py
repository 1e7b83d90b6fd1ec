"""A small campaign, run once for all workers: three chunks, two scenarios, three controllers."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from codegen.sweep import plan as planning
from codegen.sweep import store
from codegen.sweep.engine import Threads, run_campaign
from codegen.sweep.plan import Plan
from tests import shared

ROOT = Path(__file__).resolve().parents[2]

SPEC = """
samples = {samples}
seed = 5
scenarios = ["step-steer", "sine-with-dwell"]
lead_s = 0.2
length_s = 3.9

[controllers]
pi = "{root}/generated/4ws2-paper"
tracking = "{root}/generated/4ws2"
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
"""Samples with six runs each: three chunks, the last one short."""


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


class Recording(Threads):
    """One thread that records its chunks and calls `after` when a chunk is stored."""

    def __init__(self, after: Callable[[int], object] = lambda number: None) -> None:
        super().__init__(1)
        self.driven: list[int] = []
        self._after = after

    def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        for number, table in super().run(work, numbers):
            self.driven.append(number)
            yield number, table
            self._after(number)


@pytest.fixture(scope="package", autouse=True)
def _several_groups() -> Iterator[None]:
    """Store several row groups in a file, like long campaigns."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "ROWS_PER_GROUP", 400)
        yield


@pytest.fixture(scope="session")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return planning.read(write_spec(tmp_path_factory.mktemp("spec")))


@pytest.fixture(scope="package")
def whole(plan: Plan) -> Path:
    """Return the file of the campaign. Tests must not change its folder."""
    with shared.locked("sweep campaign") as folder:
        return run_campaign(plan, folder, Threads(1))

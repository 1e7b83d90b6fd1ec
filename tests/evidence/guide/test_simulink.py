"""The files of docs/simulink.md in Octave: every scenario, other formats, and the specification for Legacy Code Tool.

The page itself runs in test_commands.py, with one scenario.
"""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from codegen.export.runs import save
from codegen.importing.maps import Choices, import_map
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import load
from codegen.sil.toolchain import compiler_command
from hil_sim.scenarios import SCENARIOS
from tests.docs.blocks import ROOT, blocks
from tests.docs.page import write

BUILD = ROOT / "generated" / "4ws2"
UNITS = "vx=m/s,delta_f=rad,yaw_rate=rad/s"

STUB = """function result = legacy_code(action, def, varargin)
  result = struct();
  if strcmp(action, 'sfcn_cmex_generate')
    printf('%s;\\n', def.StartFcnSpec, def.InitializeConditionsFcnSpec, def.OutputFcnSpec, def.TerminateFcnSpec);
    printf('%s\\n', def.SourceFiles{:});
  end
end
"""
"""Legacy Code Tool of these tests: it prints the functions and files of a specification."""

IN_C = {r"\bsingle\b": "float", r"\bboolean\b": "bool", r"\buint8\b": "uint8_t", r"\w+\[1\]": "*"}
"""Types of Legacy Code Tool, and those of C."""

READ = """run = load('run.mat');
file = fopen('run.csv'); names = strsplit(fgetl(file), ','); fclose(file);
assert(isequal(fieldnames(run)', names) && isa(run.status, 'uint8'));
table = dlmread('run.csv', ',', 1, 0);
for k = 1:numel(names), assert(isequaln(double(run.(names{k})), table(:, k))); end
disp(num2hex(run.yaw_rate_rad_s(end)));
"""


def octave(script: str, folder: Path) -> str:
    """Run a script in Octave and return what it prints."""
    call = ["octave-cli", "--quiet", "--no-init-file", script]
    answer = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """Return a folder with the files of the page and the build."""
    for block in blocks("docs/simulink.md"):
        if block.mark is not None:
            write(block, tmp_path)
    (tmp_path / "generated").symlink_to(ROOT / "generated")
    return tmp_path


def test_the_specification_has_the_prototypes_of_the_header(page: Path) -> None:
    (page / "legacy_code.m").write_text(STUB)
    printed = octave("make_ars_block.m", page).splitlines()
    functions, files = printed[:4], printed[4:]
    assert files == ["ars_block.c", *sorted(path.name for path in (BUILD / "src").glob("*.c") if path.stem != "ars_dynamics")]
    text = "\n".join(functions)
    for name, in_c in IN_C.items():
        text = re.sub(name, in_c, text)
    (page / "prototypes.c").write_text(f'#include "ars_block.h"\n{text}\n')
    command = [*compiler_command(), "-std=c99", "-Wall", "-Werror", "-fsyntax-only", "prototypes.c"]
    answer = subprocess.run(command, cwd=page, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr


@pytest.mark.long
def test_octave_repeats_every_run_without_a_friction_estimate(page: Path) -> None:
    software, counts = load(BUILD), []
    for scenario in SCENARIOS.values():
        inputs = scenario.inputs(software.config)
        if not np.isnan(inputs[:, 3]).all() or inputs[:, 5].any():
            continue
        save(ClosedLoop(software).run(inputs), page / "run.mat")
        printed = octave("compare.m", page)
        assert ", 0 differ;" in printed, f"{scenario.name}: {printed}"
        counts.append(scenario.name)
    assert len(counts) >= 5


def test_octave_reads_all_columns(page: Path) -> None:
    software = load(BUILD)
    record = ClosedLoop(software).run(SCENARIOS["step-steer"].inputs(software.config))
    save(record, page / "run.mat")
    save(record, page / "run.csv")
    (page / "read.m").write_text(READ)
    assert octave("read.m", page).strip() == record[-1, 3].tobytes()[::-1].hex()


@pytest.mark.parametrize("version", ["-v4", "-v6", "-v7"])
def test_maps_that_octave_saves(version: str, page: Path) -> None:
    script = page / "make_map.m"
    script.write_text(script.read_text().replace("'-v7'", f"'{version}'"))
    octave("make_map.m", page)
    got = import_map(page / "mine.mat", Choices({}, UNITS)).reference_map
    speed, angle = np.linspace(5.0, 40.0, 36), np.linspace(0.25, 8.0, 32) * np.pi / 180
    gain = speed / (2.9 + 0.003 * speed**2)
    wanted = np.minimum(1.2 * gain[:, np.newaxis] * angle, 6.0 / speed[:, np.newaxis])
    np.testing.assert_allclose(got.yaw_rate, wanted, rtol=1e-14)  # a few roundings of two libraries
    np.testing.assert_allclose(got.speed, speed, rtol=1e-15)

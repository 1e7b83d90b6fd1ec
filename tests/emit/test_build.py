"""A build as a whole: its example runs, and its id depends on every input. `tests/verify` compiles it strictly."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from codegen.configuration import Kind
from codegen.emit.build import BuildInputs, BuildOptions, _build_id
from codegen.emit.text import Precision
from codegen.sil.toolchain import compiler_command
from tests import builds
from tests.emit.rendered import EACH_KIND_AND_DOUBLE, laid_out, rendered


@pytest.mark.parametrize(("kind", "precision"), EACH_KIND_AND_DOUBLE)
def test_the_example_runs(tmp_path: Path, kind: Kind, precision: Precision) -> None:
    folder, program = laid_out(rendered(kind, precision), tmp_path / "build"), tmp_path / "example"
    sources = [*(folder / "src").iterdir(), folder / "example" / "example_main.c"]
    subprocess.run([*compiler_command(), "-std=c99", f"-I{folder / 'include'}", *sources, "-o", program, "-lm"], check=True)
    result = subprocess.run([program], check=True, capture_output=True, text=True)
    assert "yaw rate" in result.stdout and "reference" in result.stdout
    assert result.stderr == ""


def test_every_input_changes_the_build_id() -> None:
    config, options, inputs = builds.CONFIG, BuildOptions("4ws2"), BuildInputs("4ws2.npz", "0" * 64, "map")
    changed = [replace(options, **{name: value}) for name, value in (("name", "x"), ("prefix", "x"), ("precision", "double"))]
    ids = {_build_id(config, each, inputs) for each in (options, *changed)}
    ids |= {_build_id(builds.TRACKING_CONFIG, options, inputs)}
    ids |= {_build_id(config, options, replace(inputs, map_sha256="1" * 64))}
    assert len(ids) == 6
    assert _build_id(config, options, replace(inputs, map_file="renamed.npz", config_source="preset")) in ids

"""The generated C with other compilers and options: a Cortex-M4F at each optimisation, C++, CMake."""

from pathlib import Path

import pytest

from codegen.config import Kind
from tests.emit.rendered import laid_out, rendered
from tests.emit.test_cortex_m import cross, run, succeeded
from tests.evidence.toolchains.programs import tool

__all__ = ["cross"]  # a fixture


@pytest.mark.parametrize("kind", ["tracking", "feedforward"])
def test_cmake_builds_and_tests_the_folder(tmp_path: Path, kind: Kind) -> None:
    folder = laid_out(rendered(kind), tmp_path / "folder")
    before = sorted(path.relative_to(folder) for path in folder.rglob("*"))
    at = tmp_path / "cmake-build"
    flags = "-DCMAKE_C_FLAGS=-Wall -Wextra -Werror"
    succeeded(run([tool("cmake"), "-G", "Unix Makefiles", "-S", folder, "-B", at, flags]))
    succeeded(run([tool("cmake"), "--build", at]))
    result = succeeded(run([tool("ctest"), "--test-dir", at, "--output-on-failure"]))
    assert "100% tests passed" in result.stdout
    assert "-ffp-contract=off" in (at / "CMakeFiles" / "ars.dir" / "flags.make").read_text()  # the same bits everywhere
    assert sorted(path.relative_to(folder) for path in folder.rglob("*")) == before

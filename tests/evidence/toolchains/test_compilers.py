"""The generated C with other compilers and options: a Cortex-M4F at each optimisation, C++, CMake."""

from pathlib import Path

import pytest

from codegen.config import Kind
from codegen.emit.text import Precision
from tests.emit.rendered import KINDS, laid_out, rendered
from tests.emit.test_cortex_m import WARNINGS, Cross, cross, foreign_symbols, run, succeeded, writable_bytes
from tests.evidence.toolchains.programs import tool

__all__ = ["cross"]  # a fixture

VARIANTS: list[tuple[Kind, Precision]] = [(kind, precision) for precision in ("single", "double") for kind in KINDS]


@pytest.mark.long
@pytest.mark.parametrize("optimisation", ["-O2", "-Os"])
@pytest.mark.parametrize("kind", KINDS)
def test_optimised_code_needs_no_double_and_no_library(cross: Cross, kind: Kind, optimisation: str) -> None:
    _, objects = cross.build(kind, optimisation)
    assert foreign_symbols(objects) == {}
    assert not any(writable_bytes(at) for at in objects.values())


@pytest.mark.long
@pytest.mark.parametrize(("kind", "precision"), VARIANTS)
def test_headers_serve_cpp(tmp_path: Path, kind: Kind, precision: Precision) -> None:
    """The headers compile as C++11, and the program links with the C objects, compiled without a warning at -O2."""
    folder = laid_out(rendered(kind, precision), tmp_path / "build")
    sources = sorted((folder / "src").iterdir())
    succeeded(run([tool("gcc"), *WARNINGS, "-O2", "-I", folder / "include", "-c", *sources], tmp_path))
    includes = "".join(f'#include "{header.name}"\n' for header in sorted((folder / "include").iterdir()))
    source = tmp_path / "main.cpp"
    source.write_text(
        f"{includes}\nint main()\n{{\n    ars_controller_t controller;\n    ars_controller_init(&controller, 0);\n"
        "    return ars_selftest() ? 0 : 1;\n}\n"
    )
    flags = ("-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
    objects = sorted(tmp_path.glob("*.o"))
    succeeded(run([tool("g++"), *flags, "-I", folder / "include", source, *objects, "-o", tmp_path / "program", "-lm"]))
    succeeded(run([tmp_path / "program"]))


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

"""Strict compilation of the generated C: a Cortex-M4F without double arithmetic, and the compiler of the host.

Other optimisations, C++ and CMake: tests/evidence/toolchains.
"""

import functools
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from elftools.elf.elffile import ELFFile
from elftools.elf.sections import SymbolTableSection

from codegen.config import Kind
from codegen.emit.build import BuildInputs, BuildOptions, _build_id, build
from codegen.emit.text import Precision
from codegen.sil.toolchain import compiler_command
from tests import builds
from tests.emit.rendered import EACH_KIND_AND_DOUBLE, KINDS, laid_out, rendered

WARNINGS = (
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wfloat-equal", "-Wshadow"),
    *("-Wundef", "-Wmissing-prototypes", "-Werror"),
)


def run(command: Iterable[str | Path], cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    words = [str(word) for word in command]
    variables = {**os.environ, "LC_ALL": "C", **environment}
    return subprocess.run(words, cwd=cwd, env=variables, capture_output=True, text=True, check=False)


def succeeded(result: subprocess.CompletedProcess[str]) -> subprocess.CompletedProcess[str]:
    assert result.returncode == 0, result.stderr + result.stdout
    return result


# --- Cortex-M4F: single-precision FPU, every double operation is a call --------------------------------------------

MEMORY = frozenset(
    {"memcpy", "memset", "memmove"}
    | {f"__aeabi_mem{what}{alignment}" for what in ("cpy", "move", "set", "clr") for alignment in ("", "4", "8")}
)
"""Functions that a compiler may call to copy a struct; every toolchain has them."""
DYNAMICS_LIBRARY = frozenset({"sinf", "cosf", "atanf", "sqrtf"})

# A bare target has no C library: these prototypes are all that the generated C may need of one. The double functions are
# declared so that the test finds a call of one, not the compiler.
BARE_HEADERS = {
    "math.h": "float sinf(float); float cosf(float); float atanf(float); float sqrtf(float);\n"
    "double sin(double); double cos(double); double atan(double); double sqrt(double); double fabs(double);\n",
    "string.h": "#include <stddef.h>\nvoid *memcpy(void *to, const void *from, size_t size);\n",
}
# Without unwind tables, which refer to the C++ personality of the ABI.
CORTEX_M4F = (
    *("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp", "-ffp-contract=off", "-fno-sanitize=undefined"),
    *("-fno-unwind-tables", "-fno-asynchronous-unwind-tables"),
)


class Cross:
    """The cross compiler, with its cache and the bare headers in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "bare").mkdir()
        for name, text in BARE_HEADERS.items():
            (folder / "bare" / name).write_text(text)

    def compile(self, source: Path, include: Path, at: Path, *flags: str) -> Path:
        """Compile one object file with the strict warnings of clang."""
        command = [sys.executable, "-m", "ziglang", "cc", *CORTEX_M4F, *WARNINGS, *flags]
        command += ["-I", str(include), "-isystem", str(self.folder / "bare"), "-c", str(source), "-o", str(at)]
        cache = str(self.folder / "cache")
        succeeded(run(command, at.parent, ZIG_GLOBAL_CACHE_DIR=cache, ZIG_LOCAL_CACHE_DIR=cache))
        return at

    @functools.cache  # noqa: B019 - one instance, as long as the session
    def build(self, kind: Kind, *flags: str) -> tuple[Path, dict[str, Path]]:
        """Return the folder of a single-precision build, and the object file of each of its units."""
        folder = laid_out(rendered(kind), self.folder / "-".join((kind, *flags)) / "build")
        sources = {path.stem.removeprefix("ars_"): path for path in sorted((folder / "src").iterdir())}
        include, objects = folder / "include", folder.parent
        return folder, {name: self.compile(path, include, objects / f"{name}.o", *flags) for name, path in sources.items()}


@pytest.fixture(scope="session")
def cross(tmp_path_factory: pytest.TempPathFactory) -> Cross:
    return Cross(tmp_path_factory.mktemp("cross"))


def symbols(at: Path) -> tuple[set[str], set[str]]:
    """Return the names that an object file defines for others, and those that it needs from them."""
    with at.open("rb") as file:
        table = ELFFile(file).get_section_by_name(".symtab")
        assert isinstance(table, SymbolTableSection)
        named = [symbol for symbol in table.iter_symbols() if symbol.name]
        needed = {symbol.name for symbol in named if symbol["st_shndx"] == "SHN_UNDEF"}
        return {symbol.name for symbol in named if symbol["st_info"]["bind"] == "STB_GLOBAL"} - needed, needed


def foreign_symbols(objects: Mapping[str, Path]) -> dict[str, set[str]]:
    """Return the symbols that each unit needs beside the other units, memory functions and, in the dynamics, four functions.

    A list of allowed names, not of forbidden ones: soft-float helpers have many names (__aeabi_dmul, __muldf3, ...).
    """
    table = {part: symbols(at) for part, at in objects.items()}
    own = set().union(*(defined for defined, _ in table.values()))
    library = {"dynamics": DYNAMICS_LIBRARY}
    found = {part: needed - own - MEMORY - library.get(part, frozenset()) for part, (_, needed) in table.items()}
    return {part: names for part, names in found.items() if names}


def writable_bytes(at: Path) -> dict[str, int]:
    """Return the sizes of the sections in RAM (SHF_WRITE and SHF_ALLOC) that are not empty."""
    with at.open("rb") as file:
        elf = ELFFile(file)
        assert elf["e_machine"] == "EM_ARM"
        sections = [section for section in elf.iter_sections() if section["sh_flags"] & 0x3 == 0x3]
        return {section.name: section["sh_size"] for section in sections if section["sh_size"]}


@pytest.mark.parametrize("kind", KINDS)
def test_single_precision_needs_no_double_no_library_and_no_memory(cross: Cross, kind: Kind) -> None:
    """All memory is the caller's, so instances share nothing. Without optimisation nothing is left out."""
    _, objects = cross.build(kind, "-O0")
    assert foreign_symbols(objects) == {}
    assert not any(writable_bytes(at) for at in objects.values())
    _, needed = symbols(objects["dynamics"])
    assert needed - MEMORY == set(rendered(kind).manifest["dynamics_library_functions"])


# --- the host: strict warnings, mixed builds -----------------------------------------------------------------------


def strict(folder: Path, *arguments: str | Path) -> None:
    """Compile with the strict warnings as errors."""
    succeeded(run([*compiler_command(), *WARNINGS, "-ffp-contract=off", "-I", folder / "include", *arguments]))


@pytest.mark.parametrize(("kind", "precision"), EACH_KIND_AND_DOUBLE)
def test_sources_example_and_headers_compile_without_a_warning(tmp_path: Path, kind: Kind, precision: Precision) -> None:
    """The example runs, and each header stands alone, also included twice."""
    folder = laid_out(rendered(kind, precision), tmp_path / "build")
    alone = []
    for header in sorted((folder / "include").iterdir()):
        alone.append(tmp_path / f"{header.stem}_alone.c")
        alone[-1].write_text(
            f'#include "{header.name}"\n#include "{header.name}"\n'
            f"int {header.stem}_alone(void);\nint {header.stem}_alone(void) {{ return 0; }}\n"
        )
    assert len(alone) == (10 if kind == "tracking" else 9)
    program = tmp_path / "example"
    strict(folder, "-O1", *alone, *(folder / "src").iterdir(), folder / "example" / "example_main.c", "-o", program, "-lm")
    result = succeeded(run([program]))
    assert "yaw rate" in result.stdout
    assert "reference" in result.stdout
    assert result.stderr == ""


def test_two_builds_live_in_one_program(tmp_path: Path) -> None:
    """Each build has its own prefix, and no name of one collides with the other's."""
    inputs = BuildInputs("other.npz", "0" * 64, "map")
    other = build(builds.MAPS["uneven"](), builds.FEEDFORWARD_CONFIG, BuildOptions("other", "rws_2", "double"), inputs)
    both = {"ars": rendered("tracking"), "rws_2": other}
    includes: list[str | Path] = []
    sources, headers = [], ""
    for prefix, folder in both.items():
        place = laid_out(folder, tmp_path / prefix)
        includes += ["-I", place / "include"]
        sources += [*(place / "src").iterdir()]
        headers += "".join(f'#include "{path.name}"\n' for path in sorted((place / "include").iterdir()))
    main = tmp_path / "main.c"
    main.write_text(f"{headers}\nint main(void)\n{{\n    return (ars_selftest() && rws_2_selftest()) ? 0 : 1;\n}}\n")
    strict(tmp_path / "ars", *includes, main, *sources, "-O1", "-o", tmp_path / "program", "-lm")
    succeeded(run([tmp_path / "program"]))


def test_every_input_makes_another_build_id() -> None:
    config, options, inputs = builds.CONFIG, BuildOptions("4ws2"), BuildInputs("4ws2.npz", "0" * 64, "map")
    changed = [replace(options, **{name: value}) for name, value in (("name", "x"), ("prefix", "x"), ("precision", "double"))]
    ids = {_build_id(config, each, inputs) for each in (options, *changed)}
    ids |= {_build_id(builds.TRACKING_CONFIG, options, inputs)}
    ids |= {_build_id(config, options, replace(inputs, map_sha256="1" * 64))}
    assert len(ids) == 6
    assert _build_id(config, options, replace(inputs, map_file="renamed.npz", config_source="preset")) in ids

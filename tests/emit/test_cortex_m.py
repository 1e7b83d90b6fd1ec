"""The generated C as an ECU project meets it: strict compilers, a Cortex-M4F without double arithmetic, C++, CMake, a desk."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest
from elftools.elf.elffile import ELFFile
from elftools.elf.sections import SymbolTableSection

from codegen.config import Config, Kind, Schedule, parse
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.text import Precision
from codegen.emit.write import Folder, write_folder
from codegen.refmap.solve import solve_case

WARNINGS = (
    *(
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Wdouble-promotion",
        "-Wfloat-equal",
        "-Wshadow",
        "-Wundef",
    ),
    *("-Wmissing-prototypes", "-Werror"),
)
HEADED = ("map", "limiter", "controller", "dynamics", "e2e", "can", "task", "reference_model")
"""Sources with a header of their name; the last is one of the kind "tracking" alone."""
PARTS = (*HEADED, "calibration", "selftest")

EVEN = {"speed_points": 21, "front_angle_points": 20}
UNEVEN = {
    "speed_breakpoints_km_h": [20.0, 25.0, 31.0, 40.0, 60.0, 90.0, 120.0],
    "front_angle_breakpoints_deg": [0.1, 0.5, 1.0, 2.5, 4.0, 7.0, 10.0],
}
GRIDS: dict[str, dict[str, Any]] = {"even": EVEN, "uneven": UNEVEN}

SCHEDULE = Schedule(speed_km_h=[15.0, 60.0, 120.0], proportional_gain_s=[0.01, 0.1, 0.14], integral_gain=[1.8, 0.9, 0.4])

Variant = tuple[Precision, str, str, Kind]
"""Precision, prefix, grid, kind of controller."""

# Every pair of choices at least once.
VARIANTS: tuple[Variant, ...] = (
    ("single", "ars", "even", "tracking"),
    ("single", "rws_2", "uneven", "pi"),
    ("single", "ars", "uneven", "feedforward"),
    ("single", "rws_2", "even", "proportional"),
    ("double", "rws_2", "uneven", "tracking"),
    ("double", "ars", "even", "pi"),
    ("double", "rws_2", "even", "feedforward"),
    ("double", "ars", "uneven", "proportional"),
)
SINGLE = tuple(variant for variant in VARIANTS if variant[0] == "single")


def named(variant: object) -> str:
    return "-".join(map(str, variant)) if isinstance(variant, tuple) else str(variant)


all_variants = pytest.mark.parametrize("variant", VARIANTS, ids=named)
single_variants = pytest.mark.parametrize("variant", SINGLE, ids=named)


@functools.cache
def configuration(grid: str, kind: Kind) -> Config:
    controller = {"kind": kind, "tracking": {"schedule": SCHEDULE.model_dump()}}
    return parse({"grid": GRIDS[grid], "controller": controller}, "test")


@functools.cache
def made(variant: Variant, name: str = "4ws2", map_hash: str = "0" * 64) -> Folder:
    """A build in memory."""
    precision, prefix, grid, kind = variant
    config = configuration(grid, kind)
    options = BuildOptions(name, prefix, precision)
    return build(solve_case(config, "4ws-2"), config, options, BuildInputs("4ws2.npz", map_hash, "map"))


def parts_of(variant: Variant) -> tuple[str, ...]:
    """The sources that a build has."""
    return PARTS if variant[3] == "tracking" else tuple(part for part in PARTS if part != "reference_model")


def laid_out(folder: Folder, at: Path) -> Path:
    write_folder(folder, at)
    return at


def run(command: Iterable[str | Path], cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    words = [str(word) for word in command]
    variables = {**os.environ, "LC_ALL": "C", **environment}
    return subprocess.run(words, cwd=cwd, env=variables, capture_output=True, text=True, check=False)


def succeeded(result: subprocess.CompletedProcess[str]) -> subprocess.CompletedProcess[str]:
    assert result.returncode == 0, result.stderr + result.stdout
    return result


def tool(name: str) -> str:
    """A program of the host, or skip."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


# --- Cortex-M4F: single-precision FPU, every double is a call ------------------------------------------------------

MEMORY = frozenset(
    {"memcpy", "memset", "memmove"}
    | {f"__aeabi_mem{what}{alignment}" for what in ("cpy", "move", "set", "clr") for alignment in ("", "4", "8")}
)
"""What a compiler may call to copy a struct; every toolchain has them."""
DYNAMICS_LIBRARY = frozenset({"sinf", "cosf", "atanf", "sqrtf"})

# A bare target has no C library: these prototypes are all that the generated C may need of one. The double functions are
# declared so that a call of one is found by the test and not by the compiler.
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
        self._cache = folder / "cache"
        self._headers = folder / "bare"
        self._headers.mkdir()
        for name, text in BARE_HEADERS.items():
            (self._headers / name).write_text(text)

    def compile(self, source: Path, include: Path, at: Path, *flags: str) -> Path:
        """One object file, to the strict warnings of clang as well."""
        command = [sys.executable, "-m", "ziglang", "cc", *CORTEX_M4F, *WARNINGS, *flags]
        command += ["-I", str(include), "-isystem", str(self._headers), "-c", str(source), "-o", str(at)]
        cache = str(self._cache)
        succeeded(run(command, at.parent, ZIG_GLOBAL_CACHE_DIR=cache, ZIG_LOCAL_CACHE_DIR=cache))
        return at


@pytest.fixture(scope="session")
def cross(tmp_path_factory: pytest.TempPathFactory) -> Cross:
    return Cross(tmp_path_factory.mktemp("cross"))


def cross_compiled(cross: Cross, variant: Variant, folder: Path, *flags: str) -> dict[str, Path]:
    """Object file of each part of a build."""
    laid_out(made(variant), folder / "build")
    return {
        part: cross.compile(
            folder / "build" / "src" / f"{variant[1]}_{part}.c", folder / "build" / "include", folder / f"{part}.o", *flags
        )
        for part in parts_of(variant)
    }


def symbols(at: Path) -> tuple[set[str], set[str]]:
    """Names that an object file defines for others, and names that it needs from them."""
    with at.open("rb") as file:
        table = ELFFile(file).get_section_by_name(".symtab")
        assert isinstance(table, SymbolTableSection)
        named_symbols = [symbol for symbol in table.iter_symbols() if symbol.name]
        needed = {symbol.name for symbol in named_symbols if symbol["st_shndx"] == "SHN_UNDEF"}
        defined = {
            symbol.name
            for symbol in named_symbols
            if symbol["st_shndx"] != "SHN_UNDEF" and symbol["st_info"]["bind"] == "STB_GLOBAL"
        }
    return defined, needed


def strangers(objects: Mapping[str, Path]) -> dict[str, set[str]]:
    """What each object needs beside the other objects, memory functions and, in the dynamics, four library functions.

    A list of what is allowed, not of what is forbidden: soft-float helpers have many names (__aeabi_dmul, __muldf3, ...).
    """
    table = {part: symbols(at) for part, at in objects.items()}
    own = set().union(*(defined for defined, _ in table.values()))
    library = {"dynamics": DYNAMICS_LIBRARY}
    return {part: needed - own - MEMORY - library.get(part, frozenset()) for part, (_, needed) in table.items()}


@pytest.mark.parametrize("optimisation", ["-O2", "-Os", "-O0"])
@single_variants
def test_single_precision_needs_no_double_and_no_library(
    cross: Cross, tmp_path: Path, variant: Variant, optimisation: str
) -> None:
    objects = cross_compiled(cross, variant, tmp_path, optimisation)
    assert strangers(objects) == {part: set() for part in parts_of(variant)}


@single_variants
def test_dynamics_need_the_functions_that_the_manifest_names(cross: Cross, tmp_path: Path, variant: Variant) -> None:
    objects = cross_compiled(cross, variant, tmp_path, "-O0")  # nothing is optimised away
    _, needed = symbols(objects["dynamics"])
    assert needed - MEMORY == set(made(variant).manifest["dynamics_library_functions"])
    assert needed - MEMORY <= DYNAMICS_LIBRARY


@single_variants
def test_objects_hold_no_writable_data(cross: Cross, tmp_path: Path, variant: Variant) -> None:
    """All memory is the caller's: nothing in .data or .bss, so instances do not share anything."""
    for part, at in cross_compiled(cross, variant, tmp_path, "-O2").items():
        with at.open("rb") as file:
            elf = ELFFile(file)
            assert elf["e_machine"] == "EM_ARM"
            writable = {
                section.name: section["sh_size"]
                for section in elf.iter_sections()
                if section["sh_flags"] & 0x1 and section["sh_flags"] & 0x2  # SHF_WRITE and SHF_ALLOC
            }
        assert not any(writable.values()), (part, writable)


@pytest.fixture(scope="session")
def sound(cross: Cross, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Path]]:
    """A build folder and its objects, to plant faults in; both are to be left as they are."""
    folder = tmp_path_factory.mktemp("sound")
    objects = cross_compiled(cross, SINGLE[0], folder, "-O2")
    return folder / "build", objects


@pytest.mark.parametrize(
    ("part", "planted", "helper"),
    [
        ("map", "return (float)((double)x * 0.1);", "__aeabi_dmul"),
        ("controller", "return (float)((double)x * 0.1);", "__aeabi_dmul"),
        ("dynamics", "return (float)((double)x * 0.1);", "__aeabi_dmul"),
        ("controller", "return (float)sin((double)x);", "sin"),
        ("dynamics", "return (float)sin((double)x);", "sin"),
        ("controller", "return ((double)x > 0.1) ? 1.0f : 0.0f;", "__aeabi_dcmpgt"),
        ("controller", "return (float)((double)x + (double)(int)x);", "__aeabi_i2d"),
        ("map", "return sinf(x);", "sinf"),  # the map calls no library at all, in single precision neither
        ("limiter", "return (float)((double)x * 0.1);", "__aeabi_dmul"),
        ("reference_model", "return (float)((double)x * 0.1);", "__aeabi_dmul"),
        ("reference_model", "return atanf(x);", "atanf"),  # its tyre curves are tables
    ],
)
def test_a_planted_fault_is_found(
    cross: Cross, sound: tuple[Path, dict[str, Path]], tmp_path: Path, part: str, planted: str, helper: str
) -> None:
    folder, objects = sound
    changed = tmp_path / "planted.c"
    changed.write_text(
        (folder / "src" / f"ars_{part}.c").read_text()
        + f"\n#include <math.h>\nfloat planted(float x);\nfloat planted(float x)\n{{\n    {planted}\n}}\n"
    )
    faulty = cross.compile(changed, folder / "include", tmp_path / "planted.o", "-O2")
    assert strangers(objects) == {name: set() for name in PARTS}
    found = strangers({**objects, part: faulty})
    assert helper in found.pop(part)
    assert not any(found.values())


def test_a_forgotten_suffix_is_found(cross: Cross, sound: tuple[Path, dict[str, Path]], tmp_path: Path) -> None:
    """One f missing in the generated code. The warnings that tell of it as well are switched off, to see the helpers."""
    folder, objects = sound
    before, start, after = (folder / "src" / "ars_dynamics.c").read_text().partition("const float t0 = ")
    assert "f * " in after
    changed = tmp_path / "forgotten.c"
    changed.write_text(before + start + after.replace("f * ", " * ", 1))
    flags = ("-O2", "-Wno-double-promotion", "-Wno-implicit-float-conversion")
    faulty = cross.compile(changed, folder / "include", tmp_path / "forgotten.o", *flags)
    assert "__aeabi_dmul" in strangers({**objects, "dynamics": faulty})["dynamics"]


def test_double_precision_is_exempt_and_seen(cross: Cross, tmp_path: Path) -> None:
    """A double build needs the soft-float helpers by nature: the same search finds them in every part that computes."""
    found = strangers(cross_compiled(cross, ("double", "ars", "uneven", "tracking"), tmp_path, "-O2"))
    for part in ("map", "limiter", "controller", "dynamics", "can", "reference_model", "selftest"):
        assert any(name.startswith("__aeabi_d") for name in found[part])


# --- the host: strict warnings, C++, mixed builds ------------------------------------------------------------------


def host_compiled(folder: Path, variant: Variant, objects: Path, *flags: str) -> list[Path]:
    """Object files of all parts by gcc; fails the test on any warning."""
    gcc, prefix = tool("gcc"), variant[1]
    objects.mkdir(exist_ok=True)
    found = []
    for part in parts_of(variant):
        at = objects / f"{prefix}_{part}.o"
        source = folder / "src" / f"{prefix}_{part}.c"
        succeeded(run([gcc, *WARNINGS, *flags, "-ffp-contract=off", "-I", folder / "include", "-c", source, "-o", at]))
        found.append(at)
    return found


@pytest.mark.parametrize("optimisation", ["-O0", "-O2"])
@all_variants
def test_sources_and_example_compile_without_a_warning_and_run(tmp_path: Path, variant: Variant, optimisation: str) -> None:
    folder = laid_out(made(variant), tmp_path / "build")
    objects = host_compiled(folder, variant, tmp_path / "objects", optimisation)
    program = tmp_path / "example"
    source = folder / "example" / "example_main.c"
    succeeded(run([tool("gcc"), *WARNINGS, optimisation, "-I", folder / "include", source, *objects, "-o", program, "-lm"]))
    result = succeeded(run([program]))
    assert "yaw rate" in result.stdout
    assert "reference" in result.stdout
    assert result.stderr == ""


def test_the_warnings_are_on(tmp_path: Path) -> None:
    """The flags refuse what they are there to refuse."""
    for name, text in {
        "promotion": "float f(float x);\nfloat f(float x) { return (float)(x * 0.1); }\n",
        "equality": "int f(float x);\nint f(float x) { return x == 0.0f; }\n",
        "conversion": "short f(int x);\nshort f(int x) { return x; }\n",
        "shadow": "int f(int x);\nint f(int x) { { int x = 1; (void)x; } return x; }\n",
        "undefined": "#if NOT_THERE\n#endif\nint f(void);\nint f(void) { return 0; }\n",
        "prototype": "int f(void) { return 0; }\n",
    }.items():
        source = tmp_path / f"{name}.c"
        source.write_text(text)
        assert run([tool("gcc"), *WARNINGS, "-c", source, "-o", tmp_path / "out.o"]).returncode != 0, name


@all_variants
def test_each_header_stands_alone(tmp_path: Path, variant: Variant) -> None:
    folder = laid_out(made(variant), tmp_path / "build")
    headers = sorted((folder / "include").iterdir())
    assert {header.name for header in headers} >= {f"{variant[1]}_{part}.h" for part in parts_of(variant) if part in HEADED}
    for header in headers:
        source = tmp_path / f"{header.stem}_alone.c"
        source.write_text(
            f'#include "{header.name}"\n#include "{header.name}"\nint nothing(void);\nint nothing(void) {{ return 0; }}\n'
        )
        succeeded(run([tool("gcc"), *WARNINGS, "-I", folder / "include", "-fsyntax-only", source]))


@all_variants
def test_headers_serve_cpp(tmp_path: Path, variant: Variant) -> None:
    """Compiled as C++11 and linked with the C objects."""
    compiler, prefix = tool("g++"), variant[1]
    folder = laid_out(made(variant), tmp_path / "build")
    objects = host_compiled(folder, variant, tmp_path / "objects", "-O1")
    includes = "".join(f'#include "{header.name}"\n' for header in sorted((folder / "include").iterdir()))
    source = tmp_path / "main.cpp"
    source.write_text(
        f"{includes}\nint main()\n{{\n    {prefix}_controller_t controller;\n    {prefix}_controller_init(&controller, 0);\n"
        f"    return {prefix}_selftest() ? 0 : 1;\n}}\n"
    )
    flags = ("-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
    program = tmp_path / "program"
    succeeded(run([compiler, *flags, "-I", folder / "include", source, *objects, "-o", program, "-lm"]))
    succeeded(run([program]))


def test_two_builds_live_in_one_program(tmp_path: Path) -> None:
    """Each under its prefix: no name of one collides with the other's."""
    objects, includes, body, parts = [], [], [], []
    for variant in (VARIANTS[0], VARIANTS[3]):
        prefix = variant[1]
        folder = laid_out(made(variant), tmp_path / prefix)
        objects += host_compiled(folder, variant, tmp_path / "objects", "-O1")
        includes += ["-I", str(folder / "include")]
        body.append(prefix)
        parts += [f"{prefix}_{part}" for part in parts_of(variant) if part in HEADED]
    source = tmp_path / "main.c"
    headers = "".join(f'#include "{part}.h"\n' for part in parts)
    calls = " && ".join(f"{prefix}_selftest()" for prefix in body)
    source.write_text(f"{headers}\nint main(void)\n{{\n    return ({calls}) ? 0 : 1;\n}}\n")
    program = tmp_path / "program"
    succeeded(run([tool("gcc"), *WARNINGS, *includes, source, *objects, "-o", program, "-lm"]))
    succeeded(run([program]))


@pytest.mark.parametrize("part", HEADED)
@pytest.mark.parametrize("difference", ["map", "grid", "name", "precision"])
def test_header_and_source_of_two_builds_do_not_compile(tmp_path: Path, part: str, difference: str) -> None:
    base: Variant = ("single", "ars", "even", "tracking")
    other = {
        "map": lambda: made(base, map_hash="1" * 64),
        "grid": lambda: made(("single", "ars", "uneven", "tracking")),
        "name": lambda: made(base, name="other"),
        "precision": lambda: made(("double", "ars", "even", "tracking")),
    }[difference]()
    folder = laid_out(made(base), tmp_path / "build")
    gcc = tool("gcc")

    def compiled(name: str) -> subprocess.CompletedProcess[str]:
        source = folder / "src" / f"ars_{name}.c"
        return run([gcc, "-std=c99", "-I", folder / "include", "-fsyntax-only", source])

    for name in PARTS:
        succeeded(compiled(name))
    (folder / "include" / f"ars_{part}.h").write_bytes(other.files[f"include/ars_{part}.h"])
    result = compiled(part)
    assert result.returncode != 0
    assert f"ars_{part}.h and this source come from different builds" in result.stderr


@pytest.mark.parametrize("variant", [VARIANTS[0], VARIANTS[2]], ids=named)
def test_cmake_builds_and_tests_the_folder(tmp_path: Path, variant: Variant) -> None:
    cmake, ctest = tool("cmake"), tool("ctest")
    tool("make")
    folder = laid_out(made(variant), tmp_path / "folder")
    before = sorted(path.relative_to(folder) for path in folder.rglob("*"))
    at = tmp_path / "cmake-build"
    succeeded(run([cmake, "-G", "Unix Makefiles", "-S", folder, "-B", at, "-DCMAKE_C_FLAGS=-Wall -Wextra -Werror"]))
    succeeded(run([cmake, "--build", at]))
    result = succeeded(run([ctest, "--test-dir", at, "--output-on-failure"]))
    assert "100% tests passed" in result.stdout
    commands = (at / "CMakeFiles" / f"{variant[1]}.dir" / "flags.make").read_text()
    assert "-ffp-contract=off" in commands  # the same bits everywhere
    assert sorted(path.relative_to(folder) for path in folder.rglob("*")) == before


def test_cmake_folder_is_a_library_of_another_project(tmp_path: Path) -> None:
    """As its first lines say: add_subdirectory, link, done. The example stays out."""
    cmake = tool("cmake")
    tool("make")
    laid_out(made(VARIANTS[0]), tmp_path / "ecu" / "4ws2")
    (tmp_path / "ecu" / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\nproject(ecu LANGUAGES C)\nadd_subdirectory(4ws2)\n"
        "add_executable(ecu main.c)\ntarget_link_libraries(ecu PRIVATE ars)\n"
    )
    (tmp_path / "ecu" / "main.c").write_text('#include "ars_controller.h"\nint main(void) { return ars_selftest() ? 0 : 1; }\n')
    at = tmp_path / "cmake-build"
    succeeded(run([cmake, "-G", "Unix Makefiles", "-S", tmp_path / "ecu", "-B", at]))
    succeeded(run([cmake, "--build", at]))
    succeeded(run([at / "ecu"]))
    assert not (at / "4ws2" / "ars_example").exists()

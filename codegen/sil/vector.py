"""Detect the vector instructions that compiler and machine support for the batch.

Vectors require GCC and the vector sin, cos and atan of the GNU C library (libmvec; atan since 2.35).
"""

from __future__ import annotations

import functools
import platform
from pathlib import Path
from typing import Literal

from codegen.errors import BuildError
from codegen.sil.compile import Library, compile_library
from codegen.sil.toolchain import compiler_command

Isa = Literal["x86-64-v4", "x86-64-v3", "none"]
"""Level of the x86-64 psABI: AVX-512, AVX2 with FMA; "none": scalar code for any compiler and machine."""

ISAS: tuple[Isa, ...] = ("x86-64-v4", "x86-64-v3", "none")
"""All levels, the best first."""

FUNCTIONS = ("sin", "cos", "atan")
"""Functions of the mathematical library that the batch calls."""

_COMMON = (
    "-O3",
    # Without these flags GCC merges sin(x) and cos(x) into sincos, which has no vector form.
    "-fno-builtin-sin",
    "-fno-builtin-cos",
    # Without this flag GCC keeps branches around operations that could trap; results are the same.
    "-fno-trapping-math",
    "-DBATCH_VECTOR_LIBRARY",
)
VECTOR_FLAGS: dict[Isa, tuple[str, ...]] = {
    "x86-64-v4": (*_COMMON, "-march=x86-64-v4", "-mprefer-vector-width=512"),
    "x86-64-v3": (*_COMMON, "-march=x86-64-v3", "-mprefer-vector-width=256"),
    "none": (),
}
"""Additional flags for the source with the vectorised loops."""

_PREFIX: dict[Isa, str] = {"x86-64-v4": "_ZGVeN8v_", "x86-64-v3": "_ZGVdN4v_"}
"""Name prefix of vector functions in the x86-64 vector function ABI."""

_V3 = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"}
_NEEDED: dict[Isa, set[str]] = {
    "x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "x86-64-v3": _V3,
    "none": set(),
}
"""Instructions of each level, by their names in /proc/cpuinfo; abm means lzcnt."""

_PROBE = {
    "probe.h": "void probe(double *x);\n",
    "probe.c": "\n".join(
        [
            '#include "probe.h"',
            "#include <math.h>",
            *(f'__attribute__((const, nothrow, simd("notinbranch"))) double {name}(double);' for name in FUNCTIONS),
            "void probe(double *x)",
            "{",
            "    int k;",
            "    for (k = 0; k < 64; k++) {",
            "        x[k] = sin(x[k]) + cos(x[k]) + atan(x[k]);",
            "    }",
            "}",
            "",
        ]
    ),
}


def machine_runs(isa: Isa) -> bool:
    """Return whether Linux reports the instructions of a level for this machine."""
    return _NEEDED[isa] <= _processor_flags()


def _processor_flags() -> set[str]:
    if platform.machine() not in ("x86_64", "AMD64"):
        return set()
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return set()
    line = next((line for line in text.splitlines() if line.startswith("flags")), "")
    return set(line.partition(":")[2].split())


def compiler_offers(isa: Isa) -> bool:
    """Return whether the compiler vectorises the mathematical functions at a level."""
    return isa == "none" or _probed(compiler_command(), isa)


@functools.lru_cache(maxsize=16)
def _probed(compiler: tuple[str, ...], isa: Isa) -> bool:
    del compiler  # only a key of the cache; compile_library finds the compiler itself
    try:
        library = compile_library(
            "vector_probe", _PROBE, ["probe.h"], include_folders=(".",), unit_flags={"probe.c": VECTOR_FLAGS[isa]}
        )
    except BuildError:
        return False
    return is_vectorised(library, isa)


def is_vectorised(library: Library, isa: Isa) -> bool:
    """Return whether the dynamic symbols of a library contain only vector calls of FUNCTIONS at a level.

    Always true for "none".
    """
    if isa == "none":
        return True
    content = library.path.read_bytes()
    vectors = (f"\0{_PREFIX[isa]}{name}\0".encode() for name in FUNCTIONS)
    singles = (f"\0{name}\0".encode() for name in (*FUNCTIONS, "sincos"))
    return all(name in content for name in vectors) and not any(name in content for name in singles)


def best_isa() -> Isa:
    """Return the best level that compiler, mathematical library and machine support. Raises BuildError without a compiler."""
    return next(isa for isa in ISAS if machine_runs(isa) and compiler_offers(isa))

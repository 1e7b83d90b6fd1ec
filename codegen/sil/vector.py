"""Which vector instructions the compiler can use for the batch, and this machine can run.

Vectors need GCC and a GNU C library that has sin, cos and atan for them (libmvec; atan since 2.35).
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
"""Level of the x86-64 psABI: AVX-512, AVX2 with FMA; "none": one number after the other, by any compiler on any machine."""

ISAS: tuple[Isa, ...] = ("x86-64-v4", "x86-64-v3", "none")
"""Best first."""

FUNCTIONS = ("sin", "cos", "atan")
"""Of the mathematical library, that the batch calls."""

_COMMON = (
    "-O3",
    # Else GCC makes one call of sin(x) and cos(x), for which there is no vector form.
    "-fno-builtin-sin",
    "-fno-builtin-cos",
    "-DBATCH_VECTOR_LIBRARY",
)
FLAGS: dict[Isa, tuple[str, ...]] = {
    "x86-64-v4": (*_COMMON, "-march=x86-64-v4", "-mprefer-vector-width=512"),
    "x86-64-v3": (*_COMMON, "-march=x86-64-v3", "-mprefer-vector-width=256"),
    "none": (),
}
"""Beside the flags of every source, for the one whose loops are to become vectors."""

_PREFIX: dict[Isa, str] = {"x86-64-v4": "_ZGVeN8v_", "x86-64-v3": "_ZGVdN4v_"}
"""Of a vector function's name, by the x86-64 vector function ABI."""

_V3 = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "xsave"}
_NEEDED: dict[Isa, set[str]] = {
    "x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "x86-64-v3": _V3,
    "none": set(),
}
"""What Linux calls the instructions of a level; abm: lzcnt."""

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
    """Whether processor and system offer the instructions of a level, as Linux tells."""
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
    """Whether the compiler makes vector calls of the mathematical functions at a level."""
    return isa == "none" or _probed(compiler_command(), isa)


@functools.lru_cache(maxsize=16)
def _probed(compiler: tuple[str, ...], isa: Isa) -> bool:
    del compiler  # found again by compile_library; here only for the memory of the answer
    try:
        library = compile_library(
            "vector_probe", _PROBE, ["probe.h"], include_folders=(".",), unit_flags={"probe.c": FLAGS[isa]}
        )
    except BuildError:
        return False
    return is_vectorised(library, isa)


def is_vectorised(library: Library, isa: Isa) -> bool:
    """Whether a library calls each of FUNCTIONS for vectors of a level, and none of them for a single number.

    To be seen in the names of its dynamic symbols. True for "none", which promises nothing.
    """
    if isa == "none":
        return True
    content = library.path.read_bytes()
    vectors = (f"\0{_PREFIX[isa]}{name}\0".encode() for name in FUNCTIONS)
    singles = (f"\0{name}\0".encode() for name in (*FUNCTIONS, "sincos"))
    return all(name in content for name in vectors) and not any(name in content for name in singles)


def best_isa() -> Isa:
    """The best level that compiler, mathematical library and machine offer together. Raises BuildError: no compiler."""
    return next(isa for isa in ISAS if machine_runs(isa) and compiler_offers(isa))

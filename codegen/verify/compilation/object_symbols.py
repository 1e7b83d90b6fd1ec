"""Symbols that object files define and require."""

from __future__ import annotations

import io
import re
from typing import Any

from codegen.verify.packages import module

# Functions that a compiler calls to copy or clear a struct, and a symbol that the ARM ABI references without a call.
_RUNTIME = re.compile(r"mem(?:cpy|move|set)|__aeabi_mem(?:cpy|move|set|clr)[48]?|__aeabi_unwind_cpp_pr[012]")

# In double precision on a core whose FPU is for single only: arithmetic, comparisons, conversions, shifts of 64 bits.
_SOFT_DOUBLE = re.compile(r"__aeabi_(?:d\w+|f2d|u?i2d|u?l2d|l[lr]s[lr]|lasr)|__\w*df\w*|__(?:ash[lr]|lshr)di3")

LIBRARY = ("sin", "cos", "atan", "sqrt")
"""All that the dynamics, and nothing else, may call of the mathematical library; in single precision with an f behind."""


def exported(content: bytes) -> tuple[str, ...]:
    """Return the sorted names that an object exports. Raises MissingTool."""
    return tuple(sorted(symbol.name for symbol in _symbols(content) if _is_global(symbol) and not _is_undefined(symbol)))


def needed(content: bytes) -> tuple[str, ...]:
    """Return the sorted undefined names of an object. Raises MissingTool."""
    return tuple(sorted(symbol.name for symbol in _symbols(content) if _is_undefined(symbol)))


def is_allowed(name: str, *, library: bool, single: bool, has_double: bool) -> bool:
    """Return whether generated C may require a function.

    Args:
        library: the object may call the mathematical library.
        single: the build computes in single precision.
        has_double: the core's FPU computes in double precision.
    """
    suffix = "f" if single else ""
    return (
        _RUNTIME.fullmatch(name) is not None
        or (library and name in {f"{function}{suffix}" for function in LIBRARY})
        or (not single and not has_double and _SOFT_DOUBLE.fullmatch(name) is not None)
    )


def fault(name: str) -> str:
    """Describe the fault of a required function that is not allowed."""
    kind = "double precision" if _SOFT_DOUBLE.fullmatch(name) else "which a bare target need not have"
    return f"needs {name}, {kind}"


def _symbols(content: bytes) -> list[Any]:
    elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(content))
    return [symbol for symbol in elf.get_section_by_name(".symtab").iter_symbols() if symbol.name]


def _is_undefined(symbol: Any) -> bool:
    return bool(symbol["st_shndx"] == "SHN_UNDEF")


def _is_global(symbol: Any) -> bool:
    return bool(symbol["st_info"]["bind"] == "STB_GLOBAL")

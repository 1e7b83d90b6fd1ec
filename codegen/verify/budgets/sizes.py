"""The objects of a build for a Cortex-M4F, each compiled by itself, and what they hold of flash and RAM."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from codegen.verify.packages import module
from codegen.verify.target.cross import CORTEX_M4F, FLAGS, INCLUDES, source_tree, zig

SECTIONS = ("text", "rodata", "data", "bss")
"""Code, constants, and memory that is written: with a start value, and zero."""


@dataclass(frozen=True)
class Sizes:
    """Bytes of an object by the kind of its sections, padding between them left out.

    Attributes:
        text: code with the constants among it.
        rodata: constants.
        data, bss: memory that is written.
        written: names of what lies in the memory that is written, with their bytes.
    """

    text: int = 0
    rodata: int = 0
    data: int = 0
    bss: int = 0
    written: tuple[tuple[str, int], ...] = ()

    @property
    def flash(self) -> int:
        """Bytes of flash: start values lie there too."""
        return self.text + self.rodata + self.data

    def to_dict(self) -> dict[str, int]:
        """Return JSON values."""
        return {section: getattr(self, section) for section in SECTIONS}


def compile_objects(sources: Mapping[str, bytes], flags: Sequence[str]) -> dict[str, bytes]:
    """Compile every .c file of `sources` and return the objects by path.

    Raises:
        CodegenError: `ziglang` is not installed.
        BuildError: C that does not compile.
    """
    found = {}
    with source_tree(sources) as tree:
        for unit in sorted(path for path in sources if path.endswith(".c")):
            zig(["cc", *CORTEX_M4F.flags, *FLAGS, *flags, *INCLUDES, "-c", unit, "-o", "../unit.o"], tree)
            found[unit] = (tree.parent / "unit.o").read_bytes()
    return found


def sizes_of(content: bytes) -> Sizes:
    """Return the sizes of an object. Raises CodegenError if `pyelftools` is not installed."""
    elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(content))
    totals = dict.fromkeys(SECTIONS, 0)
    kinds: dict[Any, str] = {"SHN_COMMON": "bss"}
    for index, section in enumerate(elf.iter_sections()):
        kind = re.match(r"\.(text|rodata|data|bss)(\.|\Z)", section.name)
        if kind:
            kinds[index] = kind[1]
            totals[kind[1]] += int(section["sh_size"])
    written = []
    for symbol in elf.get_section_by_name(".symtab").iter_symbols():
        place, size = symbol["st_shndx"], int(symbol["st_size"])
        if size and kinds.get(place) in ("data", "bss"):
            written.append((str(symbol.name), size))
            totals["bss"] += size if place == "SHN_COMMON" else 0
    return Sizes(**totals, written=tuple(sorted(written)))


def defines(content: bytes, function: str) -> bool:
    """Return whether an object defines a function of this name."""
    elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(content))
    return any(symbol.name == function and symbol["st_size"] for symbol in elf.get_section_by_name(".symtab").iter_symbols())

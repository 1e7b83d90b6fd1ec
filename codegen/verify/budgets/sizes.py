"""The objects of a build for a Cortex-M4F, each compiled by itself, and their flash and RAM."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from codegen.verify.packages import module
from codegen.verify.target.cross import CORTEX_M4F, FLAGS, INCLUDES, source_tree, zig

SECTIONS = ("text", "rodata", "data", "bss")
"""Code, constants, and written memory with and without a start value."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of an object.

    Attributes:
        sections: bytes by section, without padding between sections.
        written: names of the variables in written memory, with their bytes.
    """

    sections: Mapping[str, int]
    written: tuple[tuple[str, int], ...]

    @property
    def flash(self) -> int:
        """Bytes of flash: code, constants and start values."""
        return sum(self.sections[name] for name in ("text", "rodata", "data"))


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
        kind = re.match(rf"\.({'|'.join(SECTIONS)})(\.|\Z)", section.name)
        if kind:
            kinds[index] = kind[1]
            totals[kind[1]] += int(section["sh_size"])
    symbols = [(each, each["st_shndx"]) for each in elf.get_section_by_name(".symtab").iter_symbols() if each["st_size"]]
    totals["bss"] += sum(int(symbol["st_size"]) for symbol, place in symbols if place == "SHN_COMMON")
    written = [(symbol.name, int(symbol["st_size"])) for symbol, place in symbols if kinds.get(place) in ("data", "bss")]
    return Sizes(totals, tuple(sorted(written)))

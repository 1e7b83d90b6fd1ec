"""Sizes of linked images."""

from __future__ import annotations

import io
from typing import Any

from codegen.verify.tools import module


def flash_bytes(image: bytes) -> int:
    """Return the bytes of code and constants of an ELF file."""
    elf: Any = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(image))
    sections = [elf.get_section_by_name(name) for name in (".text", ".rodata")]
    return sum(int(section["sh_size"]) for section in sections if section is not None)

"""Where the objects of a program lie, by its symbols and its DWARF: what a calibration tool is told by an A2L."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from elftools.dwarf.die import DIE
from elftools.elf.elffile import ELFFile
from elftools.elf.sections import SymbolTableSection

_THROUGH = ("DW_TAG_typedef", "DW_TAG_const_type", "DW_TAG_volatile_type")


@dataclass(frozen=True)
class Place:
    """Address and bytes of an object or a part of one."""

    address: int
    size: int


class Program:
    """A program file."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            elf = ELFFile(file)
            self._symbols = dict(self._objects(elf))
            self._types = {name: self._layout(die) for name, die in _variables(elf) if name in self._symbols}

    def place(self, name: str) -> Place:
        """Of `object.field.field[index]`."""
        first, *rest = name.replace("[", ".[").split(".")
        at, layout = self._symbols[first], self._types[first]
        for step in rest:
            if step.startswith("["):
                layout = layout["element"]
                at += int(step[1:-1]) * layout["size"]
            else:
                offset, layout = layout["fields"][step]
                at += offset
        return Place(at, layout["size"])

    @staticmethod
    def _objects(elf: ELFFile) -> Iterator[tuple[str, int]]:
        for section in elf.iter_sections():
            if isinstance(section, SymbolTableSection):
                for symbol in section.iter_symbols():
                    if symbol["st_info"]["type"] == "STT_OBJECT":
                        yield symbol.name, symbol["st_value"]

    def _layout(self, die: DIE) -> dict[str, Any]:
        kind = die.get_DIE_from_attribute("DW_AT_type")
        while kind.tag in _THROUGH:
            kind = kind.get_DIE_from_attribute("DW_AT_type")
        if kind.tag == "DW_TAG_array_type":
            element = self._layout(kind)
            for dimension in reversed([child.attributes["DW_AT_upper_bound"].value + 1 for child in kind.iter_children()]):
                element = {"element": element, "size": dimension * element["size"]}
            return element
        layout: dict[str, Any] = {"size": kind.attributes["DW_AT_byte_size"].value}
        if kind.tag == "DW_TAG_structure_type":
            layout["fields"] = {
                field.attributes["DW_AT_name"].value.decode(): (
                    field.attributes["DW_AT_data_member_location"].value,
                    self._layout(field),
                )
                for field in kind.iter_children()
            }
        elif kind.tag == "DW_TAG_pointer_type":
            layout = {"size": 8}
        return layout


def _variables(elf: ELFFile) -> Iterator[tuple[str, DIE]]:
    for unit in elf.get_dwarf_info().iter_CUs():
        for die in unit.get_top_DIE().iter_children():
            if die.tag == "DW_TAG_variable" and "DW_AT_type" in die.attributes and "DW_AT_name" in die.attributes:
                yield die.attributes["DW_AT_name"].value.decode(), die

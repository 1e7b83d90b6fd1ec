"""Machine code of a build for a Cortex-M4F: sizes of the objects, and functions of the linked image with their calls and stack.

Each object is compiled by itself. Functions are read after inlining. The mapping symbols `$t` and `$d` separate code from the
constants between it (ELF for the Arm Architecture, IHI 0044, section 5.5.5).
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from codegen.errors import BuildError
from codegen.verify.target import CORTEX_M4F, INCLUDES, TARGET_FLAGS, source_tree, zig
from codegen.verify.tools import module

STACK_FLAG = "-fstack-size-section"
"""Flag that makes clang write the stack use of each function (as of -fstack-usage) into the object."""


@dataclass(frozen=True)
class Routine:
    """A function of the image.

    Attributes:
        start, end: addresses, including constants between its code.
        stack: own bytes of stack; None if unknown.
        calls: addresses of the functions that it calls, or jumps to as its last act.
        uses_pointer: whether it calls, or jumps to, an address in a register.
    """

    name: str
    start: int
    end: int
    stack: int | None
    calls: frozenset[int]
    uses_pointer: bool


@dataclass(frozen=True)
class Depth:
    """Largest stack of a call in bytes, and the names along the deepest chain of calls."""

    bytes: int
    chain: tuple[str, ...]


class Program:
    """Functions of an image for a Cortex-M, by start address in `routines`. Raises MissingTool: no pyelftools or capstone."""

    def __init__(self, image: bytes) -> None:
        elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(image))
        text = elf.get_section_by_name(".text")
        self._base, self._code = int(text["sh_addr"]), bytes(text.data())
        symbols = sorted(elf.get_section_by_name(".symtab").iter_symbols(), key=lambda symbol: int(symbol["st_value"]))
        marks = {int(each["st_value"]): each.name[1] == "t" for each in symbols if each.name[:2] in ("$t", "$d")}
        stacks = dict(_stack_sizes(elf))
        self.routines: dict[int, Routine] = {}
        for symbol in symbols:
            if symbol["st_info"]["type"] == "STT_FUNC" and symbol["st_size"]:
                start = int(symbol["st_value"]) & ~1
                end = start + int(symbol["st_size"])
                flow = self._flow(symbol.name, start, end, marks)
                self.routines[start] = Routine(symbol.name, start, end, stacks.get(start), *flow)

    def _flow(self, name: str, start: int, end: int, marks: Mapping[int, bool]) -> tuple[frozenset[int], bool]:
        """Return `calls` and `uses_pointer` of a function."""
        capstone = module("capstone", "capstone")
        decoder = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
        decoder.detail = True
        calls, uses_pointer = set(), False
        for first, last in pairwise((start, *sorted(mark for mark in marks if start < mark < end), end)):
            place = first if marks.get(first, True) else last
            for each in decoder.disasm(self._code[place - self._base : last - self._base], place):
                place = each.address + each.size
                written = {each.reg_name(register) for register in each.regs_access()[1]}
                if each.group(capstone.CS_GRP_BRANCH_RELATIVE):
                    target = each.operands[-1].imm
                    calls |= {target} if each.group(capstone.CS_GRP_CALL) or not start <= target < end else set()
                elif "pc" in written:  # a return takes the address from the stack or from lr
                    uses_pointer |= not ("sp" in written or (each.op_str == "lr" and "lr" not in written))
            if place != last:
                raise BuildError(f"the instruction at {place:#x} is unknown", where=name)
        return frozenset(calls), uses_pointer

    def named(self, name: str) -> Routine:
        """Return the function of a name. Raises BuildError if the image has none."""
        for routine in self.routines.values():
            if routine.name == name:
                return routine
        raise BuildError("there is no such function", where=name, remedy="build again")

    def reached(self, *entries: str) -> frozenset[Routine]:
        """Return functions by name and all functions that they call."""
        found: set[Routine] = set()
        waiting = [self.named(entry) for entry in entries]
        while waiting:
            routine = waiting.pop()
            waiting += [self.routines[called] for called in routine.calls if routine not in found]
            found.add(routine)
        return frozenset(found)

    def depth(self, entry: str) -> Depth:
        """Return the largest stack depth of a call. A tail call counts as a call, which overestimates the depth.

        Raises:
            BuildError: recursion, a call through a pointer, or a function of unknown stack use.
        """
        return self._depth(self.named(entry), ())

    def _depth(self, routine: Routine, callers: tuple[Routine, ...]) -> Depth:
        if routine in callers:
            raise BuildError("it calls itself: its stack has no bound", where=routine.name)
        if routine.uses_pointer:
            raise BuildError("it calls through a pointer: its stack has no bound", where=routine.name)
        if routine.stack is None:
            raise BuildError("the compiler does not report its stack use", where=routine.name)
        below = [self._depth(self.routines[called], (*callers, routine)) for called in sorted(routine.calls)]
        deepest = max(below, key=lambda each: each.bytes, default=Depth(0, ()))
        return Depth(routine.stack + deepest.bytes, (routine.name, *deepest.chain))


def _stack_sizes(elf: Any) -> Iterator[tuple[int, int]]:
    """Yield address and stack bytes of each function; the section holds a word and a LEB128 number for each."""
    number = module("elftools.common.construct_utils", "pyelftools").ULEB128("bytes")
    for section in elf.iter_sections():
        stream = io.BytesIO(section.data() if section.name == ".stack_sizes" else b"")
        while word := stream.read(4):
            yield int.from_bytes(word, "little") & ~1, int(number.parse_stream(stream))


SECTIONS = ("text", "rodata", "data", "bss")
"""Code, constants, and written memory with and without a start value."""


@dataclass(frozen=True)
class Sizes:
    """Bytes of an object by section, without padding between them, and of the variables in written memory by name."""

    sections: Mapping[str, int]
    written: tuple[tuple[str, int], ...]

    @property
    def flash(self) -> int:
        """Bytes of flash: code, constants and start values."""
        return sum(self.sections[name] for name in ("text", "rodata", "data"))


def compile_objects(sources: Mapping[str, bytes], flags: Sequence[str]) -> dict[str, bytes]:
    """Compile every .c file of `sources` and return the objects by path. Raises as `zig`."""
    found = {}
    with source_tree(sources) as tree:
        for unit in sorted(path for path in sources if path.endswith(".c")):
            zig(["cc", *CORTEX_M4F.flags, *TARGET_FLAGS, *flags, *INCLUDES, "-c", unit, "-o", "../unit.o"], tree)
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

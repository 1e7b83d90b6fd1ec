"""Functions of a linked image: instructions, basic blocks, callees and stack.

All of it is read from the image, so it describes the code that runs, after inlining. The mapping symbols `$t` and `$d` (ELF
for the Arm Architecture, IHI 0044, section 5.5.5) separate code from the constants between it.

Read from the image itself, so that it is the code that runs, after every inlining. Code and the constants between it are told
apart by the mapping symbols `$t` and `$d` (ELF for the Arm Architecture, IHI 0044, section 5.5.5).
"""

from __future__ import annotations

import bisect
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from codegen.errors import BuildError
from codegen.verify.budgets.cycles import Flow, Instruction, decode
from codegen.verify.packages import module

STACK_FLAG = "-fstack-size-section"
"""Flag that makes clang write the stack use of each function (as of -fstack-usage) into the object."""

STACK_SECTION = ".stack_sizes"

Mark = tuple[int, bool, str]
"""Start of a range of code or constants, and its source file."""


class NoBound(BuildError):
    """The stack of a function has no known bound."""


@dataclass(frozen=True)
class Routine:
    """A function of the image.

    Attributes:
        name: as in C.
        unit: source file without its folder.
        start, end: addresses, including constants between its code.
        instructions: in address order.
        stack: own bytes; None if unknown.
    """

    name: str
    unit: str
    start: int
    end: int
    instructions: tuple[Instruction, ...] = field(repr=False)
    stack: int | None

    @property
    def calls(self) -> frozenset[int]:
        """Addresses of the functions that it calls, or jumps to as its last act."""
        called = {each.target for each in self.instructions if each.flow is Flow.CALL}
        jumps = {each.target for each in self.instructions if each.flow in (Flow.BRANCH, Flow.CONDITIONAL)}
        outside = {target for target in jumps if target is not None and not self.start <= target < self.end}
        return frozenset(target for target in called | outside if target is not None)

    def blocks(self, entered: Iterable[int] = ()) -> tuple[tuple[Instruction, ...], ...]:
        """Return the basic blocks. A call does not end one; unreachable padding is omitted.

        Args:
            entered: addresses that were jumped to. They start a block too; targets of a jump table are named by no instruction.
        """
        leaders = {address for address in entered if self.start <= address < self.end}
        for each in self.instructions:
            if each.flow in (Flow.BRANCH, Flow.CONDITIONAL) and each.target is not None:
                leaders.add(each.target)
            if each.flow not in (Flow.NEXT, Flow.CALL):
                leaders.add(each.end)
        found: list[list[Instruction]] = []
        for each in self.instructions:
            if not found or each.address in leaders or found[-1][-1].end != each.address:
                found.append([])
            found[-1].append(each)
        return tuple(tuple(block) for block in found if not all(each.is_nop for each in block))


@dataclass(frozen=True)
class Depth:
    """Largest stack depth of a call.

    Attributes:
        bytes: of the function and of the deepest chain of those that it calls.
        chain: names along that chain.
    """

    bytes: int
    chain: tuple[str, ...]


class Program:
    """Functions of an image for a Cortex-M.

    Attributes:
        routines: by address.

    Raises:
        CodegenError: `pyelftools` is not installed.
    """

    def __init__(self, image: bytes) -> None:
        self._elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(image))
        symbols = list(self._elf.get_section_by_name(".symtab").iter_symbols())
        segments = [each for each in self._elf.iter_segments() if each["p_type"] == "PT_LOAD" and each["p_filesz"]]
        self._memory = [(int(each["p_vaddr"]), bytes(each.data())) for each in segments]
        stacks = dict(_stack_sizes(self._elf))
        self.routines = tuple(sorted(self._read(symbols, stacks), key=lambda routine: routine.start))
        self._starts = [routine.start for routine in self.routines]
        self.instructions = tuple(each for routine in self.routines for each in routine.instructions)

    def _read(self, symbols: Sequence[Any], stacks: Mapping[int, int]) -> Iterator[Routine]:
        marks = _marks(symbols)
        known = set()
        for symbol in symbols:
            start, size = int(symbol["st_value"]) & ~1, int(symbol["st_size"])
            if symbol["st_info"]["type"] != "STT_FUNC" or not size or start in known:
                continue
            known.add(start)
            pieces = _pieces(marks, start, start + size)
            code = (each for first, last, is_code, _ in pieces if is_code for each in decode(self._bytes(first, last), first))
            yield Routine(symbol.name, pieces[0][3], start, start + size, tuple(code), stacks.get(start))

    def _bytes(self, start: int, end: int) -> bytes:
        for address, content in self._memory:
            if address <= start and end <= address + len(content):
                return content[start - address : end - address]
        raise BuildError(f"there is no code at {start:#x}", where="the image")

    def named(self, name: str) -> Routine:
        """Return the function of a name. Raises BuildError if the image has none."""
        for routine in self.routines:
            if routine.name == name:
                return routine
        raise BuildError("there is no such function", where=name, remedy="build again")

    def at(self, address: int) -> Routine | None:
        """Return the function that contains an address."""
        index = bisect.bisect_right(self._starts, address) - 1
        return self.routines[index] if index >= 0 and address < self.routines[index].end else None

    def reached(self, *entries: str) -> tuple[Routine, ...]:
        """Return functions by name and all that they call, by address."""
        found: dict[int, Routine] = {}
        waiting = [self.named(entry) for entry in entries]
        while waiting:
            routine = waiting.pop()
            if routine.start not in found:
                found[routine.start] = routine
                waiting += [called for called in map(self.at, routine.calls) if called is not None]
        return tuple(found[start] for start in sorted(found))

    def depth(self, entry: str) -> Depth:
        """Return the largest stack depth of a call.

        A tail call counts as a call, which overestimates the depth.

        Raises:
            NoBound: recursion, a call through a pointer, or a function of unknown stack use.
        """
        done: dict[int, Depth] = {}

        def visit(routine: Routine, callers: tuple[int, ...]) -> Depth:
            if routine.start in callers:
                raise NoBound("it calls itself: its stack has no bound", where=routine.name)
            if any(each.flow is Flow.POINTER for each in routine.instructions):
                raise NoBound("it calls through a pointer: its stack has no bound", where=routine.name)
            if routine.stack is None:
                raise NoBound("the compiler does not tell how much stack it takes", where=routine.name)
            if routine.start not in done:
                called = [each for each in map(self.at, sorted(routine.calls)) if each is not None]
                below = [visit(each, (*callers, routine.start)) for each in called]
                deepest = max(below, key=lambda each: each.bytes, default=Depth(0, ()))
                done[routine.start] = Depth(routine.stack + deepest.bytes, (routine.name, *deepest.chain))
            return done[routine.start]

        return visit(self.named(entry), ())

    def line_of(self, address: int) -> str:
        """Return file and line of an instruction, such as "src/ars_map.c:12"; "" if unknown."""
        index = bisect.bisect_right(self._lines[0], address) - 1
        return self._lines[1][index] if index >= 0 and self.at(address) is not None else ""

    @cached_property
    def _lines(self) -> tuple[list[int], list[str]]:
        """Addresses, and the lines that begin there."""
        rows: dict[int, str] = {}
        debug: Any = self._elf.get_dwarf_info()
        for unit in debug.iter_CUs():
            program = debug.line_program_for_CU(unit)
            name = unit.get_top_DIE().get_full_path().replace("\\", "/")
            files = program["file_entry"] if program else ()
            for state in (entry.state for entry in program.get_entries() if entry.state) if program else ():
                # A line 0 is the compiler's own.
                if not state.end_sequence and state.line:
                    rows[int(state.address)] = f"{_relative(name, files, state.file)}:{state.line}"
        ordered = sorted(rows)
        return ordered, [rows[address] for address in ordered]


def _relative(unit: str, files: Sequence[Any], index: int) -> str:
    """Return the file of a line: the last two parts of its path, as in a build folder."""
    own = files[index - 1].name.decode() if 0 < index <= len(files) else ""
    path = unit if not own or unit.endswith(f"/{own}") or unit == own else own
    return "/".join(path.split("/")[-2:])


def _marks(symbols: Sequence[Any]) -> list[Mark]:
    found, unit = [], ""
    for symbol in symbols:
        if symbol["st_info"]["type"] == "STT_FILE":
            unit = symbol.name
        elif symbol.name[:2] in ("$t", "$d"):
            found.append((int(symbol["st_value"]), symbol.name[1] == "t", unit))
    return sorted(found)


def _pieces(marks: Sequence[Mark], start: int, end: int) -> list[tuple[int, int, bool, str]]:
    """Yield first and last address of each piece of a function, whether it is code, and the file."""
    first = bisect.bisect_right([address for address, _, _ in marks], start) - 1
    inside = [(max(address, start), is_code, unit) for address, is_code, unit in marks[max(first, 0) :] if address < end]
    ends = [*(address for address, _, _ in inside[1:]), end]
    return [(address, stop, is_code, unit) for (address, is_code, unit), stop in zip(inside, ends, strict=True)]


def _stack_sizes(elf: Any) -> Iterator[tuple[int, int]]:
    """Yield address and stack bytes of each function; the section holds a word and a LEB128 number for each."""
    for section in elf.iter_sections():
        data, place = (section.data() if section.name == STACK_SECTION else b""), 0
        while place < len(data):
            address, size, shift = int.from_bytes(data[place : place + 4], "little"), 0, 0
            place += 4
            while data[place] & 0x80:
                size, shift, place = size | (data[place] & 0x7F) << shift, shift + 7, place + 1
            yield address & ~1, size | data[place] << shift
            place += 1

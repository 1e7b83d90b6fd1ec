"""Emulate an ECU core in this process (unicorn): load an image, call its functions, count the instructions of a call exactly.

On a Cortex-M, counting is by basic blocks: the emulator reports each block that it enters, and a block runs to its end. The
number of instructions follows from the bytes of the block; a Thumb instruction has 16 or 32 bits. An instruction in an IT block
whose condition does not hold counts too, as the core spends a cycle on it.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import IntArray
from codegen.errors import BuildError
from codegen.verify.packages import module
from codegen.verify.target.cross import CORTEX_M4F, CORTEX_M7, CORTEX_M33, POWERPC_BE, Core

PAGE = 0x1000
STACK_TOP, STACK_BYTES = 0x4000_0000, 0x1_0000
DATA, DATA_BYTES = 0x6000_0000, 0x80_0000
RETURN = 0x7000_0000
"""Return address of a call, on a page of its own."""

SIZE_BITS = 16
"""Bits of a traced block for its size in bytes; the others hold its address."""

CALL_SECONDS = 60.0


@dataclass(frozen=True)
class Machine:
    """Emulation of a kind of core: names of unicorn's constants, and the calling convention.

    Attributes:
        architecture, mode: arguments for opening unicorn.
        prefix: prefix of the architecture's constants.
        model: constant of the core.
        arguments: registers of the first four words; the result is in the first.
        stack, link: registers.
        linkage: bytes above the stack pointer that a function may overwrite.
        thumb: whether an address of code has its lowest bit set.
        byte_order: as in a NumPy dtype, "<" or ">".
        fpu_on: register -> bits that enable the FPU.
    """

    architecture: str
    mode: tuple[str, ...]
    prefix: str
    model: str
    arguments: tuple[str, str, str, str]
    stack: str
    link: str
    linkage: int
    thumb: bool
    byte_order: str
    fpu_on: Mapping[str, int]


def _cortex_m(model: str) -> Machine:
    return Machine(
        "ARM",
        ("THUMB", "MCLASS"),
        "ARM",
        f"CPU_ARM_CORTEX_{model}",
        ("R0", "R1", "R2", "R3"),
        "SP",
        "LR",
        0,
        True,
        "<",
        {"C1_C0_2": 0xF << 20, "FPEXC": 0x4000_0000},  # coprocessors 10 and 11
    )


_POWERPC = Machine(
    "PPC",
    ("PPC32", "BIG_ENDIAN"),
    "PPC",
    "CPU_PPC32_7457A_V1_2",
    ("3", "4", "5", "6"),
    "1",
    "LR",
    16,
    False,
    ">",
    {"MSR": 0x2000},
)

MACHINES: Mapping[str, Machine] = {
    CORTEX_M4F.name: _cortex_m("M4"),
    CORTEX_M7.name: _cortex_m("M7"),
    CORTEX_M33.name: _cortex_m("M33"),
    POWERPC_BE.name: _POWERPC,
}
"""Cores that can be emulated, by their names."""


@dataclass(frozen=True)
class Function:
    """A function of the image: its code and the constants within it, from `start` to before `end`."""

    name: str
    start: int
    end: int


@dataclass(frozen=True)
class Blocks:
    """Executed basic blocks in order: address and number of instructions, both (n,)."""

    address: IntArray
    instructions: IntArray


class Processor:
    """One core with its memory. Not shared between threads.

    Attributes:
        functions: of the image, by address.
        name: of the core.
        byte_order: of its numbers, as in a NumPy dtype: "<" or ">".

    Raises:
        CodegenError: `unicorn` or `pyelftools` is not installed.
    """

    def __init__(self, image: bytes, core: Core = CORTEX_M4F) -> None:
        self._machine = machine = MACHINES[core.name]
        self._unicorn = unicorn = module("unicorn", "unicorn")
        self._constants = module(f"unicorn.{machine.prefix.lower()}_const", "unicorn")
        elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(image))
        mode = sum(getattr(unicorn, f"UC_MODE_{name}") for name in machine.mode)
        self._core = unicorn.Uc(getattr(unicorn, f"UC_ARCH_{machine.architecture}"), mode)
        self._core.ctl_set_cpu_model(getattr(self._constants, f"UC_{machine.model}"))
        for start, size in ((STACK_TOP - STACK_BYTES, STACK_BYTES), (DATA, DATA_BYTES), (RETURN, PAGE)):
            self._core.mem_map(start, size)
        self._load(elf)
        for register, bits in machine.fpu_on.items():
            self._set(register, self._get(register) | bits)
        symbols = list(elf.get_section_by_name(".symtab").iter_symbols())
        self.functions = _functions(symbols)
        self.name, self.byte_order = core.name, machine.byte_order
        self._addresses = {symbol.name: int(symbol["st_value"]) for symbol in symbols if symbol.name}
        self._trace: list[int] = []
        self._known: dict[int, int] = {}

    def _get(self, register: str) -> int:
        return int(self._core.reg_read(getattr(self._constants, f"UC_{self._machine.prefix}_REG_{register}")))

    def _set(self, register: str, value: int) -> None:
        self._core.reg_write(getattr(self._constants, f"UC_{self._machine.prefix}_REG_{register}"), value)

    def _load(self, elf: Any) -> None:
        segments = [each for each in elf.iter_segments() if each["p_type"] == "PT_LOAD" and each["p_memsz"]]
        mapped = 0
        for segment in sorted(segments, key=lambda each: int(each["p_vaddr"])):
            start = int(segment["p_vaddr"])
            end = -(-(start + int(segment["p_memsz"])) // PAGE) * PAGE
            first = max(start // PAGE * PAGE, mapped)  # two segments may share a page
            if end > first:
                self._core.mem_map(first, end - first)
                mapped = end
            self._core.mem_write(start, segment.data())

    def call(self, name: str, *arguments: int) -> int:
        """Call a function with up to four words; the word that it gives back.

        Raises:
            BuildError: the code goes where there is no memory, or does not come back.
        """
        machine, thumb = self._machine, int(self._machine.thumb)
        for register, value in zip(machine.arguments, arguments, strict=False):
            self._set(register, value)
        self._set(machine.stack, STACK_TOP - machine.linkage)
        self._set(machine.link, RETURN | thumb)
        try:
            self._core.emu_start(self._addresses[name] | thumb, RETURN, timeout=round(CALL_SECONDS * 1e6))
        except self._unicorn.UcError as error:
            raise BuildError(f"the code on the {self.name} ended at {self._get('PC'):#x}: {error}", where=name) from None
        if self._get("PC") != RETURN:
            raise BuildError(f"the code on the {self.name} did not return within {CALL_SECONDS:g} s", where=name)
        return self._get(machine.arguments[0])

    def traced(self, work: Callable[[], object]) -> Blocks:
        """Trace every basic block that runs during `work`. Raises ValueError for a core without Thumb instructions."""
        if not self._machine.thumb:
            raise ValueError(f"the instructions of a {self.name} are not counted")
        self._trace.clear()
        # Blocks that were translated before would not call the hook.
        self._core.ctl_flush_tb()
        append = self._trace.append

        def entered(core: Any, address: int, size: int, data: Any) -> None:  # noqa: ARG001 - as the emulator calls it
            append((address << SIZE_BITS) | size)

        hook = self._core.hook_add(self._unicorn.UC_HOOK_BLOCK, entered)
        try:
            work()
        finally:
            self._core.hook_del(hook)
            self._core.ctl_flush_tb()
        return self._blocks(np.array(self._trace, dtype=np.int64))

    def _blocks(self, trace: IntArray) -> Blocks:
        different, inverse = np.unique(trace, return_inverse=True)
        counts = np.array([self._instructions(int(block)) for block in different], dtype=np.int64)
        return Blocks(trace >> SIZE_BITS, counts[inverse])

    def _instructions(self, block: int) -> int:
        if block not in self._known:
            code = self.read(block >> SIZE_BITS, block & ((1 << SIZE_BITS) - 1))
            self._known[block] = instructions_in(code)
        return self._known[block]

    def write(self, address: int, content: bytes) -> None:
        """Write to memory."""
        self._core.mem_write(address, content)

    def read(self, address: int, size: int) -> bytes:
        """Read from memory."""
        return bytes(self._core.mem_read(address, size))


class CortexM4(Processor):
    """A Cortex-M4F."""

    def __init__(self, image: bytes) -> None:
        super().__init__(image, CORTEX_M4F)


def instructions_in(code: bytes) -> int:
    """Count Thumb instructions: 32 bits if the first five are 0b11101 to 0b11111 (Armv7-M ARM, A5.1)."""
    place = count = 0
    while place < len(code):
        place += 4 if code[place + 1] >> 3 in (0b11101, 0b11110, 0b11111) else 2
        count += 1
    return count


def _functions(symbols: Sequence[Any]) -> tuple[Function, ...]:
    found = (
        Function(symbol.name, int(symbol["st_value"]) & ~1, (int(symbol["st_value"]) & ~1) + int(symbol["st_size"]))
        for symbol in symbols
        if symbol["st_info"]["type"] == "STT_FUNC" and symbol["st_size"]
    )
    return tuple(sorted(found, key=lambda function: function.start))

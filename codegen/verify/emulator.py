"""A Cortex-M4F in this process (unicorn): loads an image, calls its functions, and counts the instructions of a call exactly.

Counted by basic blocks: the emulator tells each block that it enters, and a block is run through to its end. What a block
holds is read from its bytes, in which a Thumb instruction has 16 or 32 bits. An instruction whose condition in an IT block does
not hold counts too: the core takes it in, and spends a cycle on it.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.errors import BuildError
from codegen.verify.packages import module

IntArray = npt.NDArray[np.int64]

PAGE = 0x1000
STACK_TOP, STACK_BYTES = 0x4000_0000, 0x1_0000
DATA, DATA_BYTES = 0x6000_0000, 0x20_0000
RETURN = 0x7000_0000
"""Where a call returns to: a page of its own."""

SIZE_BITS = 16
"""A block is kept as its address and, in so many bits, its size in bytes."""

CALL_SECONDS = 60.0
COPROCESSORS_10_AND_11 = 0xF << 20
FPU_ON = 0x4000_0000


@dataclass(frozen=True)
class Function:
    """A function of the image: its code, and the constants that stand among it, from `start` to before `end`."""

    name: str
    start: int
    end: int


@dataclass(frozen=True)
class Blocks:
    """What was run, in order: address and instructions of each basic block, both (n,)."""

    address: IntArray
    instructions: IntArray


class CortexM4:
    """One core with its memory. Not shared between threads.

    Attributes:
        functions: of the image, by address.

    Raises:
        CodegenError: `unicorn` or `pyelftools` is not installed.
    """

    def __init__(self, image: bytes) -> None:
        unicorn, arm = module("unicorn", "unicorn"), module("unicorn.arm_const", "unicorn")
        elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(image))
        self._unicorn, self._arm = unicorn, arm
        self._core = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._core.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        for start, size in ((STACK_TOP - STACK_BYTES, STACK_BYTES), (DATA, DATA_BYTES), (RETURN, PAGE)):
            self._core.mem_map(start, size)
        self._load(elf)
        self._core.reg_write(arm.UC_ARM_REG_C1_C0_2, self._core.reg_read(arm.UC_ARM_REG_C1_C0_2) | COPROCESSORS_10_AND_11)
        self._core.reg_write(arm.UC_ARM_REG_FPEXC, FPU_ON)
        symbols = list(elf.get_section_by_name(".symtab").iter_symbols())
        self.functions = _functions(symbols)
        self._addresses = {symbol.name: int(symbol["st_value"]) for symbol in symbols if symbol.name}
        self._trace: list[int] = []
        self._known: dict[int, int] = {}

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
        """Call a function with up to four words; what it leaves in r0.

        Raises:
            BuildError: the code goes where there is no memory, or does not come back.
        """
        core, arm = self._core, self._arm
        for register, value in zip(
            (arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1, arm.UC_ARM_REG_R2, arm.UC_ARM_REG_R3), arguments, strict=False
        ):
            core.reg_write(register, value)
        core.reg_write(arm.UC_ARM_REG_SP, STACK_TOP)
        core.reg_write(arm.UC_ARM_REG_LR, RETURN | 1)
        try:
            core.emu_start(self._addresses[name] | 1, RETURN, timeout=round(CALL_SECONDS * 1e6))
        except self._unicorn.UcError as error:
            at = core.reg_read(arm.UC_ARM_REG_PC)
            raise BuildError(f"the code on the Cortex-M4F ended at {at:#x}: {error}", where=name) from None
        if core.reg_read(arm.UC_ARM_REG_PC) != RETURN:
            raise BuildError(f"the code on the Cortex-M4F did not return within {CALL_SECONDS:g} s", where=name)
        return int(core.reg_read(arm.UC_ARM_REG_R0))

    def traced(self, work: Callable[[], object]) -> Blocks:
        """Every basic block that runs during `work`."""
        self._trace.clear()
        # Blocks that were translated before do not tell.
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
        """Into memory."""
        self._core.mem_write(address, content)

    def read(self, address: int, size: int) -> bytes:
        """From memory."""
        return bytes(self._core.mem_read(address, size))


def instructions_in(code: bytes) -> int:
    """Thumb instructions in a piece of code: 32 bits where the first five are 0b11101 to 0b11111 (Armv7-M ARM, A5.1)."""
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

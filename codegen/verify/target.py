"""Cores of ECUs: compile C for them with the clang of `ziglang`, and run it on emulated ones (unicorn).

On a Cortex-M, instructions are counted by basic blocks: the emulator reports each block that it enters, and a block runs to its
end. The number of instructions follows from the bytes of the block; a Thumb instruction has 16 or 32 bits. An instruction in an
IT block whose condition does not hold counts too, as the core spends a cycle on it.
"""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from codegen.arrays import IntArray
from codegen.emit.render import verbatim
from codegen.errors import BuildError
from codegen.programs import run_program
from codegen.sil.toolchain import require_success
from codegen.verify.tools import module, require, stored


@dataclass(frozen=True)
class Core:
    """Instruction set to compile for, without an operating system: its name for users, and the flags for zig's clang.

    `has_double`: whether its FPU computes in double precision.
    """

    name: str
    flags: tuple[str, ...]
    has_double: bool = False


# FPUs in single precision, arguments in their registers.
CORTEX_M4F = Core("Cortex-M4F", ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp"))
CORTEX_M7 = Core("Cortex-M7", ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp"))
CORTEX_M33 = Core("Cortex-M33", ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m33+fp_armv8d16sp"))
RISCV32 = Core("RV32IMAFC", ("-target", "riscv32-freestanding", "-mcpu=generic_rv32+m+a+c+f"))
POWERPC_BE = Core("PowerPC, big-endian", ("-target", "powerpc-freestanding-eabihf"), has_double=True)
AARCH64 = Core("AArch64", ("-target", "aarch64-freestanding"), has_double=True)
X86_64 = Core("x86-64", ("-target", "x86_64-freestanding"), has_double=True)
CORES = (X86_64, AARCH64, CORTEX_M4F, CORTEX_M7, CORTEX_M33, RISCV32, POWERPC_BE)

TARGET_FLAGS = (
    "-std=c99",
    "-ffp-contract=off",  # as the generated CMake: the same bits everywhere
    "-fno-sanitize=undefined",  # which zig switches on by default
    "-fomit-frame-pointer",  # as gcc's -O2; clang's own keeps one
    "-fno-unwind-tables",
    "-fno-asynchronous-unwind-tables",
    "-ffunction-sections",
    "-g",  # or zig strips the symbols from a small image
)

MEMORY_UNIT, SCRIPT = "bare/memory.c", "image.ld"
INCLUDES = ("-Iinclude", "-isystem", "bare")
# A bare target has no C library. The generated C may use only these prototypes.
BARE_HEADERS = {
    "bare/math.h": "float sinf(float); float cosf(float); float atanf(float);\n",
    "bare/string.h": "#include <stddef.h>\nvoid *memcpy(void *to, const void *from, size_t size);\n",
}


def compile_image(
    sources: Mapping[str, str | bytes], entries: Sequence[str], flags: Sequence[str] = ("-O2",), core: Core = CORTEX_M4F
) -> bytes:
    """Link an ELF file at fixed addresses with only what the entries reach.

    Args:
        sources: relative path with "/" -> content, of all .c, .h and .o files; headers are found in include/.
        entries: functions to keep, one or more.
        flags: optimisation, definitions.
        core: what to compile for.

    Raises:
        CodegenError: `ziglang` is not installed.
        BuildError: C that does not compile, or needs a function that nobody defines.
    """
    units = sorted(path for path in sources if path.endswith((".c", ".o")))
    keep = [f"-Wl,-u,{entry}" for entry in entries]
    link = ["-nostdlib", f"-Wl,-e,{entries[0]},--gc-sections,-T,{SCRIPT}", *keep]
    with source_tree({**sources, MEMORY_UNIT: verbatim("verify/memory.c"), SCRIPT: verbatim(f"verify/{SCRIPT}")}) as tree:
        image = tree.parent / "image.elf"
        zig(["cc", *core.flags, *TARGET_FLAGS, *flags, *INCLUDES, *link, *units, MEMORY_UNIT, "-o", f"../{image.name}"], tree)
        return image.read_bytes()


def preprocess(sources: Mapping[str, str | bytes], units: Sequence[str]) -> dict[str, str]:
    """Return each unit after preprocessing, with line markers. Raises as `compile_image`."""
    with source_tree(sources) as tree:
        return {unit: zig(["cc", *CORTEX_M4F.flags, *TARGET_FLAGS, *INCLUDES, "-E", unit], tree) for unit in units}


@contextlib.contextmanager
def source_tree(sources: Mapping[str, str | bytes]) -> Iterator[Path]:
    """Store the sources and the bare headers in a folder; its parent is for outputs. Raises BuildError if the disk is full."""
    with stored({f"tree/{path}": content for path, content in {**BARE_HEADERS, **sources}.items()}) as scratch:
        yield scratch / "tree"


def zig(arguments: Sequence[str], folder: Path) -> str:
    """Run `zig` in a folder next to which it may write, and return its output.

    Raises:
        CodegenError: `ziglang` is not installed.
        BuildError: zig fails.
    """
    result = zig_result(arguments, folder)
    require_success(result, "the cross compiler")
    return result.stdout


def zig_result(arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run `zig` as above, and return what it answered. Raises CodegenError if `ziglang` is not installed."""
    program = require("ziglang") / "zig"  # what `python -m ziglang` runs, but without another Python
    # Kept nowhere: no folder is used twice, so zig's own cache would only grow.
    cache = str(folder.parent / "cache")
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    return run_program([str(program), *arguments], folder, environment=environment)


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
        architecture: prefix of the architecture's constants.
        mode: arguments for opening unicorn.
        model: constant of the core.
        arguments: registers of the first four words; the result is in the first.
        stack: register of the stack pointer.
        linkage: bytes above the stack pointer that a function may overwrite.
        byte_order: as in a NumPy dtype, "<" or ">".
        fpu_on: register -> bits that enable the FPU.
    """

    architecture: str
    mode: tuple[str, ...]
    model: str
    arguments: tuple[str, str, str, str]
    stack: str
    linkage: int
    byte_order: str
    fpu_on: Mapping[str, int]

    @property
    def is_thumb(self) -> bool:
        """Whether an address of code has its lowest bit set."""
        return self.architecture == "ARM"


def _cortex_m(model: str) -> Machine:
    fpu_on = {"C1_C0_2": 0xF << 20, "FPEXC": 0x4000_0000}  # coprocessors 10 and 11
    return Machine("ARM", ("THUMB", "MCLASS"), f"CPU_ARM_CORTEX_{model}", ("R0", "R1", "R2", "R3"), "SP", 0, "<", fpu_on)


MACHINES: Mapping[str, Machine] = {
    CORTEX_M4F.name: _cortex_m("M4"),
    CORTEX_M7.name: _cortex_m("M7"),
    CORTEX_M33.name: _cortex_m("M33"),
    POWERPC_BE.name: Machine(
        "PPC", ("PPC32", "BIG_ENDIAN"), "CPU_PPC32_7457A_V1_2", ("3", "4", "5", "6"), "1", 16, ">", {"MSR": 0x2000}
    ),
}
"""Cores that can be emulated, by their names."""


@dataclass(frozen=True)
class Blocks:
    """Executed basic blocks in order: address and number of instructions, both (n,)."""

    address: IntArray
    instructions: IntArray


class Processor:
    """One core with its memory. Not shared between threads.

    Attributes:
        name: of the core.
        byte_order: of its numbers, as in a NumPy dtype: "<" or ">".

    Raises:
        CodegenError: `unicorn` or `pyelftools` is not installed.
    """

    def __init__(self, image: bytes, core: Core = CORTEX_M4F) -> None:
        self._machine = machine = MACHINES[core.name]
        self._unicorn = unicorn = module("unicorn", "unicorn")
        self._constants = module(f"unicorn.{machine.architecture.lower()}_const", "unicorn")
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
        self.name, self.byte_order = core.name, machine.byte_order
        self._addresses = {symbol.name: int(symbol["st_value"]) for symbol in symbols if symbol.name}

    def _get(self, register: str) -> int:
        return int(self._core.reg_read(self._register(register)))

    def _set(self, register: str, value: int) -> None:
        self._core.reg_write(self._register(register), value)

    def _register(self, name: str) -> int:
        return int(getattr(self._constants, f"UC_{self._machine.architecture}_REG_{name}"))

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
        """Call a function with up to four words and return the word that it returns.

        Raises:
            BuildError: the code leaves the memory, or does not return.
        """
        machine, thumb = self._machine, int(self._machine.is_thumb)
        for register, value in zip(machine.arguments, arguments, strict=False):
            self._set(register, value)
        self._set(machine.stack, STACK_TOP - machine.linkage)
        self._set("LR", RETURN | thumb)
        try:
            self._core.emu_start(self._addresses[name] | thumb, RETURN, timeout=round(CALL_SECONDS * 1e6))
        except self._unicorn.UcError as error:
            raise BuildError(f"the code on the {self.name} ended at {self._get('PC'):#x}: {error}", where=name) from None
        if self._get("PC") != RETURN:
            raise BuildError(f"the code on the {self.name} did not return within {CALL_SECONDS:g} s", where=name)
        return self._get(machine.arguments[0])

    def traced(self, work: Callable[[], object]) -> Blocks:
        """Trace every basic block that runs during `work`. Raises ValueError for a core without Thumb instructions."""
        if not self._machine.is_thumb:
            raise ValueError(f"the instructions of a {self.name} are not counted")
        found: list[int] = []
        # Blocks that were translated before would not call the hook.
        self._core.ctl_flush_tb()

        def entered(core: Any, address: int, size: int, data: Any) -> None:  # noqa: ARG001 - as the emulator calls it
            found.append((address << SIZE_BITS) | size)

        hook = self._core.hook_add(self._unicorn.UC_HOOK_BLOCK, entered)
        try:
            work()
        finally:
            self._core.hook_del(hook)
            self._core.ctl_flush_tb()
        trace = np.array(found, dtype=np.int64)
        different, inverse = np.unique(trace, return_inverse=True)
        codes = [self.read(block >> SIZE_BITS, block & ((1 << SIZE_BITS) - 1)) for block in different.tolist()]
        counts = np.array([instructions_in(code) for code in codes], dtype=np.int64)
        return Blocks(trace >> SIZE_BITS, counts[inverse])

    def write(self, address: int, content: bytes) -> None:
        """Write to memory."""
        self._core.mem_write(address, content)

    def read(self, address: int, size: int) -> bytes:
        """Read from memory."""
        return bytes(self._core.mem_read(address, size))


def instructions_in(code: bytes) -> int:
    """Count Thumb instructions: 32 bits if the first five are 0b11101 to 0b11111 (Armv7-M ARM, A5.1)."""
    place = count = 0
    while place < len(code):
        place += 4 if code[place + 1] >> 3 in (0b11101, 0b11110, 0b11111) else 2
        count += 1
    return count

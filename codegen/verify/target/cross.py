"""C sources compiled and linked for ECU cores, by the C compiler (clang) in the package `ziglang`."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.programs import run_program
from codegen.sil.toolchain import require_success
from codegen.verify.check import stored
from codegen.verify.packages import require


@dataclass(frozen=True)
class Core:
    """Instruction set to compile for, without an operating system.

    Attributes:
        name: as users know it.
        flags: for zig's clang.
        has_double: whether its FPU computes in double precision.
    """

    name: str
    flags: tuple[str, ...]
    has_double: bool = False


def _core(name: str, target: str, cpu: str = "", has_double: bool = False) -> Core:
    return Core(name, ("-target", target, *((f"-mcpu={cpu}",) if cpu else ())), has_double)


# FPUs in single precision, arguments in their registers.
CORTEX_M4F = _core("Cortex-M4F", "thumb-freestanding-eabihf", "cortex_m4+vfp4d16sp")
CORTEX_M7 = _core("Cortex-M7", "thumb-freestanding-eabihf", "cortex_m7+fp_armv8d16sp")
CORTEX_M33 = _core("Cortex-M33", "thumb-freestanding-eabihf", "cortex_m33+fp_armv8d16sp")
RISCV32 = _core("RV32IMAFC", "riscv32-freestanding", "generic_rv32+m+a+c+f")
POWERPC_BE = _core("PowerPC, big-endian", "powerpc-freestanding-eabihf", has_double=True)
AARCH64 = _core("AArch64", "aarch64-freestanding", has_double=True)
X86_64 = _core("x86-64", "x86_64-freestanding", has_double=True)
CORES = (X86_64, AARCH64, CORTEX_M4F, CORTEX_M7, CORTEX_M33, RISCV32, POWERPC_BE)

FLAGS = (
    "-std=c99",
    "-ffp-contract=off",  # as the generated CMake: the same bits everywhere
    "-fno-sanitize=undefined",  # which zig switches on by default
    "-fomit-frame-pointer",  # as gcc's -O2; clang's own keeps one
    "-fno-unwind-tables",
    "-fno-asynchronous-unwind-tables",
    "-ffunction-sections",
    "-g",  # or zig strips the symbols from a small image
)

FLASH, RAM = 0x0800_0000, 0x2000_0000

# Functions that a compiler may call to copy or clear a struct. Every toolchain provides them; unused ones are not linked.
_MEMORY = """#include <stddef.h>
void *memcpy(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);
void __aeabi_memcpy(void *to, const void *from, size_t size);
void __aeabi_memclr(void *to, size_t size);
void *memcpy(void *to, const void *from, size_t size)
{
    __aeabi_memcpy(to, from, size);
    return to;
}
void *memset(void *to, int value, size_t size)
{
    for (size_t k = 0; k < size; k++) {
        ((unsigned char *)to)[k] = (unsigned char)value;
    }
    return to;
}
void __aeabi_memcpy(void *to, const void *from, size_t size)
{
    for (size_t k = 0; k < size; k++) {
        ((unsigned char *)to)[k] = ((const unsigned char *)from)[k];
    }
}
void __aeabi_memclr(void *to, size_t size)
{
    (void)memset(to, 0, size);
}
void __aeabi_memcpy4(void *to, const void *from, size_t size) __attribute__((alias("__aeabi_memcpy")));
void __aeabi_memcpy8(void *to, const void *from, size_t size) __attribute__((alias("__aeabi_memcpy")));
void __aeabi_memclr4(void *to, size_t size) __attribute__((alias("__aeabi_memclr")));
void __aeabi_memclr8(void *to, size_t size) __attribute__((alias("__aeabi_memclr")));
"""

MEMORY_UNIT, SCRIPT = "bare/memory.c", "image.ld"
INCLUDES = ("-Iinclude", "-isystem", "bare")
# A bare target has no C library. The generated C may use only these prototypes.
BARE_HEADERS = {
    "bare/math.h": "float sinf(float); float cosf(float); float atanf(float);\n",
    "bare/string.h": "#include <stddef.h>\nvoid *memcpy(void *to, const void *from, size_t size);\n",
}

_SCRIPT = f"""SECTIONS {{
  . = {FLASH:#x};
  .text : {{ *(.text*) }}
  .rodata : {{ *(.rodata*) }}
  . = {RAM:#x};
  .data : {{ *(.data*) }}
  .bss : {{ *(.bss*) *(COMMON) }}
  /DISCARD/ : {{ *(.ARM.exidx*) *(.ARM.extab*) }}
}}
"""


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
    with source_tree({**sources, MEMORY_UNIT: _MEMORY, SCRIPT: _SCRIPT}) as tree:
        image = tree.parent / "image.elf"
        zig(["cc", *core.flags, *FLAGS, *flags, *INCLUDES, *link, *units, MEMORY_UNIT, "-o", f"../{image.name}"], tree)
        return image.read_bytes()


def preprocess(sources: Mapping[str, str | bytes], units: Sequence[str]) -> dict[str, str]:
    """Return each unit after preprocessing, with line markers. Raises as `compile_image`."""
    with source_tree(sources) as tree:
        return {unit: zig(["cc", *CORTEX_M4F.flags, *FLAGS, *INCLUDES, "-E", unit], tree) for unit in units}


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
    require("ziglang")
    # Kept nowhere: no folder is used twice, so zig's own cache would only grow.
    cache = str(folder.parent / "cache")
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    result = run_program([sys.executable, "-m", "ziglang", *arguments], folder, environment=environment)
    require_success(result, "the cross compiler")
    return result.stdout

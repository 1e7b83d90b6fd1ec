"""C sources compiled and linked for a Cortex-M4F, by the C compiler (clang) in the package `ziglang`."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from codegen.errors import BuildError
from codegen.sil.toolchain import require_success
from codegen.verify.packages import require

TARGET = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp")
"""ARMv7E-M with the FPU in single precision, arguments in its registers."""

FLAGS = (
    "-std=c99",
    "-ffp-contract=off",  # as the generated CMake: the same bits everywhere
    "-fno-sanitize=undefined",  # which zig switches on by default
    "-fno-unwind-tables",
    "-fno-asynchronous-unwind-tables",
    "-ffunction-sections",
    "-g0",
)

FLASH, RAM = 0x0800_0000, 0x2000_0000

# What a compiler may call to copy or clear a struct. Every toolchain brings it; these are plain, and left out where not called.
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

MEMORY_UNIT = "bare/memory.c"
BARE = {
    # A bare target has no C library. These prototypes are all that the generated C may need of one.
    "bare/math.h": "float sinf(float); float cosf(float); float atanf(float); float sqrtf(float);\n",
    "bare/string.h": "#include <stddef.h>\nvoid *memcpy(void *to, const void *from, size_t size);\n",
    MEMORY_UNIT: _MEMORY,
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


def compile_image(sources: Mapping[str, str | bytes], entries: Sequence[str], flags: Sequence[str] = ("-O2",)) -> bytes:
    """An ELF file at fixed addresses, with what the entries reach and nothing else.

    Args:
        sources: relative path with "/" -> content, of all .c and .h files; headers are found in include/.
        entries: functions to keep, in the order of what matters: at least one.
        flags: optimisation, definitions.

    Raises:
        CodegenError: `ziglang` is not installed.
        BuildError: C that does not compile, or needs a function that nobody defines.
    """
    require("ziglang")
    units = sorted(path for path in sources if path.endswith(".c"))
    keep = [f"-Wl,-u,{entry}" for entry in entries]
    link = ["-nostdlib", f"-Wl,-e,{entries[0]},--gc-sections,-T,image.ld", *keep]
    try:
        with tempfile.TemporaryDirectory(prefix="ars-cross-") as scratch_name:
            scratch = Path(scratch_name)
            tree = scratch / "tree"
            for path, content in {**BARE, **sources, "image.ld": _SCRIPT}.items():
                (tree / path).parent.mkdir(parents=True, exist_ok=True)
                (tree / path).write_bytes(content.encode() if isinstance(content, str) else content)
            command = [*TARGET, *FLAGS, *flags, "-Iinclude", "-isystem", "bare", *link, *units, MEMORY_UNIT, "-o", "../image.elf"]
            zig(["cc", *command], tree, "the cross compiler")
            return (scratch / "image.elf").read_bytes()
    except OSError as error:
        raise BuildError(f"the image cannot be stored: {error.strerror or error}", remedy="free space for temporary files") from error


def zig(arguments: Sequence[str], folder: Path, where: str) -> str:
    """What `zig` prints, run in a folder beside which it may leave files. Raises BuildError where it fails."""
    # Nothing here is made twice from the same path, so zig's own cache would only grow.
    cache = str(folder.parent / "cache")
    result = subprocess.run(
        [sys.executable, "-m", "ziglang", *arguments],
        cwd=folder,
        env={**os.environ, "LC_ALL": "C", "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    require_success(result, where)
    return result.stdout

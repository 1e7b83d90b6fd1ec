"""The emulated core: counts of known instructions, and code that leaves its memory.

test_pil.py compares results and byte order with this machine.
"""

import functools

import pytest

from codegen.errors import BuildError
from codegen.verify import target
from codegen.verify.machine_code import Program
from codegen.verify.target import CORTEX_M4F, POWERPC_BE, Core, Processor, compile_image


def assembled(name: str, *lines: str) -> str:
    """Return a C file with one function in assembly."""
    head = ("syntax unified", "thumb", "text", f"global {name}", f"type {name}, %function", "thumb_func")
    code = [*(f".{line}" for line in head), f"{name}:", *lines, f".size {name}, . - {name}"]
    return f'__asm__("{"".join(f"{line}{chr(92)}n" for line in code)}");\n'


LOOP = ("add.w r2, r1, #256", "cmp r1, #3", "ite eq", "moveq r3, #1", "addne.w r3, r3, #1", "subs r1, #1", "bne 1b")
ASSEMBLY = {
    "a.c": assembled("counted", "movs r1, #5", "1:", *LOOP, "mov r0, r3", "bx lr"),
    "b.c": assembled("caller", "push {r4, lr}", "bl counted", "bl counted", "pop {r4, pc}"),
}
IN_COUNTED = 3 + 5 * len(LOOP)
BAD_CODE = """
void trap(void);
void trap(void) { __builtin_trap(); }
int unmapped(void);
int unmapped(void) { int *volatile p = (int *)0x90000000u; return *p; }
void away(void);
void away(void) { void (*volatile f)(void) = (void (*)(void))0x91000001u; f(); }
void stay(void);
void stay(void) { for (;;) { __asm__ volatile(""); } }
"""


@functools.cache
def image(core: Core = CORTEX_M4F) -> bytes:
    more, names = (ASSEMBLY, ("counted", "caller")) if core is CORTEX_M4F else ({}, ())
    return compile_image({"f.c": BAD_CODE, **more}, ("trap", "unmapped", "away", "stay", *names), core=core)


def test_instructions_are_counted_exactly_where_they_run() -> None:
    """Covers narrow and wide instructions, a loop, an IT block with a skipped branch, and nested calls."""
    core, counted = Processor(image()), Program(image()).named("counted")
    assert core.call("counted") == 3  # set to 1 in the round with r1 = 3, incremented in the two rounds after it
    blocks = core.traced(lambda: core.call("caller"))  # includes code that already ran uncounted
    inside = (blocks.address >= counted.start) & (blocks.address < counted.end)
    assert blocks.instructions[inside].sum() == 2 * IN_COUNTED
    assert blocks.instructions.sum() == 4 + 2 * IN_COUNTED


@pytest.mark.parametrize("core", [CORTEX_M4F, POWERPC_BE], ids=lambda core: core.name)
def test_wild_jumps_and_endless_code_are_reported(core: Core, monkeypatch: pytest.MonkeyPatch) -> None:
    processor = Processor(image(core), core)
    for name in ("trap", "unmapped", "away"):
        with pytest.raises(BuildError, match=rf"^{name}: the code on the {core.name} ended at 0x"):
            processor.call(name)

    monkeypatch.setattr(target, "CALL_SECONDS", 0.05)
    with pytest.raises(BuildError, match=rf"^stay: the code on the {core.name} did not return within 0\.05 s$"):
        processor.call("stay")

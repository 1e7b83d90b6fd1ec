"""The emulated core: counts of known instructions, decoded instructions, and code that leaves its memory.

test_pil.py compares results and byte order with this machine.
"""

import functools

import pytest

from codegen.errors import BuildError
from codegen.verify.budgets.cycles import Flow, decode
from codegen.verify.target import emulator
from codegen.verify.target.cross import CORTEX_M4F, POWERPC_BE, Core, compile_image
from codegen.verify.target.emulator import CortexM4, Processor, instructions_in


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
    core = CortexM4(image())
    function = {function.name: function for function in core.functions}
    assert core.call("counted") == 3  # set to 1 in the round with r1 = 3, incremented in the two rounds after it
    blocks = core.traced(lambda: core.call("caller"))  # includes code that already ran uncounted
    inside = (blocks.address >= function["counted"].start) & (blocks.address < function["counted"].end)
    assert blocks.instructions[inside].sum() == 2 * IN_COUNTED
    assert blocks.instructions.sum() == 4 + 2 * IN_COUNTED


@pytest.mark.parametrize("core", [CORTEX_M4F, POWERPC_BE], ids=lambda core: core.name)
def test_wild_jumps_and_endless_code_are_reported(core: Core, monkeypatch: pytest.MonkeyPatch) -> None:
    processor = Processor(image(core), core)
    for name in ("trap", "unmapped", "away"):
        with pytest.raises(BuildError, match=rf"^{name}: the code on the {core.name} ended at 0x"):
            processor.call(name)

    monkeypatch.setattr(emulator, "CALL_SECONDS", 0.05)
    with pytest.raises(BuildError, match=rf"^stay: the code on the {core.name} did not return within 0\.05 s$"):
        processor.call("stay")


AT = 0x0800_0100


def code(*words: int) -> bytes:
    return b"".join(word.to_bytes(2, "little") for word in words)


# Encodings from LLVM's disassembler; cycles from tables 3-1 and 7-1 of the Cortex-M4 technical reference manual.
PLAIN = {
    "movs r0, #100": ((0x2064,), 1),
    "ldrb r0, [r4, #22]": ((0x7DA0,), 2),
    "pop {r4, r5}": ((0xBC30,), 3),
    "ldrd r0, r1, [r2]": ((0xE9D2, 0x0100), 3),
    "sdiv r0, r0, r1": ((0xFB90, 0xF0F1), 12),
    "vldr d0, [r0]": ((0xED90, 0x0B00), 3),
    "vpush {d8, d9}": ((0xED2D, 0x8B04), 5),
    "vmla.f32 s0, s1, s2": ((0xEE00, 0x0A81), 3),
    "vdiv.f32 s14, s2, s0": ((0xEE81, 0x7A00), 14),
    "vsqrt.f32 s0, s0": ((0xEEB1, 0x0AC0), 14),
}

JUMPS = {
    "bx lr": ((0x4770,), Flow.RETURN, None, 1),
    "bx r3": ((0x4718,), Flow.POINTER, None, 1),
    "mov pc, r0": ((0x4687,), Flow.POINTER, None, 1),
    "pop.w {r4, r8, pc}": ((0xE8BD, 0x8110), Flow.RETURN, None, 4),
    "ldr pc, [sp], #4": ((0xF85D, 0xFB04), Flow.RETURN, None, 2),
    "ldr.w pc, [r0]": ((0xF8D0, 0xF000), Flow.POINTER, None, 2),
    "tbb [pc, r0]": ((0xE8DF, 0xF000), Flow.TABLE, None, 2),
    "b +0x30": ((0xE016,), Flow.BRANCH, 0x30, 1),
    "bne -0x86": ((0xD1BB,), Flow.CONDITIONAL, -0x86, 1),
    "cbnz r0, +0x46": ((0xBB08,), Flow.CONDITIONAL, 0x46, 1),
    "ble.w +0x10a": ((0xF340, 0x8083), Flow.CONDITIONAL, 0x10A, 1),
    "bl -0x800": ((0xF7FF, 0xFBFE), Flow.CALL, -0x800, 1),
}


def test_every_instruction_is_decoded() -> None:
    """The code contains every instruction; cycles, flow, target and size of each are compared."""
    table = [(words, Flow.NEXT, None, cycles) for words, cycles in PLAIN.values()] + list(JUMPS.values())
    words = [word for each, *_ in table for word in each]
    found = decode(code(*words), AT)
    assert len(found) == len(table) == instructions_in(code(*words))
    address = AT
    for name, each, (encoded, flow, offset, cycles) in zip([*PLAIN, *JUMPS], found, table, strict=True):
        target = None if offset is None else address + offset
        expected = (address, 2 * len(encoded), flow, target, cycles)
        assert (each.address, each.size, each.flow, each.target, each.cycles) == expected, name
        assert not each.is_nop
        address = each.end
    assert decode(code(0xBF00), AT)[0].is_nop

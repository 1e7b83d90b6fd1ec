"""The emulated core: what it counts, against programs whose instructions are known one by one."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.errors import BuildError
from codegen.verify import emulator
from codegen.verify.cross import compile_image
from codegen.verify.emulator import DATA, CortexM4, instructions_in


def assembled(name: str, body: str) -> str:
    """A C file with one function in assembly."""
    lines = ["syntax unified", "thumb", "text", f"global {name}", f"type {name}, %function", "thumb_func"]
    head = "".join(f".{line}\\n" for line in lines)
    code = "".join(f"{line.strip()}\\n" for line in body.strip().splitlines())
    return f'__asm__("{head}{name}:\\n{code}.size {name}, . - {name}\\n");\n'


COUNTED = assembled(
    "counted",
    """
    movs r1, #5
    1: add.w r2, r1, #256
    cmp r1, #3
    ite eq
    moveq r3, #1
    addne.w r3, r3, #1
    subs r1, #1
    bne 1b
    mov r0, r3
    bx lr
    """,
)
ROUNDS, IN_A_ROUND, BEFORE_AND_AFTER = 5, 7, 3
CALLER = assembled(
    "caller",
    """
    push {r4, lr}
    bl counted
    bl counted
    pop {r4, pc}
    """,
)


def core_of(*sources: str, entries: tuple[str, ...]) -> CortexM4:
    return CortexM4(compile_image({f"{number}.c": text for number, text in enumerate(sources)}, entries))


def test_a_call_is_counted_to_the_instruction() -> None:
    """Narrow and wide ones, a loop, and an IT block of which one branch is passed over: all of it is taken in."""
    core = core_of(COUNTED, entries=("counted",))
    results: list[int] = []
    blocks = core.traced(lambda: results.append(core.call("counted")))
    assert blocks.instructions.sum() == BEFORE_AND_AFTER + ROUNDS * IN_A_ROUND
    assert results == [3]  # set to 1 in the round with r1 = 3, and counted up in the two after it


def test_a_call_in_a_call_is_counted_where_it_is() -> None:
    core = core_of(COUNTED, CALLER, entries=("caller",))
    function = {function.name: function for function in core.functions}
    blocks = core.traced(lambda: core.call("caller"))
    inside = {
        name: blocks.instructions[(blocks.address >= each.start) & (blocks.address < each.end)].sum()
        for name, each in function.items()
    }
    assert inside == {"caller": 4, "counted": 2 * (BEFORE_AND_AFTER + ROUNDS * IN_A_ROUND)}


def test_what_ran_before_is_counted_as_well_and_nothing_twice() -> None:
    """Code that the emulator has translated without counting tells no less than new code."""
    core = core_of(COUNTED, entries=("counted",))
    core.call("counted")
    counts = [core.traced(lambda: core.call("counted")).instructions.sum() for _ in range(2)]
    core.call("counted")
    assert counts == [BEFORE_AND_AFTER + ROUNDS * IN_A_ROUND] * 2


def test_nothing_runs_and_nothing_is_counted() -> None:
    core = core_of(COUNTED, entries=("counted",))
    assert core.traced(lambda: None).instructions.sum() == 0


@pytest.mark.parametrize(
    ("code", "instructions"),
    [
        ("", 0),
        ("7047", 1),  # bx lr
        ("00bf 00bf", 2),  # nop, nop
        ("40f2 0100", 1),  # movw r0, #1
        ("ffe7", 1),  # b, with 0b11100 narrow
        ("00e8 0000", 1),  # 0b11101 wide
        ("00bf f8ee 000a 7047", 3),  # nop, vldr-like wide, bx lr
    ],
)
def test_widths_are_read_from_the_first_five_bits(code: str, instructions: int) -> None:
    assert instructions_in(bytes.fromhex(code.replace(" ", ""))) == instructions


SCALE = """#include <stdint.h>
static float factor = 2.0f;
float last[1000];
void scale(const float *x, float *y, uint32_t count);
void scale(const float *x, float *y, uint32_t count)
{
    for (uint32_t k = 0u; k < count; k++) {
        y[k] = factor * x[k] / 3.0f;
        last[k] = y[k];
    }
    factor += 1.0f;
}
"""


def test_arithmetic_is_that_of_single_precision() -> None:
    """Subnormal numbers too; and initialised, writable and zeroed memory are where the code takes them to be."""
    core = core_of(SCALE, entries=("scale",))
    x = np.array([1.0, -0.1, 3e-45, 1e-38, 3e38, np.inf, np.pi], dtype=np.float32)
    core.write(DATA, x.tobytes())
    for factor in (np.float32(2.0), np.float32(3.0)):
        core.call("scale", DATA, DATA + 1024, x.size)
        found = np.frombuffer(core.read(DATA + 1024, x.nbytes), dtype=np.float32)
        with np.errstate(over="ignore"):
            expected = (factor * x) / np.float32(3.0)
        assert found.tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    "body",
    [
        "int *volatile p = (int *)0x90000000u; return *p;",  # no memory
        "void (*volatile f)(void) = (void (*)(void))0x91000001u; f(); return 0;",
        "__builtin_trap();",
    ],
)
def test_code_that_goes_astray(body: str) -> None:
    core = core_of(f"int stray(void);\nint stray(void)\n{{\n    {body}\n}}\n", entries=("stray",))
    with pytest.raises(BuildError, match=r"^stray: the code on the Cortex-M4F ended at 0x"):
        core.call("stray")


def test_code_that_does_not_return(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emulator, "CALL_SECONDS", 0.05)
    core = core_of(
        'void stay(void);\nvoid stay(void)\n{\n    for (;;) {\n        __asm__ volatile("");\n    }\n}\n', entries=("stay",)
    )
    with pytest.raises(BuildError, match=r"^stay: the code on the Cortex-M4F did not return within 0\.05 s$"):
        core.call("stay")


def test_a_function_that_nobody_defines() -> None:
    text = "float sinf(float);\nfloat f(float x);\nfloat f(float x)\n{\n    return sinf(x);\n}\n"
    with pytest.raises(BuildError, match="the C does not compile: undefined symbol: sinf"):
        compile_image({"f.c": text}, ("f",))

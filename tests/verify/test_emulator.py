"""The emulated cores: what they compute, and what is counted, against programs whose instructions are known one by one."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.errors import BuildError
from codegen.verify.target import emulator
from codegen.verify.target.cross import CORTEX_M4F, CORTEX_M7, CORTEX_M33, POWERPC_BE, Core, compile_image
from codegen.verify.target.emulator import DATA, CortexM4, Processor, Stray, instructions_in

CORES = pytest.mark.parametrize("core", [CORTEX_M4F, CORTEX_M7, CORTEX_M33, POWERPC_BE], ids=lambda core: core.name)


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


@CORES
def test_arithmetic_is_that_of_single_precision(core: Core) -> None:
    """Subnormal numbers too; and initialised, writable and zeroed memory are where the code takes them to be."""
    processor = Processor(compile_image({"f.c": SCALE}, ("scale",), core=core), core)
    number = np.dtype(f"{processor.byte_order}f4")
    x = np.array([1.0, -0.1, 3e-45, 1e-38, 3e38, np.inf, np.pi], dtype=np.float32)
    processor.write(DATA, x.astype(number).tobytes())
    for factor in (np.float32(2.0), np.float32(3.0)):
        processor.call("scale", DATA, DATA + 1024, x.size)
        found = np.frombuffer(processor.read(DATA + 1024, x.nbytes), dtype=number)
        with np.errstate(over="ignore"):
            expected = (factor * x) / np.float32(3.0)
        assert found.astype(np.float32).tobytes() == expected.tobytes()


ORDER = """#include <stdint.h>
static const uint32_t word = 0x01020304u;
uint32_t order(uint32_t a, uint32_t b, uint32_t c, uint32_t d);
uint32_t order(uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    const volatile uint8_t *const bytes = (const volatile uint8_t *)&word;

    return (1000u * bytes[0]) + a + (2u * b) + (3u * c) + (4u * d);
}
"""


@CORES
def test_arguments_come_in_order_and_bytes_in_that_of_the_core(core: Core) -> None:
    processor = Processor(compile_image({"f.c": ORDER}, ("order",), core=core), core)
    first = {"<": 4, ">": 1}[processor.byte_order]
    assert processor.call("order", 1, 10, 100, 200) == 1000 * first + 1 + 20 + 300 + 800
    word = processor.read(processor.address("word"), 4)
    assert word == bytes([1, 2, 3, 4])[:: 1 if first == 1 else -1]


NESTED = """float deep(float x, int depth);
float deep(float x, int depth)
{
    volatile float own[8] = { x };

    return (depth > 0) ? (deep(own[0] + 1.0f, depth - 1) + own[0]) : own[1];
}
int enter(void);
int enter(void)
{
    return (int)deep(0.0f, 20);
}
"""


@CORES
def test_calls_within_calls_have_their_stack(core: Core) -> None:
    processor = Processor(compile_image({"f.c": NESTED}, ("enter",), core=core), core)
    assert processor.call("enter") == sum(range(20))
    assert processor.name == core.name


def test_only_thumb_is_counted() -> None:
    processor = Processor(compile_image({"f.c": ORDER}, ("order",), core=POWERPC_BE), POWERPC_BE)
    with pytest.raises(ValueError, match="instructions of a PowerPC"):
        processor.traced(lambda: None)


@CORES
def test_where_code_goes_astray_is_known(core: Core) -> None:
    text = "int stray(void);\nint stray(void)\n{\n    __builtin_trap();\n}\n"
    processor = Processor(compile_image({"f.c": text}, ("stray",), core=core), core)
    (function,) = (each for each in processor.functions if each.name == "stray")
    with pytest.raises(Stray, match=f"the code on the {core.name} ended at 0x") as caught:
        processor.call("stray")
    assert caught.value.address - function.start == (0 if core is not POWERPC_BE else 4)


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

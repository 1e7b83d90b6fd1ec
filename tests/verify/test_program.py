"""Functions of an image: what they call, their blocks, and the stack that a call can take."""

from __future__ import annotations

import functools

import pytest

from codegen.errors import BuildError
from codegen.verify.budgets.program import STACK_FLAG, NoBound, Program
from codegen.verify.target.cross import compile_image
from codegen.verify.target.emulator import DATA, CortexM4

SOURCE = """
#include <stdint.h>
uint32_t entry(uint32_t x);
uint32_t other(uint32_t x);
__attribute__((noinline)) static uint32_t leaf(uint32_t x) { volatile uint32_t a[8]; a[x & 7u] = x; return a[1]; }
__attribute__((noinline)) static uint32_t deep(uint32_t x) { volatile uint32_t a[64]; a[x & 63u] = x; return leaf(x) + a[2]; }
__attribute__((noinline)) static uint32_t flat(uint32_t x) { return leaf(x + 1u) * 3u; }
uint32_t entry(uint32_t x)
{
    uint32_t y = flat(x);
    if (x > 5u) {
        y += deep(x);
    }
    return y + 1u;
}
uint32_t other(uint32_t x)
{
    switch (x) {
    case 0u: return leaf(1u) + 5u;
    case 1u: return leaf(7u) * 3u;
    case 2u: return leaf(x) ^ 99u;
    case 3u: return leaf(11u) - 4u;
    case 4u: return leaf(13u) + x;
    case 5u: return leaf(17u) / 5u;
    default: return 12u;
    }
}
uint32_t again(uint32_t x);
uint32_t again(uint32_t x) { volatile uint32_t k = x; return k > 3u ? again(k / 2u) + again(k - 3u) : 1u; }
uint32_t (*hook)(uint32_t x);
uint32_t through(uint32_t x);
uint32_t through(uint32_t x) { return hook(x) + 1u; }
uint32_t last(uint32_t x);
uint32_t last(uint32_t x) { return hook(x); }
uint32_t tail(uint32_t x);
uint32_t tail(uint32_t x) { return flat(x * 5u); }
"""
ENTRIES = ("entry", "other", "again", "through", "last", "tail")
SOURCES = {"src/sample.c": SOURCE}


@functools.cache
def image(*flags: str) -> bytes:
    return compile_image(SOURCES, ENTRIES, ("-O2", *flags))


@functools.cache
def program() -> Program:
    return Program(image(STACK_FLAG))


def test_functions_with_their_file_and_their_code() -> None:
    names = {routine.name for routine in program().routines}
    assert {"leaf", "deep", "flat", *ENTRIES} <= names
    for routine in program().routines:
        assert routine.unit == "sample.c"
        assert routine.instructions[0].address == routine.start
        assert routine.instructions[-1].end <= routine.end
        assert program().at(routine.end - 2) is routine
    assert program().at(0x1000) is None
    with pytest.raises(BuildError, match=r"^nothing: there is no such function"):
        program().named("nothing")


def test_calls_direct_and_as_the_last_act() -> None:
    start = {routine.name: routine.start for routine in program().routines}
    assert program().named("entry").calls == {start["flat"], start["deep"]}
    assert program().named("tail").calls <= {start["flat"], start["leaf"]}
    assert program().named("tail").calls
    assert [routine.name for routine in program().reached("leaf")] == ["leaf"]
    assert {routine.name for routine in program().reached("entry")} == {"entry", "flat", "deep", "leaf"}


def test_the_deepest_chain_is_found() -> None:
    depth = program().depth("entry")
    assert depth.chain == ("entry", "deep", "leaf")
    assert depth.bytes == sum(program().named(name).stack or 0 for name in depth.chain)
    assert depth.bytes >= 64 * 4 + 8 * 4
    assert program().depth("leaf").bytes < depth.bytes - 64 * 4


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("again", "again: it calls itself: its stack has no bound"),
        ("through", "through: it calls through a pointer: its stack has no bound"),
        ("last", "last: it calls through a pointer: its stack has no bound"),
    ],
)
def test_no_bound(name: str, why: str) -> None:
    with pytest.raises(NoBound) as caught:
        program().depth(name)
    assert str(caught.value) == why


def test_without_the_compilers_word_there_is_no_bound() -> None:
    with pytest.raises(NoBound, match=r"^leaf: the compiler does not tell"):
        Program(image()).depth("leaf")


def test_a_switch_over_a_table_is_no_call_and_all_its_blocks_are_found() -> None:
    """Each case is entered by a number; the blocks that were entered so are all that there are."""
    routine, core = program().named("other"), CortexM4(image(STACK_FLAG))
    assert program().depth("other").chain == ("other", "leaf")
    entered: set[int] = set()
    for case in range(8):
        ran = core.traced(lambda case=case: core.call("other", case))  # type: ignore[misc]
        entered |= set(ran.address.tolist())
    blocks = routine.blocks(entered)
    assert len(blocks) > 7
    # A call ends a block of the emulator; the instruction behind it is inside one of ours.
    spans = {each.address for block in blocks for each in block}
    assert {address for address in entered if routine.start <= address < routine.end} <= spans
    one_case = set(core.traced(lambda: core.call("other", 2)).address.tolist())
    missed = [block for block in routine.blocks(entered) if not one_case & {each.address for each in block}]
    assert len(missed) >= 6


def test_lines_of_the_source() -> None:
    lines = {program().line_of(block[0].address) for block in program().named("entry").blocks()}
    text = SOURCE.splitlines()
    branch = 1 + text.index("        y += deep(x);")
    assert f"src/sample.c:{branch}" in lines
    assert all(line.startswith("src/sample.c:") for line in lines)
    assert program().line_of(DATA // 1024) == ""

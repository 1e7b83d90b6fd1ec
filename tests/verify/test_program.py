"""Functions of an image: their calls and the maximum stack of a call; flash and RAM of an object."""

import functools

import pytest

from codegen.configuration import Kind
from codegen.errors import BuildError
from codegen.verify.machine_code import SECTIONS, STACK_FLAG, Program, Sizes, compile_objects, sizes_of
from codegen.verify.target import compile_image
from tests.verify import builds, planted

SOURCE = """
#include <stdint.h>
__attribute__((noinline)) static uint32_t leaf(uint32_t x) { volatile uint32_t a[8]; a[x & 7u] = x; return a[1]; }
__attribute__((noinline)) static uint32_t deep(uint32_t x) { volatile uint32_t a[64]; a[x & 63u] = x; return leaf(x) + a[2]; }
__attribute__((noinline)) static uint32_t flat(uint32_t x) { return leaf(x + 1u) * 3u; }
uint32_t entry(uint32_t x) { uint32_t y = flat(x); if (x > 5u) {
        y += deep(x);
    } return y + 1u; }
uint32_t other(uint32_t x) { switch (x) { case 0u: return leaf(1u) + 5u; case 1u: return leaf(7u) * 3u; case 2u:
    return leaf(x) ^ 99u; case 3u: return leaf(11u) - 4u; case 4u: return leaf(13u) + x; case 5u: return leaf(17u) / 5u;
    default: return 12u; } }
uint32_t again(uint32_t x) { volatile uint32_t k = x; return k > 3u ? again(k / 2u) + again(k - 3u) : 1u; }
uint32_t (*hook)(uint32_t x);
uint32_t through(uint32_t x) { return hook(x) + 1u; }
uint32_t last(uint32_t x) { return hook(x); }
uint32_t tail(uint32_t x) { return flat(x * 5u); }
"""
ENTRIES = ("entry", "other", "again", "through", "last", "tail")


@functools.cache
def image(*flags: str) -> bytes:
    return compile_image({"src/sample.c": SOURCE}, ENTRIES, ("-O2", *flags))


@functools.cache
def program() -> Program:
    return Program(image(STACK_FLAG))


def test_direct_calls_tail_calls_and_the_deepest_chain() -> None:
    start = {routine.name: address for address, routine in program().routines.items()}
    assert {"leaf", "deep", "flat", *ENTRIES} <= start.keys()
    assert program().named("entry").calls == {start["flat"], start["deep"]}
    assert set() < program().named("tail").calls <= {start["flat"], start["leaf"]}
    assert {routine.name for routine in program().reached("entry")} == {"entry", "flat", "deep", "leaf"}
    depth = program().depth("entry")
    assert depth.chain == ("entry", "deep", "leaf")
    assert depth.bytes == sum(program().named(name).stack or 0 for name in depth.chain) >= 64 * 4 + 8 * 4
    assert program().depth("leaf").bytes < depth.bytes - 64 * 4
    assert program().depth("other").chain == ("other", "leaf")  # a switch is no call through a pointer


@pytest.mark.parametrize(
    ("name", "why"),
    [("again", "it calls itself"), ("through", "it calls through a pointer"), ("last", "it calls through a pointer")],
)
def test_recursion_and_pointers_make_the_stack_unbounded(name: str, why: str) -> None:
    with pytest.raises(BuildError) as caught:
        program().depth(name)
    assert str(caught.value) == f"{name}: {why}: its stack has no bound"
    with pytest.raises(BuildError, match=r"^leaf: the compiler does not report its stack use"):
        Program(image()).depth("leaf")


WRITTEN = b"""
#include <stdint.h>
static const uint32_t table[50] = { 1u, 2u, 3u };
static uint8_t counter[12];
static uint32_t start[3] = { 7u, 8u, 9u };
uint32_t shared __attribute__((common));
uint32_t look(uint32_t k);
uint32_t look(uint32_t k) { counter[k]++; start[k] += shared; return table[k] + counter[k]; }
"""
CLEAN = b"unsigned look(unsigned k);\nunsigned look(unsigned k) { return k * 3u; }\n"


def test_sections_and_written_variables_of_each_unit() -> None:
    objects = compile_objects({"src/a.c": WRITTEN, "src/b.c": CLEAN}, ("-O2",))
    assert list(objects) == ["src/a.c", "src/b.c"]
    found, clean = map(sizes_of, objects.values())
    assert 10 < found.sections["text"] < 100
    assert found.sections == {"text": found.sections["text"], "rodata": 200, "data": 12, "bss": 16}
    assert found.written == (("counter", 12), ("shared", 4), ("start", 12))
    assert found.flash == found.sections["text"] + 200 + 12
    assert clean == Sizes({**dict.fromkeys(SECTIONS, 0), "text": clean.flash}, ())


@pytest.mark.parametrize("kind", builds.KINDS)
def test_a_build_has_no_memory_of_its_own(kind: Kind) -> None:
    """All memory is the caller's, so instances share nothing. `test_budgets` plants violations."""
    objects = compile_objects(planted.subject_of(builds.made(kind, "uneven")).sources(), ("-O0",))
    assert [path for path, content in objects.items() if sizes_of(content).written] == []

"""Flash and RAM of an object."""

from __future__ import annotations

from codegen.verify.budgets.sizes import Sizes, compile_objects, defines, sizes_of

SOURCE = b"""
#include <stdint.h>
static const uint32_t table[50] = { 1u, 2u, 3u };
static uint8_t counter[12];
static uint32_t start[3] = { 7u, 8u, 9u };
uint32_t shared __attribute__((common));
uint32_t look(uint32_t k);
uint32_t look(uint32_t k) { counter[k]++; start[k] += shared; return table[k] + counter[k]; }
"""
CLEAN = b"unsigned look(unsigned k);\nunsigned look(unsigned k) { return k * 3u; }\n"


def objects(**units: bytes) -> dict[str, bytes]:
    return compile_objects({f"src/{name}.c": text for name, text in units.items()}, ("-O2",))


def test_sections_and_written_variables() -> None:
    found = sizes_of(objects(a=SOURCE)["src/a.c"])
    assert (found.rodata, found.data, found.bss) == (200, 12, 12 + 4)
    assert found.written == (("counter", 12), ("shared", 4), ("start", 12))
    assert 10 < found.text < 100
    assert found.flash == found.text + 200 + 12
    assert found.to_dict() == {"text": found.text, "rodata": 200, "data": 12, "bss": 16}


def test_units_are_compiled_apart() -> None:
    found = objects(a=SOURCE, b=CLEAN)
    assert list(found) == ["src/a.c", "src/b.c"]
    clean = sizes_of(found["src/b.c"])
    assert clean == Sizes(text=clean.text)
    assert defines(found["src/b.c"], "look")
    assert not defines(found["src/b.c"], "table")

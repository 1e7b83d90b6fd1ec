"""The rule for loops: the generated C keeps it, and what breaks it is found."""

from __future__ import annotations

import pytest

from codegen.config import Kind
from codegen.errors import BuildError
from codegen.verify.budgets.bounded_loops import complaints
from tests.verify import builds

FOOT = "float planted(float x);\nfloat planted(float x)\n{\n    uint32_t i;\n    uint32_t n = (uint32_t)x;\n"


@pytest.mark.parametrize("kind", builds.KINDS)
def test_every_loop_of_a_build_has_a_fixed_number_of_rounds(kind: Kind) -> None:
    folder = builds.made(kind)
    assert complaints(folder.files, folder.manifest) == ()


def test_so_have_those_of_uneven_axes_and_several_frictions() -> None:
    folder = builds.made("tracking", "uneven", layers=True)
    assert complaints(folder.files, folder.manifest) == ()


def planted(statements: str, before: str = "") -> tuple[str, ...]:
    """Complaints about the limiter with a function more. The limiter is small, and needs no other unit."""
    folder = builds.made("pi")
    files = {path: content for path, content in folder.files.items() if path.startswith("include/")}
    text = folder.files["src/ars_limiter.c"].decode() + before + FOOT + f"    {statements}\n    return x;\n}}\n"
    files["src/ars_limiter.c"] = text.encode()
    return complaints(files, folder.manifest)


@pytest.mark.parametrize(
    ("statements", "complaint"),
    [
        ("while (n > 0u) { n--; }", "while in planted"),
        ("do { n--; } while (n > 0u);", "dowhile in planted"),
        ("again: if (n > 0u) { n--; goto again; }", "goto in planted"),
        ("for (;;) { n++; }", "a for loop that does not start with counter = constant in planted"),
        ("for (uint32_t k = 0u; k < 3u; k++) { n++; }", "a for loop that does not start with counter = constant in planted"),
        ("for (i = n; i < 3u; i++) { x += 1.0f; }", "a for loop from what is no constant in planted"),
        ("for (i = 0u; i < n; i++) { x += 1.0f; }", "a for loop to what is no constant in planted"),
        ("for (i = 0u; n < 3u; i++) { n++; }", "a for loop whose condition does not compare its counter in planted"),
        ("for (i = 0u; ; i++) { n++; }", "a for loop whose condition does not compare its counter in planted"),
        ("for (i = 0u; i != 3u; i++) { n++; }", "a for loop that does not step towards its end in planted"),
        ("for (i = 0u; i < 3u; i--) { n++; }", "a for loop that does not step towards its end in planted"),
        ("for (i = 9u; i > 1u; i -= 3u) { n++; }", "a for loop that does not step towards its end in planted"),
        ("for (i = 0u; i < 9u; i += 0u) { n++; }", "a for loop that does not step towards its end in planted"),
        ("for (i = 0u; i < 9u; i += n) { n++; }", "a for loop that does not step towards its end in planted"),
        ("for (i = 0u; i < 9u; n++) { x += 1.0f; }", "a for loop that does not step towards its end in planted"),
        ("for (i = 9u; i >= 0u; i--) { n++; }", "a for loop that does not step towards its end in planted"),
        ("for (i = 0u; i < 9u; i++) { i = n; }", "a for loop whose body writes its counter in planted"),
        ("for (i = 0u; i < 9u; i++) { if (n > 2u) { i--; } }", "a for loop whose body writes its counter in planted"),
        ("for (i = 0u; i < 9u; i++) { uint32_t *p = &i; *p = n; }", "a for loop whose body writes its counter in planted"),
        ("float (*f)(float) = ars_pointer; x = f(x);", "a call of f in planted"),
        ("float (*f)(float) = ars_pointer; x = (*f)(x);", "a call of a pointer in planted"),
        ("x = somewhere(x);", "a call of somewhere in planted"),
    ],
)
def test_what_breaks_the_rule_is_found(statements: str, complaint: str) -> None:
    (found,) = planted(statements, "float ars_pointer(float x);\nfloat somewhere(float x);\n")
    place, _, told = found.partition(": ")
    assert told == complaint
    assert place.startswith("src/ars_limiter.c:")


@pytest.mark.parametrize(
    "statements",
    [
        "for (i = 0u; i < 9u; i++) { n++; }",
        "for (i = 8u; i > 0u; i >>= 1u) { n++; }",
        "for (i = 8u; i > 0u; i--) { n++; }",
        "for (i = 0u; i <= ((uint32_t)ARS_LIMITER_POINTS - 1u); i += 2u) { n++; break; }",
    ],
)
def test_what_keeps_it_is_not(statements: str) -> None:
    assert planted(statements) == ()


@pytest.mark.parametrize(
    ("count", "last", "found"),
    [("3u", "", 0), ("(uint32_t)x", "", 1), ("3u", "count = 1u;", 1)],
)
def test_a_bound_may_be_a_parameter_that_is_always_constant(count: str, last: str, found: int) -> None:
    helper = (
        "static uint32_t helper(uint32_t count)\n{\n    uint32_t k;\n    uint32_t n = 0u;\n"
        f"    for (k = 0u; k < count; k++) {{ n++; }}\n    {last}\n    return n;\n}}\n"
    )
    complained = planted(f"n = helper(2u) + helper({count});", helper)
    assert [each.partition(": ")[2] for each in complained] == ["a for loop to what is no constant in helper"] * found


def test_recursion_is_found() -> None:
    direct = "static float other(float x);\nstatic float other(float x)\n{\n    return planted(x);\n}\n"
    found = planted("x = other(x) + (float)n; i = 0u; (void)i;", "float planted(float x);\n" + direct)
    assert [each.partition(": ")[2] for each in found] == ["recursion, other -> planted -> other"]


def test_c_that_cannot_be_parsed() -> None:
    with pytest.raises(BuildError, match=r"^src/ars_limiter\.c: not plain C99: "):
        planted("n = = 1u;")

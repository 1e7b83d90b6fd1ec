"""Check of loops: every loop of the C has a fixed number of iterations."""

from collections import defaultdict

import pytest

from codegen.errors import BuildError
from codegen.verify.bounded_loops import complaints
from tests.verify import builds

PI = builds.made("pi", "uneven")
START, CONSTANT = "that does not start with counter = constant", "to what is no constant"
STEP = "that does not step towards its end"
COUNTER, BODY = "whose condition does not compare its counter", "whose body writes its counter"

REFUSED = {
    "while (n > 0u) { n--; }": "while",
    "again: if (n > 0u) { n--; goto again; }": "goto",
    "for (uint32_t k = 0u; k < 3u; k++) { n++; }": f"a for loop {START}",
    "for (i = n; i < 3u; i++) { x += 1.0f; }": "a for loop from what is no constant",
    "for (i = 0u; i < n; i++) { x += 1.0f; }": f"a for loop {CONSTANT}",
    "for (i = 0u; n < 3u; i++) { n++; }": f"a for loop {COUNTER}",
    "for (i = 0u; i != 3u; i++) { n++; }": f"a for loop {STEP}",
    "for (i = 0u; i < 9u; i += 0u) { n++; }": f"a for loop {STEP}",
    "for (i = 0u; i < 9u; n++) { x += 1.0f; }": f"a for loop {STEP}",
    "for (i = 9u; i >= 0u; i--) { n++; }": f"a for loop {STEP}",
    "for (i = 0u; i < 9u; i++) { i = n; }": f"a for loop {BODY}",
    "for (i = 0u; i < 9u; i++) { uint32_t *p = &i; *p = n; }": f"a for loop {BODY}",
    "float (*f)(float) = ars_pointer; x = f(x);": "a call of f",
    "x = somewhere(x);": "a call of somewhere",
    "x = other(x);": "",  # the recursion is reported once, from `other`
}
ACCEPTED = (
    "for (i = 0u; i < 9u; i++) { n++; }",
    "for (i = 8u; i > 0u; i >>= 1u) { n++; }",
    "for (i = 0u; i <= ((uint32_t)ARS_LIMITER_POINTS - 1u); i += 2u) { n++; break; }",
    "n = fixed(2u) + fixed(3u);",
)
"""Accepted code. The bound of the last one is a parameter that is constant in every call."""

HELPER = "static uint32_t {}(uint32_t m)\n{{\n    uint32_t k;\n    for (k = 0u; k < m; k++) {{ }}\n    {}\n    return k;\n}}\n"
BEFORE = (
    "float ars_pointer(float x);\nfloat somewhere(float x);\nfloat last(float x);\n"
    "static float other(float x)\n{\n    return last(x);\n}\n"
    + HELPER.format("fixed", "")
    + HELPER.format("varied", "")
    + HELPER.format("written", "m = 1u;")
)
AFTER = (
    "float last(float x)\n{\n    return other(x) + (float)varied((uint32_t)x) + (float)varied(2u) + (float)written(2u);\n}\n"
)


def planted(*statements: str) -> dict[str, list[str]]:
    """Return the findings by function: the limiter with one more function per statement, planted_0 and so on."""
    each = "float planted_{0}(float x)\n{{\n    uint32_t i;\n    uint32_t n = (uint32_t)x;\n    {1}\n    return x;\n}}\n"
    files = {path: content for path, content in PI.files.items() if path.startswith("include/")}
    middle = "".join(map(each.format, range(len(statements)), statements))
    text = PI.files["src/ars_limiter.c"].decode() + BEFORE + middle + AFTER
    found = defaultdict(list)
    for complaint in complaints(files | {"src/ars_limiter.c": text.encode()}, PI.manifest):
        place, _, what = complaint.partition(": ")
        assert place.startswith("src/ars_limiter.c:")
        what, _, function = what.rpartition(" in ") if " in " in what else (what, "", "recursion")
        found[function].append(what)
    return found


def test_every_loop_of_a_build_has_a_fixed_number_of_iterations() -> None:
    folder = builds.made("tracking", "uneven", layers=True)
    assert complaints(folder.files, folder.manifest) == ()


def test_only_unbounded_loops_are_found() -> None:
    found = planted(*REFUSED, *ACCEPTED)
    for number, (statement, complaint) in enumerate(REFUSED.items()):
        assert found.pop(f"planted_{number}", []) == [complaint] * bool(complaint), statement
    unbounded = [f"a for loop {CONSTANT}"]
    recursion = ["recursion, other -> last -> other"]
    assert found == {"varied": unbounded, "written": unbounded, "recursion": recursion}


def test_c_that_cannot_be_parsed() -> None:
    with pytest.raises(BuildError, match=r"^src/ars_limiter\.c: not plain C99: "):
        planted("n = = 1u;")

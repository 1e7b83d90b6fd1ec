"""`deviations.md` describes the files beside it; `tests/verify` compares it with the findings of analysers."""

import functools
from collections.abc import Mapping

import pytest

from codegen.config import Kind
from codegen.emit.deviations import CHECKER, ENTRIES, FILE, category_of, deviations, excerpt, read_deviations
from codegen.emit.misra_rules import ADVISORY, MANDATORY, RULES, category
from codegen.emit.text import Precision
from codegen.refmap.stack import solve_stack
from tests import builds
from tests.emit.rendered import EACH_KIND_AND_DOUBLE, KINDS, rendered


@functools.cache
def made(kind: Kind, precision: Precision = "single") -> Mapping[str, bytes]:
    """Files of a build. The map of kind "tracking" is uneven and for two frictions."""
    if kind != "tracking":
        return rendered(kind, precision).files
    config = builds.CONFIGS[kind]
    config = config.model_copy(update={"grid": config.grid.model_copy(update=builds.UNEVEN)})
    return builds.render(solve_stack(config, "4ws-2", (0.5, 0.9)), config, precision).files


@pytest.mark.parametrize(("kind", "precision"), EACH_KIND_AND_DOUBLE)
def test_each_row_names_a_line_of_the_build(kind: Kind, precision: Precision) -> None:
    files = made(kind, precision)
    rows = [row for _, row in read_deviations(files[FILE].decode("ascii"))]
    assert rows == list(deviations(files))
    places = [(row.file, row.line, row.rule) for row in rows]
    assert len(set(places)) == len(places)
    assert [(file, line) for file, line, _ in places] == sorted((file, line) for file, line, _ in places)
    for row in rows:
        line = files[row.file].decode("ascii").split("\n")[row.line - 1]
        assert row.code == excerpt(line)
        assert row.category == category_of(row.rule) != "mandatory"
        assert len(row.reason.split()) > 5


def test_every_entry_has_a_line_in_some_build() -> None:
    used = {row.rule for kind in KINDS for row in deviations(made(kind))}
    assert used == {entry.rule for entry in ENTRIES}


def test_the_table_holds_any_code() -> None:
    text = "    if ((a | b) && (c || d)) { e(); } " + 30 * "very_long_"
    files = {"src/ars_map.c": f"typedef union {{ int a; }} u_t;\nstatic const u_t x = {{ {text} }};\n".encode()}
    (row,) = [row for row in deviations(files) if row.line == 2 and row.rule == "19.2"]
    table = f"|---|---|---|---|---|---|\n{row.row}\n"
    assert read_deviations(table) == ((2, row),)
    assert "a \\| b" in row.row
    assert row.code.endswith("...")


@pytest.mark.parametrize("row", ["| src/a.c | x | 8.9 | advisory | `x` | because |", "| src/a.c | 1 | 8.9 | advisory | `x` |"])
def test_a_line_that_is_no_row_is_refused(row: str) -> None:
    with pytest.raises(ValueError, match="line 3"):
        read_deviations(f"# Title\n|---|\n{row}\n")


SOURCE = """/* static const float in_comment = 1.0f; */
ARS_SECTION_CONST static const float one = 1.0f;
ARS_SECTION_CONST static const float two = 2.0f;
ARS_SECTION_CONST
static const float table[2][3] = {
    { 1.0f }
};

ARS_SECTION_CODE static float first(
    const a_t *a, float x)
{
    return (a->two * one) + table[0][0] + x; /* two */
}

ARS_SECTION_CODE float ars_second(float x)
{
    return first(0, x) + one;
}
"""


def test_rules_about_names_cover_all_units() -> None:
    other = SOURCE.replace("ars_second", "ars_third").replace("one", "three") + "/* ars_second */\n"
    files = {"src/ars_one.c": SOURCE.encode(), "src/ars_two.c": other.encode()}

    def found(rule: str) -> list[tuple[str, int]]:
        return [(row.file.removeprefix("src/ars_"), row.line) for row in deviations(files) if row.rule == rule]

    assert found("5.9") == [("one.c", 3), ("one.c", 5), ("one.c", 9), ("two.c", 3), ("two.c", 5), ("two.c", 9)]
    assert found("8.7") == [("one.c", 15), ("two.c", 15)]
    assert found("8.9") == [("one.c", 5), ("two.c", 5)]
    files["src/ars_two.c"] += b"ARS_SECTION_CODE float ars_fourth(float x)\n{\n    return ars_second(x);\n}\n"
    assert found("8.7") == [("two.c", 15), ("two.c", 20)]


@pytest.mark.parametrize(
    ("chain", "lines"),
    [
        ("if (x > 1.0f) {\n} else if (x <= 1.0f) {\n} else {\n}\n", [2]),
        ("if (x >= (float)y) {\n} else if (z > y) {\n} else if (x < (float)y) {\n} else {\n}\n", [3]),
        ("if (x > 1.0f) {\n} else if (x < 1.0f) {\n} else {\n}\n", []),
        ("if (x > 1.0f) {\n}\nif (z > 1.0f) {\n} else if (x <= 1.0f) {\n}\n", []),
        ("if (x > 1.0f) {\n} else if (z <= 1.0f) {\n}\n", []),
    ],
)
def test_opposite_comparisons_of_a_chain(chain: str, lines: list[int]) -> None:
    found = deviations({"src/ars_one.c": chain.encode()})
    assert [(row.line, row.rule) for row in found] == [(line, "multiCondition") for line in lines]


def test_categories_of_rules() -> None:
    """With its amendments 1 to 4, MISRA C:2012 has 200 rules."""
    assert len(RULES) == 200
    assert not MANDATORY & ADVISORY
    assert set(RULES) >= MANDATORY | ADVISORY
    assert (category("17.3"), category("15.7"), category("15.5")) == ("mandatory", "required", "advisory")
    assert category_of("nullPointer") == CHECKER
    with pytest.raises(KeyError):
        category("99.1")

"""`[budgets]`: values, defaults, and their absence from a configuration that does not set them."""

from __future__ import annotations

import re
import tomllib
from typing import get_args

import pytest

from codegen.budget_sections import Budgets, MapShape
from codegen.config import Config, Kind, parse, preset, preset_text
from codegen.errors import ConfigError

PLAIN = MapShape()
KEYS = tuple(Budgets.model_fields)


@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_kind_has_every_budget_but_that_of_the_flash(kind: Kind) -> None:
    found = Budgets().resolved(kind, PLAIN)
    assert set(KEYS) - set(found) == {"flash_bytes_max"}
    assert all(value > 0 for value in found.values())


def test_a_map_that_is_more_work_may_take_more() -> None:
    """Lookups, and each function with one: by ten instructions a round of the search, and by the tables for several frictions
    and for the grip that slip leaves."""
    plain = Budgets().resolved("pi", PLAIN)
    uneven = Budgets().resolved("pi", MapShape(search_rounds=8))
    stacked = Budgets().resolved("pi", MapShape(search_rounds=8, frictions=4))
    gripping = Budgets().resolved("pi", MapShape(search_rounds=8, with_grip=True))
    more = {"lookup_instructions_max", "reference_instructions_max", "step_instructions_max", "task_instructions_max"}
    for found, by in ((uneven, 80), (gripping, 80 + 60)):
        assert {key: found[key] - plain[key] for key in plain} == {key: by if key in more else 0 for key in plain}
    # Where the car lies between two frictions, a reference is more work still.
    steered = {"reference_instructions_max": 20}
    assert {key: stacked[key] - plain[key] for key in plain} == {
        key: 80 + 100 + steered.get(key, 0) if key in more else 0 for key in plain
    }


@pytest.mark.parametrize(
    ("shape", "lookup", "reference"),
    [
        (MapShape(is_raw=True), 15, 30),
        (MapShape(is_raw=True, with_grip=True), 60 + 2 * 15, 60 + 3 * 15),
        (MapShape(is_raw=True, frictions=3), 90 + 2 * 15, 90 + 20 + 4 * 15),
        (MapShape(is_raw=True, frictions=3, with_grip=True), 90 + 60 + 30 + 4 * 15, 90 + 60 + 30 + 20 + 6 * 15),
    ],
)
def test_raw_numbers_take_a_conversion_for_each_table_and_layer(shape: MapShape, lookup: int, reference: int) -> None:
    for kind, step in (("pi", lookup), ("tracking", reference)):
        plain, found = Budgets().resolved(kind, PLAIN), Budgets().resolved(kind, shape)
        assert found["lookup_instructions_max"] - plain["lookup_instructions_max"] == lookup
        assert found["reference_instructions_max"] - plain["reference_instructions_max"] == reference
        assert found["step_instructions_max"] - plain["step_instructions_max"] == step


def test_a_given_budget_does_not_depend_on_the_map() -> None:
    budgets = Budgets(step_instructions_max=321, flash_bytes_max=65_536)
    found = budgets.resolved("pi", MapShape(search_rounds=8))
    assert (found["step_instructions_max"], found["flash_bytes_max"]) == (321, 65_536)
    assert found["lookup_instructions_max"] == 95 + 80


@pytest.mark.parametrize(
    ("line", "message"),
    [
        *(
            (f"lookup_instructions_max = {value}", r"budgets\.lookup_instructions_max: ")
            for value in ("0", "95.5", "true", '"95"')
        ),
        ("step_instruction_max = 5", r"budgets\.step_instruction_max: unknown key; did you mean 'step_instructions_max'\?$"),
    ],
)
def test_bad_budgets(line: str, message: str) -> None:
    with pytest.raises(ConfigError, match=rf"^ars\.toml: {message}"):
        parse(tomllib.loads(f"[budgets]\n{line}\n"), "ars.toml")


def test_a_configuration_without_budgets_of_its_own_is_written_without_them() -> None:
    """So what was made before there were any stays what it is, to the byte."""
    assert "budgets" not in preset().to_json()
    assert "budgets" not in Config().model_dump(mode="json")
    own = parse({"budgets": {"step_instructions_max": 321}}, "ars.toml")
    assert own != Config()
    assert parse(own.model_dump(mode="json"), "manifest.json") == own


def test_the_table_in_the_preset_is_that_of_the_code() -> None:
    """Its comment is a table of keys and kinds."""
    text = preset_text()
    header = next(line for line in text.splitlines() if '"tracking"   "pi"' in line)
    columns: list[list[Kind]] = [["tracking"], ["pi", "proportional"], ["feedforward"]]
    assert re.findall(r'"(\w+)"', header) == [kind for kinds in columns for kind in kinds]
    for key in KEYS:
        row = re.search(rf"^#   {key} +(\S+) +(\S+) +(\S+)", text, re.MULTILINE)
        assert row, key
        for stated, kinds in zip(row.groups(), columns, strict=True):
            for kind in kinds:
                value = Budgets().resolved(kind, PLAIN).get(key)
                # A kind without the function has no use for its budget.
                assert stated in ("-", "-" if value is None else f"{value:,}"), (key, kind)
                assert (stated == "-") == (value is None or (key.startswith("reference") and kind in ("pi", "proportional")))

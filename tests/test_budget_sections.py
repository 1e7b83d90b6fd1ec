"""`[budgets]`: values, defaults, and their absence from a configuration that does not set them."""

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


# Ten instructions a round of the search; a conversion for each table and layer of raw numbers; where the car lies between two
# frictions, a reference is more work still. A step looks up as its law does: the PI in the map, tracking through a reference.
@pytest.mark.parametrize(
    ("shape", "lookup", "reference"),
    [
        (MapShape(search_rounds=8), 80, 80),
        (MapShape(search_rounds=8, with_grip=True), 80 + 60, 80 + 60),
        (MapShape(search_rounds=8, frictions=4), 80 + 100, 80 + 100 + 20),
        (MapShape(is_raw=True), 15, 30),
        (MapShape(is_raw=True, with_grip=True), 60 + 2 * 15, 60 + 3 * 15),
        (MapShape(is_raw=True, frictions=3), 90 + 2 * 15, 90 + 20 + 4 * 15),
        (MapShape(is_raw=True, frictions=3, with_grip=True), 90 + 60 + 30 + 4 * 15, 90 + 60 + 30 + 20 + 6 * 15),
    ],
)
@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_a_map_that_is_more_work_may_take_more(shape: MapShape, lookup: int, reference: int, kind: Kind) -> None:
    plain, found = Budgets().resolved(kind, PLAIN), Budgets().resolved(kind, shape)
    step = lookup if kind == "pi" else reference
    more = {"lookup": lookup, "reference": reference, "step": step, "task": step}
    assert {key: found[key] - plain[key] for key in plain} == {
        key: more.get(key.removesuffix("_instructions_max"), 0) for key in plain
    }


def test_a_given_budget_does_not_depend_on_the_map() -> None:
    found = Budgets(step_instructions_max=321, flash_bytes_max=65_536).resolved("pi", MapShape(search_rounds=8))
    assert (found["step_instructions_max"], found["flash_bytes_max"]) == (321, 65_536)
    assert found["lookup_instructions_max"] == 95 + 80


@pytest.mark.parametrize(
    ("line", "message"),
    [
        *((f"lookup_instructions_max = {value}", r"budgets\.lookup_instructions_max: ") for value in ("0", "95.5", "true")),
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

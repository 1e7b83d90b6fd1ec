"""`sweep.toml`: the number of runs in its tables, and one line of error for each invalid one."""

import math
from pathlib import Path
from typing import Any

import pytest

from codegen.errors import ConfigError
from codegen.sweep.spec import load, parse

GOOD: dict[str, Any] = {"samples": 10, "controllers": {"pi": "build"}}
FACTORIAL = {"design": "factorial", "samples": None}


def tables(**changes: Any) -> dict[str, Any]:
    return {key: value for key, value in {**GOOD, **changes}.items() if value is not None}


def friction(value: Any) -> dict[str, Any]:
    return {"factors": {"friction": value}}


def test_runs_are_the_product_of_samples_scenarios_and_controllers() -> None:
    spec = parse(GOOD, "x")
    assert (spec.design, spec.seed, spec.scenarios, spec.run_count) == ("monte-carlo", 0, ["step-steer"], 10)
    controllers = {"pi": "a", "tracking": "b", "passive": ""}
    assert parse(tables(scenarios=["step-steer", "sine-with-dwell"], controllers=controllers), "x").run_count == 10 * 2 * 3
    factors = {"friction": [0.4, 0.6], "mass_percent": {"uniform": [-20, 20], "points": 5}, "delay_samples": 1}
    spec = parse(tables(**FACTORIAL, factors=factors), "x")
    assert spec.sample_count == 2 * 5
    assert spec.factors["mass_percent"].levels == [-20.0, -10.0, 0.0, 10.0, 20.0]


def test_the_order_of_keys_does_not_count() -> None:
    assert parse(GOOD, "x").digest() == parse(dict(reversed(GOOD.items())), "x").digest()
    assert parse(GOOD, "x").digest() != parse(tables(samples=4), "x").digest()


WHOLE_SEED = "seed: 9223372036854775808 is no whole number from 0 to 9223372036854775807; give one, without a point"
MISSPELT = "there is no factor 'mass_percnt'; did you mean 'mass_percent'?"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sampels": 5, "samples": None}, "sampels: unknown key; did you mean 'samples'?"),
        ({"samples": 0}, "samples: 0 is no whole number from 1 to 100000000; give one, without a point or an exponent"),
        ({"seed": 2**63}, WHOLE_SEED),
        (friction({"uniform": [0.4, 0.9], "points": 3}), "factors.friction.points is for a factorial design; remove it"),
        ({"samples": None}, "samples is missing; a monte-carlo design needs it"),
        ({"scenarios": ["step-steer", "step-steer"]}, "names one twice"),
        ({"controllers": {}}, "controllers: at least 1 entry needed, not 0; add what is missing"),
        ({"controllers": {"passive": ""}}, "controllers names no build"),
        ({"controllers": {"passive": "build"}}, 'write passive = ""'),
        ({"controllers": {"pi": "a", "own": ""}}, "a name without a folder"),
        ({"factors": {"mass_percnt": [1.0]}}, MISSPELT),
        (friction([90]), "friction is 90, outside 0.05 to 1.5; check the unit"),
        (friction([0.5, 90]), "friction reaches from 0.5 to 90, outside 0.05 to 1.5; check the unit"),
        (friction([math.nan]), "nan and inf are no values"),
        (friction({"uniform": [0.4, 0.5, 0.6]}), "at most 2 entries possible, not 3; remove some"),
        (friction(True), "a number is needed, not True"),
        (friction({"uniform": [0.9, 0.4]}), "uniform needs the lower end first"),
        (friction({"uniform": [0.4, 0.9], "values": [0.4]}), "exactly one of uniform, normal and values"),
        (friction({"normal": [0.8, 0.1]}), "goes with within"),
        (friction({"normal": [0.8, 0.0], "within": [0.4, 1.0]}), "a deviation above zero"),
        (friction({"normal": [0.8, 0.01], "within": [0.1, 0.2]}), "more than 4 deviations from the mean"),
        ({"factors": {"delay_samples": {"uniform": [0, 3]}}}, "delay_samples takes whole numbers"),
        ({"factors": {"steering_percent": 50, "steering_wheel_angle_deg": 20}}, "both set the amplitude"),
        ({"design": "factorial"}, "samples does not go with a factorial design"),
        ({**FACTORIAL, **friction({"uniform": [0.4, 0.9]})}, "no levels for a factorial design"),
    ],
)
def test_invalid_tables(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(tables(**changes), "sweep.toml")
    assert message in str(caught.value)
    assert str(caught.value).startswith("sweep.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"\xff\xfe", b"samples = ", b"a" * 2_000_000, None])
def test_files_that_cannot_be_read(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "sweep.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"sweep\.toml"):
        load(path)
    with pytest.raises(ConfigError, match="not a file"):
        load(tmp_path)

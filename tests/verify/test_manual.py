"""The safety manual: correct for every kind of map, precision and controller, with the results of the checks."""

import copy
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.map_file.map import from_arrays
from codegen.optimum.solve import solve_case
from codegen.verify import manual, record
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS, VerificationReport
from tests.verify import builds

COMMITTED = Path(__file__).parents[2] / "generated"
PI = builds.made("pi", "uneven").manifest
Manifest = Mapping[str, Any]
RECORD: Manifest = json.loads(Path(__file__).with_name("record.json").read_bytes())
"""Record of a full verification, of an older build of kind "tracking"."""


@pytest.mark.parametrize("name", ["4ws2-paper", "4ws2"])
def test_a_committed_record_is_of_the_committed_build(name: str) -> None:
    """A build that has changed since the last release has none: the full form of the evidence's part `builds` writes it."""
    folder = COMMITTED / name
    if (folder / "verify.json").exists():
        found, subject = json.loads((folder / "verify.json").read_bytes()), Subject.read(folder)
        assert found["build"]["manifest_sha256"] == subject.manifest_sha256
        assert (found["effort"], found["edited"], list(subject.edited)) == ("whole", [], [])
        assert {check["verdict"] for check in found["checks"].values()} == {"passed"}
        assert subject.manifest["build_id"] in (folder / "verify.md").read_text(encoding="ascii")


def test_every_check_has_its_tables() -> None:
    assert list(manual.FIGURE_TABLES) == [check.name for check in CHECKS]


def text_of(manifest: Manifest, **outcomes: Outcome) -> str:
    """Return the manual with its sentences on one line each."""
    named = {name.replace("_", "-"): outcome for name, outcome in outcomes.items()}
    report = VerificationReport(Subject("sample", {}, manifest, (), "0123abcd" * 8), Effort(), named)
    text = manual.manual(record.to_dict(report), manifest, record.CHECK_TITLES)
    assert text.isascii()
    assert "None" not in text, "a value that is missing"
    return text.replace("\n  ", " ")


SPEED, FRONT_ANGLE = np.linspace(5.0, 35.0, 7), np.radians(np.linspace(0.5, 8.0, 6))
"""18 to 126 km/h and 0.5 to 8 deg: not the grid of any preset."""
YAW_RATE = np.minimum(
    0.8 * SPEED[:, np.newaxis] * FRONT_ANGLE / (2.8 + 0.003 * SPEED[:, np.newaxis] ** 2), 7.0 / SPEED[:, np.newaxis]
)


def bare() -> Manifest:
    """Return the manifest of a build of a plain table."""
    table = from_arrays({"vx": SPEED, "delta_f": FRONT_ANGLE, "yaw_rate": YAW_RATE}, "bare.npz")
    return builds.build_of(table, builds.config_of("feedforward", "uneven")).manifest


def solved(**sections: dict[str, Any]) -> Manifest:
    """Return the manifest of a build of a solved map with some keys of its configuration changed."""
    config = builds.config_of("feedforward", "uneven").replace(sections)
    return builds.build_of(solve_case(config, builds.CASE), config, "map").manifest


def with_another_car() -> Manifest:
    config = builds.config_of("feedforward", "uneven")
    return builds.build_of(
        solve_case(config, builds.CASE), config.replace({"vehicle": {"mass_kg": 2500.0}}), "mine.toml"
    ).manifest


def placed() -> Manifest:
    """Return a manifest of `codegen build --max-error`: fewer breakpoints, and no rule per cell."""
    manifest = copy.deepcopy(dict(PI))
    for key in ("rules", "rule_by_speed_and_front_angle"):
        del manifest["map"][key]
    manifest["map"]["placement"] = PLACED
    return manifest


COVERS = "The optimisation covers 20 to 120 km/h and 0.1 to 10 deg at the front wheels"
PLACED = {"own_speed_range_m_s": [20 / 3.6, 120 / 3.6], "own_front_angle_range_rad": np.radians([0.1, 10.0]).tolist()}
OF_THE_MAP = ("for the car, tyres", "solved by the optimisation", "The optimisation covers")
UNCHECKED = "**It has not been checked that it fits the car** of the configuration "

TEXTS: dict[str, tuple[Callable[[], Manifest], tuple[str, ...], tuple[str, ...]]] = {
    "chosen breakpoints": (placed, (COVERS,), ("| cells |",)),
    "bare": (
        bare,
        (
            "The table covers 18 to 126 km/h and 0.5 to 8 deg at the front wheels",
            f"{UNCHECKED}of the preset (the paper's car)",
            "at most 7 m/s^2, the most that is in the table",
            "| given by the table |",
            "Where the table has no rear angles",
        ),
        OF_THE_MAP,
    ),
    "another car": (
        with_another_car,
        ("with the one in `mine.toml`: **that both describe the same car has not been checked.**",),
        ("for the car, tyres",),
    ),
    "stack": (
        lambda: builds.made("tracking", "uneven", layers=True).manifest,
        (
            "a stack for the peak frictions 0.3, 0.5, 0.7 and 0.9.",
            "below 0.3 the values are those of 0.3, and the bound decreases in proportion",
            "Without an estimate, or with a higher one, 0.9 is assumed.",
        ),
        ("The map assumes a peak friction",),
    ),
    "limiter slower than the law, actuator narrower": (
        lambda: solved(limiter={"rear_rate_max_deg_s": 20.0}, limits={"rear_angle_max_deg": 2.0}),
        ("by at most 20 deg/s in every status; the limiter enforces this.\n", "The command is within +-3.5 deg"),
        ("25 deg/s",),
    ),
    "no rate, and the reaction to loss": (
        lambda: solved(
            controller={
                "rear_rate_max_deg_s": "off",
                "fail_safe": {"degraded_samples_max": 0, "rate_deg_s": 5.0, "recovery_samples": 1},
            },
            limiter={"rear_rate_max_deg_s": "off"},
        ),
        (
            "The rate of the command is not limited in this build",
            "10 ms after the last good sample, with the first lost one, a signal counts as lost.",
            "it returns the command to zero by at most 5 deg/s, or faster where the limiter's bound requires it",
        ),
        (),
    ),
}
"""Manifest, texts that its manual contains, and texts that it does not contain."""


@pytest.mark.parametrize(("manifest", "present", "absent"), TEXTS.values(), ids=TEXTS)
def test_terms_of_use(manifest: Callable[[], Manifest], present: tuple[str, ...], absent: tuple[str, ...]) -> None:
    text = text_of(manifest())
    assert [part for part in present if part not in text] == []
    assert [part for part in absent if part in text] == []


def test_feedback_and_margin_are_those_of_the_kind() -> None:
    texts = {kind: text_of(builds.made(kind, "uneven").manifest) for kind in builds.KINDS}
    for part, kinds in {
        "This kind has no feedback": {"feedforward", "proportional"},
        "The stability margins assume an actuator lag": {"tracking", "pi"},
        "may exceed that bound by 15 %": {"tracking"},
        "The command of this kind depends on neither the map": {"proportional"},
    }.items():
        assert {kind for kind, text in texts.items() if part in text} == kinds, part
    assert not PI["margins"]["enough"]
    assert f"**The feedback of this build has little margin from {PI['margins']['warns_from_km_h']:g} km/h" in texts["pi"]


def section_of(name: str, figures: Manifest) -> str:
    """Return the results of a check in the manual."""
    text = text_of(PI, **{name: Outcome("It shows", "one", Verdict.PASSED, figures=figures)})
    return text.partition("Every figure is in")[2].partition("## Limitations")[0]


@pytest.mark.parametrize("name", [check.name for check in CHECKS])
def test_incomplete_figures_give_no_broken_table(name: str) -> None:
    """A check may end before its figures are known."""
    figures = RECORD["checks"][name]["figures"]
    for table in section_of(name, figures).split("\n\n"):
        lines = [line for line in table.splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in lines}) <= 1
        assert len(lines) != 2, "a table without a row"
    for other in ({}, *(dict.fromkeys(figures, value) for value in (None, 1.5, [[]], {"a": None}))):
        assert "|" not in section_of(name, other)

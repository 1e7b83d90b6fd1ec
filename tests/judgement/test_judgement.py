"""The judgement of a car: its verdict, where it is stored, and when it is valid."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.errors import CodegenError
from codegen.explore.explorer import Explorer
from codegen.judgement.drives import DwellFigures, Peaks, StepFigures
from codegen.judgement.facts import check_path
from codegen.judgement.judge import judge, sentence
from codegen.judgement.model import MISSING_RECORD, Judgement, Row, Stored, Verdict, of_manifest, of_map
from codegen.judgement.rows import dwell_rows, step_rows
from codegen.map_file import judged
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.report.html.page import Table, Text
from codegen.report.html.verdict import headline, judgement_blocks, tiles
from tests import builds, shared

from .test_steady import passive_map

GENERATED = Path(__file__).resolve().parents[2] / "generated"
FEEDFORWARD = builds.FEEDFORWARD_CONFIG


def judged_once(reference_map: ReferenceMap, config: Config) -> Judgement:
    """Return a judgement, made once per run."""
    found = shared.once(f"judge {judged.inputs_sha256(reference_map, config)}", lambda: judge(reference_map, config).to_dict())
    return Judgement.model_validate(found)


@pytest.fixture(scope="module")
def weak_map() -> ReferenceMap:
    """Return a map of 60 % of the yaw rates of the passive car, with feedforward alone."""
    return passive_map(FEEDFORWARD, factor=0.6)


@pytest.fixture(scope="module")
def weak(weak_map: ReferenceMap) -> Judgement:
    """Return the judgement of that car."""
    return judged_once(weak_map, FEEDFORWARD)


def test_a_car_that_turns_60_percent_of_passive_is_called_worse(weak: Judgement) -> None:
    assert weak.sentence.startswith("With the controller, this car is worse in largest lateral")
    faults = {row.key for row in weak.faults}
    assert faults >= {"lateral_acceleration", "yaw_rate_low", "step_yaw_rate", "dwell_displacement"}
    step = weak.row("step_yaw_rate")
    assert step is not None and step.value is not None and step.passive is not None
    assert step.value == pytest.approx(0.6 * step.passive, rel=0.02)  # the transients of the drive and the sample's delay
    assert "42.5 km/h" in step.at
    assert len(weak.warnings) == len(faults) and all(": " in text and "; required: " in text for text in weak.warnings)
    assert [tile.look for tile in tiles(weak)][:1] == ["bad"]


def test_every_quantity_has_its_worst_speed(weak: Judgement) -> None:
    for key in ("overshoot", "rise", "delay"):
        for quantity in ("yaw_rate", "lateral_acceleration"):
            row = weak.row(f"{key}_{quantity}")
            assert row is not None and "km/h" in row.at, (key, quantity)
        yaw_rate, lateral = weak.row(f"{key}_yaw_rate"), weak.row(f"{key}_lateral_acceleration")
        assert yaw_rate and lateral and yaw_rate.passive != lateral.passive
    assert {f"yaw_gain_{speed}" for speed in (60, 80, 120)} <= {row.key for row in weak.rows}
    assert weak.row("dwell_ratio_1_s") and weak.row("dwell_ratio_1.75_s")
    assert all(row.verdict == "stated" or row.required for row in weak.rows)


def test_the_worst_of_several_speeds_is_that_which_exceeds_passive_most() -> None:
    both = np.array([[3.0, 12.0, 30.0], [0.0, 1.0, 29.0]])
    quantities = {"yaw rate": both, "lateral acceleration": both[:, ::-1]}
    peaks = Peaks(*(np.zeros((2, 3)),) * 3)
    figures = StepFigures(
        np.array([60.0, 80.0, 120.0]), np.array([3.0, 2.0, 1.0]), both, both, quantities, {"yaw rate": 0.01 * both}, peaks
    )
    found = {row.key: row for row in step_rows(figures, 42.5)}
    assert set(found) == {"overshoot_yaw_rate", "overshoot_lateral_acceleration", "rise_yaw_rate"}
    overshoot = found["overshoot_yaw_rate"]
    assert (overshoot.value, overshoot.passive, overshoot.at) == (12.0, 1.0, "80 km/h, step of 2.0 deg")
    assert overshoot.verdict == "worse" and "80 km/h" in overshoot.warning
    assert found["rise_yaw_rate"].verdict == "worse"  # 0.12 s against 0.01 s


def test_a_straight_rear_axle_is_as_good_as_the_passive_car() -> None:
    """The feedforward on a map of the passive car itself leaves the rear wheels nearly straight."""
    found = judged_once(passive_map(FEEDFORWARD), FEEDFORWARD)
    assert {row.key for row in found.faults} <= {"lane_change_sideslip", "dwell_sweep"}
    for row in found.rows:
        if row.key.startswith(("step", "rise")):
            assert row.value == pytest.approx(row.passive, rel=0.1), row


def row(key: str, verdict: Verdict) -> Row:
    return Row(key=key, title=key, value=1.0, passive=2.0, unit="g", digits=0, required="more", verdict=verdict)


@pytest.mark.parametrize(
    ("own", "passive", "verdict"),
    [
        (10.0, 15.0, "equal"),  # within the criterion, and no better by more than the distance to it
        (30.0, math.inf, "better"),
        (36.0, 20.0, "worse"),
        (36.0, 40.0, "missed"),
        (math.inf, 20.0, "worse"),
        (math.inf, math.inf, "missed"),
    ],
)
def test_a_yaw_rate_ratio_is_judged_against_criterion_and_passive(own: float, passive: float, verdict: Verdict) -> None:
    peaks = Peaks(*(np.full((2, 4), 0.01),) * 3)
    ratios = {1.0: np.tile([[own], [passive]], 4), 1.75: np.zeros((2, 4))}
    found = [*dwell_rows(DwellFigures(np.full((2, 4), 2.5), 1.83, ratios, peaks))]
    assert [row.verdict for row in found] == ["equal", verdict, "equal"]
    assert found[1].value_text == ("spins" if own == math.inf else f"{own:.1f} %")


@pytest.mark.parametrize(
    ("own", "passive", "needed", "verdict"),
    [
        (2.12, 3.0, 1.83, "equal"),  # enough for every car
        (1.9, 1.95, 1.83, "equal"),  # 97 % of passive
        (1.9, 2.1, 1.83, "worse"),
        (1.6, 1.65, 1.83, "missed"),
        (1.6, 1.65, 1.52, "equal"),  # a heavy car
        (3.2, 2.5, 1.83, "better"),
    ],
)
def test_a_displacement_needs_the_standard_and_the_passive_car(own: float, passive: float, needed: float, verdict: str) -> None:
    peaks = Peaks(*(np.full((2, 4), 0.01),) * 3)
    ratios = {after: np.zeros((2, 4)) for after in (1.0, 1.75)}
    displacement, *_ = dwell_rows(DwellFigures(np.tile([[own], [passive]], 4), needed, ratios, peaks))
    assert displacement.verdict == verdict
    assert f"(reserve {own - needed:.2f} m)" in displacement.required


def test_the_sentence_names_faults_first_and_not_too_many() -> None:
    assert sentence([row("a", "equal")]) == "This car is as good with the controller as without, and not better."
    assert sentence([row("a", "better")]) == (
        "This car is better with the controller than without: in a 1 g (passive 2 g). "
        "It is nowhere worse beyond the tolerances."
    )
    many = [row(str(number), "worse") for number in range(9)]
    text = sentence([row("good", "better"), *many, row("limit", "missed")])
    assert text.startswith("With the controller, this car is worse in 0 1 g (passive 2 g), 1 1 g")
    assert " more and misses a criterion in limit 1 g (passive 2 g); it is better in good 1 g (passive 2 g)." in text
    assert "8 1 g" not in text


def test_a_stored_judgement_is_valid_for_its_inputs_only(weak_map: ReferenceMap, weak: Judgement, tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    npz.save(judged.with_judgement(weak_map.with_config(FEEDFORWARD), weak.to_dict()), path)
    read = npz.load(path)
    assert of_map(read, FEEDFORWARD).judgement == weak
    assert read.active is not None
    other_types = replace(read, active=read.active.astype(np.int64), yaw_rate=np.where(read.feasible, read.yaw_rate, -np.nan))
    assert of_map(other_types, FEEDFORWARD).state == "current"
    assert check_path(path).warnings[-len(weak.warnings) :] == weak.warnings

    rates = read.yaw_rate.copy()
    rates[2, 2] *= 1.0 + 1e-12
    heavier = FEEDFORWARD.replace({"vehicle.mass_kg": 2400.0})
    for stale in (of_map(replace(read, yaw_rate=rates), FEEDFORWARD), of_map(read, heavier)):
        assert (stale.state, stale.judgement) == ("out of date", None)
        assert "`codegen check --drive`" in stale.note
    npz.save(replace(read, yaw_rate=rates), path)
    found = check_path(path)
    assert found.facts["judgement"] == {"state": "out of date"}
    assert any("out of date" in note for note in found.notes)
    npz.save(judged.with_judgement(read, None), path)
    assert check_path(path).facts["judgement"] == {"state": "missing"}


@pytest.mark.parametrize("damage", ["text", {"rows": 3}, {"rows": [{"key": "a"}]}, {"sentence": None}])
def test_damaged_judgements_are_out_of_date(weak_map: ReferenceMap, weak: Judgement, damage: Any) -> None:
    content = {**weak.to_dict(), **damage} if isinstance(damage, dict) else damage
    assert of_map(judged.with_judgement(weak_map, content), FEEDFORWARD).state == "out of date"
    assert of_manifest({"judgement": content}).state == "out of date"


def test_a_build_takes_a_valid_judgement_along_and_its_c_does_not_change(weak_map: ReferenceMap, weak: Judgement) -> None:
    options, inputs = BuildOptions("weak"), BuildInputs("weak.npz", "0" * 64, "map")
    without = weak_map.with_config(FEEDFORWARD)
    with_one = judged.with_judgement(without, weak.to_dict())
    plain, found = (build(each, FEEDFORWARD, options, inputs) for each in (without, with_one))
    assert found.files == plain.files
    assert found.manifest["build_id"] == plain.manifest["build_id"]
    assert "judgement" not in plain.manifest and of_manifest(plain.manifest).state == "missing"
    assert of_manifest(found.manifest).judgement == weak
    assert of_manifest(found.manifest, is_edited=True).state == "out of date"
    older = {**weak.to_dict(), "definition": judged.DEFINITION_VERSION - 1}
    assert of_manifest({"judgement": older}).state == "out of date"
    stale = judged.with_judgement(with_one, {**weak.to_dict(), "inputs_sha256": "0" * 64})
    assert "judgement" not in build(stale, FEEDFORWARD, options, inputs).manifest


def test_the_report_leads_with_it(weak: Judgement) -> None:
    assert headline(Stored("current", weak)) == Text(weak.sentence)
    first = headline(MISSING_RECORD)
    assert first.kind == "notice" and "`codegen check --drive`" in first.text
    table, *texts = judgement_blocks(Stored("current", weak))
    assert isinstance(table, Table) and len(table.rows) == len(weak.rows)
    assert table.verdicts["worse"] == "bad" and "worse" in {cells[3] for cells in table.rows}
    assert any(isinstance(text, Text) and "rear angle 100 %" in text.text for text in texts)


def test_the_explorer_has_it_until_a_setting_moves(weak: Judgement) -> None:
    explorer = Explorer(builds.CONFIG, "4ws-2", "map", (), Stored("current", weak))
    shown = explorer.picture({"step.speed_km_h": 50.0})["judgement"]
    assert (shown["state"], shown["sentence"], len(shown["rows"])) == ("current", weak.sentence, len(weak.rows))
    moved = explorer.picture({"limits.sideslip_max_deg": 2.0})["judgement"]
    assert moved["state"] == "out of date" and "`codegen check --drive`" in moved["sentence"] and not moved["rows"]


def test_a_judgement_is_json_without_loss(weak: Judgement) -> None:
    assert Judgement.model_validate(json.loads(json.dumps(weak.to_dict(), allow_nan=False))) == weak


def test_without_gains_only_the_map_is_judged() -> None:
    config = builds.TRACKING_CONFIG.replace({"controller.tracking.schedule": None})
    found = judge(passive_map(config), config)
    assert any("no gains yet" in note for note in found.notes)
    assert found.row("yaw_rate_low") is not None and found.row("step_yaw_rate") is None


def test_a_bare_map_has_no_car_to_judge(tmp_path: Path) -> None:
    own = passive_map()
    np.savez(tmp_path / "bare.npz", vx=own.speed, delta_f=own.front_angle, yaw_rate=np.nan_to_num(own.yaw_rate))
    found = check_path(tmp_path / "bare.npz", drive=True)
    assert "judgement" not in found.facts
    assert any("no car to judge" in note for note in found.notes)


def test_drive_judges_a_build_by_its_own_c(tmp_path: Path, weak_map: ReferenceMap) -> None:
    """A build of another tool's table has no map: only drives are judged."""
    from codegen.emit.write import write_folder

    bare = ReferenceMap(weak_map.speed, weak_map.front_angle, weak_map.yaw_rate, weak_map.feasible)
    folder = tmp_path / "weak"
    write_folder(build(bare, FEEDFORWARD, BuildOptions("weak"), BuildInputs("weak.npz", "0" * 64, "ars.toml")), folder)
    found = check_path(folder, drive=True).facts["judgement"]
    keys = {each["key"] for each in found["rows"]}
    assert "step_yaw_rate" in keys and "yaw_rate_low" not in keys
    assert any("the map is not in the build" in note for note in found["notes"])
    with pytest.raises(CodegenError):
        check_path(tmp_path / "none.npz", drive=True)

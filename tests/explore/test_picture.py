"""What the page is shown, against what the project's own functions say of the same setting."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import pytest

from codegen.config import KM_H, preset
from codegen.design.margins import family_margins, nominal_margins
from codegen.emit.laws import law_of
from codegen.errors import CodegenError
from codegen.explore.explorer import Explorer
from codegen.explore.picture import binding_colours, figures
from codegen.refmap.map import Binding
from codegen.refmap.solve import solve_case
from codegen.report.html.maps import NamedMap, heat_maps
from codegen.report.map_plots import BINDING_COLOURS, OTHER_COLOURS
from codegen.report.style import GREY
from codegen.report.summary import binding_text
from codegen.vehicle.tyre import AxleTyres

MAP_KEYS = ("yaw_rate", "sideslip", "rear_angle", "binding")


def unpacked(table: dict[str, Any]) -> np.ndarray:
    kind = {"f4": "<f4", "u1": "u1"}[table["dtype"]]
    shape = [int(part) for part in table["shape"].split(",")]
    return np.frombuffer(base64.b64decode(table["bdata"]), dtype=kind).reshape(shape)


def test_the_map_is_the_one_that_codegen_solve_makes(pi: Explorer) -> None:
    moved = {"lambda": 150.0, "limits.sideslip_max_deg": 2.0}
    shown = pi.picture(moved)["map"]
    expected = solve_case(pi.configured(moved), pi.case)
    # Single precision of deg/s: 7 digits.
    np.testing.assert_allclose(unpacked(shown["yaw_rate"]), np.degrees(expected.yaw_rate).T, rtol=1e-6)
    np.testing.assert_allclose(unpacked(shown["rear_angle"]), np.degrees(expected.rear_angle).T, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(shown["speed_km_h"], expected.speed / KM_H, atol=1e-4)
    assert shown["feasible_percent"] == round(100.0 * expected.feasible.mean(), 1)


def test_what_binds_is_told_in_words_and_keeps_its_colour(tracking: Explorer) -> None:
    first = tracking.picture({})["map"]
    later = tracking.picture({"limits.sideslip_max_deg": 0.5, "limits.lateral_acceleration_max_g": 0.3})["map"]
    assert later["binding_names"][: len(first["binding_names"])] == first["binding_names"]
    expected = solve_case(
        tracking.configured({"limits.sideslip_max_deg": 0.5, "limits.lateral_acceleration_max_g": 0.3}), tracking.case
    )
    cells = unpacked(later["binding"]).T
    assert expected.active is not None
    np.testing.assert_array_equal(cells == 255, ~expected.feasible)
    only = "lateral acceleration"
    np.testing.assert_array_equal(
        cells == later["binding_names"].index(only), expected.feasible & (expected.active == Binding.LATERAL_ACCELERATION)
    )
    assert (cells == later["binding_names"].index(only)).any()
    assert later["binding_colours"][: len(first["binding_names"])] == first["binding_colours"]


@pytest.mark.parametrize("moved", [{}, {"limits.sideslip_max_deg": 0.5, "limits.lateral_acceleration_max_g": 0.3}])
def test_what_binds_has_the_colours_of_the_report(tracking: Explorer, moved: dict[str, float]) -> None:
    shown = tracking.picture(moved)["map"]
    own = dict(zip(shown["binding_names"], shown["binding_colours"], strict=True))
    solved = solve_case(tracking.configured(moved), tracking.case)
    chart = next(each for each in heat_maps(NamedMap("map", solved)).charts if each.name == "map-binding")
    theirs = {trace["name"]: trace["marker"]["color"] for trace in chart.figure["data"] if trace.get("mode") == "markers"}
    assert len(theirs) > 1
    # Sets without a colour of their own take turns: in the report by the map, in the explorer from its beginning on.
    fixed = {binding_text(flags) for flags in BINDING_COLOURS} if moved else set(theirs)
    assert fixed & set(theirs)
    assert {name: own[name] for name in theirs if name in fixed} == {name: theirs[name] for name in theirs if name in fixed}


def test_sets_without_a_colour_of_their_own_take_the_report_s_others_in_turn_and_keep_them() -> None:
    single = [int(Binding.NONE), int(Binding.SLIP_REAR)]
    without = [flags for flags in range(256) if flags not in BINDING_COLOURS][: len(OTHER_COLOURS) + 1]
    assert binding_colours(single) == [BINDING_COLOURS[flags] for flags in single]
    known = [without[0], *single, *without[1:]]
    colours = binding_colours(known)
    assert [colours[known.index(flags)] for flags in without] == [*OTHER_COLOURS, GREY]
    assert binding_colours(known[:4]) == colours[:4]


@pytest.mark.parametrize(
    ("key", "value", "parts"),
    [
        ("lambda", 100.0, {"map", "cut", "step"}),
        ("limits.sideslip_max_deg", 1.0, {"map", "cut"}),
        ("limits.lateral_acceleration_max_g", 0.3, {"map", "cut", "step"}),
        ("limits.rear_angle_max_deg", 0.5, {"map", "cut", "step"}),
        ("limits.slip_departure_percent", 4.0, {"map", "cut", "step"}),
        ("road.friction", 0.5, {"map", "cut", "step", "margins"}),
        ("controller.integral_gain", 0.4, {"step", "margins"}),
        ("controller.proportional_gain_s", 0.1, {"step", "margins"}),
        ("step.speed_km_h", 70.0, {"cut", "step"}),
        ("step.angle_deg", 45.0, {"cut", "step"}),
        ("step.road_percent", 60.0, {"step"}),
    ],
)
def test_each_setting_changes_what_it_should_and_nothing_else(pi: Explorer, key: str, value: float, parts: set[str]) -> None:
    before, after = pi.picture({}), pi.picture({key: value})
    changed = {part for part in ("map", "cut", "step", "margins") if json.dumps(before[part]) != json.dumps(after[part])}
    assert changed == parts


def test_the_beginning_is_shown_beside_and_stays(pi: Explorer) -> None:
    begun = pi.picture({})
    moved = pi.picture({"lambda": 100.0, "controller.integral_gain": 0.4})
    assert moved["step"]["runs"]["start"] == begun["step"]["runs"]["now"]
    assert moved["cut"]["start"] == begun["cut"]["now"]
    assert moved["margins"]["start"] == begun["margins"]["now"]
    assert moved["step"]["runs"]["passive"] == begun["step"]["runs"]["passive"]


@pytest.mark.parametrize(
    "moves",
    [
        ({"road.friction": 0.7}, {"road.friction": 0.5}),
        ({"step.speed_km_h": 60.0}, {"step.speed_km_h": 80.0}),
        ({"step.angle_deg": 60.0}, {"step.angle_deg": 30.0}),
        ({"step.road_percent": 80.0}, {"step.road_percent": 60.0}),
        ({"controller.integral_gain": 0.4}, {"controller.integral_gain": 0.2}),
    ],
    ids=lambda moves: next(iter(moves[0])),
)
def test_nothing_is_shown_of_the_move_before(pi: Explorer, moves: tuple[dict[str, float], dict[str, float]]) -> None:
    """Two moves: the first leaves the start, and all that is kept is made anew; what is kept too long shows at the second."""
    before, after = (pi.picture(moved) for moved in moves)
    fresh = Explorer(pi.start, pi.case, "fresh").picture(moves[1])
    for part in ("cut", "step", "margins"):
        assert after[part] == fresh[part], part
    assert before["step"] != after["step"]


def test_the_peak_of_the_rear_angle_is_that_of_its_magnitude(pi: Explorer) -> None:
    signs = []
    for speed in (30.0, 100.0):  # against the front wheels, and with them
        shown = pi.picture({"step.speed_km_h": speed, "step.angle_deg": 30.0})["step"]
        angles = np.array(shown["runs"]["now"]["rear_angle_deg"])
        largest = angles[np.abs(angles).argmax()]
        signs.append(np.sign(largest))
        # Three digits of the figure, four of the curve.
        assert shown["figures"]["now"]["rear_angle_peak_deg"] == pytest.approx(abs(largest), abs=6e-4)
    assert signs == [-1.0, 1.0]


def test_the_paper_s_step_has_the_paper_s_figures(pi: Explorer) -> None:
    figures = pi.picture({})["step"]["figures"]
    # The cap of the map: (slip bound of the tyre over slip for each m/s^2) / speed, which the PI follows to the end.
    tyres = AxleTyres.from_config(pi.start)
    assert tyres.front_slip_bound > 0.0
    cap = pi.calibration(pi.start).total.lateral_acceleration_cap / (42.5 * KM_H)
    # An integrator: after 3 s the error is gone but for some 0.1 %.
    assert np.radians(figures["now"]["yaw_rate_steady_deg_s"]) == pytest.approx(cap, rel=5e-3)
    assert figures["passive"]["rear_angle_peak_deg"] == 0.0
    assert figures["passive"]["sideslip_peak_deg"] > figures["now"]["sideslip_peak_deg"]


def test_a_step_that_does_not_settle_has_no_steady_figures() -> None:
    """A yaw rate that still rises at the end: a tenth in its last second."""
    time = 0.01 * np.arange(2_000)
    record = np.zeros((time.size, 12))
    record[:, 0], record[:, 3] = time, np.where(time > 10.0, 0.3 + 0.03 * (time - 10.0), 0.0)
    shown = figures(record, preset())
    assert (shown["settled"], shown["yaw_rate_steady_deg_s"], shown["overshoot_percent"], shown["rise_time_s"]) == (
        *(False, None, None, None),
    )
    record[:, 3] = np.where(time > 10.0, 0.3, 0.0)
    assert figures(record, preset())["settled"] is True


def test_a_car_that_spins_has_no_figures(pi: Explorer) -> None:
    shown = pi.picture({"road.friction": 0.5, "step.speed_km_h": 70.0, "step.road_percent": 50.0})
    assert {"spins": True} in shown["step"]["figures"].values()
    json.dumps(shown, allow_nan=False)


def test_margins_are_those_of_the_configured_car(tracking: Explorer) -> None:
    moved = {"proportional_percent": 130.0}
    shown = tracking.picture(moved)["margins"]["now"]
    config = tracking.configured(moved)
    gains = law_of(config).gains(config)
    assert gains is not None
    speed = np.array(shown["speed_km_h"]) * KM_H
    expected = nominal_margins(config, speed, *gains(speed))
    # Two digits of km/h are sent: 1e-4 of a speed at the least, and margins change no faster than a few percent for each.
    np.testing.assert_allclose(shown["gain_db"], expected.gain_margin_db, rtol=1e-3)
    np.testing.assert_allclose(shown["phase_deg"], expected.phase_margin_deg, rtol=1e-3)
    assert shown["worst"]["gain_db"] == pytest.approx(min(shown["gain_db"]), abs=0.01)
    assert (shown["asked_gain_db"], shown["asked_phase_deg"]) == (8.0, 45.0)


def test_the_family_s_margins_are_those_of_codegen_tune(tracking: Explorer) -> None:
    shown = tracking.family({}, lambda: False)
    assert shown is not None
    gains = law_of(tracking.start).gains(tracking.start)
    assert gains is not None
    speed = np.array(shown["speed_km_h"])[[0, -1]] * KM_H
    expected, _ = family_margins(tracking.start, speed, *gains(speed))
    np.testing.assert_allclose(np.array(shown["gain_db"])[[0, -1]], expected.gain_margin_db, rtol=1e-3)
    # The tuned gains keep what was asked for, up to the end of the map.
    assert min(shown["gain_db"]) >= 8.0
    assert min(shown["phase_deg"]) >= 45.0
    assert shown["cars"] == 243


def test_the_family_s_margins_are_left_where_nobody_waits_for_them(tracking: Explorer) -> None:
    asked: list[int] = []

    def is_stale() -> bool:
        asked.append(len(asked))
        return len(asked) > 2

    assert tracking.family({}, is_stale) is None
    assert len(asked) == 3


def test_a_law_without_feedback_has_no_margins(pi: Explorer) -> None:
    start = pi.start
    without = Explorer(
        start.model_copy(update={"controller": start.controller.model_copy(update={"kind": "feedforward"})}), pi.case, "small"
    )
    shown = without.picture({"lambda": 500.0})
    assert shown["margins"] is None
    assert not [control for control in without.controls if control.group == "controller"]


def test_limits_that_leave_no_turn_are_one_line_and_the_next_picture_is_as_good_as_ever(pi: Explorer) -> None:
    grid = pi.start.grid.model_copy(update={"front_angle_min_deg": 4.0, "speed_min_km_h": 60.0})
    coarse = Explorer(pi.start.model_copy(update={"grid": grid}), pi.case, "coarse")
    before = coarse.picture({})
    with pytest.raises(CodegenError, match="no operating point of the grid is feasible"):
        coarse.picture({"limits.lateral_acceleration_max_g": 0.05})
    after = coarse.picture({})
    assert {**after, "took_ms": None} == {**before, "took_ms": None}

"""The test suite: its cells and plants compared with the physics, its figures, and drives with the PI.

The whole suite runs in `tests/evidence/drives/test_suite_drives.py`.
"""

import json
import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.errors import CodegenError, ConfigError
from codegen.optimum import exact
from codegen.optimum.problem import SteadyTurnProblem
from codegen.units import KM_H
from codegen.vehicle.dynamics import single_track, two_track
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import AxleTyres
from hil_sim import second_plant
from hil_sim.metrics import column
from hil_sim.scenarios import PATH_SCENARIOS
from hil_sim.second_plant.run import STEER_TIME as SECOND_STEER_TIME
from hil_sim.suite import cells as changes
from hil_sim.suite import tracking
from hil_sim.suite.cells import (
    CELL_ANGLE_SHARES,
    CELL_DURATION,
    CELL_SPEEDS_KM_H,
    CELL_STEER_TIME,
    COMBINED,
    NOMINAL,
    Cell,
    c1,
    cells,
    conditions,
    lags,
)
from hil_sim.suite.controller_properties import (
    SETTLING_TIME_S,
    TIMINGS,
    FamilyMargins,
    MarginPoint,
    TimingError,
    compare_rise,
    margins_of,
    rise_times,
    sine_tracking,
    timing_errors,
)
from hil_sim.suite.full_suite import third_party_cells
from hil_sim.suite.requirements import Limits, Measured, all_passed, car_requirements, requirements
from hil_sim.suite.runs import CellResult, drive, judge, map_yaw_rate, run_table, software_of, summarise
from hil_sim.suite.subjects import Subject, around, around_folder, passive_of
from hil_sim.suite.tracking import SuiteResult, run_suite
from tests import builds
from tests.hil_sim.made import record, spun

CONFIG = builds.CONFIG
CASE = CONFIG.case("4ws-2")
LAGS, CONDITIONS = lags(CONFIG.rear_actuator.lag_s), conditions(CONFIG)


@pytest.fixture(scope="module")
def pi() -> Subject:
    """Return the paper's controller with its map."""
    return Subject("pi", CONFIG, around(builds.paper_map(), CONFIG))


def test_cells_are_six_speeds_by_four_amplitudes_on_the_grid() -> None:
    problem, found = SteadyTurnProblem.from_config(CONFIG, CASE), cells(CONFIG, CASE)
    assert [(cell.speed_km_h, cell.share) for cell in found] == [
        (speed, share) for speed in CELL_SPEEDS_KM_H for share in CELL_ANGLE_SHARES
    ]
    largest = [cell for cell in found if cell.share == 1.0]
    # At 25 km/h the grid ends (10 deg) before the feasible range; at higher speeds the edge is the last feasible angle.
    assert largest[0].front_angle_deg == pytest.approx(10.0, rel=1e-12)
    for cell in largest[1:]:
        around_edge = np.deg2rad(cell.front_angle_deg * np.array([1.0 - 1e-9, 1.0 + 1e-9]))
        solution = exact.solve(problem, np.array([cell.speed_km_h * KM_H]), around_edge)
        assert solution.feasible[0].tolist() == [True, False]
    assert [cell.front_angle_deg / largest[-1].front_angle_deg for cell in found[-4:]] == pytest.approx(
        CELL_ANGLE_SHARES, rel=1e-12
    )
    assert (c1(CONFIG).speed_km_h, c1(CONFIG).front_angle_deg) == (42.5, pytest.approx(6.75))
    for other, speeds in (
        ({"grid.speed_max_km_h": 70.0}, {25.0, 42.5, 60.0}),
        ({"vehicle.top_speed_km_h": 90.0}, {25.0, 42.5, 60.0, 80.0}),
        ({"grid.speed_max_km_h": 150.0}, {*CELL_SPEEDS_KM_H, 140.0, 150.0}),
        ({"vehicle.top_speed_km_h": 150.0}, {*CELL_SPEEDS_KM_H}),  # the map ends below
    ):
        assert {cell.speed_km_h for cell in cells(CONFIG.replace(other), CASE)} == speeds
    assert {cell.speed_km_h for cell in cells(CONFIG, CASE, (60.0, 130.0))} == {60.0}  # those that a caller lists
    slower = CONFIG.replace({"grid": {"speed_min_km_h": 10.0, "speed_max_km_h": 24.0}})
    with pytest.raises(CodegenError, match="ends at 24 km/h"):
        cells(slower, CASE)


def test_a_cell_is_a_step_at_the_steering_wheel() -> None:
    inputs = Cell(80.0, 3.0).scenario(CONFIG, 0.6, 0.8).inputs(CONFIG)
    assert len(inputs) == round(CELL_DURATION / 1e-3)
    before, after = inputs[round(CELL_STEER_TIME / 1e-3) - 1], inputs[round(CELL_STEER_TIME / 1e-3)]
    assert after == pytest.approx(
        [80.0 * KM_H, math.radians(40.0), 0.6, 0.8, 0.0, 0.0, 0.0]
    )  # 3 deg at the wheels: 40 at the steering wheel
    assert before[1] == 0.0
    assert np.isnan(Cell(80.0, 3.0).scenario(CONFIG).inputs(CONFIG)[0, 3])


def test_lags_follow_the_car() -> None:
    slow = CONFIG.replace({"rear_actuator.lag_s": 0.09})
    names = [each.name for each in conditions(slow) if each.group == "lag"]
    assert names == [each.name for each in lags(0.09)] == ["lag-36", "lag-90", "lag-180"]
    assert [each.plant(slow).rear_actuator.lag_s for each in lags(0.09)] == [0.036, 0.09, 0.18]
    assert COMBINED.plant(slow).rear_actuator.lag_s == 0.18
    assert [each.name for each in LAGS] == ["lag-20", "lag-50", "lag-100"]  # the paper's car


def test_load_sensitivity_and_relaxation() -> None:
    """`tests/sweep` compares the other changes with the cars of a campaign; one condition has all of them."""
    own = changes.together(changes.load_sensitivity(-0.1), changes.relaxation(0.6))
    others = changes.together(
        changes.mass(20.0), changes.stiffness(-20.0, -20.0), changes.peak(-10.0), changes.actuator_lag(2.0)
    )
    assert COMBINED.plant(CONFIG) == changes.together(others, own)(CONFIG)
    car = own(CONFIG)
    varied, nominal = AxleTyres.from_config(car), AxleTyres.from_config(CONFIG)
    for tyre, base in ((varied.front, nominal.front), (varied.rear, nominal.rear)):
        load = base.static_load
        assert tyre.cornering_stiffness == pytest.approx(base.cornering_stiffness, rel=1e-12)
        assert tyre.peak(load, 0.9) == pytest.approx(base.peak(load, 0.9), rel=1e-12)  # it acts only away from the static load
        assert tyre.peak(1.5 * load, 0.9) == pytest.approx(0.95 * base.peak(1.5 * load, 0.9), rel=1e-12)
    assert car.plant.relaxation_length_m == 0.6
    with pytest.raises(ConfigError, match=r"varied plant.*mass_kg"):  # impossible for a car
        changes.mass(-95.0)(CONFIG)


def test_the_ideal_plant_and_both_kinds_of_road() -> None:
    parts = {"relaxation_length_m": 0.4, "roll_deg_per_g": 4.0, "actuator_motor_share": 0.5, "backlash_deg": 0.1}
    parts |= {"rear_relaxation_factor": 1.2, "slippery_stiffness_share": 0.5, "command_delay_samples": 1}
    car = CONFIG.replace({"plant": parts})
    assert all(getattr(car.plant, key) == value for key, value in parts.items())
    assert changes.ideal(car) == changes.ideal(CONFIG)
    by_name = {each.name: each for each in conditions(car)}
    assert by_name["ideal"].plant(car) == changes.ideal(car)
    for name, stiffness_share in (("friction-40", 0.4 / 0.9), ("friction-40-stiff-exact", 1.0)):
        for slip, share in ((1e-6, stiffness_share), (0.5, 0.4 / 0.9)):  # where a tyre is linear, and where it slides
            model, lateral_speed = two_track(by_name[name].plant(CONFIG)), 20.0 * math.tan(slip)
            wet, dry = (
                float(model.derivative([lateral_speed, *[0.0] * 6], [20.0, 0.0, 0.0, friction, 0.0, 0.0])[0])
                for friction in (0.4, CONFIG.road.friction)
            )
            assert wet / dry == pytest.approx(share, rel=1e-6 if slip < 0.1 else 0.1)


def ramp_with_peak(sign: float = 1.0) -> np.ndarray:
    """Return a yaw rate that rises to 0.6 rad/s in half a second and falls to 0.5 in another."""
    return record(
        CELL_DURATION,
        yaw_rate_rad_s=lambda t: sign * np.interp(t, [1.0, 1.5, 2.0], [0.0, 0.6, 0.5]),
        sideslip_rad=lambda t: sign * np.interp(t, [1.0, 1.5, 2.0], [0.0, -0.03, 0.01]),
    )


def test_figures_of_a_run_made_by_hand() -> None:
    found = judge(ramp_with_peak(-1.0), Cell(42.5, 5.0), "x", -0.4)
    # See the step response of test_metrics.
    times = (found.overshoot_percent, found.rise_time_s, found.settling_time_s)
    assert times == pytest.approx((20.0, 0.38, 0.95))
    assert found.settled and not found.spun
    assert found.sideslip_max_deg == pytest.approx(math.degrees(0.03))
    assert found.yaw_rate_steady_deg_s == pytest.approx(-math.degrees(0.5))
    assert (found.map_error_percent, found.map_overshoot_percent) == pytest.approx((25.0, 50.0))
    unknown = judge(ramp_with_peak(), Cell(42.5, 5.0), "x")
    assert (unknown.map_error_percent, unknown.map_overshoot_percent) == (None, None)
    creeping = record(CELL_DURATION, yaw_rate_rad_s=lambda t: 0.5 * (1.0 - np.exp(-4.0 * np.clip(t - 1.0, 0.0, None))))
    overshoot = judge(creeping, Cell(42.5, 5.0), "x").overshoot_percent
    assert overshoot == pytest.approx(0.0, abs=1e-6) and overshoot >= 0.0
    found = judge(spun(ramp_with_peak(), 5.0), Cell(42.5, 5.0), "x", 0.4)
    assert found.spun and found.spun_at_s == pytest.approx(4.0)
    figures = found.to_dict()
    assert {figures[name] for name in set(figures) - {"cell", "condition", "spun_at_s", "settled"}} == {None}


def result(share: float, **figures: Any) -> CellResult:
    times = {"rise_time_s": 0.3, "settling_time_s": 0.5, "spun_at_s": None, "settled": True}
    others = {"overshoot_percent": 1.0, "sideslip_max_deg": 1.0, "yaw_rate_steady_deg_s": 20.0}
    others |= {"map_error_percent": 0.0, "map_overshoot_percent": 1.0, "slip_percent": 90.0, "sideslip_excess_deg": 0.1}
    return CellResult(cell=Cell(60.0, 10.0 * share, share), condition="nominal", **{**times, **others, **figures})


OTHERS = ("cell", "condition", "spun_at_s", "settled", "yaw_rate_steady_deg_s")
FIGURES = tuple(field.name for field in fields(CellResult) if field.name not in OTHERS)
SPIN = result(1.0, spun_at_s=2.0, settled=False, **dict.fromkeys(FIGURES))
OSCILLATING = result(1.0, settled=False, settling_time_s=None)


def test_summary_names_the_worst_cell_of_each_figure() -> None:
    rows = [
        result(0.25, overshoot_percent=3.0),
        result(0.5, rise_time_s=0.7, map_error_percent=-10.0),
        result(0.75, settled=False, settling_time_s=None, sideslip_max_deg=4.0),
        SPIN,
    ]
    found, alone = summarise("pi", "nominal", rows), summarise("pi", "nominal", [SPIN])
    assert (found.cells, [cell.share for cell in found.spins], [cell.share for cell in found.unsettled]) == (4, [1.0], [0.75])
    assert found.overshoot_mean_percent == pytest.approx(5.0 / 3.0)  # of the three without a spin
    worst = {name: (getattr(found, name).value, getattr(found, name).cell.share) for name in FIGURES}
    figures = [(3.0, 0.25), (0.7, 0.5), (0.5, 0.25), (4.0, 0.75), (-10.0, 0.5), (1.0, 0.25), (90.0, 0.25), (0.1, 0.25)]
    assert worst == dict(zip(FIGURES, figures, strict=True))
    assert (alone.overshoot_mean_percent, alone.overshoot_percent, alone.settling_time_s) == (None, None, None)


def test_rise_times_exclude_spins() -> None:
    (row,) = rise_times("x", [result(0.5), result(0.75, rise_time_s=0.5), SPIN])
    assert (row.mean_s, row.largest_s) == (pytest.approx(0.4), 0.5)
    assert rise_times("x", [SPIN])[0].mean_s is None
    # They are compared only where neither car spins.
    ours, theirs = [result(0.5, rise_time_s=0.4), SPIN, result(1.0)], [result(0.5), result(0.75, rise_time_s=9.0), SPIN]
    (slower,) = compare_rise(ours, theirs)
    assert (slower.speed_km_h, slower.cells, slower.mean_s, slower.other_mean_s) == (60.0, 1, 0.4, 0.3)
    assert slower.difference_s == pytest.approx(0.1)
    assert compare_rise([SPIN], [result(0.75)]) == ()


def good() -> Measured:
    """Return the results of a controller that meets every limit."""
    rows = [result(share) for share in CELL_ANGLE_SHARES]
    points = tuple(MarginPoint(speed, 8.5, 46.0, 1.7, True) for speed in (20.0, 120.0))
    return Measured(
        summaries={condition.name: summarise("good", condition.name, rows) for condition in CONDITIONS},
        c1={lag.name: result(1.0) for lag in LAGS},
        margins=FamilyMargins(points),
        third_party=summarise("good", "third-party", rows),
        instructions=1040,
        timing={name: TimingError(2e-4, 0.01) for name in TIMINGS},
        path_errors=dict.fromkeys(PATH_SCENARIOS, (0.2, 0.2)),
        results=dict.fromkeys((condition.name for condition in CONDITIONS), rows),
    )


def with_rows(condition: str, *rows: CellResult) -> Measured:
    measured = good()
    return replace(measured, summaries={**measured.summaries, condition: summarise("good", condition, rows)})


def failing(measured: Measured) -> set[tuple[str, str]]:
    return {(row.subject_matter, row.figure) for row in requirements(measured) if row.passed is False}


def test_a_good_controller_passes_every_row() -> None:
    rows = requirements(good())
    assert all(row.passed for row in rows)
    assert [row.asked for row in rows[:3]] == ["at most 2 %", "at most 0.6 s", "at most 0.38 s"]
    slow = requirements(replace(good(), actuator_lag_s=0.1))
    assert [row.asked for row in slow[:3]] == ["at most 2 %", "at most 0.7 s", "at most 0.48 s"]
    assert {row.limit for row in slow if row.figure == "settling time to 2 %" and "C1" not in row.subject_matter} == {1.2}
    # 3 lags of C1, 3 plants of 4 rows, error to the map and slip of 1, 2 other actuators, 3 margins,
    # 2 of the third party, 11 of slippery roads of each kind, 2 timings, 2 paths, 1 count.
    assert len(rows) == 9 + 12 + 2 + 2 + 3 + 2 + 2 * 11 + 2 + 2 + 1
    # A value equal to its limit passes despite rounding: 1.6 - 1.0 > 0.6, as computed for a settling time.
    assert failing(replace(good(), c1={lag.name: result(1.0, settling_time_s=1.6 - 1.0) for lag in LAGS})) == set()


CAR_FIGURES = ("spins in 1 cells", "overshoot", "settling time to 2 %")
SIDESLIP_EXCESS = "|sideslip| beyond its bound"
NOMINAL_CELLS, SLIPPERY_CELLS = "all cells, as configured", "friction 0.4, no estimate"


@pytest.mark.parametrize(
    ("condition", "rows", "wanted"),
    [
        ("nominal", [result(1.0, overshoot_percent=3.1)], {(NOMINAL_CELLS, "overshoot")}),
        ("mass-plus-20", [result(1.0, settling_time_s=1.12)], {("all cells, mass +20 %", "settling time to 2 %")}),
        ("mass-minus-20", [result(1.0, sideslip_excess_deg=0.3)], {("all cells, mass -20 %", SIDESLIP_EXCESS)}),
        ("friction-60", [result(1.0, sideslip_max_deg=3.6)], {("friction 0.6, no estimate", "|sideslip|")}),
        ("friction-40-wrong", [result(1.0, sideslip_max_deg=5.6)], {("friction 0.4, estimated 0.6", "|sideslip|")}),
        (
            "friction-60-stiff",
            [result(1.0, sideslip_max_deg=3.6)],
            {("friction 0.6, stiff, no estimate", "|sideslip|")},
        ),
        ("relaxation-600", [result(1.0, overshoot_percent=99.0)], set()),  # reported, without a limit
        ("nominal", [OSCILLATING], {(NOMINAL_CELLS, "settling time to 2 %")}),
        (
            "nominal",
            [SPIN],
            {(NOMINAL_CELLS, name) for name in ("spins in 2 cells", "overshoot", "settling time to 2 %", SIDESLIP_EXCESS)},
        ),
        # At friction 0.4 without an estimate one spin of 24 is allowed; nothing else has a limit there.
        ("friction-40", [result(1.0, sideslip_max_deg=9.0, overshoot_percent=99.0)], set()),
        ("friction-40", [SPIN], set()),
        ("friction-40", [SPIN, SPIN], {(SLIPPERY_CELLS, "spins in 3 cells")}),
    ],
)
def test_each_figure_out_of_bounds_is_found(condition: str, rows: list[CellResult], wanted: set[tuple[str, str]]) -> None:
    assert failing(with_rows(condition, result(0.5), *rows)) == wanted


def test_a_random_car_has_limits_on_both_plants() -> None:
    good_cells, spun = (summarise("tracking", "x", rows) for rows in ([result(1.0)], [SPIN]))
    steady = summarise("tracking", "x", [result(1.0, map_error_percent=9.0)])
    for summaries, missed in (
        ({"nominal": good_cells, "roll": good_cells, "ideal": spun}, set()),
        ({"nominal": good_cells, "roll": steady}, set()),  # its tyres are not those of the map
        ({"nominal": steady, "roll": good_cells}, {"|error to the map|, steady"}),
        ({"nominal": good_cells, "roll": spun}, {f"{name}, roll plant" for name in CAR_FIGURES}),
    ):
        rows = car_requirements("car 1", summaries, None, Limits())
        assert {row.figure for row in rows if row.passed is False and not row.stretch} == missed


def test_missed_stretch_goals_and_missing_measurements_do_not_fail() -> None:
    rows = requirements(with_rows("nominal", result(1.0, slip_percent=102.0, map_error_percent=-1.1)))
    missed = [(row.figure, row.stretch) for row in rows if row.passed is False]
    assert missed == [("|error to the map|, steady", True), ("slip of its bound, steady", True)]
    assert all_passed(rows)
    # In step 2e-4 rad/s: 1.05 times that and one code of 2e-4 rad/s are 4.1e-4.
    uneven = {**good().timing, "free-running clocks": TimingError(4.2e-4, 0.01)}
    assert failing(replace(good(), timing=uneven)) == {("yaw moment, free-running clocks", "yaw-rate error, rms")}
    for own, note in ((0.201, ""), (None, "the car spins")):
        paths = {**good().path_errors, "slalom": (own, 0.2)}
        (row,) = [row for row in requirements(replace(good(), path_errors=paths)) if row.passed is False]
        assert (row.subject_matter, row.measured, row.note) == ("slalom, with a driver", own, note)
    measured = replace(good(), c1={**good().c1, "lag-50": OSCILLATING})
    (row,) = [row for row in requirements(measured) if row.passed is False]
    assert (row.subject_matter, row.measured, row.note) == ("C1, actuator lag 50 ms", None, "it does not settle")
    assert {(row.passed, row.note) for row in requirements(Measured({}, {}, None))} == {(None, "not measured in this run")}


@pytest.mark.parametrize(("own", "feedforward", "limit"), [(5.1, 6.6, 5.0), (9.1, 12.0, 9.0), (9.1, None, 5.0)])
def test_with_another_lag_the_overshoot_is_compared_with_the_feedforward(
    own: float, feedforward: float | None, limit: float
) -> None:
    """The cell is the one furthest beyond its limit; a feedforward that spins does not raise the limit."""
    rows = [result(0.5, overshoot_percent=5.0), result(1.0, overshoot_percent=own)]
    others = [result(0.5), result(1.0, overshoot_percent=feedforward)]
    measured = replace(good(), results={**good().results, "lag-100": rows}, feedforward={"lag-100": others})
    (row,) = [row for row in requirements(measured) if row.passed is False]
    assert (row.subject_matter, row.note) == ("all cells, actuator lag 100 ms", rows[1].cell.title)
    assert (row.measured, row.limit) == (own, limit)
    assert failing(with_rows("lag-100", result(0.5), SPIN)) == {("all cells, actuator lag 100 ms", "overshoot")}
    step = replace(good(), c1={**good().c1, "lag-100": result(1.0, overshoot_percent=2.9)})
    assert failing(step) == {("C1, actuator lag 100 ms", "overshoot")}
    assert failing(replace(step, feedforward_c1={"lag-100": result(1.0, overshoot_percent=4.0)})) == set()


def test_margins_name_the_speed_and_an_unstable_loop() -> None:
    weak = FamilyMargins((MarginPoint(20.0, 9.0, 44.0, 1.7, True), MarginPoint(120.0, 7.9, 50.0, 1.9, True)))
    rows = {row.figure: row for row in requirements(replace(good(), margins=weak)) if row.passed is False}
    assert {figure: (row.measured, row.note) for figure, row in rows.items()} == {
        "gain margin": (7.9, "at 120 km/h"),
        "phase margin": (44.0, "at 20 km/h"),
        "peak sensitivity": (1.9, "at 120 km/h"),
    }
    lost = FamilyMargins((MarginPoint(20.0, 9.0, 46.0, 1.7, True), MarginPoint(120.0, 0.0, 0.0, None, False)))
    assert lost.sensitivity is None
    assert lost.speed_of("sensitivity") == 120.0
    assert {row.note for row in requirements(replace(good(), margins=lost)) if row.passed is False} == {"an unstable loop"}
    # JSON has no infinity. A PI without integral part may never cross unit gain.
    loop = FamilyMargins((MarginPoint(20.0, math.inf, math.inf, 1.0, True),))
    row = next(row for row in requirements(replace(good(), margins=loop)) if row.figure == "phase margin")
    assert (row.measured, row.passed) == (math.inf, True)
    text = json.dumps([loop.to_dict(), row.to_dict()], allow_nan=False)
    assert json.loads(text)[0]["points"][0]["phase_margin_deg"] is None


def test_an_integral_on_the_measured_yaw_rate_tolerates_irregular_samples(pi: Subject) -> None:
    errors = timing_errors(pi)
    # The resolution of the yaw rate on the bus is 2e-4 rad/s; the passive car has 0.043 rad/s. The offset that was learned at
    # the onset of the moment, at most its bound, is unlearned in at least every other sample.
    inputs = pi.config.controller.inputs
    taught = math.radians(inputs.yaw_rate_offset_max_deg_s) * math.exp(
        -SETTLING_TIME_S / (2.0 * inputs.yaw_rate_correction_time_s)
    )
    assert list(errors) == list(TIMINGS) and all(error.settled_rad_s < 2e-4 + taught for error in errors.values())
    assert errors["0 and 2 frames in turn"].whole_rad_s > errors["in step"].whole_rad_s > 1e-3


def test_a_subject_keeps_its_controller_on_every_plant(pi: Subject, build_folder: Any) -> None:
    """The C is the same in every library, whether rendered in memory or read from a folder."""
    nominal, slow = software_of(pi, NOMINAL), software_of(pi, LAGS[2])
    assert software_of(pi, NOMINAL) is nominal
    assert slow.config.rear_actuator.lag_s > nominal.config.rear_actuator.lag_s
    assert len({software.parameters().rear_angle_error_max for software in (nominal, slow)}) == 1
    assert nominal.map_yaw_rate(20.0, 0.05) == slow.map_yaw_rate(20.0, 0.05)
    loaded = Subject("folder", CONFIG, around_folder(build_folder))
    assert np.array_equal(drive(loaded, NOMINAL, c1(CONFIG)), drive(pi, NOMINAL, c1(CONFIG)))


def test_parameters_and_one_sample_of_delay_reach_the_controller(pi: Subject) -> None:
    gentle = replace(pi, name="gentle", parameters={"integral_gain": 0.3})
    overshoots = [run_table(subject, [NOMINAL], [c1(CONFIG)])["nominal"][0].overshoot_percent for subject in (pi, gentle)]
    assert overshoots[1] < 0.5 * overshoots[0]
    with pytest.raises(ValueError, match="no parameter 'gain'"):
        run_table(replace(pi, parameters={"gain": 1.0}), [NOMINAL], [c1(CONFIG)])
    # The first nonzero command moves the rear axle one period later than without delay, and later on a bus with more.
    slow_bus = replace(NOMINAL, plant=lambda config: config.replace({"plant.command_delay_samples": 4}))
    late, prompt = drive(pi, NOMINAL, c1(CONFIG)), drive(pi, NOMINAL, c1(CONFIG), delay_samples=0)
    moved = [int(np.flatnonzero(column(made, "rear_angle_rad"))[0]) for made in (late, prompt, drive(pi, slow_bus, c1(CONFIG)))]
    assert moved[0] == moved[1] + 1 and moved[2] == moved[1] + 4


def test_road_and_estimate_reach_plant_and_controller(pi: Subject) -> None:
    cell = Cell(60.0, 4.0)
    references = {}
    for name in ("nominal", "friction-40", "friction-40-exact"):
        condition = next(each for each in CONDITIONS if each.name == name)
        references[name] = map_yaw_rate(pi, condition, cell)
        made = column(drive(pi, condition, cell), "yaw_rate_reference_rad_s")
        assert made[-1] == pytest.approx(references[name], rel=1e-5)  # single precision
    assert references["friction-40"] == references["nominal"]
    assert references["friction-40-exact"] < 0.6 * references["nominal"]
    passive_runs = [drive(passive_of(pi), each, cell) for each in CONDITIONS if each.name in ("nominal", "friction-40")]
    largest = [float(np.abs(column(made, "lateral_acceleration_m_s2")).max()) for made in passive_runs]
    assert largest[1] < 0.4 * 9.81 < largest[0]


CHOSEN = tuple(each for each in CONDITIONS if each.name in ("nominal", "friction-60"))


@pytest.fixture(scope="module")
def suite(pi: Subject) -> SuiteResult:
    """Return the results of the paper's PI and the passive car in three cells under two conditions."""
    seen: list[tuple[str, int, int]] = []
    three = [cell for cell in cells(CONFIG, CASE) if (cell.speed_km_h, cell.share) in ((25.0, 1.0), (60.0, 0.75), (120.0, 1.0))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracking, "cells", lambda config, case: tuple(three))
        found = run_suite(pi, [], CASE, chosen=CHOSEN, progress=lambda *step: seen.append(step))
    assert [(done, total) for _, done, total in seen] == [(k, 2) for k in range(2)]
    with pytest.raises(ValueError, match="two subjects have one name: pi, pi"):
        run_suite(pi, [replace(pi)], CASE, chosen=[])
    return found


def test_the_papers_pi(suite: SuiteResult) -> None:
    """The overshoot on the paper's step is 15, 17 and 19 %; a prototype of the same loop had 15, 17 and 18 %."""
    overshoots = [suite.c1["pi"][lag.name].overshoot_percent for lag in LAGS]
    assert overshoots == pytest.approx([15.3, 17.3, 18.8], abs=0.1)
    assert [suite.c1["pi"][lag.name].map_error_percent for lag in LAGS] == pytest.approx([0.0] * 3, abs=1e-2)
    assert suite.c1["passive"]["lag-50"].overshoot_percent < 0.01
    # Worst of all cells: the prototype had 174 %.
    worst = suite.summary("pi", "nominal").overshoot_percent
    assert worst is not None
    assert worst.value == pytest.approx(139.7, abs=3.0)
    assert (worst.cell.speed_km_h, worst.cell.share) == (120.0, 1.0)
    assert suite.summary("pi", "friction-60").spins
    times = [row.mean_s for row in suite.rise_times["pi"]]
    assert times == sorted(times, reverse=True)
    assert not suite.passed
    found = {passed: {row.subject_matter for row in suite.requirements if row.passed is passed} for passed in (False, None)}
    assert {"C1, actuator lag 50 ms", "all cells, as configured", "margins over the family"} <= found[False]
    assert {"all cells, mass +20 %", "third party's plant", "Cortex-M4F"} <= found[None]


def test_margins_of_the_pi_fall_with_speed_and_a_law_without_feedback_has_none() -> None:
    one_car = {"actuator_lag_s": [0.05], "mass_percent": [0.0], "stiffness_percent": [0.0], "relaxation_length_m": [0.0]}
    config = CONFIG.replace({"tuning": one_car})
    found = margins_of(config, (20.0, 80.0, 120.0))
    assert found is not None
    # The published gains with 50 ms of lag and a sample of delay: 82 deg/30 dB, 43/12, 24/7.8 as rounded.
    assert [point.phase_margin_deg for point in found.points] == pytest.approx([82.0, 43.0, 24.0], abs=0.6)
    assert [point.gain_margin_db for point in found.points] == pytest.approx([30.0, 12.0, 7.8], abs=0.6)
    assert (found.gain_margin_db, found.speed_of("gain_margin_db")) == (found.points[-1].gain_margin_db, 120.0)
    own, worst = ([point.phase_margin_deg for point in points] for points in (found.configured, found.points))
    assert own == pytest.approx(worst, rel=1e-9)  # a family with one member
    assert margins_of(CONFIG.replace({"controller": {"kind": "feedforward"}})) is None
    fast, slow = ({"tuning": one_car, "grid.speed_max_km_h": top} for top in (160.0, 90.0))
    speeds = [[point.speed_km_h for point in made.points] for one in (fast, slow) if (made := margins_of(CONFIG.replace(one)))]
    assert [each[-3:] for each in speeds] == [[140.0, 150.0, 160.0], [70.0, 80.0, 90.0]]


def test_sine_of_the_passive_car_is_that_of_linear_theory(pi: Subject) -> None:
    passive, largest, speed = passive_of(pi), cells(CONFIG, CASE)[19], 100.0 * KM_H
    a, b = (np.array(matrix) for matrix in single_track(CONFIG, "linear").jacobian([0, 0], [speed, 0, 0, 0.9]))

    def response(frequency: float) -> complex:
        """Return the linear passive car's yaw rate over front angle, relative to its steady value."""
        dynamic = np.linalg.solve(2j * math.pi * frequency * np.eye(2) - a, b[:, 1])
        return complex(dynamic[1] / np.linalg.solve(-a, b[:, 1])[1])

    def lag(frequency: float) -> complex:
        return 1.0 + 2j * math.pi * frequency * CONFIG.steering.lag_s

    lowest = abs(response(0.2) / lag(0.2))
    driven = [Cell(42.5, 6.0, 1.0), Cell(60.0, 6.0, 1.0), Cell(100.0, 1.2, 0.25), largest]
    slower, rows = (found := sine_tracking(passive, driven))[:3], found[3:]
    assert [(row.speed_km_h, row.frequency_hz) for row in rows] == [(100.0, f) for f in (0.5, 1.0, 1.5)]
    assert {row.speed_km_h for row in slower} == {60.0}  # the two largest speeds
    # The passive car turns more than the map at 100 km/h by the ratio of their steady gains.
    small = Cell(100.0, 0.1 * largest.front_angle_deg)
    gain = float(SingleTrack.from_config(CONFIG).yaw_gain(speed))
    of_map = map_yaw_rate(passive, NOMINAL, small) / math.radians(small.front_angle_deg)
    assert rows[0].gain_of_map == pytest.approx(rows[0].gain_of_steady * lowest * gain / of_map, rel=1e-2)
    for row in rows:
        # The recorded front angle already includes the steering's lag. Tyres at a tenth of the largest angle are slightly
        # nonlinear (measured: up to 0.07 % and 0.5 deg).
        assert row.gain_of_steady == pytest.approx(abs(response(row.frequency_hz)) / lowest, rel=1e-3)
        assert row.phase_deg == pytest.approx(math.degrees(np.angle(response(row.frequency_hz))), abs=0.6)


@pytest.mark.parametrize("controlled", [True, False])
def test_third_partys_cells_are_judged_by_the_same_figures(
    pi: Subject, controlled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A synthetic recording replaces its simulation, which has its own tests."""
    driven: list[tuple[bool, float]] = []

    def run(software: Any, config: Config, scenario: Any) -> np.ndarray:
        driven.append((software is not None, scenario.settings.speed_km_h))
        made = ramp_with_peak()
        made[:, 0] += SECOND_STEER_TIME - CELL_STEER_TIME
        return made

    monkeypatch.setattr(second_plant, "run", run)
    rows = third_party_cells(builds.paper_map(), CONFIG, software_of(pi, NOMINAL), controlled=controlled)
    assert driven == [(controlled, speed) for speed in (40.0, 70.0, 100.0) for _ in range(3)]
    assert [row.cell.share for row in rows[:3]] == [0.3, 0.6, 0.9]
    for row in rows:
        assert (row.overshoot_percent, row.rise_time_s) == pytest.approx((20.0, 0.38))
        assert row.map_error_percent == pytest.approx(100.0 * (0.5 / map_yaw_rate(pi, NOMINAL, row.cell) - 1.0), rel=1e-6)

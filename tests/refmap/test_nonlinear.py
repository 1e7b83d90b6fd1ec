"""The map on the plant's own steady turns: against a dense search, against IPOPT, and driven in closed loop."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.agreement import SAME
from benchmarks.dense_search import DenseSearch
from benchmarks.nonlinear_map import nonlinear
from benchmarks.random_cars import random_car, random_cells
from codegen import config as configuration
from codegen.config import KM_H, Config
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.evidence import excess_note
from codegen.emit.folder import Folder
from codegen.refmap import ipopt
from codegen.refmap.extend import extend
from codegen.refmap.map import Binding, ReferenceMap, load
from codegen.refmap.model_excess import model_excess
from codegen.refmap.nonlinear import NonlinearTurns
from codegen.refmap.place import Request
from codegen.refmap.problem import breakpoints
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import solve_stack
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop
from codegen.sil.software import RECORD_COLUMNS, compile_build
from codegen.vehicle.tyre import AxleTyres
from tests.refmap.cars import CASE

ROOT = Path(__file__).resolve().parents[2]
PAPER = configuration.preset()
CASES = ("fws", "4ws-1", "4ws-2")


@pytest.mark.parametrize("seed", range(4))
def test_against_a_dense_search(seed: int) -> None:
    """Another car for each seed; the benchmark does 2,000 cells. The tolerance is what is asked, far above what is seen."""
    rng = np.random.default_rng(100 + seed)
    config = random_car(rng)
    case = config.cases[CASE]
    turns, search = NonlinearTurns.from_config(config, case), DenseSearch.of(config, case)
    speed, front_angle = random_cells(turns, config, rng, 3)
    found = turns.at(speed, front_angle)
    for index in range(3):
        best = search.best(float(speed[index]), float(front_angle[index]))
        assert best.feasible == found.feasible[index], (config, speed[index], front_angle[index], best, found.margin[index])
        if best.feasible:
            assert abs(best.yaw_rate - found.yaw_rate[index]) < SAME


def test_stability_ends_the_curve_just_short_of_a_slip_bound() -> None:
    """A heavy car with a rear tyre that hardly rises at its bound: the samples at both sides of the limit are stable ones."""
    config = random_car(np.random.default_rng([1, 14]))
    case = config.cases[CASE]
    speed, front_angle = 135.163 / 3.6, math.radians(1.5787)
    best = DenseSearch.of(config, case).best(speed, front_angle)
    found = NonlinearTurns.from_config(config, case).at(np.array([speed]), np.array([front_angle]))
    assert found.active == 0  # no bound of the problem: the margin of stability
    assert abs(best.yaw_rate - float(found.yaw_rate[0])) < SAME


@pytest.mark.parametrize("case", CASES)
def test_against_ipopt(case: str) -> None:
    config = nonlinear(PAPER, case)
    turns = NonlinearTurns.from_config(config, config.case(case))
    speed, front_angle = (axis[::20] for axis in breakpoints(config))
    ours = turns.solve(speed, front_angle)
    peer = ipopt.solve(config, turns.problem, speed, front_angle, None, "magic-formula")
    assert np.array_equal(ours.feasible, peer.feasible)
    assert ours.feasible.sum() > 5
    # IPOPT ends within 1e-12 of its scaled variables.
    assert np.nanmax(np.abs(ours.yaw_rate - peer.yaw_rate)) < 1e-9


def made(case: str = "4ws-2") -> ReferenceMap:
    return solve_case(nonlinear(PAPER, case), case)


def test_slip_bounds_bind_and_are_kept_on_the_plant() -> None:
    """What the linear map lacks: the plant in steady state, at each optimum, by its own derivatives and slip outputs."""
    from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, two_track

    found = made()
    model, tyres = two_track(PAPER), AxleTyres.from_config(PAPER)
    assert model.output is not None
    cells = np.argwhere(found.feasible)[::23]
    assert found.sideslip is not None
    assert found.rear_angle is not None
    largest = np.zeros(2)
    for i, j in cells:
        x, u = np.zeros(len(PLANT_STATES)), np.zeros(len(PLANT_INPUTS))
        speed = found.speed[i]
        x[PLANT_STATES.index("lateral_speed")] = speed * math.tan(found.sideslip[i, j])
        x[PLANT_STATES.index("yaw_rate")] = found.yaw_rate[i, j]
        x[PLANT_STATES.index("steering_wheel_angle")] = found.front_angle[j] * PAPER.steering.ratio
        x[PLANT_STATES.index("rear_angle")] = found.rear_angle[i, j]
        u[PLANT_INPUTS.index("speed")], u[PLANT_INPUTS.index("friction")] = speed, PAPER.road.friction
        rate, told = np.asarray(model.derivative(x, u)).ravel(), np.asarray(model.output(x, u)).ravel()
        assert np.abs(rate[:2]).max() < 1e-8  # m/s^2, rad/s^2: forces of 10 kN to rounding
        slips = np.abs(told[-2:])
        assert (slips <= np.array([tyres.front_slip_bound, tyres.rear_slip_bound]) * (1.0 + 1e-9)).all()
        largest = np.maximum(largest, slips)
    assert (largest > 0.99 * np.array([tyres.front_slip_bound, tyres.rear_slip_bound])).all()
    assert found.active is not None
    assert (found.active[found.feasible] & (Binding.SLIP_FRONT | Binding.SLIP_REAR)).any()


def built(reference_map: ReferenceMap, config: Config, request: Request | None = None) -> Folder:
    return build(reference_map, config, BuildOptions("test", request=request), BuildInputs("test.npz", "0" * 64, "map"))


def steady_slips(folder: Folder, config: Config, speed: float, front_angle: float) -> np.ndarray:
    """Largest front and rear slip (rad) in steady state of a build on the plant: turned in slowly, then held."""
    software = compile_build(folder.files, folder.manifest)
    time = np.arange(0.0, 30.0, config.plant.sampling_time_s)
    inputs = np.zeros((time.size, len(INPUT_COLUMNS)))
    inputs[:, INPUT_COLUMNS.index("speed")] = speed
    wheel = front_angle * config.steering.ratio * np.clip(time / 10.0, 0.0, 1.0)
    inputs[:, INPUT_COLUMNS.index("steering_wheel_command")] = wheel
    inputs[:, INPUT_COLUMNS.index("friction")] = config.road.friction
    inputs[:, INPUT_COLUMNS.index("friction_estimate")] = math.nan
    record = ClosedLoop(software).run(inputs)[-200:]
    assert np.ptp(record[:, RECORD_COLUMNS.index("yaw_rate_rad_s")]) < 1e-4  # rad/s: settled
    columns = [RECORD_COLUMNS.index(name) for name in ("slip_front_rad", "slip_rear_rad")]
    return np.asarray(np.abs(record[:, columns]).max(axis=0))


SLIP_SHARE = 0.01
"""By which a driven car may exceed its bound: on the breakpoints driven here the table is exact, and what is left is single
precision and the residue of the settling."""


@pytest.mark.parametrize(("row", "share"), [(22, 0.99), (40, 0.95), (60, 0.95), (90, 0.9)])
def test_closed_loop_keeps_the_slip_bounds_in_steady_state(row: int, share: float) -> None:
    """On breakpoints near where the map ends; the linear map, on the same plant, exceeds its bound."""
    tyres = AxleTyres.from_config(PAPER)
    bounds = np.array([tyres.front_slip_bound, tyres.rear_slip_bound])
    found, config = made(), nonlinear(PAPER, "4ws-2")
    last = int(np.flatnonzero(found.feasible[row])[-1])
    column = int(share * last)
    speed, front_angle = float(found.speed[row]), float(found.front_angle[column])
    slips = steady_slips(built(found, config), config, speed, front_angle)
    assert (slips <= bounds * (1.0 + SLIP_SHARE)).all(), slips / bounds


def tracking(trim_percent: float | None = None) -> Config:
    """The recommended controller on the paper's car, with its tuned gains and the nonlinear tyre; by default its own trim."""
    tuned = load(ROOT / "generated/4ws2-tracking.npz").config
    assert tuned is not None
    data = nonlinear(tuned, "4ws-2").model_dump(mode="json")
    if trim_percent is not None:
        data["controller"]["tracking"]["trim_max_percent"] = trim_percent
    return configuration.parse(data, "test")


def test_kind_tracking_keeps_them_with_the_trim_that_the_build_asks_for() -> None:
    """At the operating point that is named; with the default trim the bound is exceeded there."""
    config = tracking()
    found = solve_case(config, "4ws-2")
    folder = built(found, config)
    named = re.search(r"trim_max_percent = (\d+) keeps them", excess_note(folder.manifest))
    assert named is not None
    place, tyres = folder.manifest["reference_model_excess"], AxleTyres.from_config(config)
    bounds = np.array([tyres.front_slip_bound, tyres.rear_slip_bound])
    speed, front_angle = place["at_km_h"] * KM_H, math.radians(place["at_front_angle_deg"])
    assert (steady_slips(folder, config, speed, front_angle) / bounds).max() > 1.0 + 2.0 * SLIP_SHARE
    enough = tracking(float(named[1]))
    mended = built(found, enough)
    assert mended.manifest["reference_model_excess"]["enough"] and excess_note(mended.manifest) == ""
    slips = steady_slips(mended, enough, speed, front_angle)
    assert (slips <= bounds * (1.0 + SLIP_SHARE)).all(), slips / bounds


@pytest.mark.parametrize(
    ("percent", "trim", "options", "told"),
    [
        (4.6, 5.0, {}, ""),
        (4.6, 10.0, {}, ""),
        (4.6, 20.0, {}, "5 % are enough on these breakpoints: controller.tracking.trim_max_percent = 5 has less overshoot"),
        (-2.0, 2.0, {}, ""),
        (-2.0, 3.0, {}, "controller.tracking.trim_max_percent = 1 has less overshoot"),
        (4.6, 1.0, {"max_error_rad_s": 0.01}, "controller.tracking.trim_max_percent = 5 keeps them, with more overshoot"),
        (20.5, 20.0, {"max_error_rad_s": None}, "no trim takes back so much, and a finer [grid], or codegen build --max-error"),
        (20.5, 20.0, {"max_error_rad_s": 0.01, "max_flash_bytes": 900}, "and a smaller --max-error brings"),
        (20.5, 20.0, {"max_error_rad_s": None, "max_flash_bytes": 900}, "and a larger --max-flash brings"),
    ],
)
def test_what_is_told_of_a_trim(percent: float, trim: float, options: dict[str, object], told: str) -> None:
    place = {"at_km_h": 120.0, "at_front_angle_deg": 4.3, "at_friction": 0.9}
    excess = {"percent": percent, **place, "trim_max_percent": trim, "enough": percent <= trim}
    note = excess_note({"reference_model_excess": excess, "options": options})
    assert told in note and bool(told) == bool(note)


def test_kind_tracking_keeps_them_on_chosen_breakpoints() -> None:
    """Beside the edge of the map, where the rear angle that the reference model takes from its table turns fastest."""
    config = tracking(5.0)
    found = solve_case(config, "4ws-2")
    folder = built(found, config, Request(math.radians(0.1), None, "int16", "--max-error 0.1deg/s --storage int16"))
    assert folder.manifest["reference_model_excess"]["enough"]
    tyres, turns = AxleTyres.from_config(config), NonlinearTurns.from_config(config, config.cases["4ws-2"])
    bounds = np.array([tyres.front_slip_bound, tyres.rear_slip_bound])
    for speed in np.array([70.0, 95.0, 110.0]) * KM_H:
        edge = float(turns.edge(np.array([speed])).front_angle[0])
        for share in (0.7, 0.9, 0.99):
            slips = steady_slips(folder, config, float(speed), share * edge)
            assert (slips <= bounds * (1.0 + SLIP_SHARE)).all(), (speed / KM_H, share, slips / bounds)


def test_every_friction_of_a_stack_is_asked() -> None:
    """On a slippery road the same error of a table is a larger part of what the map asks for."""
    config = tracking()
    stack = solve_stack(config, "4ws-2", [0.4, 0.9])
    total = extend(stack, config, config.steering.front_angle_stop)
    found = model_excess(stack, total, config)
    assert found.friction == 0.4
    alone = model_excess(replace(stack, layers=()), replace(total, layers=()), config)
    assert alone.friction == 0.9 and alone.percent < found.percent


def test_a_rear_angle_that_is_off_shows_as_an_excess() -> None:
    """The question is asked of the tables that the build holds, not of the map that was solved."""
    config = tracking()
    found = solve_case(config, "4ws-2")
    total = extend(found, config, config.steering.front_angle_stop)
    turned = replace(total, rear_angle=total.rear_angle - math.radians(0.2))
    assert model_excess(found, turned, config).percent > model_excess(found, total, config).percent + 1.0


def test_nothing_is_asked_of_other_maps_and_kinds() -> None:
    # Kind pi follows the map itself.
    assert "reference_model_excess" not in built(made(), nonlinear(PAPER, "4ws-2")).manifest
    config = load(ROOT / "generated/4ws2-tracking.npz").config
    assert config is not None
    linear = solve_case(config, "4ws-2")
    assert "reference_model_excess" not in built(linear, config).manifest
    total = extend(linear, config, config.steering.front_angle_stop)
    # The model does no more than a map of linear tyres asks for, but for what the last cell of the grid makes of its kink.
    assert model_excess(linear, total, config).percent <= config.controller.tracking.trim_max_percent == 1.0


def test_the_linear_map_exceeds_them() -> None:
    tyres = AxleTyres.from_config(PAPER)
    linear = solve_case(PAPER, "4ws-2")
    last = int(np.flatnonzero(linear.feasible[22])[-1])
    slips = steady_slips(built(linear, PAPER), PAPER, float(linear.speed[22]), float(linear.front_angle[last]))
    over = (slips / np.array([tyres.front_slip_bound, tyres.rear_slip_bound])).max()
    assert 1.10 < over < 1.25


def test_the_file_says_how_it_was_solved() -> None:
    found = made()
    assert found.meta["configuration"]["cases"]["4ws-2"]["tyre_model"] == "magic-formula"
    assert found.meta["method"] != "exact"
    assert "tyre_model" not in solve_case(PAPER, "4ws-2").meta["configuration"]["cases"]["4ws-2"]

"""Laws for the rear angle and the envelope, compared with an independent model, IPOPT and closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from codegen.configuration import REFERENCE_CASES, Case, Config, preset
from codegen.errors import ConfigError
from codegen.map_file import map as npz
from codegen.map_file.bounds import Binding
from codegen.optimum import exact, ipopt
from codegen.optimum.problem import SteadyTurnProblem, breakpoints
from codegen.optimum.solve import solve_case, solve_stack
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres
from tests.optimum.cars import PAPER, SteadyModel, changed, random_config

SMALL = {"speed_points": 6, "front_angle_min_deg": 0.5, "front_angle_points": 8}
WHEELBASE = REFERENCE_CASES["variable-wheelbase"]
TIGHT = {"envelope_rear_slip_deg": 3.0}
"""An envelope that the paper's car reaches: its own slip and rear angle bounds stay within 5.1 deg of rear slip."""


def wheelbase_case(*factors: float) -> Case:
    """Return a variable wheelbase with factors at the default speeds."""
    return Case(**{**WHEELBASE.model_dump(), "wheelbase_factor": list(factors)})


def wanted_rear_angle(model: SteadyModel, case: Case, speed: float, front_angle: float) -> float:
    """Return the rear angle of a law from the independent model alone: its turns are affine in the rear angle."""
    turns = model.turns(speed, front_angle, np.array([0.0, 1e-3]))
    if case.reference == "zero-sideslip":
        value, wanted = turns.sideslip, 0.0
    else:
        car, factors = model.problem.car, (case.wheelbase_speed_km_h, case.wheelbase_factor)
        factor = float(np.interp(speed / KM_H, *factors))  # type: ignore[arg-type]
        # Same tyres, and the arms of the virtual car: the understeer coefficient does not change.
        value, wanted = turns.yaw_rate, speed * front_angle / (factor * car.wheelbase + car.understeer_coefficient * speed**2)
    per_rear_angle = (value[1] - value[0]) / 1e-3
    limit = model.problem.rear_angle_max
    return float(np.clip((wanted - value[0]) / per_rear_angle, -limit, limit))


@pytest.mark.parametrize("name", ["zero-sideslip", "variable-wheelbase"])
def test_a_law_compared_with_the_independent_model(name: str) -> None:
    """The tolerances are rounding: 1e-9 rad of 0.1 rad. Cells with less than 1e-9 rad of margin may be either."""
    rng, counts = np.random.default_rng(20_261_127), np.zeros(3)
    for _ in range(40):
        config = random_config(rng, rear_steering=True)
        model = SteadyModel.of(config, config.case(name))
        speeds, angles = breakpoints(config)
        found = exact.solve(model.problem, speeds, angles)
        for i, j in np.ndindex(found.feasible.shape):
            rear_angle = wanted_rear_angle(model, config.case(name), speeds[i], angles[j])
            turns = model.turns(speeds[i], angles[j], np.array([rear_angle]))
            held = abs(rear_angle) == model.problem.rear_angle_max
            others = max(float(share[0]) for flag, share in turns.used.items() if flag is not Binding.REAR_ANGLE)
            if abs(others - 1.0) > 1e-9:
                assert found.feasible[i, j] == (others < 1.0)
            if found.feasible[i, j]:
                assert found.rear_angle[i, j] == pytest.approx(rear_angle, abs=1e-9)
                assert found.yaw_rate[i, j] == pytest.approx(turns.yaw_rate[0], abs=1e-9)
                assert found.sideslip[i, j] == pytest.approx(turns.sideslip[0], abs=1e-9)
                assert bool(found.active[i, j] & Binding.REAR_ANGLE) == held
            counts += (others < 1.0, others >= 1.0, others < 1.0 and held)
    assert (counts > 10).all()  # feasible, infeasible, and with the rear angle at its bound


def test_a_variable_wheelbase_turns_like_the_other_car() -> None:
    """The other car has both arms 1.3 times as long, and no rear steering."""
    vehicle = {key: 1.3 * getattr(PAPER.vehicle, key) for key in ("cg_to_front_axle_m", "cg_to_rear_axle_m")}
    fws = Case(rear_steering=False)
    longer = turns_of(changed(PAPER, vehicle=vehicle), fws)
    speed, front_angle = np.array([6.0, 12.0, 30.0]), np.radians([0.5, 1.0])
    found = turns_of(PAPER, wheelbase_case(1.3, 1.3, 1.3)).solve(speed, front_angle)
    assert found.feasible.all()
    np.testing.assert_allclose(found.yaw_rate, longer.solve(speed, front_angle).yaw_rate, rtol=1e-12)
    assert (found.rear_angle > 0.0).all()
    same = turns_of(PAPER, wheelbase_case(1.0, 1.0, 1.0)).solve(speed, front_angle)
    np.testing.assert_array_equal(same.yaw_rate, turns_of(PAPER, fws).solve(speed, front_angle).yaw_rate)
    # At walking pace it is geometry: the turning circle is that of the other wheelbase.
    slow = turns_of(PAPER, wheelbase_case(0.75, 0.75, 0.75)).solve(np.array([0.5]), front_angle)
    np.testing.assert_allclose(slow.rear_angle[0], (1.0 - 1.0 / 0.75) * front_angle, rtol=1e-4)  # K vx^2 / L is 1e-6


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
@pytest.mark.parametrize("name", REFERENCE_CASES)
def test_against_ipopt(name: str, tyre_model: str) -> None:
    """IPOPT finds the turn of the law as the nearest one inside the bounds; it converges to 1e-12 of its scaled variables."""
    config = changed(PAPER, grid=SMALL, limits=TIGHT).with_tyre_model(tyre_model)
    turns = turns_of(config, config.case(name))
    speed, front_angle = breakpoints(config)
    ours = turns.solve(speed, front_angle)
    peer = ipopt.solve(config, turns, speed, front_angle, None, tyre_model)  # type: ignore[arg-type]
    np.testing.assert_array_equal(ours.feasible, peer.feasible)
    np.testing.assert_array_equal(ours.active, peer.active)
    assert 10 < ours.feasible.sum() < ours.feasible.size
    assert np.nanmax(np.abs(ours.yaw_rate - peer.yaw_rate)) < 1e-9
    assert np.nanmax(np.abs(ours.rear_angle - peer.rear_angle)) < 1e-9


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
@pytest.mark.parametrize("name", ["zero-sideslip", "variable-wheelbase"])
def test_the_edge_is_where_the_law_leaves_a_bound(name: str, tyre_model: str) -> None:
    """1e-6 inside is feasible, 1e-6 outside infeasible; the edge of the nonlinear car is 1e-9 inside."""
    config = PAPER.with_tyre_model(tyre_model)
    turns, speed = turns_of(config, config.case(name)), np.array([20.0, 30.0, 45.0, 70.0, 110.0]) * KM_H
    edge = turns.edge(speed)
    inside, outside = (turns.at(speed, edge.front_angle * share) for share in (1.0 - 1e-6, 1.0 + 1e-6))
    assert inside.feasible.all() and not outside.feasible.any()
    np.testing.assert_allclose(inside.yaw_rate, edge.yaw_rate, rtol=1e-5)
    np.testing.assert_allclose(inside.rear_angle, edge.rear_angle, atol=1e-6)
    nearest = turns.at(speed, edge.front_angle * (1.0 - 1e-8)).active  # within the tolerance of the bound that ends the turns
    assert edge.grip_limited.any() and not edge.grip_limited.all()
    np.testing.assert_array_equal(edge.grip_limited, (nearest & (Binding.SLIP_FRONT | Binding.SLIP_REAR)) != 0)


def test_the_limits_of_the_envelope() -> None:
    """Peak slip by a scan of the force in steps of 1e-5 rad; the rear axle's steady capacity is mu p1 g at the static load."""
    config = changed(PAPER, tyre={"rear": {**PAPER.tyre.rear.model_dump(), "peak_factor_p1": 0.95}})
    problem = SteadyTurnProblem.from_config(config, config.case("envelope"))
    slips = np.arange(0.0, 0.3, 1e-5)
    force = AxleTyres.from_config(config).rear.force(slips)
    assert problem.envelope_rear_slip_max == pytest.approx(slips[force.argmax()], abs=1e-5)
    assert problem.envelope_lateral_acceleration_max == pytest.approx(0.9 * 0.95 * 9.81, rel=1e-12)
    tight = SteadyTurnProblem.from_config(changed(config, limits=TIGHT), config.case("envelope"))
    assert tight.envelope_rear_slip_max == math.radians(3.0)
    off = SteadyTurnProblem.from_config(changed(config, limits=TIGHT), config.case("4ws-2"))
    assert off.envelope_rear_slip_max == off.envelope_lateral_acceleration_max == math.inf


def test_the_envelope_of_the_papers_car_never_binds() -> None:
    """Its rear slip bound and rear angle bound add to less than the slip of the peak force."""
    config = changed(PAPER, grid=SMALL)
    plain, found = solve_case(config, "4ws-2"), solve_case(config, "envelope")
    problem = SteadyTurnProblem.from_config(config, config.case("envelope"))
    assert problem.rear_slip_max + problem.rear_angle_max < problem.envelope_rear_slip_max
    np.testing.assert_array_equal(found.yaw_rate, plain.yaw_rate)
    np.testing.assert_array_equal(found.active, plain.active)


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_a_tighter_envelope_bounds_the_rear_slip_with_straight_wheels(tyre_model: str) -> None:
    config = changed(PAPER, grid=SMALL, limits=TIGHT).with_tyre_model(tyre_model)
    found, plain = solve_case(config, "envelope"), solve_case(config, "4ws-2")
    assert found.sideslip is not None and found.active is not None
    rear = np.tan(found.sideslip) - config.vehicle.cg_to_rear_axle_m * found.yaw_rate / found.speed[:, np.newaxis]
    slip = np.abs(np.arctan(rear))
    binds = (found.active & Binding.ENVELOPE_SIDESLIP) != 0
    assert np.nanmax(slip) <= math.radians(3.0) * (1.0 + 2e-3)  # small angles of the linear car: 3 deg cubed over 3
    np.testing.assert_allclose(slip[binds], math.radians(3.0), rtol=2e-3)
    assert 1 < binds.sum() < found.feasible.sum() and found.feasible.sum() <= plain.feasible.sum()


@pytest.mark.parametrize("name", REFERENCE_CASES)
def test_a_map_holds_its_case(name: str) -> None:
    """Whoever loads it needs no table of this version; the bits of the envelope are named where it is on."""
    config = changed(preset("recommended"), grid=SMALL)
    made = solve_stack(config, name, (0.5, 0.9))
    found = npz.from_bytes(npz.to_bytes(made), "test")
    assert found.case == name and found.config is not None
    assert found.config.cases[name] == config.case(name)
    assert found.config.cases[name].tyre_model == "magic-formula" == found.layers[0].map.tyre_model
    assert found.config.cases.keys() == {*config.cases, name}
    assert ("envelope_sideslip" in found.meta["active_bits"]) == (name == "envelope")


def test_a_case_of_ones_own_replaces_it() -> None:
    own = {"zero-sideslip": {"reference": "zero-sideslip", "envelope": True}}
    config = changed(PAPER, cases=own)
    assert config.case("zero-sideslip").envelope and config.with_case("zero-sideslip") is config


BOTH = {"wheelbase_speed_km_h": [20.0, 60.0], "wheelbase_factor": [0.8, 1.0]}


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ({"reference": "zero-sideslip", "rear_steering": False}, "needs rear_steering = true"),
        ({"reference": "variable-wheelbase"}, "needs wheelbase_speed_km_h and wheelbase_factor; add both"),
        ({"reference": "variable-wheelbase", **BOTH, "wheelbase_factor": [1.0]}, "differ in length; give a factor for each"),
        ({"reference": "variable-wheelbase", **BOTH, "wheelbase_factor": [0.2, 1.0]}, "0.2 is outside 0.3 to 5"),
        ({"reference": "variable-wheelbase", **BOTH, "wheelbase_speed_km_h": [60.0, 20.0]}, "sort the list"),
        (BOTH, 'need reference = "variable-wheelbase"'),
        ({"reference": "zero-slip"}, "zero-sideslip"),
    ],
)
def test_cases_that_are_refused(case: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=r"^test: cases\.mine") as caught:
        changed(PAPER, cases={"mine": case})
    assert words in str(caught.value)


def test_a_virtual_car_that_is_unstable_is_refused() -> None:
    """With soft rear tyres; its critical speed is sqrt(s) times that of the car: vx^2 = s L / -K."""
    tyre = {"front": {"cornering_stiffness_n_per_rad": 120e3}, "rear": {"cornering_stiffness_n_per_rad": 90e3}}
    config: Config = changed(PAPER, tyre=tyre, grid={"speed_max_km_h": 130.0})
    critical = SteadyTurnProblem.from_config(config, config.case("4ws-2")).car.critical_speed / KM_H
    assert critical * math.sqrt(0.6) < 130.0 < critical * math.sqrt(0.9)
    turns_of(config, wheelbase_case(0.9, 0.9, 0.9))
    with pytest.raises(ConfigError, match=r"^wheelbase_factor: .* unstable at 130 km/h; raise the factors"):
        turns_of(config, wheelbase_case(0.9, 0.9, 0.6))

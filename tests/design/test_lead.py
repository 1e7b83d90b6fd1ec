"""Lead and response gain: the chosen pairs, simulated alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from codegen.configuration import Schedule, parse
from codegen.design import lead
from codegen.design.family import nominal
from codegen.design.lead import (
    DEVIATION_OVERSHOOT_PERCENT,
    LAG_OVERSHOOT_PERCENT,
    LEAD_ANGLE_SHARES,
    LEADS_S,
    OVERSHOOT_PERCENT,
    SETTLING_S,
    Response,
    compile_controller,
    family_of,
    tune_response,
    with_response,
)
from codegen.design.sampled import continuous
from codegen.design.tune import with_tracking
from codegen.units import KM_H
from codegen.vehicle.plant_car import PLANT_PARAMETERS
from hil_sim.suite.cells import NOMINAL, cells
from hil_sim.suite.runs import drive, judge
from hil_sim.suite.subjects import of_config
from tests import builds


def test_the_chosen_pairs_keep_their_limits_when_simulated_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rise times may differ by one sample, because the steady yaw rate is averaged over another second."""
    monkeypatch.setattr(lead, "RESPONSE_GAINS_S", (0.0, 0.1))
    monkeypatch.setattr(lead, "LEADS_S", LEADS_S[::2])
    monkeypatch.setattr("codegen.configuration.RESPONSE_AHEAD_FACTORS", (1.0,))
    schedule = Schedule(speed_km_h=[15.0, 60.0, 100.0], proportional_gain_s=[0.03, 0.06, 0.09], integral_gain=[1.7, 1.2, 0.8])
    config = with_tracking(builds.TRACKING_CONFIG, {"schedule": schedule}, "test")
    done: list[tuple[int, int]] = []
    software = compile_controller(builds.paper_map(), config)
    ahead, found = tune_response(builds.paper_map(), config, schedule, software, lambda *step: done.append(step))
    assert [one.speed_km_h for one in found] == [60.0, 100.0] and all(one.is_on_target for one in found)
    assert [step for step, _ in done] == list(range(1, done[0][1] + 1))
    changes = with_response(config, schedule, ahead, found)
    assert changes["response_ahead_s"] == ahead == 0.06
    assert changes["schedule"]["lead_s"] == [found[0].lead_s, found[0].lead_s, found[1].lead_s]
    rate = config.steering.wheel_rate_max_deg_s / config.steering.ratio
    assert max(np.abs(changes["schedule"]["lead_s"])) * rate <= changes["lead_max_deg"] <= 0.1 + LEADS_S[-1] * rate
    subject = of_config("tuned", builds.paper_map(), with_tracking(config, changes, "test"))
    for one in found:
        points, whole = (
            cells(config, config.case("4ws-2"), (one.speed_km_h,), LEAD_ANGLE_SHARES),
            np.ceil(100.0 * one.rise_s) / 100.0,
        )
        driven = [judge(drive(subject, NOMINAL, cell), cell, "x") for cell in points]
        assert max(result.rise_time_s or 9.0 for result in driven) == pytest.approx(whole, abs=0.011)
        assert max(result.overshoot_percent or 0.0 for result in driven) <= min(one.overshoot_percent + 0.2, OVERSHOOT_PERCENT)
        assert max(result.settling_time_s or 9.0 for result in driven) <= SETTLING_S + 0.011


@pytest.mark.parametrize(
    ("settling", "expected"), [("2.5 1.0 0.9", 0.06), ("2.6 1.0 0.9", 0.081), ("2.8 2.75 2.7 2.75", 0.105)]
)
def test_the_first_sufficient_look_ahead_is_chosen(monkeypatch: pytest.MonkeyPatch, settling: str, expected: float) -> None:
    tried = map(float, settling.split())
    monkeypatch.setattr(lead, "_pairs", lambda *_: (Response(60.0, 0.0, 0.0, 4.2, next(tried), 0.3, 4.0),))
    monkeypatch.setattr(lead._Search, "of", lambda *_: None)
    config = builds.TRACKING_CONFIG
    assert tune_response(builds.paper_map(), config, config.controller.tracking.schedule, None, None)[0] == expected


def test_measured_deviations_replace_stiffness_and_lag() -> None:
    """Both ends of each axis; masses stay, and so does the order of the rows."""
    keys = ["tyre.rear.cornering_stiffness_n_per_rad", "vehicle.yaw_inertia_kg_m2", "rear_actuator.lag_s"]
    table = {"keys": keys, "standard_deviations": [2_000.0, 100.0, 0.002], "correlations": np.eye(3).tolist()}
    table["interval_floor_percent"] = 0.0
    data = builds.TRACKING_CONFIG.model_dump(mode="json", exclude_none=True)
    own, limits = family_of(parse({**data, "identified": table}, "test"))
    plain, plain_limits = family_of(builds.TRACKING_CONFIG)
    assert np.array_equal(own[:3], plain[:3])
    front_grip = lead.FRONT_GRIP_OVERSHOOT_PERCENT
    assert limits.tolist() == [
        *plain_limits[:3],
        *[DEVIATION_OVERSHOOT_PERCENT] * 4,
        front_grip,
        *LAG_OVERSHOOT_PERCENT[:1] * 2,
    ]
    inertia, lag = (PLANT_PARAMETERS.index(name) for name in ("yaw_inertia", "rear_lag"))
    radius = chi2.ppf(0.99, 2) ** 0.5
    apart = own[3:7] - own[0]
    assert sorted(apart[:, inertia]) == pytest.approx([-100.0 * radius, 0.0, 0.0, 100.0 * radius], abs=1e-9)
    stiffness = PLANT_PARAMETERS.index("rear_stiffness_factor")
    slope = builds.TRACKING_CONFIG.tyre.rear.cornering_stiffness_n_per_rad
    assert max(own[3:7, stiffness]) / own[0, stiffness] == pytest.approx(1.0 + 2_000.0 * radius / slope)
    for name in ("front_stiffness_factor", "front_peak_factor"):
        factor = own[7, PLANT_PARAMETERS.index(name)] / own[0, PLANT_PARAMETERS.index(name)]
        assert factor == pytest.approx(lead.FRONT_GRIP_FACTOR), name
    assert (own[8:, lag] - own[0, lag]).tolist() == pytest.approx([step * chi2.ppf(0.99, 1) ** 0.5 * 0.002 for step in (-1, 1)])


@pytest.mark.parametrize("grid", [{}, {"speed_min_km_h": 2.0, "speed_max_km_h": 20.0}])
def test_the_plant_step_of_tuning_resolves_the_car_at_its_first_speed(grid: dict[str, float]) -> None:
    """The lightest, stiffest car of the family; the Runge-Kutta method is stable up to a step of 2.7 time constants."""
    config = builds.TRACKING_CONFIG.replace({"grid": grid, "rear_actuator.lag_s": 0.1, "steering.lag_s": 0.05})
    step, speed = lead._plant_step(config), config.grid.speed_min_km_h * KM_H
    factors = {"mass_factor": 0.8, "front_stiffness_factor": 1.15, "rear_stiffness_factor": 1.15}
    a, _ = continuous(config, [replace(nominal(config), **factors)], np.array([speed]))
    fastest = np.abs(np.linalg.eigvals(a[0, 0, :2, :2])).max()
    assert step * fastest < 1.0
    assert config.controller.sampling_time_s / step == pytest.approx(round(config.controller.sampling_time_s / step))
    assert step > 0.9e-3


def test_the_family_of_relaxed_tyres_has_a_longer_relaxation_length() -> None:
    config = builds.TRACKING_CONFIG.replace({"plant.relaxation_length_m": 0.4}, "test")
    cars, limits = family_of(config)
    length = cars[:, PLANT_PARAMETERS.index("relaxation_length")]
    longest = int(np.argmax(length))
    assert length[longest] == pytest.approx(0.6) and limits[longest] == lead.RELAXATION_OVERSHOOT_PERCENT
    assert (np.delete(length, longest) == 0.4).all()


@pytest.mark.parametrize(("speed", "is_met"), [(60.0, True), (80.0, False)])
def test_a_slow_car_misses_its_limits_at_high_speed_only(speed: float, is_met: bool) -> None:
    assert Response(speed, 0.0, 0.0, 1.0, 1.0, lead.RISE_MAX_S + 0.01, 3.0).is_met == is_met

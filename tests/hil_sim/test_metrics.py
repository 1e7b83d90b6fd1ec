"""Figures of runs against recordings made by hand; recordings on disk."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.config import Config
from codegen.errors import CodegenError
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from codegen.vehicle.tyre import AxleTyres
from hil_sim import manoeuvres
from hil_sim.faults import Fault
from hil_sim.metrics import Run, evaluate, frequency, others, ramp, sine_with_dwell, spin_time, step_metrics
from hil_sim.recording import load_csv, save_csv, to_csv
from hil_sim.runs import run
from hil_sim.scenarios import SCENARIOS, find
from hil_sim.suite.plants import changed
from tests import builds
from tests.hil_sim.made import record

CONFIG = builds.CONFIG
RATIO = CONFIG.steering.ratio
DEGREE = math.radians(1.0)


def run_of(name: str, made: np.ndarray, config: Config = CONFIG, **changes: float) -> Run:
    return Run(made, replace(find(name), **changes), config)


def spinning(sign: float = 1.0, degrees: float = 12.0, rear: float = -8.0) -> np.ndarray:
    """Sideslip that rises evenly from 3 s on to `degrees` at 4 s, as does the slip of the rear axle."""
    made = record(6.0, status=0.0, yaw_rate_rad_s=0.3, front_angle_rad=0.05)
    for name, end in (("sideslip_rad", degrees), ("slip_rear_rad", rear)):
        made[:, RECORD_COLUMNS.index(name)] = sign * np.interp(made[:, 0], [3.0, 4.0], [0.0, end * DEGREE])
    return made


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_spin_has_its_time_and_no_number_after_it(sign: float) -> None:
    made = spinning(sign)
    # 10 deg of 12 are passed 0.8333 s up the ramp; the first row beyond counts.
    assert spin_time(made) == pytest.approx(3.84)
    found = evaluate(find("low-friction"), CONFIG, {"controlled": made, "passive": record(6.0, status=2.0)})
    spun, dry = (found.runs[name].to_dict() for name in ("controlled", "passive"))
    assert spun.pop("spun_at_s") == pytest.approx(3.84)
    assert dry["spun_at_s"] is None
    assert set(spun.values()) == {None}
    assert found.rows[0] == ("spin", "", ("spun at t = 3.84 s", "no"))
    assert all(texts[0] == "spun" and texts[1] != "spun" for _, _, texts in found.rows[1:])


def test_a_spin_needs_ten_degrees_and_a_sliding_rear_axle() -> None:
    assert spin_time(spinning(degrees=9.99)) is None
    assert spin_time(spinning(degrees=10.5)) is not None
    # Rolling through a tight turn: the sideslip of the geometry, and no slip.
    assert spin_time(spinning(degrees=20.0, rear=1.0)) is None
    made = record(6.0)
    made[400:, RECORD_COLUMNS.index("yaw_rate_rad_s")] = math.nan  # a run out of all numbers counts as a spin
    assert spin_time(made) == pytest.approx(4.0)


def test_figures_from_before_the_spin_stay() -> None:
    made = dwell_record()
    late = made[:, 0] > 4.5
    for name in ("sideslip_rad", "slip_rear_rad"):
        made[late, RECORD_COLUMNS.index(name)] = 0.3
    found = evaluate(find("sine-with-dwell"), CONFIG, {"controlled": made}).runs["controlled"]
    assert found["lateral_displacement_m"] is not None
    assert found["yaw_rate_ratio_1_00_s_percent"] is not None
    assert found["yaw_rate_ratio_1_75_s_percent"] is None
    assert found["meets_fmvss_126"] is False


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_step(sign: float) -> None:
    """The yaw rate rises from 2 s on within 0.5 s to 0.6 rad/s and falls to 0.5 until 3 s."""
    made = record(
        6.0,
        yaw_rate_rad_s=lambda t: sign * np.interp(t, [2.0, 2.5, 3.0], [0.0, 0.6, 0.5]),
        yaw_rate_reference_rad_s=sign * 0.4,
        sideslip_rad=lambda t: sign * np.interp(t, [2.0, 2.5, 3.0], [0.0, -0.03, 0.01]),
        front_angle_rad=lambda t: np.where(t >= 2.0, sign * 0.1, 0.0),
    )
    found = step_metrics(made, 2.0, RATIO)
    assert found.settled
    assert found.yaw_rate_steady_deg_s == pytest.approx(sign * math.degrees(0.5))
    assert found.yaw_rate_peak_deg_s == pytest.approx(sign * math.degrees(0.6))
    assert found.yaw_rate_reference_deg_s == pytest.approx(sign * math.degrees(0.4))
    assert found.overshoot_percent == pytest.approx(20.0)
    assert found.peak_time_s == pytest.approx(0.5)
    # 90 % of 0.5 rad/s lies 0.375 s up the ramp, and 0.51 rad/s 0.45 s down the other one; the row at or after it counts.
    assert (found.rise_time_s, found.settling_time_s) == (pytest.approx(0.38), pytest.approx(0.95))
    assert found.yaw_rate_gain_per_s == pytest.approx(0.5 / (0.1 * RATIO))
    assert found.sideslip_abs_max_deg == pytest.approx(math.degrees(0.03))
    assert found.sideslip_steady_deg == pytest.approx(sign * math.degrees(0.01))


def test_settling_is_to_the_last_time_outside() -> None:
    """A late dip of 3 % counts, one of 1 % does not; and a car that never steers has settled at once."""

    def dip(share: float) -> np.ndarray:
        return record(6.0, yaw_rate_rad_s=lambda t: np.where(t < 1.2, 0.0, 0.5) * (1.0 - share * ((t > 3.995) & (t < 4.995))))

    assert step_metrics(dip(0.03), 1.0).settling_time_s == pytest.approx(4.0)
    assert step_metrics(dip(0.01), 1.0).settling_time_s == pytest.approx(0.2)
    assert step_metrics(record(6.0), 1.0).settling_time_s == 0.0


def test_a_run_that_swings_to_the_end_is_not_settled() -> None:
    found = step_metrics(record(6.0, yaw_rate_rad_s=lambda t: np.where(t < 1.0, 0.0, 0.5 + 0.01 * np.sin(12.0 * t))), 1.0)
    assert not found.settled
    assert found.settling_time_s is None
    assert found.overshoot_percent == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(("held", "controlled"), [(0, True), (40, True), (60, False)])
def test_the_reference_is_given_while_most_of_the_last_second_is_controlled(held: int, controlled: bool) -> None:
    made = record(6.0, yaw_rate_rad_s=0.5, status=lambda t: np.where(t > 5.995 - 0.01 * held, Status.DEGRADED, 0.0))
    assert (step_metrics(made, 1.0).yaw_rate_reference_deg_s is not None) == controlled


def test_steady_slip_stands_beside_the_bound_of_the_axle() -> None:
    """Only the last second counts: the transient before is larger."""
    tyres = AxleTyres.from_config(CONFIG)
    made = record(
        6.0,
        yaw_rate_rad_s=0.3,
        front_angle_rad=0.05,
        slip_front_rad=lambda t: np.where(t < 4.9, -2.0, -0.5) * tyres.front_slip_bound,
        slip_rear_rad=lambda t: np.where(t < 4.9, 0.5, 1.25) * tyres.rear_slip_bound,
    )
    scenario = replace(find("step-steer"), steer_time=2.0)
    found = evaluate(scenario, CONFIG, {"run": made}).runs["run"]
    assert found["slip_front_steady_deg"] == pytest.approx(-0.5 * math.degrees(tyres.front_slip_bound))
    assert found["slip_front_steady_of_bound_percent"] == pytest.approx(50.0)
    assert found["slip_rear_steady_of_bound_percent"] == pytest.approx(125.0)
    # Tyres without a slip bound have it in degrees alone.
    soft = {"limits": {"slip_departure_percent": 50.0}, "tyre": {"rear": {"cornering_stiffness_n_per_rad": 5_000.0}}}
    unbounded = evaluate(scenario, changed(CONFIG, soft), {"run": made}).runs["run"]
    assert unbounded["slip_rear_steady_deg"] == found["slip_rear_steady_deg"]
    assert unbounded["slip_rear_steady_of_bound_percent"] is None


GRADIENT = 0.002
"""rad s^2/m of the car made by hand."""


def ramp_run(sign: float = 1.0, share: float = 1.0) -> Run:
    """80 km/h; lateral acceleration 0.1 m/s^2 more each second, an understeering car that bends beyond 4 m/s^2."""
    speed = 80.0 / 3.6

    def lateral(time: np.ndarray) -> np.ndarray:
        return share * 0.1 * np.clip(time - 2.0, 0.0, None)

    def angle(time: np.ndarray) -> np.ndarray:
        ay = lateral(time)
        return sign * ((CONFIG.vehicle.wheelbase / speed**2 + GRADIENT) * ay + 0.01 * np.clip(ay - 4.0, 0.0, None) ** 2)

    made = record(62.0, speed_m_s=speed, front_angle_rad=angle, lateral_acceleration_m_s2=lambda t: sign * lateral(t))
    return run_of("ramp-steer", made)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ramp(sign: float) -> None:
    rows = {metric.key: metric.value for metric in ramp.measure(ramp_run(sign))}
    assert rows["understeer_gradient_deg_s2_m"] == pytest.approx(math.degrees(GRADIENT), rel=1e-9)
    expected = (CONFIG.vehicle.wheelbase / (80.0 / 3.6) ** 2 + GRADIENT) * 0.3 * 9.80665 * RATIO
    assert rows["steering_wheel_at_0_3_g_deg"] == pytest.approx(sign * math.degrees(expected), rel=1e-9)
    assert ramp.understeer_gradient(ramp_run(sign, 0.2)) is None  # the ramp never reaches the range of the fit


LATERAL = 4.0


def dwell_record(sign: float = 1.0, ratios: tuple[float, float] = (30.0, -5.0), lateral: float = LATERAL) -> np.ndarray:
    """Steering of the standard from 1 s on; the yaw rate falls to its second peak, -0.5 rad/s, at 2.2 s.

    `ratios` are the yaw rates 1.00 s and 1.75 s after the end of steering, in % of that peak.
    """
    end = 1.0 + manoeuvres.DWELL_LENGTH
    times = [1.0, 1.3, 2.2, end, end + 1.00, end + 1.75]
    rates = [0.0, 0.6, -0.5, -0.45, *(-0.5 * share / 100.0 for share in ratios)]
    return record(
        6.0,
        front_angle_rad=lambda t: sign * 80.0 * DEGREE / RATIO * manoeuvres.dwell_shape(t - 1.0),
        yaw_rate_rad_s=lambda t: sign * np.interp(t, times, rates),
        lateral_acceleration_m_s2=lambda t: sign * np.where(t > 0.9, lateral, 0.0),
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sine_with_dwell(sign: float) -> None:
    times = sine_with_dwell.steering_times(run_of("sine-with-dwell", dwell_record(sign)))
    assert times is not None
    # The wheel reaches 5 of 80 deg after asin(1/16) / (2 pi 0.7); between 10 ms rows the sine is straight within 1e-6 s.
    assert times.beginning == pytest.approx(1.0 + math.asin(5.0 / 80.0) / (2.0 * math.pi * 0.7), abs=1e-5)
    assert times.reversal == pytest.approx(1.0 + 0.5 / 0.7, abs=1e-4)
    # 0.1 deg of 80 at 352 deg/s are 0.3 ms before the end.
    assert times.completion == pytest.approx(1.0 + manoeuvres.DWELL_LENGTH, abs=2e-3)
    found = evaluate(find("sine-with-dwell"), CONFIG, {"one": dwell_record(sign)}).runs["one"]
    # The completion lies within 2 ms, over which this yaw rate moves by 0.6 % of its peak; between rows it is straight.
    assert found["yaw_rate_ratio_1_00_s_percent"] == pytest.approx(30.0, abs=0.7)
    assert found["yaw_rate_ratio_1_75_s_percent"] == pytest.approx(-5.0, abs=0.7)
    assert found["lateral_displacement_m"] == pytest.approx(0.5 * LATERAL * 1.07**2, rel=1e-9)
    assert found["meets_fmvss_126"] is True


@pytest.mark.parametrize(
    ("ratios", "lateral", "mass", "end", "met"),
    [
        ((34.0, 19.0), LATERAL, 2335.0, 6.0, True),
        ((36.0, 19.0), LATERAL, 2335.0, 6.0, False),
        ((34.0, 21.0), LATERAL, 2335.0, 6.0, False),
        ((34.0, 19.0), 3.1, 2335.0, 6.0, False),  # 1.77 m
        ((34.0, 19.0), 3.1, 3600.0, 6.0, True),  # a heavy car must reach 1.52 m
        ((34.0, 19.0), 2.6, 3600.0, 6.0, False),  # 1.49 m
        # A run that ends between the two times passes nothing, and fails where it has failed.
        ((34.0, 19.0), LATERAL, 2335.0, 1.0 + manoeuvres.DWELL_LENGTH + 1.5, None),
        ((36.0, 19.0), LATERAL, 2335.0, 1.0 + manoeuvres.DWELL_LENGTH + 1.5, False),
    ],
)
def test_criteria_of_the_standard(
    ratios: tuple[float, float], lateral: float, mass: float, end: float, met: bool | None
) -> None:
    made = dwell_record(ratios=ratios, lateral=lateral)
    config = changed(CONFIG, {"vehicle": {"mass_kg": mass}})
    found = evaluate(find("sine-with-dwell"), config, {"one": made[made[:, 0] < end]}).runs["one"]
    assert found["meets_fmvss_126"] is met
    assert (found["yaw_rate_ratio_1_75_s_percent"] is None) == (end < 6.0)


def test_a_run_without_that_steering_has_none_of_its_figures() -> None:
    found = evaluate(find("sine-with-dwell"), CONFIG, {"straight": record(6.0)}).runs["straight"]
    assert found["lateral_displacement_m"] is None
    assert found["meets_fmvss_126"] is None


def test_displacement_of_an_acceleration_that_rises_evenly() -> None:
    made = record(3.0, lateral_acceleration_m_s2=lambda t: 2.0 * t)
    # 2 t^3 / 6 from zero on, whatever the rows are.
    assert sine_with_dwell.lateral_displacement(run_of("sine-with-dwell", made), 0.0, 1.0733) == pytest.approx(1.0733**3 / 3.0)


def test_frequency_response_of_a_known_filter() -> None:
    """A first-order lag with a dead time of five rows, as the sampled recurrence has it."""
    wheel = find("sine-sweep").inputs(CONFIG)[::10, 1]
    lag, gain, rows = 0.15, 0.4, 5
    pole = math.exp(-0.01 / lag)
    response = np.zeros(len(wheel))
    for index in range(1, len(wheel)):
        response[index] = pole * response[index - 1] + gain * (1.0 - pole) * wheel[max(index - 1 - rows, 0)]
    made = record(len(wheel) * 0.01, front_angle_rad=wheel / RATIO, yaw_rate_rad_s=response)
    found = frequency.frequency_response(run_of("sine-sweep", made))
    assert found is not None
    z = np.exp(2j * np.pi * found.frequency * 0.01)
    exact = gain * (1.0 - pole) * z ** -(1.0 + rows) / (1.0 - pole / z)
    # Of the band that is averaged only the curvature over 3 % of its frequency is left, and at the ends the fading.
    assert found.gain == pytest.approx(np.abs(exact), rel=2e-3)
    assert found.phase == pytest.approx(np.unwrap(np.angle(exact)), abs=5e-3)
    fine = np.geomspace(0.2, 3.5, 10_000)
    values = gain * (1.0 - pole) / np.abs(1.0 - pole * np.exp(-2j * np.pi * fine * 0.01))
    bandwidth = fine[np.argmax(values < values[0] * 10.0 ** (-3.0 / 20.0))]
    assert found.where_gain_falls(frequency.BANDWIDTH_SHARE) == pytest.approx(bandwidth, rel=2e-3)


def test_a_car_that_does_not_fall_off_has_no_bandwidth() -> None:
    wheel = find("sine-sweep").inputs(CONFIG)[::10, 1]
    made = record(len(wheel) * 0.01, front_angle_rad=wheel / RATIO, yaw_rate_rad_s=0.3 * wheel)
    found = evaluate(find("sine-sweep"), CONFIG, {"one": made, "still": record(85.0)})
    assert found.runs["one"]["bandwidth_3_db_hz"] is None
    assert found.runs["one"]["yaw_rate_gain_per_s"] == pytest.approx(0.3)
    assert found.runs["still"]["yaw_rate_gain_per_s"] is None


def test_corner() -> None:
    """A fault from 3 to 4 s; degraded from 3.05 s on, fail-safe, control again from 4.2 s on."""
    made = record(
        8.0,
        yaw_rate_rad_s=lambda t: 0.2 + np.where((t >= 3.0) & (t < 5.0), 0.05, 0.0),
        rear_angle_rad=lambda t: np.interp(t, [3.0, 3.5], [0.02, 0.01]),
        status=lambda t: np.where(t < 3.045, 0.0, np.where(t < 3.085, 3.0, np.where(t < 4.195, 4.0, 1.0))),
    )
    scenario = replace(find("ecu-loss"), faults=(Fault("drop", 3.0, 1.0),))
    found = evaluate(scenario, CONFIG, {"one": made}).runs["one"]
    assert found["yaw_rate_deviation_deg_s"] == pytest.approx(math.degrees(0.05), rel=0.03)  # one row of 51 before is after
    assert found["rear_angle_deviation_deg"] == pytest.approx(math.degrees(0.01), rel=1e-3)
    assert found["rear_rate_abs_max_deg_s"] == pytest.approx(math.degrees(0.02), rel=1e-6)
    assert found["not_controlled_s"] == pytest.approx(4.2 - 3.05)
    assert found["recovery_s"] == pytest.approx(0.2)


def test_path_of_a_circle() -> None:
    radius, rate = 50.0, 0.4
    heading, offset = others.path(run_of("split-friction", record(4.0, speed_m_s=radius * rate, yaw_rate_rad_s=rate)))
    assert heading[-1] == pytest.approx(rate * 3.99)
    # The trapezoidal rule over 10 ms: (0.4 * 0.01)^2 / 12 of the whole.
    assert offset[-1] == pytest.approx(radius * (1.0 - math.cos(rate * 3.99)), rel=1e-5)


def test_control_begins_and_ends_at_the_thresholds(software: Software) -> None:
    scenario = find("speed-ramp")
    found = evaluate(scenario, CONFIG, {"controlled": run(software, scenario)}).runs["controlled"]
    # 24 km/h in 6 s: a row is 0.04 km/h.
    assert found["control_begins_km_h"] == pytest.approx(15.0, abs=0.05)
    assert found["control_ends_km_h"] == pytest.approx(12.0, abs=0.05)
    without = evaluate(scenario, CONFIG, {"passive": record(6.0, status=2.0)})
    assert not any("control" in title for title, _, _ in without.rows)  # figures that no car has are left out


def test_a_recording_shows_how_well_the_reference_is_followed() -> None:
    made = record(
        10.0,
        yaw_rate_rad_s=0.1,
        yaw_rate_reference_rad_s=lambda t: np.where(t < 5.0, 0.11, 5.0),
        status=lambda t: np.where(t < 2.5, 1.0, np.where(t < 5.0, 0.0, 4.0)),
    )
    found = evaluate(replace(find("step-steer"), kind="recording"), CONFIG, {"one": made}).runs["one"]
    assert found["yaw_rate_error_rms_deg_s"] == pytest.approx(math.degrees(0.01))  # nothing of the fail-safe
    assert (found["controlled_percent"], found["limited_percent"]) == pytest.approx((50.0, 25.0))
    assert found["speed_max_km_h"] == pytest.approx(72.0)


def test_a_car_at_rest_has_figures_and_no_recording_has_none() -> None:
    for scenario in SCENARIOS.values():
        assert evaluate(scenario, CONFIG, {"still": record(scenario.duration, speed_m_s=0.0, status=2.0)}).rows
    for records in ({}, {"one": np.zeros((1, 12))}):
        with pytest.raises(ValueError, match="recording"):
            evaluate(find("step-steer"), CONFIG, records)


def test_csv_reads_back_to_the_same_bits(tmp_path: Path) -> None:
    made = record(6.0, status=3.0, yaw_rate_rad_s=np.random.default_rng(1).normal(size=600))
    save_csv(made, tmp_path / "run.csv")
    np.testing.assert_array_equal(load_csv(tmp_path / "run.csv"), made)
    assert to_csv(made).splitlines()[1].endswith(b",3")


@pytest.mark.parametrize(
    "text", ["", "a,b\n", ",".join(RECORD_COLUMNS) + "\n1,2\n", ",".join(RECORD_COLUMNS) + "\n" + 11 * "x," + "1\n"]
)
def test_csv_that_is_no_run(tmp_path: Path, text: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text)
    with pytest.raises(CodegenError, match=r"run\.csv"):
        load_csv(path)

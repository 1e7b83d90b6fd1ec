"""Figures of runs compared with synthetic recordings; recordings on disk."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.metrics import SineWithDwell
from codegen.metrics.sine import DWELL_LENGTH
from codegen.sil.software import RECORD_COLUMNS, Software
from hil_sim.bench import run
from hil_sim.faults import Fault
from hil_sim.logs import load_csv, save_csv, to_csv
from hil_sim.metrics import Run, RunMetrics, evaluate, rows, spin_time, steering_response, step_metrics
from hil_sim.scenario_files import find
from hil_sim.scenarios import SCENARIOS
from tests import builds
from tests.hil_sim.made import dwell_record, record

CONFIG = builds.CONFIG
RATIO = CONFIG.steering.ratio
DEGREE = math.radians(1.0)
END = 1.0 + DWELL_LENGTH
signs = pytest.mark.parametrize("sign", [1.0, -1.0])


def figures(name: str, made: np.ndarray, config: Config = CONFIG, **changes: object) -> RunMetrics:
    return evaluate(replace(find(name), **changes), config, {"one": made}).runs["one"]


def run_of(name: str, made: np.ndarray) -> Run:
    return Run(made, find(name), CONFIG)


def check(found: RunMetrics, rel: float = 1e-6, **expected: float | bool | None) -> None:
    for key, value in expected.items():
        assert found[key] == (value if value is None or isinstance(value, bool) else pytest.approx(value, rel=rel)), key


def spinning(sign: float = 1.0, degrees: float = 12.0, rear: float = -8.0) -> np.ndarray:
    """Return a recording whose sideslip rises linearly from 3 s to `degrees` at 4 s, as does the rear axle's slip."""
    ramp = {"sideslip_rad": degrees, "slip_rear_rad": rear}
    columns = {name: lambda t, end=end: sign * np.interp(t, [3.0, 4.0], [0.0, end * DEGREE]) for name, end in ramp.items()}
    return record(6.0, status=0.0, yaw_rate_rad_s=0.3, front_angle_rad=0.05, **columns)


@signs
def test_a_spin_has_its_time_and_no_number_after_it(sign: float) -> None:
    found = evaluate(find("low-friction"), CONFIG, {"controlled": spinning(sign), "passive": record(6.0, status=2.0)})
    spun_car, dry = (found.runs[name].to_dict() for name in ("controlled", "passive"))
    # 10 deg of 12 are passed 0.8333 s up the ramp; the first row beyond counts.
    assert spun_car.pop("spun_at_s") == pytest.approx(3.84)
    assert dry["spun_at_s"] is None
    assert set(spun_car.values()) == {None}
    assert found.rows[0] == ("spin", "", ("spun at t = 3.84 s", "no"))
    assert all(texts[0] == "spun" and texts[1] != "spun" for _, _, texts in found.rows[1:])


def test_a_spin_needs_ten_degrees_and_a_sliding_rear_axle() -> None:
    assert spin_time(spinning(degrees=9.99)) is None
    assert spin_time(spinning(degrees=10.5)) is not None
    # Rolling through a tight turn: geometric sideslip without tyre slip.
    assert spin_time(spinning(degrees=20.0, rear=1.0)) is None
    made = record(6.0)
    made[400:, RECORD_COLUMNS.index("yaw_rate_rad_s")] = math.nan  # a run that leaves the finite numbers counts as a spin
    assert spin_time(made) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("wave", "settling_time"),
    [
        (lambda t: 0.5 - 0.015 * ((t > 3.995) & (t < 4.995)), 4.0),  # a late dip of 3 % counts
        (lambda t: 0.5 - 0.005 * ((t > 3.995) & (t < 4.995)), 0.2),  # one of 1 % does not
        (lambda t: 0.0 * t, 0.0),  # a car that never steers has settled at once
        (lambda t: 0.5 + 0.011 * np.sin(12.0 * t), None),  # it oscillates to the end
    ],
)
def test_settling_ends_at_the_last_time_outside(wave: object, settling_time: float | None) -> None:
    found = step_metrics(record(6.0, yaw_rate_rad_s=lambda t: np.where(t < 1.2, 0.0, wave(t))), 1.0)
    assert found["settling_time_s"] == (None if settling_time is None else pytest.approx(settling_time))
    assert found["settled"] == (settling_time is not None)


@signs
def test_understeer_of_a_ramp(sign: float) -> None:
    """80 km/h; lateral acceleration rises by 0.1 m/s^2 per second; the car understeers progressively beyond 4 m/s^2."""
    speed, gradient = 80.0 / 3.6, 0.002

    def ramp(share: float) -> RunMetrics:
        def lateral(time: np.ndarray) -> np.ndarray:
            return share * 0.1 * np.clip(time - 2.0, 0.0, None)

        def angle(time: np.ndarray) -> np.ndarray:
            ay = lateral(time)
            return sign * ((CONFIG.vehicle.wheelbase / speed**2 + gradient) * ay + 0.01 * np.clip(ay - 4.0, 0.0, None) ** 2)

        columns = {"front_angle_rad": angle, "lateral_acceleration_m_s2": lambda t: sign * lateral(t)}
        return figures("ramp-steer", record(62.0, speed_m_s=speed, **columns))

    expected = (CONFIG.vehicle.wheelbase / speed**2 + gradient) * 0.3 * 9.80665 * RATIO
    check(ramp(1.0), 1e-9, understeer_gradient_deg_s2_m=math.degrees(gradient))
    check(ramp(1.0), 1e-9, steering_wheel_at_0_3_g_deg=sign * math.degrees(expected))
    check(ramp(0.2), understeer_gradient_deg_s2_m=None)  # the ramp never reaches the range of the fit


@signs
def test_sine_with_dwell_figures(sign: float) -> None:
    times = SineWithDwell(run_of("sine-with-dwell", dwell_record(sign)).runs).times
    beginning, reversal, completion = (float(each[0]) for each in times)
    # The wheel reaches 5 of 80 deg after asin(1/16) / (2 pi 0.7); between 10 ms rows the sine is straight within 1e-6 s.
    assert beginning == pytest.approx(1.0 + math.asin(5.0 / 80.0) / (2.0 * math.pi * 0.7), abs=1e-5)
    assert reversal == pytest.approx(1.0 + 0.5 / 0.7, abs=1e-4)
    # 0.1 deg of 80 at 352 deg/s are 0.3 ms before the end.
    assert completion == pytest.approx(END, abs=2e-3)
    found = figures("sine-with-dwell", dwell_record(sign))
    # The completion lies within 2 ms, over which this yaw rate moves by 0.6 % of its peak; between rows it is straight.
    assert found["yaw_rate_ratio_1_00_s_percent"] == pytest.approx(30.0, abs=0.7)
    assert found["yaw_rate_ratio_1_75_s_percent"] == pytest.approx(-5.0, abs=0.7)
    check(found, 1e-9, lateral_displacement_m=0.5 * 4.0 * 1.07**2, meets_fmvss_126=True)
    check(figures("sine-with-dwell", record(6.0)), lateral_displacement_m=None, meets_fmvss_126=None)


@pytest.mark.parametrize(
    ("ratios", "lateral", "mass", "end", "met"),
    [
        ((34.0, 19.0), 4.0, 2335.0, 6.0, True),
        ((36.0, 19.0), 4.0, 2335.0, 6.0, False),
        ((34.0, 21.0), 4.0, 2335.0, 6.0, False),
        ((34.0, 19.0), 3.1, 2335.0, 6.0, False),  # 1.77 m
        ((34.0, 19.0), 3.1, 3600.0, 6.0, True),  # a heavy car must reach 1.52 m
        ((34.0, 19.0), 2.6, 3600.0, 6.0, False),  # 1.49 m
        # A run that ends between the two times cannot pass; it fails if the first criterion failed.
        ((34.0, 19.0), 4.0, 2335.0, END + 1.5, None),
        ((36.0, 19.0), 4.0, 2335.0, END + 1.5, False),
    ],
)
def test_criteria_of_the_standard(
    ratios: tuple[float, float], lateral: float, mass: float, end: float, met: bool | None
) -> None:
    made = dwell_record(ratios=ratios, lateral=lateral)
    found = figures("sine-with-dwell", made[made[:, 0] < end], CONFIG.replace({"vehicle": {"mass_kg": mass}}))
    assert found["meets_fmvss_126"] is met
    assert (found["yaw_rate_ratio_1_75_s_percent"] is None) == (end < 6.0)


def test_frequency_response_of_a_known_filter() -> None:
    """The filter is a sampled first-order lag with a dead time of five rows."""
    wheel = find("sine-sweep").inputs(CONFIG)[::10, 1]
    lag, gain, rows = 0.15, 0.4, 5
    pole = math.exp(-0.01 / lag)
    response = np.zeros(len(wheel))
    for index in range(1, len(wheel)):
        response[index] = pole * response[index - 1] + gain * (1.0 - pole) * wheel[max(index - 1 - rows, 0)]
    made = record(len(wheel) * 0.01, front_angle_rad=wheel / RATIO, yaw_rate_rad_s=response)
    found = steering_response.frequency_response(run_of("sine-sweep", made))
    assert found is not None
    z = np.exp(2j * np.pi * found.frequency * 0.01)
    exact = gain * (1.0 - pole) * z ** -(1.0 + rows) / (1.0 - pole / z)
    # Averaging leaves only the curvature over 3 % of the frequency, and the fading at the ends.
    assert found.gain == pytest.approx(np.abs(exact), rel=2e-3)
    assert found.phase == pytest.approx(np.unwrap(np.angle(exact)), abs=5e-3)
    fine = np.geomspace(0.2, 3.5, 10_000)
    values = gain * (1.0 - pole) / np.abs(1.0 - pole * np.exp(-2j * np.pi * fine * 0.01))
    bandwidth = fine[np.argmax(values < values[0] * 10.0 ** (-3.0 / 20.0))]
    assert found.where_gain_falls(steering_response.BANDWIDTH_SHARE) == pytest.approx(bandwidth, rel=2e-3)
    # A car with a constant gain has no bandwidth, and one at rest has no gain.
    rigid = record(len(wheel) * 0.01, front_angle_rad=wheel / RATIO, yaw_rate_rad_s=0.3 * wheel)
    check(figures("sine-sweep", rigid), bandwidth_3_db_hz=None, yaw_rate_gain_per_s=0.3)
    check(figures("sine-sweep", record(85.0)), yaw_rate_gain_per_s=None)


def test_corner() -> None:
    """A fault lasts from 3 to 4 s: degraded from 3.05 s, then fail-safe, in control again from 4.2 s."""
    made = record(
        8.0,
        yaw_rate_rad_s=lambda t: 0.2 + np.where((t >= 3.0) & (t < 5.0), 0.05, 0.0),
        rear_angle_rad=lambda t: np.interp(t, [3.0, 3.5], [0.02, 0.01]),
        status=lambda t: np.where(t < 3.045, 0.0, np.where(t < 3.085, 3.0, np.where(t < 4.195, 4.0, 1.0))),
    )
    found = figures("ecu-loss", made, faults=(Fault("drop", 3.0, 1.0),))
    check(found, 0.03, yaw_rate_deviation_deg_s=math.degrees(0.05))  # one of 51 earlier rows is later
    check(found, 1e-3, rear_angle_deviation_deg=math.degrees(0.01))
    check(found, rear_rate_abs_max_deg_s=math.degrees(0.02), not_controlled_s=4.2 - 3.05, recovery_s=0.2)


def test_path_of_a_circle() -> None:
    radius, rate = 50.0, 0.4
    heading, _, offset = rows.path(run_of("split-friction", record(4.0, speed_m_s=radius * rate, yaw_rate_rad_s=rate)))
    assert heading[-1] == pytest.approx(rate * 3.99)
    # Relative error of the trapezoidal rule over 10 ms: (0.4 * 0.01)^2 / 12.
    assert offset[-1] == pytest.approx(radius * (1.0 - math.cos(rate * 3.99)), rel=1e-5)


def test_control_begins_and_ends_at_the_thresholds(software: Software) -> None:
    scenario = find("speed-ramp")
    found = figures("speed-ramp", run(software, scenario))
    # 24 km/h in 6 s: a row is 0.04 km/h.
    assert found["control_begins_km_h"] == pytest.approx(15.0, abs=0.05)
    assert found["control_ends_km_h"] == pytest.approx(12.0, abs=0.05)
    without = evaluate(scenario, CONFIG, {"passive": record(6.0, status=2.0)})
    assert not any("control" in title for title, _, _ in without.rows)  # figures that no car has are omitted


def test_a_car_at_rest_has_figures_and_no_recording_has_none() -> None:
    for scenario in SCENARIOS.values():
        assert evaluate(scenario, CONFIG, {"still": record(scenario.duration, speed_m_s=0.0, status=2.0)}).rows
    for records in ({}, {"one": np.zeros((1, 12))}):
        with pytest.raises(ValueError, match="recording"):
            evaluate(find("step-steer"), CONFIG, records)


def test_csv_reads_back_to_the_same_bits(tmp_path: Path) -> None:
    made, path = record(6.0, status=3.0, yaw_rate_rad_s=np.random.default_rng(1).normal(size=600)), tmp_path / "run.csv"
    save_csv(made, path)
    np.testing.assert_array_equal(load_csv(path), made)
    assert to_csv(made).splitlines()[1].endswith(b",3")
    header = ",".join(RECORD_COLUMNS)
    for text in ("", "a,b\n", f"{header}\n1,2\n", f"{header}\n{11 * 'x,'}1\n"):
        path.write_text(text)
        with pytest.raises(CodegenError, match=r"run\.csv"):
            load_csv(path)

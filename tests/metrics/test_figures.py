"""Figures of n runs at once, compared with values worked out by hand for synthetic signals."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.metrics import METRIC_TABLES, Runs, StepResponse, figures
from codegen.metrics.runs import METRIC_COLUMNS
from codegen.sil.software import RECORD_COLUMNS, Status
from tests import builds
from tests.hil_sim.made import dwell_record, record, spun

STEER_TIME = 1.0
RATIO = 16.0


def stacked(*records: np.ndarray, **more: object) -> Runs:
    """Return recordings as n runs, with the columns that a campaign keeps."""
    all_columns = np.stack(records, axis=-1)
    signals = {name: np.ascontiguousarray(all_columns[:, RECORD_COLUMNS.index(name)]) for name in METRIC_COLUMNS}
    return Runs(records[0][:, 0], signals, STEER_TIME, **more)


def step_record(sign: float = 1.0, **columns: object) -> np.ndarray:
    """Return a step at 1 s: up to 0.55 rad/s at 1.5 s, down to 0.5 rad/s at 2.03 s, then steady; to the left for +1."""

    def line(times: list[float], values: list[float]) -> object:
        return lambda t: sign * np.interp(t, times, values)

    made = {
        "front_angle_rad": line([1.0, 1.1], [0.0, 0.04]),
        "yaw_rate_rad_s": line([1.0, 1.5, 2.03], [0.0, 0.55, 0.5]),
        "yaw_rate_reference_rad_s": sign * 0.48,
        "sideslip_rad": line([1.0, 2.0, 3.0], [0.0, -0.01, -0.02]),
        "lateral_acceleration_m_s2": line([1.0, 1.5, 2.03], [0.0, 11.0, 10.0]),
        "rear_angle_rad": line([1.0, 1.2, 2.0], [0.0, -0.03, 0.01]),
        "slip_front_rad": line([1.0, 2.0, 3.0], [0.0, 0.04, 0.03]),
        "slip_rear_rad": line([1.0, 2.0, 3.0], [0.0, 0.025, 0.02]),
    }
    return record(6.0, **{**made, **columns})


KNOWN = {
    "spun_at_s": math.nan,
    "settled": 1.0,
    "yaw_rate_steady_deg_s": math.degrees(0.5),
    "yaw_rate_peak_deg_s": math.degrees(0.55),
    "yaw_rate_reference_deg_s": math.degrees(0.48),
    "map_yaw_rate_deg_s": math.degrees(0.4),
    "map_error_percent": 25.0,
    "map_overshoot_percent": 37.5,
    "overshoot_percent": 10.0,
    "rise_time_s": 0.41,  # 0.45 rad/s are passed after 0.4091 s
    "lateral_acceleration_overshoot_percent": 10.0,
    "lateral_acceleration_rise_time_s": 9.0 / 22.0,
    "settling_time_s": 0.93,  # 0.51 rad/s are passed 4/5 down the fall of 0.53 s, after 0.924 s
    "peak_time_s": 0.5,
    "yaw_rate_gain_per_s": 0.5 / (0.04 * RATIO),
    "sideslip_steady_deg": math.degrees(-0.02),
    "sideslip_abs_min_deg": math.degrees(0.0041),  # at the sample of the rise
    "sideslip_abs_max_deg": math.degrees(0.02),
    "rear_angle_min_deg": math.degrees(-0.03),
    "rear_angle_max_deg": math.degrees(0.01),
    "rear_angle_steady_deg": math.degrees(0.01),
    "slip_front_abs_max_deg": math.degrees(0.04),
    "slip_rear_abs_max_deg": math.degrees(0.025),
    "lateral_acceleration_max_m_s2": 11.0,
    "slip_front_steady_deg": math.degrees(0.03),
    "slip_rear_steady_deg": math.degrees(0.02),
    "slip_front_steady_of_bound_percent": 50.0,
    "slip_rear_steady_of_bound_percent": 40.0,
}
MIRRORED = {
    **{name: -value for name, value in KNOWN.items() if name.endswith(("_steady_deg", "_steady_deg_s", "_peak_deg_s"))},
    "yaw_rate_reference_deg_s": math.nan,
    "map_yaw_rate_deg_s": math.degrees(-0.4),
    "rear_angle_min_deg": math.degrees(-0.01),
    "rear_angle_max_deg": math.degrees(0.03),
}
"""Differences of a step to the right whose controller stands by for 60 % of the last second."""


def test_every_figure_of_steps_to_both_sides_and_of_a_spin() -> None:
    off = step_record(-1.0, status=lambda t: np.where((t > 5.0) & (t < 5.595), Status.STANDBY, Status.TRACKING))
    lost = step_record()
    lost[400:, RECORD_COLUMNS.index("yaw_rate_rad_s")] = math.nan
    runs = stacked(
        *(step_record(), off, spun(step_record(), 3.0), lost),
        steering_ratio=RATIO,
        slip_bounds=(0.06, 0.05),
        map_yaw_rate=np.array([0.4, -0.4, 0.4, 0.4]),
    )
    found = figures("step", runs)
    wanted = (KNOWN, {**KNOWN, **MIRRORED}, *({**dict.fromkeys(KNOWN, math.nan), "spun_at_s": time} for time in (3.0, 4.0)))
    assert list(found) == list(KNOWN)
    for place, of_run in enumerate(wanted):
        for name, value in of_run.items():
            assert found[name][place] == pytest.approx(value, rel=1e-9, nan_ok=True), (place, name)


def test_a_run_that_does_not_settle_and_one_that_stays_outside() -> None:
    swinging = step_record(yaw_rate_rad_s=lambda t: np.where(t < 1.0, 0.0, 0.5 + 0.011 * np.sin(12.0 * t)))
    leaving = step_record(yaw_rate_rad_s=lambda t: np.where(t < 1.0, 0.0, np.where(t > 5.985, 0.6, 0.5)))
    runs = stacked(swinging, leaving, record(6.0))
    found = StepResponse(runs)
    assert found.settled.tolist() == [0.0, 0.0, 1.0]
    assert found.settling_time_s.tolist() == pytest.approx([math.nan, math.nan, 0.0], nan_ok=True)
    # The last sample, at 5.99 s, is outside: the next one would be at 6 s.
    assert found.time_outside_band_s.tolist()[1:] == [5.0, 0.0]
    assert found.rise_time_interpolated_s[0] == 0.0  # from the first sample on
    assert StepResponse(stacked(step_record())).rise_time_interpolated_s == pytest.approx(0.45 / 1.1)
    assert found.overshoot_percent[2] == 0.0 and math.isnan(found.yaw_rate_gain_per_s[2])
    short = StepResponse(stacked(leaving), steady_window=0.05)  # one of five samples is at 0.6 rad/s
    assert short.yaw_rate_steady_deg_s == pytest.approx(math.degrees(0.52))


def test_a_lateral_acceleration_has_risen_when_it_stays_above() -> None:
    """A peak of the front wheels at 0.2 s, a dip, and the rise proper through 9 m/s^2; one that falls at the end; none."""
    peak = step_record(lateral_acceleration_m_s2=lambda t: np.interp(t, [1.0, 1.2, 1.4, 2.0], [0.0, 9.5, 6.0, 10.0]))
    falls = step_record(lateral_acceleration_m_s2=lambda t: np.where((t > 1.5) & (t < 5.985), 10.0, 0.0))
    still = step_record(lateral_acceleration_m_s2=0.0)
    found = StepResponse(stacked(peak, falls, still))
    assert found.lateral_acceleration_rise_time_s == pytest.approx([0.4 + 0.6 * 0.75, math.nan, 0.0], nan_ok=True)
    assert found.lateral_acceleration_overshoot_percent[2] == 0.0


@pytest.mark.parametrize("kind", METRIC_TABLES)
def test_a_run_does_not_depend_on_the_others(kind: str) -> None:
    """Bit for bit, also for one run alone, whose sums NumPy computes in another order."""
    noise = 1e-3 * np.random.default_rng(1).normal(size=(600, len(RECORD_COLUMNS) - 2))
    made = [dwell_record(), dwell_record(-1.0, (36.0, 5.0)), dwell_record(lateral=3.0), step_record(), step_record(-1.0)]
    for each in made[1:]:
        each[:, 1:-1] += noise
    gone = dwell_record()
    gone[300:, RECORD_COLUMNS.index("lateral_acceleration_m_s2")] = math.nan
    made += [record(6.0), gone, spun(dwell_record(), 2.5)]
    more = {"slip_bounds": (0.06, 0.05), "steering_ratio": builds.CONFIG.steering.ratio, "mass": 2000.0}
    found = figures(kind, stacked(*made, **more))
    for place, one in enumerate(made):
        alone = figures(kind, stacked(one, **more))
        assert {name: values[place] for name, values in found.items()} == pytest.approx(
            {name: values[0] for name, values in alone.items()}, rel=0.0, abs=0.0, nan_ok=True
        ), place


def test_a_sine_with_dwell_keeps_the_figures_from_before_a_spin() -> None:
    """The displacement is complete 1.07 s after the beginning, at 2.08 s; the first ratio 1 s after the end, at 3.93 s."""
    heavy = {"steering_ratio": builds.CONFIG.steering.ratio, "mass": np.array([3500.0, 3500.0, 3501.0, 3501.0])}
    made = (dwell_record(), spun(dwell_record(), 2.5), dwell_record(lateral=3.1), spun(dwell_record(), 2.0))
    found = figures("sine-with-dwell", stacked(*made, **heavy))
    assert found["meets_fmvss_126"].tolist() == [1.0, 0.0, 1.0, 0.0]
    expected = [0.5 * lateral * 1.07**2 for lateral in (4.0, 4.0, 3.1, math.nan)]
    assert found["lateral_displacement_m"] == pytest.approx(expected, rel=1e-9, nan_ok=True)
    assert np.isnan(found["yaw_rate_ratio_1_00_s_percent"]).tolist() == [False, True, False, True]
    assert np.isnan(found["yaw_rate_abs_max_deg_s"]).tolist() == [False, True, False, True]
    light = figures("sine-with-dwell", replace(stacked(*made, **heavy), mass=3500.0))
    assert light["meets_fmvss_126"].tolist() == [1.0, 0.0, 0.0, 0.0]

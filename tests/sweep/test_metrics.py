"""Figures of many runs at once are those of `hil_sim.metrics`, run by run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from codegen.sil.software import RECORD_COLUMNS
from codegen.sweep.metrics import COLUMNS, Runs, figures
from hil_sim.metrics import evaluate
from hil_sim.metrics.step import slip_bounds
from hil_sim.runs import run
from hil_sim.scenarios import SCENARIOS, Scenario
from hil_sim.suite.plants import changed
from tests import builds

FloatArray = npt.NDArray[np.float64]

ROUNDING = 1e-9
"""Relative, and absolute near zero: sums over samples in another order, and a crossing between two samples computed by another
expression; some 1,000 roundings of 1e-16 each, times at most 1e3 where two nearly equal numbers are subtracted."""


def scenario(name: str, **settings: float) -> Scenario:
    found = SCENARIOS[name]
    return replace(found, settings=replace(found.settings, **settings))


def recordings(name: str) -> tuple[Scenario, list[FloatArray]]:
    """Quiet, large and spinning runs of a scenario, and some that no car would drive."""
    software = builds.paper().software
    found = [
        run(
            software, scenario(name, speed_km_h=speed, friction=friction, steering_wheel_angle_deg=angle), controlled=controlled
        )
        for speed, friction, angle in (
            (42.5, 0.9, 90.0),
            (80.0, 0.9, 60.0),
            (80.0, 0.5, -40.0),
            (110.0, 0.35, 120.0),
            (60.0, 0.9, 1.0),
        )
        for controlled in (True, False)
    ]
    odd = found[0].copy()
    odd[len(odd) // 2 :, RECORD_COLUMNS.index("yaw_rate_rad_s")] = math.nan
    still = np.zeros_like(odd)
    still[:, 0] = odd[:, 0]
    swinging = found[0].copy()
    swinging[:, RECORD_COLUMNS.index("yaw_rate_rad_s")] += 0.05 * np.sin(20.0 * swinging[:, 0])
    gone = found[0].copy()
    lost = [name for name in COLUMNS if name not in ("front_angle_rad", "status")]  # the driver and the controller stay
    gone[len(gone) // 2 :, [RECORD_COLUMNS.index(name) for name in lost]] = math.nan
    return SCENARIOS[name], [*found, odd, still, swinging, gone]


@pytest.mark.parametrize("name", ["step-steer", "low-friction", "sine-with-dwell"])
@pytest.mark.parametrize("heavy", [False, True])
def test_every_figure_of_every_run(name: str, heavy: bool) -> None:
    told, records = recordings(name)
    config = changed(builds.CONFIG, {"vehicle": {"mass_kg": 3600.0}}) if heavy else builds.CONFIG
    stacked = np.stack(records, axis=-1)
    runs = Runs(
        time=records[0][:, 0],
        signals={column: stacked[:, RECORD_COLUMNS.index(column)] for column in COLUMNS},
        steer_time=told.steer_time,
        steering_ratio=config.steering.ratio,
        mass=np.full(len(records), config.vehicle.mass_kg),
        slip_bounds=slip_bounds(config),
    )
    found = figures(told.kind, runs)
    for index, record in enumerate(records):
        with np.errstate(invalid="ignore"):
            wanted = evaluate(told, config, {"run": record}).runs["run"].to_dict()
        assert found.keys() == wanted.keys()
        for key, value in wanted.items():
            one = found[key][index]
            if value is None or (isinstance(value, float) and math.isnan(value)):
                assert math.isnan(one), (index, key)
            else:
                assert one == pytest.approx(float(value), rel=ROUNDING, abs=ROUNDING), (index, key)


def test_what_was_measured_before_a_car_leaves_all_numbers_is_told() -> None:
    told, records = recordings("sine-with-dwell")
    evaluated = evaluate(told, builds.CONFIG, {"calm": records[0], "gone": records[-1]}).runs
    assert evaluated["gone"]["lateral_displacement_m"] == evaluated["calm"]["lateral_displacement_m"]
    assert evaluated["gone"].spun_at is not None


def test_the_runs_above_are_of_all_sorts() -> None:
    """Else the comparison would show less than it seems to."""
    _, records = recordings("low-friction")
    told = [evaluate(SCENARIOS["low-friction"], builds.CONFIG, {"run": record}).runs["run"] for record in records[:10]]
    assert any(run.spun_at is not None for run in told)
    assert any(run["settled"] for run in told)
    _, records = recordings("sine-with-dwell")
    good = [
        evaluate(SCENARIOS["sine-with-dwell"], builds.CONFIG, {"r": record}).runs["r"]["meets_fmvss_126"] for record in records
    ]
    assert True in good
    assert False in good
    assert None in good

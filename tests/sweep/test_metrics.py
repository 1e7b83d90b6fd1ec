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
    """Quiet, large and spinning runs of a scenario, and some that no car can drive."""
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


@pytest.mark.parametrize(("name", "heavy"), [("step-steer", False), ("sine-with-dwell", False), ("sine-with-dwell", True)])
def test_every_figure_of_every_run(name: str, heavy: bool) -> None:
    """Some runs spin and some settle; some meet FMVSS 126, some fail, some have no result."""
    described, records = recordings(name)
    config = changed(builds.CONFIG, {"vehicle": {"mass_kg": 3600.0}}) if heavy else builds.CONFIG
    stacked = np.stack(records, axis=-1)
    runs = Runs(
        time=records[0][:, 0],
        signals={column: stacked[:, RECORD_COLUMNS.index(column)] for column in COLUMNS},
        steer_time=described.steer_time,
        steering_ratio=config.steering.ratio,
        mass=np.full(len(records), config.vehicle.mass_kg),
        slip_bounds=slip_bounds(config),
    )
    found, results = figures(described.kind, runs), []
    for index, record in enumerate(records):
        with np.errstate(invalid="ignore"):
            results.append(evaluate(described, config, {"run": record}).runs["run"])
        wanted = results[-1].to_dict()
        assert found.keys() == wanted.keys()
        for key, value in wanted.items():
            one = found[key][index]
            if value is None or (isinstance(value, float) and math.isnan(value)):
                assert math.isnan(one), (index, key)
            else:
                assert one == pytest.approx(float(value), rel=ROUNDING, abs=ROUNDING), (index, key)
    assert {result.spun_at is None for result in results} == {True, False}
    if name == "sine-with-dwell":
        assert {True, False, None} <= {result["meets_fmvss_126"] for result in results}
        calm, gone = results[0], results[-1]  # figures of the time before the signals end remain
        assert gone.spun_at is not None and gone["lateral_displacement_m"] == calm["lateral_displacement_m"]
    else:
        assert any(result["settled"] for result in results)

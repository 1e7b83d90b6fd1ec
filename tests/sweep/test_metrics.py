"""Figures of many runs at once: equal to those of `hil_sim.metrics`, run by run."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.sil.software import RECORD_COLUMNS
from codegen.sweep.metrics import COLUMNS, Runs, figures
from hil_sim.bench import run
from hil_sim.metrics import evaluate
from hil_sim.metrics.step import slip_bounds
from hil_sim.scenarios import SCENARIOS
from hil_sim.suite.cells import changed
from tests import builds

ROUNDING = 1e-9
"""Relative tolerance, absolute near zero. Sums have another order, and a crossing between two samples has another expression.

Some 1,000 roundings of 1e-16 each, multiplied by up to 1e3 where two nearly equal numbers are subtracted.
"""


def recordings(name: str) -> list[np.ndarray]:
    """Return quiet, large and spinning runs of a scenario, and some that are impossible for a car."""
    base, yaw_rate = SCENARIOS[name], RECORD_COLUMNS.index("yaw_rate_rad_s")
    conditions = ((42.5, 0.9, 90.0), (80.0, 0.9, 60.0), (80.0, 0.5, -40.0), (110.0, 0.35, 120.0), (60.0, 0.9, -20.0))
    found = []
    for speed, friction, angle in conditions:
        settings = replace(base.settings, speed_km_h=speed, friction=friction, steering_wheel_angle_deg=angle)
        for controlled in (True, False):
            found.append(run(builds.paper().software, replace(base, settings=settings), controlled=controlled))
    odd, still, swinging, gone = (found[0].copy() for _ in range(4))
    odd[len(odd) // 2 :, yaw_rate] = math.nan
    still[:, 1:] = 0.0
    swinging[:, yaw_rate] += 0.05 * np.sin(20.0 * swinging[:, 0])
    lost = [name for name in COLUMNS if name not in ("front_angle_rad", "status")]  # driver and controller remain
    gone[len(gone) // 2 :, [RECORD_COLUMNS.index(name) for name in lost]] = math.nan
    return [*found, odd, still, swinging, gone]


MAP_ARGUMENTS = ("speed_m_s", "front_angle_rad")
"""Columns that are the arguments of the map."""


@pytest.mark.parametrize(("name", "heavy"), [("step-steer", False), ("sine-with-dwell", False), ("sine-with-dwell", True)])
def test_every_figure_of_every_run(name: str, heavy: bool) -> None:
    """Some runs spin and some settle; some meet FMVSS 126, some fail, some have no result."""
    described, records, look_up = SCENARIOS[name], recordings(name), builds.paper().software.map_yaw_rate
    config = changed(builds.CONFIG, {"vehicle": {"mass_kg": 3600.0}}) if heavy else builds.CONFIG
    stacked = np.stack(records, axis=-1)
    runs = Runs(
        time=records[0][:, 0],
        signals={column: stacked[:, RECORD_COLUMNS.index(column)] for column in COLUMNS},
        steer_time=described.steer_time,
        steering_ratio=config.steering.ratio,
        mass=np.full(len(records), config.vehicle.mass_kg),
        slip_bounds=slip_bounds(config),
        map_yaw_rate=look_up(*(stacked[-1, RECORD_COLUMNS.index(name)] for name in MAP_ARGUMENTS)).astype(np.float64),
    )
    found, results = figures(described.kind, runs), []
    for index, record in enumerate(records):
        with np.errstate(invalid="ignore"):
            results.append(evaluate(described, config, {"run": record}, look_up).runs["run"])
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
        calm, gone = results[0], results[-1]  # figures from before the signals end remain
        assert gone.spun_at is not None and gone["lateral_displacement_m"] == calm["lateral_displacement_m"]
    else:
        assert any(result["settled"] for result in results)

"""What is done to the car: named manoeuvres as arrays of inputs, a row for each plant step.

Each scenario names its source. Columns and units: `codegen.sil.closed_loop.INPUT_COLUMNS`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.config import KM_H, Config
from codegen.errors import CodegenError
from codegen.sil.closed_loop import INPUT_COLUMNS

FloatArray = npt.NDArray[np.float64]

DEFAULT = "step-steer"


@dataclass(frozen=True)
class Scenario:
    """One manoeuvre.

    Attributes:
        name, title: for the command line and for plots.
        source: the paper or standard that describes it.
        duration: s.
        fill: writes into an array of zeros, given the times (n,) in s of its rows; speed, steering wheel angle and the like.
        steer_time: s, when the driver starts to steer.
    """

    name: str
    title: str
    source: str
    duration: float
    steer_time: float
    fill: Callable[[FloatArray, FloatArray], None]

    def inputs(self, config: Config) -> FloatArray:
        """Inputs (steps, 6) of the whole manoeuvre on the road of the configuration, without a friction estimate."""
        step = config.plant.sampling_time_s
        samples = round(self.duration / config.controller.sampling_time_s)
        steps = samples * round(config.controller.sampling_time_s / step)
        time = np.arange(steps, dtype=np.float64) * step
        inputs = np.zeros((steps, len(INPUT_COLUMNS)))
        inputs[:, INPUT_COLUMNS.index("friction")] = config.road.friction
        inputs[:, INPUT_COLUMNS.index("friction_estimate")] = np.nan
        self.fill(inputs, time)
        return inputs


def _step_steer(speed: float, wheel_angle: float, start: float) -> Callable[[FloatArray, FloatArray], None]:
    def fill(inputs: FloatArray, time: FloatArray) -> None:
        inputs[:, INPUT_COLUMNS.index("speed")] = speed
        # The plant limits the rate at which the steering wheel follows.
        inputs[:, INPUT_COLUMNS.index("steering_wheel_command")] = np.where(time >= start - 1e-9, wheel_angle, 0.0)

    return fill


SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario(
            name="step-steer",
            title="Step steer: 90 deg at the steering wheel, 42.5 km/h",
            source="Ryu, Hwang, Yoon, Choi, section Validation Setup",
            duration=15.0,
            steer_time=10.0,
            fill=_step_steer(42.5 * KM_H, math.radians(90.0), 10.0),
        ),
    )
}


def find(name: str) -> Scenario:
    """The scenario called `name`; CodegenError with the nearest name where there is none."""
    if name in SCENARIOS:
        return SCENARIOS[name]
    near = difflib.get_close_matches(name, SCENARIOS, n=1)
    raise CodegenError(
        f"there is no scenario {name!r}",
        where="--scenario",
        remedy=f"known: {', '.join(SCENARIOS)}" + (f"; did you mean {near[0]!r}?" if near else ""),
    )

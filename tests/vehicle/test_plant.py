"""The plant in C compared with the CasADi virtual machine and an independent car."""

import functools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Config, parse
from codegen.sil.compile import compile_library
from codegen.sil.software import bench_sources
from codegen.vehicle.dynamics import PLANT_OUTPUTS, two_track, two_track_of_parameters
from codegen.vehicle.plant_car import plant_parameters
from tests.vehicle.reference_plant import CARS, Car, simulate

FURTHER_SIZES = {"roll": 0.05, "roll_rate": 0.3, "motor_angle": 0.06, "motor_rate": 0.5}
"""Scales of the states of optional parts, rad and rad/s; slips of the tyres: 0.1 rad."""
PERIODS, MILLISECOND = 20, 1e-3
"""Plant steps between two comparisons of its motion, and their size in s."""


class CPlant:
    """A car: the C functions of its plant over NumPy arrays, one row per point, its CasADi model and the independent car."""

    def __init__(self, config: Config, car: Car) -> None:
        sources = bench_sources(config, "ars", "single")
        wanted = {path: sources[path] for path in ("bench/plant.h", "bench/plant.c")}
        library = compile_library("plant", wanted, ["bench/plant.h"], include_folders=("bench",))
        self._ffi, self._lib = library.ffi, library.lib
        self.car, self.model = car, two_track(config)
        self.open_model, self.parameters = two_track_of_parameters(config), plant_parameters(config)
        self.states = self.model.states

    def rows(self, what: str, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Return the result of `plant_derivative` or `plant_output`."""
        kind, names = ("plant_state_t", self.states) if what == "derivative" else ("plant_output_t", PLANT_OUTPUTS)
        result, found = self._ffi.new(f"{kind} *"), []
        for x, u in zip(states, inputs, strict=True):
            given = self._ffi.new("plant_state_t *", tuple(x)), self._ffi.new("plant_input_t *", tuple(u))
            getattr(self._lib, f"plant_{what}")(*given, result)
            found.append([getattr(result, name) for name in names])
        return np.array(found)

    def run(self, inputs: Iterable[np.ndarray], step: float) -> np.ndarray:
        """Return the states before the first and after each step, from rest."""
        x, u = self._ffi.new("plant_state_t *"), self._ffi.new("plant_input_t *")
        rows = [[0.0] * len(self.states)]
        for row in inputs:
            u[0] = tuple(row)
            self._lib.plant_step(x, u, step)
            rows.append([getattr(x, name) for name in self.states])
        return np.array(rows)


@functools.cache
def plant(name: str) -> CPlant:
    tables, car = CARS[name]
    return CPlant(parse(tables, "test"), car)


@pytest.mark.parametrize("name", CARS)
def test_derivative_and_output_in_c(name: str) -> None:
    """The bits equal the CasADi machine's, operation by operation; the numbers match the independent car and a parametric car.

    States and inputs exceed normal driving: lifted wheels, actuators at their limits, crawling, reversing.
    """
    c, count = plant(name), 600
    rng = np.random.default_rng(1)
    further = [FURTHER_SIZES.get(name, 0.1) for name in c.states[7:]]
    x = rng.normal(size=(count, len(c.states))) * [3.0, 0.6, 2.0, 0.06, 50.0, 50.0, 2.0, *further]
    if "motor_angle" in c.states:  # half of the points within the play
        x[:, c.states.index("motor_angle")] = x[:, 3] + rng.normal(size=count) * c.car.play
    speeds = np.where(rng.random(count) < 0.2, rng.uniform(-2.0, 2.0, count), rng.uniform(2.0, 60.0, count))
    speeds[0] = 0.0
    commands = x[:, 2:4] + rng.normal(size=(count, 2)) * 0.05
    outside = rng.normal(size=(count, 2)) * [5_000.0, 3_000.0]
    u = np.column_stack([speeds, commands, rng.uniform(0.05, 1.2, count), outside])
    assert np.mean(np.abs(x[:, 1] * speeds) > 16.0) > 0.1  # m/s^2: the inner wheels of both axles are lifted
    functions: dict[str, tuple[Any, Any, Any]] = {
        "derivative": (c.model.derivative, c.open_model.derivative, c.car.derivative),
        "output": (c.model.output, c.open_model.output, c.car.outputs),
    }
    for what, (machine, open_machine, independent) in functions.items():
        found = c.rows(what, x, u)
        assert found.tobytes() == np.array(machine.map(count)(x.T, u.T)).T.tobytes()
        # The same operations, except that CasADi folds known constants.
        of_parameters = np.array(open_machine.map(count)(x.T, u.T, c.parameters)).T
        np.testing.assert_allclose(of_parameters, found, rtol=1e-12, atol=1e-12)
        # Forces of 1e4 N with a dozen roundings each, over the mass: 1e-14 m/s^2; slip rates are about 1e2 rad/s. Springs of
        # 1e5 N m/rad move ten times that load, and the balance of a body that rolls is solved in another way.
        expected = np.array([independent(*point) for point in zip(x, u, strict=True)])
        tolerance = 3e-12 if c.car.roll_gradient else 1e-13
        np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance)
    assert (c.open_model.states, c.open_model.outputs) == (c.states, PLANT_OUTPUTS)


def hold(
    seconds: float, wheel_deg: float, rear_deg: float = 0.0, speed: float = 42.5 / 3.6, friction: float = 0.9, gust: float = 0.0
) -> tuple[float, np.ndarray]:
    return seconds, np.array([speed, math.radians(wheel_deg), math.radians(rear_deg), friction, gust, -0.5 * gust])


REAR_STEPS = [hold(0.3, 90.0, rear) for rear in (0.0, -3.011, -3.5, 2.77, -9.0, 0.0)]
GUSTS = [(25.0, 0.0), (-25.0, 800.0), (9.7, 0.0)]
SLALOM = [hold(0.7, wheel, speed=80.0 / 3.6, friction=0.6, gust=gust) for wheel, gust in GUSTS]
OTHER = [hold(1.0, 40.0, friction=1.0), hold(0.5, 40.0, -4.0, friction=1.0), hold(0.5, -33.0, 1.5, friction=0.5)]


# Yaw rate of the C plant (Runge-Kutta at 1 ms) compared with the independent car (adaptive, to 1e-11). The bounds are measured
# and rounded up; 1e-6 rad/s is required. The causes are the error of the step, and a kink of a rate limit between steps.
@pytest.mark.parametrize(
    ("name", "holds", "bound"),
    [
        # The rate limit ends after exactly 295 steps, so no kink falls between two of them.
        ("paper", [hold(0.2, 0.0), hold(2.0, 90.0)], 2.5e-9),
        ("paper", REAR_STEPS, 1.2e-7),
        ("relaxed", SLALOM, 5e-9),
        ("other", OTHER, 3e-7),
        # The motor is at both ends of its play. In the last of the holds this car spins.
        ("complete", OTHER[:2], 1e-6),
    ],
    ids=["step steer", "rear steps", "slalom with relaxed tyres", "other car", "all parts"],
)
def test_motion_is_that_of_the_independent_car(name: str, holds: list[tuple[float, np.ndarray]], bound: float) -> None:
    c = plant(name)
    expected = simulate(c.car, holds, PERIODS * MILLISECOND)
    found = c.run([u for seconds, u in holds for _ in range(round(seconds / MILLISECOND))], MILLISECOND)
    difference = np.abs(found[::PERIODS] - expected)
    assert np.abs(expected[:, 1]).max() > 0.1  # it turns
    assert difference[:, c.states.index("yaw_rate")].max() < bound
    # All other states, in their own units. At a kink the steering wheel differs by 5e-6 rad, and the motor by 2e-5 rad/s.
    kinks = [index for index, state in enumerate(c.states) if state in ("steering_wheel_angle", "motor_rate")]
    assert np.delete(difference, kinks, axis=1).max() < max(1e-6, 3.0 * bound)
    assert difference[:, kinks].max() < 2e-5

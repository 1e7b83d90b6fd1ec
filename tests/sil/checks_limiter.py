"""Checks of the generated limiter. Each takes the units of a build and raises AssertionError if the build fails it."""

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tests.sil.checks_lookup import RealArray, any_numbers, special_values
from tests.sil.units import Units

CHANGES: dict[str, dict[str, Any]] = {
    "as built": {},
    "no rate limit": {"rear_rate_max": 1000.0},
    "slow": {"rear_rate_max": 0.05},
    "nothing in opposite phase": {"opposite_phase_max": 0.0},
    "bounds that rise with speed": {"opposite_phase_max": "reversed"},
    "breakpoints side by side": {"opposite_phase_speed": "side by side"},
    "tight": {"rear_angle_max": 0.01, "opposite_phase_max": 0.004, "in_phase_from_front_angle": 1e-4},
}


def period(units: Units) -> float:
    """Return the sampling period, s."""
    return units.config.controller.sampling_time_s


def parameters_of(units: Units, changes: Mapping[str, Any]) -> Any:
    """Return valid parameters with some changed; a single number for an array fills it."""
    plain = units.limiter_parameters()
    arrays: dict[str, Any] = {}
    for name, value in changes.items():
        old = getattr(plain, name)
        if isinstance(old, float):
            continue
        if value == "reversed":
            arrays[name] = list(old)[::-1]
        elif value == "side by side":
            neighbours = [units.real(old[0])]
            while len(neighbours) < len(old):
                neighbours.append(np.nextafter(neighbours[-1], units.real(math.inf)))
            arrays[name] = [float(number) for number in neighbours]
        else:
            arrays[name] = [value] * len(old)
    parameters = units.limiter_parameters(**{**changes, **arrays})
    assert units.library.lib.ars_limiter_parameters_valid(parameters), changes
    return parameters


def drive(units: Units, parameters: Any, count: int, seed: int = 0) -> RealArray:
    """Return inputs (count, 3): slow and fast, straight and turning, near and distant demands, and spells of arbitrary
    values."""
    rng, real = np.random.default_rng(seed), units.real
    t = np.arange(count)
    speeds = np.array(list(parameters.opposite_phase_speed))
    speed = 0.7 * speeds[-1] * (1.0 + np.sin(2.0 * np.pi * t / 700.0)) * rng.choice([1.0, -1.0], count, p=[0.95, 0.05])
    front = 2.0 * parameters.in_phase_from_front_angle * np.sin(2.0 * np.pi * t / 170.0)
    front = np.where(rng.random(count) < 0.1, 0.0, front)
    demand = parameters.rear_angle_max * rng.uniform(-1.5, 1.5, count // 40 + 1).repeat(40)[:count]
    inputs = np.stack([speed, front, demand], axis=1).astype(real)
    edges = np.concatenate([speeds, [parameters.speed_max, parameters.front_angle_max, parameters.in_phase_from_front_angle]])
    near = np.concatenate([np.nextafter(edges.astype(real), real(side)) for side in (-math.inf, math.inf)])
    special = np.concatenate([special_values(real), edges.astype(real), near])
    strange = rng.random((count, 3)) < np.where((t // 300) % 4 == 3, 0.4, 0.01)[:, np.newaxis]
    for column in range(3):
        inputs[:, column] = np.where(strange[:, column], any_numbers(rng, real, count, special), inputs[:, column])
    inputs[:20, 0] = np.nan  # no speed yet
    return inputs


def check_limiter_at_breakpoints(units: Units) -> None:
    """Check that the bound at a breakpoint is exactly the breakpoint's own, whatever its neighbours, on both sides and for both
    signs of the speed.

    The bounds are chosen so that a sum of differences would not reproduce them.
    """
    real = units.real
    speeds = [float(speed) for speed in units.limiter_parameters().opposite_phase_speed]
    rng = np.random.default_rng(3)
    exact = 0
    for _ in range(100):
        bounds = rng.uniform(0.0, 0.05, len(speeds)).astype(real)
        exact += int(sum(a + (b - a) != b for a, b in itertools.pairwise(bounds)))
        parameters = units.limiter_parameters(rear_rate_max=1000.0, opposite_phase_max=bounds.tolist())
        assert units.library.lib.ars_limiter_parameters_valid(parameters)
        for k, speed in enumerate(speeds):
            for sign, side in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)):
                inputs = np.array([[sign * speed, side * 0.1, -side * 1.0]])
                assert units.limiter(parameters, inputs)[0] == real(-side) * bounds[k], (k, sign, side)
    assert exact > 3, "the difference matters for some"


def check_limiter_parameters(units: Units) -> None:
    """Check that each parameter is accepted up to the ends of its range and rejected one unit in the last place beyond.

    Array elements are tested one by one. Breakpoints must increase, and no bound may exceed the largest angle.
    """
    real, plain = units.real, units.limiter_parameters()
    count = len(plain.opposite_phase_speed)

    def valid(**changes: Any) -> bool:
        return bool(units.library.lib.ars_limiter_parameters_valid(units.limiter_parameters(**changes)))

    def beyond(value: float, outward: float) -> float:
        return float(np.nextafter(real(value), real(outward)))

    ranges = {"rear_rate_max": (math.radians(1.0), 1000.0), "in_phase_from_front_angle": (1e-4, 1.0), "speed_max": (1.0, 200.0),
              "front_angle_max": (0.01, 1.5), "rear_angle_max": (1e-4, 1.0)}  # fmt: skip
    none = {"opposite_phase_max": [0.0] * count}
    for name, (low, high) in ranges.items():
        assert valid(**{name: low}, **none) and valid(**{name: high}, **none), name
        for bad in (beyond(low, -math.inf), beyond(high, math.inf), math.nan, math.inf, -math.inf):
            assert not valid(**{name: bad}, **none), (name, bad)
    for angle in (1.0, 0.5):
        assert valid(rear_angle_max=angle, opposite_phase_max=[angle] * count)
    far = [10.0 * k for k in range(1, count - 1)]
    assert valid(opposite_phase_speed=[0.0, *far, 200.0])
    assert not valid(opposite_phase_speed=[0.0, *far, beyond(200.0, math.inf)])
    speeds, bounds, most = list(plain.opposite_phase_speed), list(plain.opposite_phase_max), float(plain.rear_angle_max)
    for k in range(count):
        for bad in (math.nan, math.inf, -math.inf, beyond(0.0, -1.0)):
            assert not valid(opposite_phase_speed=[*speeds[:k], bad, *speeds[k + 1 :]]), k
            assert not valid(opposite_phase_max=[*bounds[:k], bad, *bounds[k + 1 :]]), k
        assert valid(opposite_phase_max=[*bounds[:k], most, *bounds[k + 1 :]])
        assert not valid(opposite_phase_max=[*bounds[:k], beyond(most, 1.0), *bounds[k + 1 :]]), k
        close = [float(j) for j in range(count)]
        for same, increases in ((k - 1.0, False), (beyond(k - 1.0, math.inf), True)) if k else ():
            assert valid(opposite_phase_speed=[*close[:k], same, *close[k + 1 :]]) == increases, k

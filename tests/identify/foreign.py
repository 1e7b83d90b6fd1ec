"""Cars that the model of the identification does not describe, and the drives from which they are identified."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import casadi as ca

from codegen.configuration import Config, preset
from codegen.identify.drive import Drive
from codegen.sil.plant import Plant, PlantInput, PlantSample
from codegen.units import KM_H
from codegen.vehicle.dynamics import two_track
from codegen.vehicle.tyre import CURVES, MAGIC_FORMULA, TyreCurve
from hil_sim.second_plant.plant import GRAVITY, PUBLISHED, ROLL, MultiBodyPlant, car_of, published
from hil_sim.third_plant import rolling
from tests.identify.drives import SENSOR, Course, Part, drive

START = Part(0.1, 60.0 * KM_H)
"""Beginning of every drive: the multi-body car cannot start at rest."""
ANGLE_MAX_DEG = 5.0
"""Largest angle of the rear actuators. It is larger than the bound of the map, 3.5 deg, at which a car that differs from the
model could not reach the yaw rate of the map."""


def leaning_plant(config: Config, curve: TyreCurve | None = None) -> Plant:
    """Return the car of `hil_sim.third_plant`, with another curve of its tyres."""
    config = rolling(config)
    with patch.dict(CURVES, {} if curve is None else {config.tyre.front.curve: curve}):
        return Plant(config, two_track(config))


class LeaningMultiBodyPlant(MultiBodyPlant):
    """The third-party car, whose accelerometer rolls with the body."""

    def sample(self, acting: PlantInput) -> PlantSample:
        """Return the current outputs, the lateral acceleration as measured."""
        found = super().sample(acting)
        measured = found.lateral_acceleration + GRAVITY * math.sin(self._state[ROLL])
        return replace(found, measured_lateral_acceleration=measured)


def _plant_curve(value: Callable[[Any, Any, Any], Any], peak: float) -> TyreCurve:
    """Return a curve with slope 1 at zero. What only solvers use stays that of the Magic Formula."""
    return replace(MAGIC_FORMULA, value=value, initial_slope=lambda _: 1.0, peak=lambda _: peak)


def _brush(_tyre: Any, x: Any, _functions: Any) -> Any:
    slip = ca.fmin(ca.fmax(x, -3.0), 3.0)
    return slip - slip * ca.fmax(slip, -slip) / 3.0 + slip**3 / 27.0


BRUSH = _plant_curve(_brush, 3.0)
"""Brush model with a parabolic pressure (H. B. Pacejka, Tire and Vehicle Dynamics, section 3.2.1): it slides as a whole beyond
three times the ratio of peak force and stiffness."""

TMEASY_RATIO = 2.2
"""Slope at zero times slip of the largest force, over that force."""


def _tmeasy(_tyre: Any, x: Any, _functions: Any) -> Any:
    slip = x / TMEASY_RATIO
    size = ca.fmax(slip, -slip)
    return TMEASY_RATIO * slip / (1.0 + size * (size + TMEASY_RATIO - 2.0))


TMEASY = _plant_curve(_tmeasy, TMEASY_RATIO)
"""Fraction of TMeasy up to its largest force, continued beyond (W. Hirschberg, G. Rill, H. Weinfurter, Tire model TMeasy,
Vehicle System Dynamics 45 S1, 2007)."""


@dataclass(frozen=True)
class ForeignCar:
    """A car that the model does not describe.

    Attributes:
        title: name in tables.
        config: what is known of it: masses, geometry, sensors and actuators; and its own tyres, as far as `ars.toml` has them.
        plant: function from the speed at the beginning (m/s) to the car.
        limit_acceleration: m/s^2 of the linear car to which it is steered in the drive to the limit; more rolls it over.
    """

    title: str
    config: Config
    plant: Callable[[float], Any]
    limit_acceleration: float = 14.0


def _base() -> Config:
    return preset("recommended").with_ideal_plant().replace({"rear_actuator": {"angle_max_deg": ANGLE_MAX_DEG}})


def _leaning(title: str, curve: TyreCurve | None = None) -> ForeignCar:
    config = _base()
    return ForeignCar(title, config, lambda _: leaning_plant(config, curve))


def _multi_body(number: int) -> ForeignCar:
    config = car_of(published(number), _base())
    title = f"third-party multi-body car, {PUBLISHED[number]}"
    return ForeignCar(title, config, lambda speed: LeaningMultiBodyPlant(config, speed, published(number)), 9.0)


CARS: dict[str, Callable[[], ForeignCar]] = {
    "roll": lambda: _leaning("roll, relaxation, second-order actuator"),
    "brush": lambda: _leaning("the same, brush tyres", BRUSH),
    "tmeasy": lambda: _leaning("the same, TMeasy tyres", TMEASY),
    "multi-body": lambda: _multi_body(2),
}
"""All cars by a short name."""


def programme(car: ForeignCar) -> tuple[tuple[Part, ...], ...]:
    """Return the drives of a car: that of `Course.everything` with slow turns to the slip bounds, and one to be held out."""
    course = Course(car.config)
    straight, slow, fast, back, steps = course.everything()[0]
    return (
        (START, straight, slow, fast, back, steps, course.turns(60.0, 6.5), course.turns(80.0, 6.5)),
        (START, course.front_sweep(50.0), course.front_sweep(80.0), course.rear_sweep(50.0), course.rear_sweep(80.0)),
        (START, course.limit(60.0, car.limit_acceleration), course.limit(50.0, car.limit_acceleration)),
        (START, *course.hold_out()),
    )


def drives(car: ForeignCar, seed: int = 0, *, sideslip: bool = True) -> list[Drive]:
    """Return the measured drives of `programme`, the last one to be held out."""
    signals = (*SENSOR, "delta_r_command", *(("sideslip",) if sideslip else ()))
    return [
        drive(car.config, parts, 10 * seed + k, name=f"drive {k}", signals=signals, plant=car.plant(START.speed))
        for k, parts in enumerate(programme(car))
    ]

"""The cells of the test set, which are step steers over speed and amplitude, and the conditions for every cell.

A condition is a change of the simulated car, as a function from a configuration to another, and a road. Only the plant is made
from the result; controller and map are those of the original. Properties that a change does not name are kept. Changes of mass
and peak keep the slope of the tyres at zero slip, their cornering stiffness. Otherwise the factor B would be kept, the slope
would follow load or peak, and a change of the mass would not affect the motion of the linear car at all. On a road of another
friction either B is kept, so that the stiffness falls with the friction, or the stiffness; the scenario sets that friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from codegen.configuration import Case, Config
from codegen.errors import CodegenError
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from codegen.vehicle.plant_car import deviations
from hil_sim import manoeuvres
from hil_sim.metrics.run import Figures
from hil_sim.scenarios import Scenario
from hil_sim.settings import Settings

CELL_SPEEDS_KM_H = (25.0, 42.5, 60.0, 80.0, 100.0, 120.0)
"""Speeds for a car that reaches 120 km/h; see `up_to`."""
CELL_ANGLE_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Fractions of the largest feasible front angle at a speed."""

CELL_STEER_TIME = 1.0
CELL_DURATION = 9.0
"""Duration in s. After the step 8 s remain: four time constants of a slow trim, and one second for the steady values."""

C1_SPEED_KM_H = 42.5
C1_STEERING_WHEEL_DEG = 90.0
"""The paper's step, section Validation Setup."""


@dataclass(frozen=True)
class Cell(Figures):
    """A step steer at a constant speed, the steering wheel turned as fast as the configuration allows.

    Attributes:
        speed_km_h: speed of the car.
        front_angle_deg: angle at the road wheels, to the left.
        share: fraction of the largest feasible front angle at that speed; None for another choice of angle.
    """

    speed_km_h: float
    front_angle_deg: float
    share: float | None = None

    @property
    def title(self) -> str:
        """Text for tables."""
        share = "" if self.share is None else f" ({100.0 * self.share:g} %)"
        return f"{self.speed_km_h:g} km/h, {self.front_angle_deg:.3g} deg{share}"

    def scenario(self, config: Config, friction: float | None = None, estimate: float | None = None) -> Scenario:
        """Return the scenario on a road (None: the configured friction), with a friction estimate (None: unknown)."""
        return Scenario(
            name="step-steer-cell",
            subject="Step steer",
            what="one cell of the test set",
            source="ISO 7401:2011, clause 10 (step input)",
            duration=CELL_DURATION,
            steer_time=CELL_STEER_TIME,
            kind="step",
            drive=manoeuvres.step(CELL_STEER_TIME),
            settings=Settings(self.speed_km_h, self.front_angle_deg * config.steering.ratio, friction, estimate),
        )


def cells(
    config: Config, case: Case, speeds_km_h: tuple[float, ...] | None = None, shares: tuple[float, ...] = CELL_ANGLE_SHARES
) -> tuple[Cell, ...]:
    """Return the cells of a car: speeds times shares, without speeds beyond the map; by default 24 for a map to 120 km/h.

    The largest feasible front angle is that of the continuous problem, capped at the grid's last front angle.

    Raises:
        CodegenError: the grid ends below the first of the speeds.
        ConfigError: see `turns_of` and `breakpoints`.
    """
    last, front_angle = last_cell_km_h(config), breakpoints(config)[1]
    listed = up_to(last, CELL_SPEEDS_KM_H) if speeds_km_h is None else speeds_km_h
    speeds = tuple(speed for speed in listed if speed <= last * (1.0 + 1e-9))
    if not speeds:
        slowest = (speeds_km_h or CELL_SPEEDS_KM_H)[0]
        raise CodegenError(
            f"the grid ends at {last:.4g} km/h, and the slowest cell of the test set has {slowest:g}",
            where="grid",
            remedy="solve a map that reaches higher speeds",
        )
    edge = turns_of(config, case).edge(np.array(speeds) * KM_H, float(front_angle[-1])).front_angle
    largest = np.rad2deg(np.minimum(edge, front_angle[-1]))
    return tuple(
        Cell(value, share * float(angle), share) for value, angle in zip(speeds, largest, strict=True) for share in shares
    )


def up_to(last_km_h: float, speeds_km_h: Sequence[float]) -> tuple[float, ...]:
    """Return listed speeds (km/h) up to a last one. If it is above the list, more follow in its last step, and the last one."""
    last, end = round(last_km_h, 6), speeds_km_h[-1]
    if last <= end:
        return tuple(speed for speed in speeds_km_h if speed <= last)
    step = end - speeds_km_h[-2]
    return (*speeds_km_h, *(end + step * k for k in range(1, math.ceil((last - end) / step - 1e-9))), last)


def last_cell_km_h(config: Config) -> float:
    """Return the largest speed of cells, in km/h: the last one of the map that the car reaches."""
    return min(float(breakpoints(config)[0][-1]) / KM_H, config.top_speed_km_h)


def c1(config: Config) -> Cell:
    """Return the paper's step."""
    return Cell(C1_SPEED_KM_H, C1_STEERING_WHEEL_DEG / config.steering.ratio)


def front_angle(cell: Cell) -> float:
    """Return the front angle at the road wheels in rad."""
    return math.radians(cell.front_angle_deg)


Change = Callable[[Config], Config]
VARIED = "varied plant"
"""Location in the message of a car that is impossible."""


def unchanged(config: Config) -> Config:
    """Return the car as configured."""
    return config


def mass(percent: float) -> Change:
    """Return a change of the mass (in %), with the yaw inertia and the same centre of gravity."""
    return lambda config: config.replace(deviations(config, mass=1.0 + percent / 100.0), VARIED)


def actuator_lag(factor: float) -> Change:
    """Return a change of the rear actuator's lag."""
    return lambda config: config.replace({"rear_actuator.lag_s": round(factor * config.rear_actuator.lag_s, 9)}, VARIED)


def stiffness(front_percent: float, rear_percent: float) -> Change:
    """Return a change of the tyres' slope (in %) at the same peak."""
    front, rear = (1.0 + percent / 100.0 for percent in (front_percent, rear_percent))
    return lambda config: config.replace(deviations(config, front_stiffness=front, rear_stiffness=rear), VARIED)


def peak(percent: float) -> Change:
    """Return a change of the peak force (p1, in %) at the same slope."""
    return lambda config: config.replace(deviations(config, tyre_peak=1.0 + percent / 100.0), VARIED)


def load_sensitivity(p2: float) -> Change:
    """Return a change that lowers peak friction (p2 below zero) with wheel load above the static load."""
    return lambda config: config.replace({f"tyre.{axle}.peak_load_sensitivity_p2": p2 for axle in ("front", "rear")}, VARIED)


def relaxation(length: float) -> Change:
    """Return a change that adds a relaxation length (m) to the tyres."""
    return lambda config: config.replace({"plant.relaxation_length_m": length}, VARIED)


def ideal(config: Config) -> Config:
    """Return the configuration of the ideal car: see `codegen.configuration.IDEAL_PLANT`."""
    return config.with_ideal_plant()


def kept_stiffness(share: float) -> Change:
    """Return a change of the share of the tyres' stiffness that slippery roads keep."""
    return lambda config: config.replace({"plant.slippery_stiffness_share": share}, VARIED)


def together(*changes: Change) -> Change:
    """Return several changes as one."""

    def change(config: Config) -> Config:
        for each in changes:
            config = each(config)
        return config

    return change


Group = Literal["nominal", "plant", "lag", "mass", "tyre", "combined", "friction"]

LAG_FACTORS = (0.4, 1.0, 2.0)
LOW_FRICTIONS = (0.6, 0.4)
ESTIMATE_ERROR = 0.2
"""Largest overestimate of the friction."""


@dataclass(frozen=True)
class Condition:
    """A car and a road.

    Attributes:
        name, title: key, and name in tables.
        group: varied property.
        plant: change of the configuration for the plant.
        friction: friction of the road; None for the configured one.
        estimate: friction estimate for the controller; None for unknown.
        what: details beyond the title.
        with_sensors: whether the controller measures with the errors of `[sensors]`, see `sensor_errors`. Only batches do so.
    """

    name: str
    title: str
    group: Group
    plant: Change = unchanged
    friction: float | None = None
    estimate: float | None = None
    what: str = ""
    with_sensors: bool = False

    @property
    def estimate_or_nan(self) -> float:
        """Friction estimate as passed to the C."""
        return math.nan if self.estimate is None else self.estimate

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values, without the function."""
        names = ("name", "title", "group", "friction", "estimate", "what")
        return {name: getattr(self, name) for name in names}


NOMINAL = Condition("nominal", "as configured", "nominal")
IDEAL = Condition(
    "ideal", "ideal plant", "plant", ideal, what="no relaxation, no roll, and an actuator of first order without backlash"
)
SENSORS = Condition(
    "sensors", "errors of the sensors", "plant", with_sensors=True, what="noise, resolution and bias of [sensors]"
)
MASSES = (
    Condition("mass-minus-20", "mass -20 %", "mass", mass(-20.0)),
    Condition("mass-plus-20", "mass +20 %", "mass", mass(20.0)),
)
TYRES = (
    Condition("stiffness-minus-20", "tyre stiffness -20 %", "tyre", stiffness(-20.0, -20.0)),
    Condition("stiffness-plus-15", "tyre stiffness +15 %", "tyre", stiffness(15.0, 15.0)),
    Condition("rear-stiffness-minus-20", "rear tyre stiffness -20 %", "tyre", stiffness(0.0, -20.0)),
    Condition("peak-minus-10", "tyre peak -10 %", "tyre", peak(-10.0)),
    Condition("peak-plus-10", "tyre peak +10 %", "tyre", peak(10.0)),
    Condition("load-sensitivity", "load sensitivity p2 = -0.1", "tyre", load_sensitivity(-0.1)),
    Condition("relaxation-300", "relaxation length 0.3 m", "tyre", relaxation(0.3)),
    Condition("relaxation-600", "relaxation length 0.6 m", "tyre", relaxation(0.6)),
)
COMBINED = Condition(
    "combined",
    "many at once",
    "combined",
    together(
        actuator_lag(2.0),
        mass(20.0),
        stiffness(-20.0, -20.0),
        peak(-10.0),
        load_sensitivity(-0.1),
        relaxation(0.6),
    ),
    what="twice the actuator lag, mass +20 %, tyre stiffness -20 %, peak -10 %, p2 = -0.1 and relaxation length 0.6 m",
)


ROADS = (("", "", 0.0), ("-stiff", ", stiff", 1.0))
"""Both kinds of slippery road: end of the name, of the title, and share of the tyres' stiffness that the road keeps."""


def _on_road(friction: float, road: tuple[str, str, float]) -> tuple[Condition, ...]:
    end, kept, share = road
    key, title, plant = f"friction-{100.0 * friction:.0f}{end}", f"friction {friction:g}{kept}", kept_stiffness(share)
    wrong, what = round(friction + ESTIMATE_ERROR, 9), "the road keeps the cornering stiffness of the tyres" if share else ""
    return (
        Condition(key, f"{title}, no estimate", "friction", plant, friction, what=what),
        Condition(f"{key}-exact", f"{title}, estimated {friction:g}", "friction", plant, friction, friction),
        Condition(f"{key}-wrong", f"{title}, estimated {wrong:g}", "friction", plant, friction, wrong),
    )


SLIPPERY = tuple(condition for road in ROADS for friction in LOW_FRICTIONS for condition in _on_road(friction, road))


def lags(lag_s: float) -> tuple[Condition, ...]:
    """Return the conditions with another lag of the actuator, of a car whose own lag is `lag_s`: the fastest first."""
    texts = [(f"{1e3 * factor * lag_s:.4g}", factor) for factor in LAG_FACTORS]
    return tuple(Condition(f"lag-{text}", f"actuator lag {text} ms", "lag", actuator_lag(factor)) for text, factor in texts)


def conditions(config: Config) -> tuple[Condition, ...]:
    """Return the conditions that apply to a configuration: no road with more friction than its map assumes."""
    slippery = (each for each in SLIPPERY if each.friction is not None and each.friction < config.road.friction)
    return (NOMINAL, IDEAL, SENSORS, *lags(config.rear_actuator.lag_s), *MASSES, *TYRES, COMBINED, *slippery)

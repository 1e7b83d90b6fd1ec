"""Tables and figures of the page on the choice of the map: maps of two cars, and the effect of each key on them.

Every turn is that of the car with its nonlinear tyres at the yaw rate of the map, also for the map of the linear tyre.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.judged_cars import PAPER, five_cars
from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.ecu_map.extend import extend
from codegen.figures.data import (
    BLUE,
    FRONT_ANGLE_TITLE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    VERMILION,
    Chart,
    Picture,
    axis,
    entry,
    legend_at,
    level,
    line,
    panel,
)
from codegen.figures.draw import draw
from codegen.judgement.passive import PassiveTurns, usable_slip
from codegen.judgement.steady import steady_figures
from codegen.map_file.map import ReferenceMap
from codegen.optimum.nonlinear_car import SteadyCar, Turns, curve
from codegen.optimum.solve import solve_case
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres
from scripts.guide.markdown import table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CASE = "4ws-2"
CARS: Mapping[str, tuple[str, str]] = {
    "paper": (PAPER, "The paper's car"),
    "van": ("van, loaded", "Loaded van, understeering"),
}
"""Argument of a region or figure -> name in `benchmarks.judged_cars`, and title."""

SPEEDS_KM_H = (20.0, 60.0, 80.0, 120.0)
SHOWN_KM_H = (60.0, 120.0)

WEIGHT, GRIP = f"cases.{CASE}.sideslip_weight_per_s2", "limits.grip_use_max"
FLOOR, CHARACTERISTIC = "limits.yaw_gain_floor", "limits.reference_characteristic_speed_km_h"
KEYS: Mapping[str, tuple[float, ...]] = {
    WEIGHT: (100.0, 300.0, 3000.0, 10_000.0),
    GRIP: (0.8, 0.9, 0.98, 0.995),
    FLOOR: (0.0, 0.9, 1.0, 1.2),
    CHARACTERISTIC: (60.0, 80.0, 100.0, 130.0),
}
"""Values of each key in the tables and figures. The recommended one is among them."""
LIMITS: Mapping[str, tuple[float, ...]] = {
    "limits.lateral_acceleration_max_g": (0.6, 0.8, 1.0),
    "limits.rear_angle_max_deg": (1.0, 2.0, 3.5, 5.0),
}
"""Values of keys in the tables alone."""

RECOMMENDED, OLD, LINEAR = "recommended", "old bound", "linear"
_WITHOUT_GRIP = {GRIP: None, FLOOR: 0.0}
MAPS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    LINEAR: ("linear tyre, as in the paper", {**_WITHOUT_GRIP, f"cases.{CASE}.tyre_model": "linear"}),
    OLD: ("nonlinear tyre, slip up to 10 % of departure", _WITHOUT_GRIP),
    RECOMMENDED: ("recommended", {}),
}
"""Maps in the comparison: title, and changes of the recommended configuration."""


@dataclass(frozen=True)
class Car:
    """A car with straight rear wheels: its configuration, and its steady turns up to the peak of its tyres at SPEEDS_KM_H."""

    title: str
    config: Config
    steady: SteadyCar
    passive: PassiveTurns

    def turns(self, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray) -> Turns:
        """Return the turns (n,) of the nonlinear car; NaN without one that an axle can hold."""
        with np.errstate(all="ignore"):  # turns beyond the grip
            turns = self.steady.turns(speed, front_angle, yaw_rate)
        held = (np.abs(turns.slip_front) <= self.steady.front.slip_max) & (np.abs(turns.slip_rear) <= self.steady.rear.slip_max)
        missing = ~(held & turns.converged)
        for values in (turns.slip_front, turns.slip_rear, turns.sideslip):
            values[missing] = np.nan
        return turns


def _place(speed_km_h: float) -> int:
    return SPEEDS_KM_H.index(speed_km_h)


@functools.cache
def _car(name: str) -> Car:
    key, title = CARS[name]
    grid = {"speed_breakpoints_km_h": list(SPEEDS_KM_H)}
    config = five_cars()[key].replace({"grid": grid}, "scripts/guide/map_choice.py")
    tyres = AxleTyres.from_config(config)
    steady = SteadyCar.from_config(config, (usable_slip(tyres.front), usable_slip(tyres.rear)))
    return Car(title, config, steady, PassiveTurns.of(config, KM_H * np.array(SPEEDS_KM_H)))


@dataclass(frozen=True)
class Row:
    """Steady turns at one speed over front angles: (m,) in rad, rad/s and m/s.

    Attributes:
        yaw_rate: as the ECU looks it up; NaN where a passive car has no turn.
        inside: where the turn is one of the map, and not of its extension.
    """

    speed: float
    front_angle: FloatArray
    yaw_rate: FloatArray
    inside: BoolArray


@dataclass(frozen=True)
class Solved:
    """A map of a car with its configuration."""

    car: Car
    config: Config
    reference_map: ReferenceMap

    def row(self, speed_km_h: float) -> Row:
        """Return the map at one of SPEEDS_KM_H, with its extension."""
        one, speed = self.reference_map, speed_km_h * KM_H
        total = extend(one, self.config)
        place = int(np.argmin(np.abs(total.speed - speed)))
        rates = np.minimum(total.yaw_rate[place], total.lateral_acceleration_cap / speed)
        yaw_rate = np.interp(one.front_angle, total.front_angle, rates)
        return Row(speed, one.front_angle, yaw_rate, one.feasible[_place(speed_km_h)])

    @functools.cached_property
    def grip_use(self) -> float:
        """Largest share of its lateral force that an axle uses in the map."""
        one, steady = self.reference_map, self.car.steady
        where = np.nonzero(one.feasible)
        turns = self.car.turns(one.speed[where[0]], one.front_angle[where[1]], one.yaw_rate[where])
        uses = []
        for axle, slip in ((steady.front, turns.slip_front), (steady.rear, turns.slip_rear)):
            peak = curve(axle.tyre, np.array([axle.tyre.peak_slip]))[0]
            uses.append(np.nanmax(curve(axle.tyre, np.abs(slip))[0] / peak))
        return float(max(uses))


@functools.cache
def _solved(name: str, changes: tuple[tuple[str, Any], ...]) -> Solved:
    car = _car(name)
    config = car.config.replace(dict(changes), "scripts/guide/map_choice.py")
    return Solved(car, config, solve_case(config, CASE))


def _of_map(name: str, which: str) -> Solved:
    return _solved(name, tuple(MAPS[which][1].items()))


def _of_key(name: str, key: str, value: float) -> Solved:
    return _solved(name, () if value == _own_value(name, key) else ((key, value),))


def _own_value(name: str, key: str) -> float:
    value: Any = _car(name).config
    for part in key.split("."):
        value = value[part] if isinstance(value, Mapping) else getattr(value, part)
    return float(value)


def _passive_row(car: Car, speed_km_h: float, front_angle: FloatArray) -> Row:
    yaw_rate = car.passive.yaw_rate(front_angle)[_place(speed_km_h)]
    return Row(speed_km_h * KM_H, front_angle, yaw_rate, np.isfinite(yaw_rate))


# --- tables ------------------------------------------------------------------------------------------------------------

POINTS = ((60.0, 0.4), (60.0, 0.7), (120.0, 0.4))
"""Operating points: speed in km/h, and the lateral acceleration in g that the passive car reaches at the same front angle."""

POINTS_HEAD = tuple(f"{speed:g} km/h, {share:g} g: yaw rate, β" for speed, share in POINTS)
LIMITS_HEAD = ("largest ay", "grip used", "feasible")
JUDGED_HEAD = ("least yaw rate, 80 and 120 km/h", "falling steps")


def _at_points(car: Car, row_of: Callable[[float], Row]) -> Iterator[str]:
    """Yield yaw rate over the passive car's, and sideslip in deg, at each of POINTS."""
    for speed_km_h, acceleration_g in POINTS:
        row, acceleration = row_of(speed_km_h), acceleration_g * car.config.road.gravity_m_s2
        at = np.interp([acceleration], car.passive.lateral_acceleration, car.passive.front_angle[_place(speed_km_h)])
        rate = np.interp(at, row.front_angle, row.yaw_rate)
        sideslip = math.degrees(car.turns(np.array([row.speed]), at, rate).sideslip[0])
        yield f"{100.0 * rate[0] * row.speed / acceleration:.0f} %, {round(sideslip, 1) + 0.0:.1f}°"


def _at_limits(solved: Solved) -> Iterator[str]:
    """Yield the largest lateral acceleration, the largest use of grip, and the share of feasible cells."""
    one = solved.reference_map
    yield f"{np.nanmax(one.speed[:, np.newaxis] * one.yaw_rate) / solved.config.road.gravity_m_s2:.2f} g"
    yield f"{100.0 * solved.grip_use:.0f} %"
    yield f"{100.0 * one.feasible.mean():.0f} %"


def comparison(name: str) -> str:
    """Return the table of the maps of a car beside the passive car."""
    car = _car(name)
    angles = _of_map(name, RECOMMENDED).reference_map.front_angle
    passive = (
        *_at_points(car, lambda speed_km_h: _passive_row(car, speed_km_h, angles)),
        f"{car.passive.largest.max() / car.config.road.gravity_m_s2:.2f} g",
        *("100 %", "", "", "0 %"),
    )
    rows = [("straight rear wheels", *passive)]
    for which, (title, _) in MAPS.items():
        solved = _of_map(name, which)
        judged = steady_figures(solved.reference_map, solved.config)
        shares = (f"{100.0 * judged.high.ratio:.0f} %", f"{judged.dead.falling_percent:.0f} %")
        rows.append((title, *_at_points(car, solved.row), *_at_limits(solved), *shares))
    return table((car.title, *POINTS_HEAD, *LIMITS_HEAD, *JUDGED_HEAD), rows)


def keys(name: str) -> str:
    """Return the table of a car over the values of each key; the car's own values are bold."""
    car, head = _car(name), (*POINTS_HEAD, *LIMITS_HEAD)
    rows: list[tuple[str, ...]] = []
    for key, values in {**KEYS, **LIMITS}.items():
        rows.append((f"`{key.rpartition('.')[2]}`", *("" for _ in head)))
        for value in values:
            solved = _of_key(name, key, value)
            text = f"**{value:g}**" if value == _own_value(name, key) else f"{value:g}"
            rows.append((text, *_at_points(car, solved.row), *_at_limits(solved)))
    return table((car.title, *head), rows)


# --- figures -----------------------------------------------------------------------------------------------------------

FRONT_ANGLE_MAX_DEG = 10.0
PANELS = ("Yaw rate (deg/s)", "Lateral acceleration (g)", "Sideslip (deg)")
Look = tuple[str, str, float]
"""Colour, dash and width of a line."""
LOOKS: Mapping[str, Look] = {LINEAR: (ORANGE, "solid", 2), OLD: (VERMILION, "solid", 2), RECOMMENDED: (BLUE, "solid", 3)}
PASSIVE: Look = (INK, "dot", 2)
BEYOND: Look = (MUTED, "dash", 1.5)
COMMON: Sequence[tuple[str, Look]] = (("straight rear wheels", PASSIVE), ("beyond the last turn of the map", BEYOND))


def _curves(car: Car, row: Row) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return yaw rate in deg/s, lateral acceleration in g and sideslip in deg over the front angle."""
    speed = np.full(row.front_angle.shape, row.speed)
    known = np.where(row.inside, row.yaw_rate, 0.0)
    sideslip = np.where(row.inside, car.turns(speed, row.front_angle, known).sideslip, np.nan)
    acceleration = row.speed * row.yaw_rate / car.config.road.gravity_m_s2
    return np.degrees(row.yaw_rate), acceleration, np.degrees(sideslip)


def _lines(row: Row, values: FloatArray, look: Look) -> Iterator[dict[str, Any]]:
    """Yield the line of a map, and that of its extension, which is dashed. Both have the last turn of the map."""
    degrees, (colour, dash, width) = np.degrees(row.front_angle), look
    beyond = ~row.inside
    beyond[:-1] |= ~row.inside[1:]
    yield line(degrees, np.where(row.inside, values, np.nan), "", colour, dash=dash, width=width)
    yield line(degrees, np.where(beyond, values, np.nan), "", colour, dash=BEYOND[1], width=BEYOND[2])


@dataclass(frozen=True)
class Column:
    """Panels below each other: their title, the maps with their looks, the thickest last, and the legend of the first panel."""

    title: str
    rows: Sequence[tuple[Row, Look]]
    legend: Sequence[tuple[str, Look]] = ()


def _picture(
    car: Car, columns: Sequence[Column], entries: Sequence[tuple[str, Look]], size: tuple[float, float], title: str
) -> Picture:
    """Return a picture of `columns`, each with a panel for each of PANELS, and with `entries` in the common legend."""
    curves = [[_curves(car, row) for row, _ in column.rows] for column in columns]
    charts: list[list[Chart | None]] = []
    for k, label in enumerate(PANELS):
        low, high = (of([of(each[k]) for column in curves for each in column]) for of in (np.nanmin, np.nanmax))
        room = 0.06 * (high - low)
        y = axis(label, range=[min(0.0, low - room) if k == 2 else 0.0, high + room])
        x = axis(FRONT_ANGLE_TITLE, range=[0.0, FRONT_ANGLE_MAX_DEG])
        charts.append([])
        for column, found in zip(columns, curves, strict=True):
            data = [
                each for (row, look), values in zip(column.rows, found, strict=True) for each in _lines(row, values[k], look)
            ]
            own = column.legend if k == 0 else entries
            data += [entry(name, colour, dash, width) for name, (colour, dash, width) in own]
            place = {"legend": legend_at(0.98, 0.02)} if k == 0 and column.legend else {}
            charts[-1].append(
                panel(data, x, y, title=column.title if k == 0 else "", shapes=[level(0.0, dash="solid")], **place)
            )
    return Picture(charts, size, title)


def maps_figure(name: str) -> Figure:
    """Draw the maps of a car and the passive car over the front angle, at SHOWN_KM_H."""
    car = _car(name)
    angles = _of_map(name, RECOMMENDED).reference_map.front_angle
    columns = []
    for speed_km_h in SHOWN_KM_H:
        rows = [(_of_map(name, which).row(speed_km_h), look) for which, look in LOOKS.items()]
        columns.append(Column(f"{speed_km_h:g} km/h", [*rows, (_passive_row(car, speed_km_h, angles), PASSIVE)]))
    entries = [*((MAPS[which][0], look) for which, look in LOOKS.items()), *COMMON]
    return draw(_picture(car, columns, entries, (8.4, 7.4), car.title))


VALUE_COLOURS = (ORANGE, GREEN, PURPLE)
KEY_TITLES = {
    WEIGHT: "Weight on sideslip (s⁻²)",
    GRIP: "Grip use",
    FLOOR: "Floor of the yaw rate",
    CHARACTERISTIC: "Characteristic speed (km/h)",
}


def keys_figure(name: str, speed_km_h: float) -> Figure:
    """Draw the effect of each key on the map of a car at one speed: a column for each key."""
    car = _car(name)
    angles = _of_map(name, RECOMMENDED).reference_map.front_angle
    passive = _passive_row(car, speed_km_h, angles), PASSIVE
    columns = []
    for key, values in KEYS.items():
        others = iter(VALUE_COLOURS)
        looks: dict[float, Look] = {
            value: LOOKS[RECOMMENDED] if value == _own_value(name, key) else (next(others), "solid", 1.75) for value in values
        }
        drawn = sorted(looks.items(), key=lambda item: item[1][2])
        rows = [(_of_key(name, key, value).row(speed_km_h), look) for value, look in drawn]
        columns.append(Column(KEY_TITLES[key], [*rows, passive], [(f"{value:g}", look) for value, look in looks.items()]))
    entries = [("recommended", LOOKS[RECOMMENDED]), *COMMON]
    return draw(_picture(car, columns, entries, (10.4, 7.2), f"{car.title}, {speed_km_h:g} km/h"))

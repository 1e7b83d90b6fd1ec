"""Properties of a controller beyond the cells of the test set.

- Cost: rise time over speed, and tracking of a sine at the steering wheel.
- Margins of its feedback over speed, for the configured car and the whole family of cars.
- Unevenly timed samples without a loss: a car held straight against a yaw moment, with three timings of its frames.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.margins import Margins, family_margins, family_range_km_h, nominal_margins
from codegen.emit.laws import law_of
from codegen.sil.software import RECORD_COLUMNS, Software
from codegen.units import KM_H
from hil_sim.bench import run_through_can
from hil_sim.faults import Fault
from hil_sim.metrics.run import Figures, Run, column, spin_time
from hil_sim.metrics.steering_response import FrequencyResponse, frequency_response
from hil_sim.scenario_files import find
from hil_sim.scenarios import FREE_RUNNING, Scenario
from hil_sim.suite.cells import NOMINAL, Cell, Condition, up_to
from hil_sim.suite.runs import CellResult, software_of
from hil_sim.suite.subjects import Subject

SINE_SPEEDS = 2
"""Number of speeds of the sine, the largest ones of the cells."""
SINE_FREQUENCIES_HZ = (0.5, 1.0, 1.5)
SINE_SHARE = 0.1
"""Amplitude of the sine, of the largest feasible front angle: 1 to 3 m/s^2, where tyres hardly bend."""


@dataclass(frozen=True)
class RiseTime(Figures):
    """Rise time t90 of a subject at one speed, over its cells that stay on the road; None without such a cell."""

    subject: str
    speed_km_h: float
    mean_s: float | None
    largest_s: float | None


@dataclass(frozen=True)
class SineTracking(Figures):
    """Tracking of a sine by a subject at one speed and frequency.

    Attributes:
        gain_of_steady: gain from steering wheel to yaw rate over that at the lowest frequency of the sweep (0.2 Hz).
        gain_of_map: yaw rate over that of the map at each instant.
        phase_deg: phase of the yaw rate relative to the steering wheel, negative for a lag. The map itself has none.
    """

    subject: str
    speed_km_h: float
    frequency_hz: float
    gain_of_steady: float | None
    gain_of_map: float | None
    phase_deg: float | None


def rise_times(subject: str, results: Sequence[CellResult]) -> tuple[RiseTime, ...]:
    """Return one row for each speed among the results."""
    rows = []
    for speed in dict.fromkeys(result.cell.speed_km_h for result in results):
        times = [r.rise_time_s for r in results if r.cell.speed_km_h == speed and r.rise_time_s is not None]
        mean, largest = (sum(times) / len(times), max(times)) if times else (None, None)
        rows.append(RiseTime(subject, speed, mean, largest))
    return tuple(rows)


@dataclass(frozen=True)
class Slower:
    """Rise times of two subjects at one speed, means over the cells in which both stay on the road."""

    speed_km_h: float
    cells: int
    mean_s: float
    other_mean_s: float

    @property
    def difference_s(self) -> float:
        """Difference in s; positive if the first is slower."""
        return self.mean_s - self.other_mean_s


def compare_rise(results: Sequence[CellResult], others: Sequence[CellResult]) -> tuple[Slower, ...]:
    """Return one row for each speed with such cells; both in the same order of cells."""
    rows = []
    for speed in dict.fromkeys(result.cell.speed_km_h for result in results):
        pairs = [
            (one.rise_time_s, other.rise_time_s)
            for one, other in zip(results, others, strict=True)
            if one.cell.speed_km_h == speed and one.rise_time_s is not None and other.rise_time_s is not None
        ]
        if pairs:
            means = [sum(times) / len(pairs) for times in zip(*pairs, strict=True)]
            rows.append(Slower(speed, len(pairs), *means))
    return tuple(rows)


def sine_scenario(cell: Cell, ratio: float) -> Scenario:
    """Return the sine sweep at the speed and the front angle of a cell; `ratio` is the steering ratio."""
    sweep = find("sine-sweep")
    angle = cell.front_angle_deg * ratio
    return replace(sweep, settings=replace(sweep.settings, speed_km_h=cell.speed_km_h, steering_wheel_angle_deg=angle))


def sine_tracking(subject: Subject, cells: Iterable[Cell], condition: Condition = NOMINAL) -> tuple[SineTracking, ...]:
    """Return rows at the largest SINE_SPEEDS speeds of cells at the largest feasible front angle. Raises BuildError."""
    rows: list[SineTracking] = []
    for cell in [cell for cell in cells if cell.share == 1.0][-SINE_SPEEDS:]:
        smaller = Cell(cell.speed_km_h, SINE_SHARE * cell.front_angle_deg, SINE_SHARE)
        rows += _at_one_speed(subject, smaller, condition)
    return tuple(rows)


def _at_one_speed(subject: Subject, cell: Cell, condition: Condition) -> list[SineTracking]:
    software = software_of(subject, condition)
    plant = software.config
    scenario = sine_scenario(cell, plant.steering.ratio)
    record = subject.loop(software).run(scenario.inputs(plant))
    asked = _with_map_yaw_rate(software, record)
    found, of_map = (frequency_response(Run(made, scenario, plant)) for made in (record, asked))
    if spin_time(record) is not None or found is None or of_map is None:
        return [SineTracking(subject.name, cell.speed_km_h, f, None, None, None) for f in SINE_FREQUENCIES_HZ]
    rows = []
    for frequency in SINE_FREQUENCIES_HZ:
        gain, phase = _at(found, frequency)
        steady, map_gain = float(found.gain[0]), _at(of_map, frequency)[0]
        rows.append(SineTracking(subject.name, cell.speed_km_h, frequency, gain / steady, gain / map_gain, math.degrees(phase)))
    return rows


def _with_map_yaw_rate(software: Software, record: FloatArray) -> FloatArray:
    """Return the recording with the map's yaw rate in place of the car's."""
    ideal = record.copy()
    values = software.map_yaw_rate(column(record, "speed_m_s"), column(record, "front_angle_rad"))
    ideal[:, RECORD_COLUMNS.index("yaw_rate_rad_s")] = values
    return ideal


def _at(found: FrequencyResponse, frequency: float) -> tuple[float, float]:
    """Return gain and phase (rad), interpolated on the logarithmic frequency axis."""
    place, places = math.log(frequency), np.log(found.frequency)
    return float(np.interp(place, places, found.gain)), float(np.interp(place, places, found.phase))


MARGIN_SPEEDS_KM_H = (20.0, 25.0, 30.0, 36.0, 42.5, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0)
"""Speeds at and between the breakpoints of a schedule; see `up_to`."""


@dataclass(frozen=True)
class MarginPoint:
    """The worst figures of the family at one speed; each may be of another member. Sensitivity is None for unstable loops."""

    speed_km_h: float
    gain_margin_db: float
    phase_margin_deg: float
    sensitivity: float | None
    stable: bool


@dataclass(frozen=True)
class FamilyMargins:
    """Margins over speed, and the worst of all speeds.

    Attributes:
        points: the worst of the family at each speed.
        configured: those of the configured car alone.
    """

    points: tuple[MarginPoint, ...]
    configured: tuple[MarginPoint, ...] = ()

    @property
    def gain_margin_db(self) -> float:
        """Smallest gain margin, in dB."""
        return min(point.gain_margin_db for point in self.points)

    @property
    def phase_margin_deg(self) -> float:
        """Smallest phase margin, in deg."""
        return min(point.phase_margin_deg for point in self.points)

    @property
    def sensitivity(self) -> float | None:
        """Largest peak sensitivity; None if a loop is unstable."""
        peaks = [point.sensitivity for point in self.points]
        return None if None in peaks else max(peak for peak in peaks if peak is not None)

    def speed_of(self, name: str) -> float:
        """Return the speed in km/h at which a figure (a field of MarginPoint) is worst."""
        choose = max if name == "sensitivity" else min
        return choose(self.points, key=lambda point: float("inf") if (v := getattr(point, name)) is None else v).speed_km_h

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values. Infinity becomes None, as JSON has no infinity."""
        return {
            name: [{key: finite_or_none(value) for key, value in asdict(point).items()} for point in getattr(self, name)]
            for name in ("points", "configured")
        }


def finite_or_none(value: float | None) -> float | None:
    """Return a value; None for infinity, which JSON cannot represent."""
    return value if value is not None and np.isfinite(value) else None


def margins_of(config: Config, speeds_km_h: tuple[float, ...] | None = None) -> FamilyMargins | None:
    """Return the margins of the configured car and the worst of the family of `config.tuning`; None without feedback.

    By default the speeds are those at which every car of the family must keep its margins.

    Raises:
        BuildError: the kind lacks a required function. ConfigError: an empty family.
    """
    gains = law_of(config).gains(config)
    if gains is None:
        return None
    speeds_km_h = speeds_km_h or up_to(family_range_km_h(config)[1], MARGIN_SPEEDS_KM_H)
    speed = np.array(speeds_km_h) * KM_H
    worst, _ = family_margins(config, speed, *gains(speed))
    own = nominal_margins(config, speed, *gains(speed))
    return FamilyMargins(_points(speeds_km_h, worst), _points(speeds_km_h, own))


def _points(speeds_km_h: tuple[float, ...], margins: Margins) -> tuple[MarginPoint, ...]:
    return tuple(
        MarginPoint(
            speed,
            float(margins.gain_margin_db[k]),
            float(margins.phase_margin_deg[k]),
            float(margins.sensitivity[k]) if np.isfinite(margins.sensitivity[k]) else None,
            bool(margins.stable[k]),
        )
        for k, speed in enumerate(speeds_km_h)
    )


SETTLING_TIME_S = 3.0
"""Time in s after the onset of the moment. Before, the age of the samples delays the correction under any law."""

DISTURBANCE = find("yaw-moment")
TIMINGS: Mapping[str, Scenario] = {
    "in step": DISTURBANCE,
    "free-running clocks": replace(DISTURBANCE, clocks=FREE_RUNNING),
    "0 and 2 frames in turn": replace(DISTURBANCE, faults=(Fault("burst", 0.0, DISTURBANCE.duration),)),
}
IN_STEP_TIMING = next(iter(TIMINGS))


@dataclass(frozen=True)
class TimingError(Figures):
    """RMS of the yaw rate (rad/s), whose reference is zero: once settled, and from the onset of the moment."""

    settled_rad_s: float
    whole_rad_s: float


def timing_errors(subject: Subject) -> dict[str, TimingError]:
    """Return timing name -> error of a controlled subject. Raises BuildError."""
    software = subject.around(subject.config)
    errors = {}
    for name, scenario in TIMINGS.items():
        record = run_through_can(software, scenario).record
        time, yaw_rate = column(record, "time_s"), column(record, "yaw_rate_rad_s")
        settled, whole = (
            float(np.sqrt(np.mean(yaw_rate[time >= scenario.steer_time + after - 1e-9] ** 2)))
            for after in (SETTLING_TIME_S, 0.0)
        )
        errors[name] = TimingError(settled, whole)
    return errors

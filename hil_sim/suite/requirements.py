"""What the controller under test must show: figures asked beside figures measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from hil_sim.suite.conditions import FRICTIONS, LAGS, MASSES, NOMINAL, SLIPPERY, Condition
from hil_sim.suite.loop_margins import FamilyMargins, finite_or_none
from hil_sim.suite.path_following import FEEDFORWARD
from hil_sim.suite.runs import CellResult
from hil_sim.suite.sample_timing import IN_STEP, TIMINGS, TimingError
from hil_sim.suite.summary import Extreme, Summary

Sense = Literal["at most", "at least"]

LAG_FACTOR = 2.0
"""A limit of a time is that of an actuator without lag, and so many times the lag of the configured one: 0.1 s for 50 ms."""
C1_OVERSHOOT_PERCENT, C1_SETTLING_S, C1_RISE_S = 2.0, 0.5, 0.28
OVERSHOOT_PERCENT, SETTLING_S, SIDESLIP_EXCESS_DEG = 3.0, 1.0, 0.2
"""The times without lag. The sideslip beyond its bound in the map, or its steady value: the map's yaw rate takes a lighter car
beyond that bound, whatever the controller."""
MAP_ERROR_PERCENT = 1.0
"""Of the steady yaw rate, either way: a goal, for a map of linear tyres asks for more than a nonlinear car can do."""
SLIP_PERCENT = 101.0
"""Largest steady slip, in percent of its bound: a goal for the same reason."""
OTHER_LAG_OVERSHOOT_PERCENT, FEEDFORWARD_FACTOR = 5.0, 0.75
"""With another actuator's lag; or so many times what the feedforward alone overshoots, where that is more."""
CAR_OVERSHOOT_PERCENT, CAR_SETTLING_S = 5.0, 1.1
GAIN_MARGIN_DB, PHASE_MARGIN_DEG, SENSITIVITY = 8.0, 45.0, 1.8
THIRD_PARTY_OVERSHOOT_PERCENT = 3.0
WET_SIDESLIP_DEG, SNOW_SIDESLIP_DEG, SNOW_SPINS_WITHOUT_ESTIMATE = 3.5, 5.5, 1
INSTRUCTIONS = 1_320
TIMING_FACTOR, TIMING_RESOLUTION_RAD_S = 1.05, 2e-4
"""Of the error in step, and one code of the yaw rate on the bus beside it: in step the error is below that."""

SLIP = "slip of its bound, steady"
NOT_MEASURED = "not measured in this run"
ROUNDING = 1e-9
"""Times are differences of sample times: 1.6 s - 1 s is a little more than 0.6 s."""


@dataclass(frozen=True)
class Requirement:
    """One figure.

    Attributes:
        subject_matter: the row of the list that it belongs to.
        figure, unit: what is measured.
        sense, limit: what is asked.
        measured: None where the figure does not exist (`note` tells why).
        passed: None where it was not measured.
        stretch: a goal that does not have to be reached.
        note: the cell or speed of a worst figure, or why there is none.
    """

    subject_matter: str
    figure: str
    unit: str
    sense: Sense
    limit: float
    measured: float | None
    passed: bool | None
    stretch: bool = False
    note: str = ""

    @property
    def asked(self) -> str:
        """In words."""
        return f"{self.sense} {self.limit:g} {self.unit}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "measured": finite_or_none(self.measured), "asked": self.asked}


@dataclass(frozen=True)
class Measured:
    """What the requirements are held against, all of the subject under test.

    Attributes:
        summaries: name of the condition to the figures over its cells.
        c1: name of the condition to the paper's step.
        margins: None where there is no feedback.
        third_party: cells on the third party's plant; None where it was not driven.
        instructions: of a step in the worst case on a Cortex-M4F; None where they were not counted.
        timing: name of the timing of the frames to the error under a yaw moment.
        path_errors: name of the scenario to the rms path error in m, and to that of the feedforward; None for a car that spins,
            empty where the feedforward was not driven beside.
        actuator_lag_s: of the configured car.
        results: name of the condition to the cells of the subject.
        feedforward, feedforward_c1: the same of the feedforward, and its paper's step; empty where it was not driven beside.
    """

    summaries: Mapping[str, Summary]
    c1: Mapping[str, CellResult]
    margins: FamilyMargins | None
    third_party: Summary | None = None
    instructions: int | None = None
    timing: Mapping[str, TimingError] = field(default_factory=dict)
    path_errors: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)
    actuator_lag_s: float = 0.05
    results: Mapping[str, Sequence[CellResult]] = field(default_factory=dict)
    feedforward: Mapping[str, Sequence[CellResult]] = field(default_factory=dict)
    feedforward_c1: Mapping[str, CellResult] = field(default_factory=dict)

    def time_limit(self, without_lag: float) -> float:
        """s, of a settling or rise time of this car."""
        return round(without_lag + LAG_FACTOR * self.actuator_lag_s, 9)


def _row(
    matter: str,
    figure: str,
    unit: str,
    asked: tuple[Sense, float],
    measured: float | None,
    note: str = "",
    stretch: bool = False,
) -> Requirement:
    sense, limit = asked
    if measured is None:
        return Requirement(matter, figure, unit, sense, limit, None, False, stretch, note)
    passed = measured <= limit + ROUNDING if sense == "at most" else measured >= limit - ROUNDING
    return Requirement(matter, figure, unit, sense, limit, measured, passed, stretch, note)


def _absent(matter: str, figure: str, unit: str, asked: tuple[Sense, float], stretch: bool = False) -> Requirement:
    return Requirement(matter, figure, unit, *asked, measured=None, passed=None, stretch=stretch, note=NOT_MEASURED)


def _c1(measured: Measured) -> list[Requirement]:
    rows = []
    for condition in LAGS:
        matter = f"C1, {condition.title}"
        figures = (
            ("overshoot", "%", C1_OVERSHOOT_PERCENT, "overshoot_percent"),
            ("settling time to 2 %", "s", measured.time_limit(C1_SETTLING_S), "settling_time_s"),
            ("rise time to 90 %", "s", measured.time_limit(C1_RISE_S), "rise_time_s"),
        )
        result = measured.c1.get(condition.name)
        beside = measured.feedforward_c1.get(condition.name)
        for figure, unit, limit, name in figures:
            asked: tuple[Sense, float] = ("at most", _overshoot_limit(limit, beside) if name == "overshoot_percent" else limit)
            if result is None:
                rows.append(_absent(matter, figure, unit, asked))
                continue
            note = "the car spins" if result.spun else "" if result.settled else "it does not settle"
            rows.append(_row(matter, figure, unit, asked, getattr(result, name), note))
    return rows


def _worst(summary: Summary | None, matter: str, figure: str, unit: str, limit: float, name: str, **more: bool) -> Requirement:
    """The worst of all cells; a cell without the figure fails it."""
    asked: tuple[Sense, float] = ("at most", limit)
    if summary is None:
        return _absent(matter, figure, unit, asked, **more)
    found: Extreme | None = getattr(summary, name)
    settling = name == "settling_time_s"
    without = len(summary.spins) + (len(summary.unsettled) if settling else 0)
    row = _row(
        matter, figure, unit, asked, None if found is None else found.value, "" if found is None else found.cell.title, **more
    )
    if not without:
        return row
    why = f"none in {without} of {summary.cells} cells, which spin{' or do not settle' if settling else ''}"
    return Requirement(matter, figure, unit, *asked, measured=row.measured, passed=False, stretch=row.stretch, note=why)


def _map_error(summary: Summary | None, matter: str, stretch: bool = True) -> Requirement:
    """Of largest magnitude over the cells; a spin fails elsewhere."""
    figure, found = "|error to the map|, steady", None if summary is None else summary.map_error_percent
    asked: tuple[Sense, float] = ("at most", MAP_ERROR_PERCENT)
    if found is None:
        return _absent(matter, figure, "%", asked, stretch=stretch)
    return _row(matter, figure, "%", asked, abs(found.value), f"{found.value:+.1f} %: {found.cell.title}", stretch=stretch)


def _slip(summary: Summary | None, matter: str, stretch: bool = True) -> Requirement:
    found = None if summary is None else summary.slip_percent
    asked: tuple[Sense, float] = ("at most", SLIP_PERCENT)
    if found is None:
        return _absent(matter, SLIP, "%", asked, stretch=stretch)
    return _row(matter, SLIP, "%", asked, found.value, found.cell.title, stretch=stretch)


def _overshoot_limit(least: float, feedforward: CellResult | None) -> float:
    """Return the limit in percent beside the feedforward in the same cell; that of a car that spins raises none."""
    found = None if feedforward is None else feedforward.overshoot_percent
    return round(max(least, FEEDFORWARD_FACTOR * (found or 0.0)), 1)


def _other_lag(measured: Measured, condition: Condition) -> Requirement:
    """The cell that is nearest to its limit, or most beyond it."""
    summary, limit = measured.summaries.get(condition.name), OTHER_LAG_OVERSHOOT_PERCENT
    own = measured.results.get(condition.name, ())
    beside = measured.feedforward.get(condition.name, (None,) * len(own))
    found = [
        (Extreme(result.overshoot_percent, result.cell), _overshoot_limit(limit, other))
        for result, other in zip(own, beside, strict=True)
        if result.overshoot_percent is not None
    ]
    if summary is not None and found:
        worst, limit = max(found, key=lambda each: each[0].value - each[1])
        summary = replace(summary, overshoot_percent=worst)
    return _worst(summary, f"all cells, {condition.title}", "overshoot", "%", limit, "overshoot_percent")


def _spins(summary: Summary | None, matter: str, limit: int) -> Requirement:
    asked: tuple[Sense, float] = ("at most", float(limit))
    if summary is None:
        return _absent(matter, "spins", "", asked)
    return _row(matter, f"spins in {summary.cells} cells", "", asked, float(len(summary.spins)), _titles(summary))


def _titles(summary: Summary) -> str:
    shown = [cell.title for cell in summary.spins[:3]]
    return "; ".join(shown) + (", ..." if len(summary.spins) > 3 else "")


def _over_cells(measured: Measured) -> list[Requirement]:
    rows, settling = [], measured.time_limit(SETTLING_S)
    for condition in (NOMINAL, *MASSES):
        matter, summary = f"all cells, {condition.title}", measured.summaries.get(condition.name)
        rows += [
            _spins(summary, matter, 0),
            _worst(summary, matter, "overshoot", "%", OVERSHOOT_PERCENT, "overshoot_percent"),
            *([_map_error(summary, matter), _slip(summary, matter)] if condition == NOMINAL else []),
            _worst(summary, matter, "settling time to 2 %", "s", settling, "settling_time_s"),
            _worst(summary, matter, "|sideslip| beyond its bound", "deg", SIDESLIP_EXCESS_DEG, "sideslip_excess_deg"),
        ]
    return [*rows, _other_lag(measured, LAGS[0]), _other_lag(measured, LAGS[-1])]


def _margins(margins: FamilyMargins | None, matter: str = "margins over the family") -> list[Requirement]:
    figures: tuple[tuple[str, str, Sense, float, str], ...] = (
        ("gain margin", "dB", "at least", GAIN_MARGIN_DB, "gain_margin_db"),
        ("phase margin", "deg", "at least", PHASE_MARGIN_DEG, "phase_margin_deg"),
        ("peak sensitivity", "", "at most", SENSITIVITY, "sensitivity"),
    )
    rows = []
    for figure, unit, sense, limit, name in figures:
        if margins is None:
            rows.append(_absent(matter, figure, unit, (sense, limit)))
            continue
        note = f"at {margins.speed_of(name):g} km/h" if all(p.stable for p in margins.points) else "an unstable loop"
        rows.append(_row(matter, figure, unit, (sense, limit), getattr(margins, name), note))
    return rows


def sideslip_limit(condition: Condition) -> float | None:
    """deg that are asked on a slippery road; None where nothing is."""
    wet, snow = FRICTIONS
    if condition.friction == wet:
        return WET_SIDESLIP_DEG
    return SNOW_SIDESLIP_DEG if condition.friction == snow and condition.estimate is not None else None


def _on_slippery_roads(summaries: Mapping[str, Summary]) -> list[Requirement]:
    rows = []
    for condition in SLIPPERY:
        summary, asked = summaries.get(condition.name), sideslip_limit(condition)
        spins = 0 if asked is not None else SNOW_SPINS_WITHOUT_ESTIMATE
        rows.append(_spins(summary, condition.title, spins))
        if asked is not None:
            rows.append(_worst(summary, condition.title, "|sideslip|", "deg", asked, "sideslip_max_deg"))
    return rows


def _third_party(summary: Summary | None) -> list[Requirement]:
    matter = "third party's plant"
    return [
        _spins(summary, matter, 0),
        _worst(summary, matter, "overshoot", "%", THIRD_PARTY_OVERSHOOT_PERCENT, "overshoot_percent"),
    ]


def _timing(errors: Mapping[str, TimingError]) -> list[Requirement]:
    rows = []
    for name in TIMINGS:
        if name == IN_STEP:
            continue
        matter, figure, unit = f"yaw moment, {name}", "yaw-rate error, rms", "deg/s"
        if not errors:
            rows.append(_absent(matter, figure, unit, ("at most", round(math.degrees(TIMING_RESOLUTION_RAD_S), 3))))
            continue
        limit = round(math.degrees(TIMING_FACTOR * errors[IN_STEP].settled_rad_s + TIMING_RESOLUTION_RAD_S), 3)
        rows.append(_row(matter, figure, unit, ("at most", limit), math.degrees(errors[name].settled_rad_s)))
    return rows


def _path_errors(errors: Mapping[str, tuple[float | None, float | None]]) -> list[Requirement]:
    rows = []
    for name, (own, beside) in errors.items():
        if beside is None:
            continue  # the feedforward spins: nothing is asked
        measured, note = (None, "the car spins") if own is None else (round(own, 3), "")
        asked: tuple[Sense, float] = ("at most", round(beside, 3))
        rows.append(_row(f"{name}, with a driver", f"path error, rms, beside {FEEDFORWARD}", "m", asked, measured, note))
    return rows


def _instructions(count: int | None) -> Requirement:
    matter, figure, asked = "Cortex-M4F", "instructions of the worst step", ("at most", float(INSTRUCTIONS))
    sense: Sense = "at most"
    if count is None:
        return _absent(matter, figure, "", (sense, asked[1]))
    return _row(matter, figure, "", (sense, asked[1]), float(count))


def requirements(measured: Measured) -> tuple[Requirement, ...]:
    """All rows, in the order of the list."""
    return (
        *_c1(measured),
        *_over_cells(measured),
        *_margins(measured.margins),
        *_third_party(measured.third_party),
        *_on_slippery_roads(measured.summaries),
        *_timing(measured.timing),
        *_path_errors(measured.path_errors),
        _instructions(measured.instructions),
    )


def car_requirements(matter: str, summary: Summary, margins: FamilyMargins | None) -> tuple[Requirement, ...]:
    """Rows of one car of `codegen sil --suite cars`; they hold for every car."""
    return (
        _spins(summary, matter, 0),
        _worst(summary, matter, "overshoot", "%", CAR_OVERSHOOT_PERCENT, "overshoot_percent"),
        _worst(summary, matter, "settling time to 2 %", "s", CAR_SETTLING_S, "settling_time_s"),
        _map_error(summary, matter, stretch=False),
        _slip(summary, matter, stretch=False),
        *_margins(margins, matter)[:2],
    )


def all_passed(rows: Sequence[Requirement]) -> bool:
    """Whether nothing that was measured fails, stretch goals aside."""
    return all(row.passed is not False or row.stretch for row in rows)

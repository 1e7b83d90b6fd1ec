"""Requirements of the controller under test: required and measured figures, and the limits of the suites with their reasons."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from codegen.configuration import parse_toml
from codegen.configuration.controller import Tuning
from codegen.configuration.section import Range, Section, first_fault
from codegen.errors import CodegenError
from codegen.files import read_text
from hil_sim.suite.cells import LOW_FRICTIONS, MASSES, NOMINAL, SLIPPERY, Condition, lags
from hil_sim.suite.controller_properties import IN_STEP_TIMING, TIMINGS, FamilyMargins, TimingError, finite_or_none
from hil_sim.suite.runs import FEEDFORWARD, CellResult, Extreme, Summary

LIMITS_BYTES_MAX = 2**16

Percent = Annotated[float, Range(0.0, 1_000.0, "%")]
Seconds = Annotated[float, Range(0.0, 60.0, "s")]
Degrees = Annotated[float, Range(0.0, 90.0, "deg")]


STEP_INSTRUCTIONS_MAX = 1_320
"""Instructions of the longest step of kind `tracking` with the limiter, of one map on even axes."""

OF_FAMILY = "worst car of the family; the default of [tuning], also if the configuration demands another value"


def designed(key: str) -> float:
    """Return the default of a margin in `[tuning]`."""
    return float(Tuning.model_fields[key].default)


class Limits(Section):
    """Limits of `codegen suite`, keys of the file of `--limits`. Each description gives the reason."""

    c1_overshoot_percent: Percent = Field(default=2.0, description="the paper's step C1: a driver hardly notices 2 %")
    c1_settling_s: Seconds = Field(default=0.5, description="of an ideal actuator; twice the actuator's lag is added")
    c1_rise_s: Seconds = Field(default=0.28, description="of an ideal actuator; twice the actuator's lag is added")
    overshoot_percent: Percent = Field(default=3.0, description="over all cells of the configured car and of its mass range")
    settling_s: Seconds = Field(default=1.0, description="over all cells; twice the actuator's lag is added")
    sideslip_excess_deg: Degrees = Field(
        default=0.2, description="beyond the map's bound, which a lighter car exceeds at the map's yaw rate"
    )
    map_error_percent: Percent = Field(default=1.0, description="of the steady yaw rate; a goal: linear maps demand too much")
    slip_percent: Percent = Field(default=101.0, description="of the slip bound in steady state; 1 % for the table")
    other_lag_overshoot_percent: Percent = Field(default=5.0, description="with an actuator of 0.4 and 2 times the lag")
    feedforward_factor: Annotated[float, Range(0.0, 10.0)] = Field(
        default=0.75, description="of the feedforward's overshoot in the same cell, where that is more than the limit"
    )
    gain_margin_db: Annotated[float, Range(0.0, 40.0, "dB")] = Field(default=designed("gain_margin_db"), description=OF_FAMILY)
    phase_margin_deg: Degrees = Field(default=designed("phase_margin_deg"), description=OF_FAMILY)
    sensitivity: Annotated[float, Range(1.0, 20.0)] = Field(
        default=designed("sensitivity_max"), description=f"peak, {OF_FAMILY}"
    )
    third_party_overshoot_percent: Percent = Field(default=3.0, description="on a third party's multi-body car, as on our own")
    wet_sideslip_deg: Degrees = Field(default=3.5, description="on friction 0.6; the map's bound is 3 deg")
    snow_sideslip_deg: Degrees = Field(default=5.5, description="on friction 0.4 with an estimate")
    snow_spins_without_estimate: Annotated[int, Field(ge=0, le=100)] = Field(
        default=1, description="on friction 0.4 without an estimate"
    )
    instructions: Annotated[int, Field(ge=1, le=100_000)] = Field(
        default=STEP_INSTRUCTIONS_MAX, description="worst step with the limiter"
    )
    timing_factor: Annotated[float, Range(1.0, 10.0)] = Field(
        default=1.05, description="of the error with frames in step, and one code"
    )
    car_overshoot_percent: Percent = Field(default=5.0, description="every random car")
    car_settling_s: Seconds = Field(default=1.1, description="every random car")

    def why(self, key: str) -> str:
        """Return the description of a limit."""
        return type(self).model_fields[key].description or ""


def load(path: Path) -> Limits:
    """Read limits from a TOML file; keys that it leaves out keep their defaults. Raises CodegenError."""
    text = read_text(path, LIMITS_BYTES_MAX, "name a TOML file of limits, such as overshoot_percent = 5.0")
    try:
        return Limits.model_validate(parse_toml(text, path, CodegenError))
    except ValidationError as error:
        raise first_fault(error, path, Limits, CodegenError) from None


Sense = Literal["at most", "at least"]

LAG_FACTOR = 2.0
"""Multiple of the configured actuator's lag that is added to time limits of an ideal actuator: 0.1 s for 50 ms."""
TIMING_RESOLUTION_RAD_S = 2e-4
"""Resolution of the yaw rate on the bus; with frames in step, the error is smaller."""

NOT_MEASURED = "not measured in this run"
ROUNDING = 1e-9
"""Tolerance for differences of sample times: 1.6 s - 1 s is a little more than 0.6 s."""


@dataclass(frozen=True)
class Requirement:
    """A required and measured figure.

    Attributes:
        subject_matter: row of the list that it belongs to.
        figure, unit: measured figure.
        sense, limit: required value.
        measured: None if the figure does not exist (`note` gives the reason).
        passed: None if it was not measured.
        stretch: whether it is a goal that does not have to be reached.
        note: cell or speed of the worst figure, or why there is none.
        key: key of the limit in `limits.Limits`; "" if the limit is another subject's figure.
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
    key: str = ""

    @property
    def asked(self) -> str:
        """Requirement as text."""
        return f"{self.sense} {self.limit:g} {self.unit}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {**asdict(self), "measured": finite_or_none(self.measured), "asked": self.asked}


@dataclass(frozen=True)
class Measured:
    """Measured figures of the subject under test.

    Attributes:
        summaries: name of the condition to the figures over its cells.
        c1: name of the condition to the paper's step.
        margins: None without feedback.
        third_party: cells on the third party's plant; None if not run.
        instructions: worst-case instructions of a step on a Cortex-M4F; None if not counted.
        timing: name of the timing of the frames to the error under a yaw moment.
        path_errors: name of the scenario to the rms path error in m, and to that of the feedforward; None for a car that spins,
            empty without the feedforward.
        actuator_lag_s: actuator lag of the configured car.
        results: name of the condition to the cells of the subject.
        feedforward, feedforward_c1: cells and paper's step of the feedforward; empty if it was not run.
        limits: required values.
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
    limits: Limits = field(default_factory=Limits)

    def time_limit(self, without_lag: float) -> float:
        """Return the limit in s of a settling or rise time of this car."""
        return round(without_lag + LAG_FACTOR * self.actuator_lag_s, 9)


def _row(
    matter: str,
    figure: str,
    unit: str,
    limit: float,
    measured: float | None,
    note: str = "",
    *,
    sense: Sense = "at most",
    stretch: bool = False,
    key: str = "",
) -> Requirement:
    """Return a row. A missing figure fails, unless it was not measured (`NOT_MEASURED`)."""
    if measured is None:
        passed = None if note == NOT_MEASURED else False
    else:
        passed = measured <= limit + ROUNDING if sense == "at most" else measured >= limit - ROUNDING
    return Requirement(matter, figure, unit, sense, limit, measured, passed, stretch, note, key)


def _c1(measured: Measured) -> list[Requirement]:
    rows, limits = [], measured.limits
    for condition in lags(measured.actuator_lag_s):
        result = measured.c1.get(condition.name)
        overshoot = _overshoot_limit(limits, limits.c1_overshoot_percent, measured.feedforward_c1.get(condition.name))
        figures = (
            ("overshoot", "%", overshoot, "overshoot_percent", "c1_overshoot_percent"),
            ("settling time to 2 %", "s", measured.time_limit(limits.c1_settling_s), "settling_time_s", "c1_settling_s"),
            ("rise time to 90 %", "s", measured.time_limit(limits.c1_rise_s), "rise_time_s", "c1_rise_s"),
        )
        if result is None:
            note = NOT_MEASURED
        else:
            note = "the car spins" if result.spun else "" if result.settled else "it does not settle"
        for figure, unit, limit, name, key in figures:
            rows.append(_row(f"C1, {condition.title}", figure, unit, limit, getattr(result, name, None), note, key=key))
    return rows


def _worst(
    limits: Limits,
    summary: Summary | None,
    matter: str,
    figure: str,
    unit: str,
    name: str,
    key: str,
    limit: float | None = None,
) -> Requirement:
    """Return the row of the worst cell; a cell without the figure fails. The limit is by default the one of the key."""
    limit = getattr(limits, key) if limit is None else limit
    if summary is None:
        return _row(matter, figure, unit, limit, None, NOT_MEASURED, key=key)
    found: Extreme | None = getattr(summary, name)
    settling = name == "settling_time_s"
    without = len(summary.spins) + (len(summary.unsettled) if settling else 0)
    value, title = (None, "") if found is None else (found.value, found.cell.title)
    row = _row(matter, figure, unit, limit, value, title, key=key)
    if not without:
        return row
    why = f"none in {without} of {summary.cells} cells, which spin{' or do not settle' if settling else ''}"
    return replace(row, passed=False, note=why)


def _steady(limits: Limits, summary: Summary | None, matter: str, stretch: bool = True) -> list[Requirement]:
    """Return the rows of the largest error to the map, by magnitude, and slip over the cells; spins fail elsewhere."""
    rows = []
    for figure, key in (("|error to the map|, steady", "map_error_percent"), ("slip of its bound, steady", "slip_percent")):
        found: Extreme | None = getattr(summary, key, None)
        value, note = None, NOT_MEASURED
        if found is not None:
            value = abs(found.value)
            note = f"{found.value:+.1f} %: {found.cell.title}" if key == "map_error_percent" else found.cell.title
        rows.append(_row(matter, figure, "%", getattr(limits, key), value, note, stretch=stretch, key=key))
    return rows


def _overshoot_limit(limits: Limits, least: float, feedforward: CellResult | None) -> float:
    """Return the limit in percent relative to the feedforward in the same cell; a spin of the feedforward raises none."""
    found = None if feedforward is None else feedforward.overshoot_percent
    return round(max(least, limits.feedforward_factor * (found or 0.0)), 1)


def _other_lag(measured: Measured, condition: Condition) -> Requirement:
    """Return the cell that is nearest to its limit, or furthest beyond it."""
    summary, limit = measured.summaries.get(condition.name), measured.limits.other_lag_overshoot_percent
    own = measured.results.get(condition.name, ())
    beside = measured.feedforward.get(condition.name, (None,) * len(own))
    found = [
        (Extreme(result.overshoot_percent, result.cell), _overshoot_limit(measured.limits, limit, other))
        for result, other in zip(own, beside, strict=True)
        if result.overshoot_percent is not None
    ]
    if summary is not None and found:
        worst, limit = max(found, key=lambda each: each[0].value - each[1])
        summary = replace(summary, overshoot_percent=worst)
    matter, key = f"all cells, {condition.title}", "other_lag_overshoot_percent"
    return _worst(measured.limits, summary, matter, "overshoot", "%", "overshoot_percent", key, limit)


def _spins(summary: Summary | None, matter: str, limit: int, key: str = "") -> Requirement:
    if summary is None:
        return _row(matter, "spins", "", float(limit), None, NOT_MEASURED, key=key)
    titles = "; ".join(cell.title for cell in summary.spins[:3]) + (", ..." if len(summary.spins) > 3 else "")
    return _row(matter, f"spins in {summary.cells} cells", "", float(limit), float(len(summary.spins)), titles, key=key)


def _over_cells(measured: Measured) -> list[Requirement]:
    rows, limits = [], measured.limits
    settling = measured.time_limit(limits.settling_s)
    for condition in (NOMINAL, *MASSES):
        matter, summary = f"all cells, {condition.title}", measured.summaries.get(condition.name)
        sideslip = ("|sideslip| beyond its bound", "deg", "sideslip_excess_deg", "sideslip_excess_deg")
        rows += [
            _spins(summary, matter, 0),
            _worst(limits, summary, matter, "overshoot", "%", "overshoot_percent", "overshoot_percent"),
            *(_steady(limits, summary, matter) if condition == NOMINAL else []),
            _worst(limits, summary, matter, "settling time to 2 %", "s", "settling_time_s", "settling_s", settling),
            _worst(limits, summary, matter, *sideslip),
        ]
    fast, _, slow = lags(measured.actuator_lag_s)
    return [*rows, _other_lag(measured, fast), _other_lag(measured, slow)]


def _margins(limits: Limits, margins: FamilyMargins | None, matter: str = "margins over the family") -> list[Requirement]:
    figures: tuple[tuple[str, str, Sense, str], ...] = (
        ("gain margin", "dB", "at least", "gain_margin_db"),
        ("phase margin", "deg", "at least", "phase_margin_deg"),
        ("peak sensitivity", "", "at most", "sensitivity"),
    )
    rows = []
    for figure, unit, sense, name in figures:
        value, note = None, NOT_MEASURED
        if margins is not None:
            value = getattr(margins, name)
            note = f"at {margins.speed_of(name):g} km/h" if all(p.stable for p in margins.points) else "an unstable loop"
        rows.append(_row(matter, figure, unit, getattr(limits, name), value, note, sense=sense, key=name))
    return rows


def sideslip_key(condition: Condition) -> str | None:
    """Return the key of the sideslip limit on a slippery road; None if there is none."""
    wet, snow = LOW_FRICTIONS
    if condition.friction == wet:
        return "wet_sideslip_deg"
    return "snow_sideslip_deg" if condition.friction == snow and condition.estimate is not None else None


def sideslip_limit(limits: Limits, condition: Condition) -> float | None:
    """Return the required sideslip in deg on a slippery road; None if there is none."""
    key = sideslip_key(condition)
    return None if key is None else float(getattr(limits, key))


def _on_slippery_roads(limits: Limits, summaries: Mapping[str, Summary]) -> list[Requirement]:
    rows = []
    for condition in SLIPPERY:
        summary, key = summaries.get(condition.name), sideslip_key(condition)
        if key is None:
            spins = limits.snow_spins_without_estimate
            rows.append(_spins(summary, condition.title, spins, "snow_spins_without_estimate"))
            continue
        rows.append(_spins(summary, condition.title, 0))
        rows.append(_worst(limits, summary, condition.title, "|sideslip|", "deg", "sideslip_max_deg", key))
    return rows


def _third_party(limits: Limits, summary: Summary | None) -> list[Requirement]:
    matter, key = "third party's plant", "third_party_overshoot_percent"
    return [
        _spins(summary, matter, 0),
        _worst(limits, summary, matter, "overshoot", "%", "overshoot_percent", key),
    ]


def _timing(limits: Limits, errors: Mapping[str, TimingError]) -> list[Requirement]:
    rows = []
    for name in TIMINGS:
        if name == IN_STEP_TIMING:
            continue
        row: tuple[str, str, str] = (f"yaw moment, {name}", "yaw-rate error, rms", "deg/s")
        if not errors:
            rows.append(_row(*row, round(math.degrees(TIMING_RESOLUTION_RAD_S), 3), None, NOT_MEASURED))
            continue
        limit = round(math.degrees(limits.timing_factor * errors[IN_STEP_TIMING].settled_rad_s + TIMING_RESOLUTION_RAD_S), 3)
        rows.append(_row(*row, limit, math.degrees(errors[name].settled_rad_s), key="timing_factor"))
    return rows


def _path_errors(errors: Mapping[str, tuple[float | None, float | None]]) -> list[Requirement]:
    rows = []
    for name, (own, beside) in errors.items():
        if beside is None:
            continue  # no limit, as the feedforward spins
        measured, note = (None, "the car spins") if own is None else (round(own, 3), "")
        figure = f"path error, rms, beside {FEEDFORWARD}"
        rows.append(_row(f"{name}, with a driver", figure, "m", round(beside, 3), measured, note))
    return rows


def _instructions(limits: Limits, count: int | None) -> Requirement:
    measured, note = (None, NOT_MEASURED) if count is None else (float(count), "")
    limit = float(limits.instructions)
    return _row("Cortex-M4F", "instructions of the worst step", "", limit, measured, note, key="instructions")


def requirements(measured: Measured) -> tuple[Requirement, ...]:
    """Return all rows in the order of the list."""
    return (
        *_c1(measured),
        *_over_cells(measured),
        *_margins(measured.limits, measured.margins),
        *_third_party(measured.limits, measured.third_party),
        *_on_slippery_roads(measured.limits, measured.summaries),
        *_timing(measured.limits, measured.timing),
        *_path_errors(measured.path_errors),
        _instructions(measured.limits, measured.instructions),
    )


ROLL_PLANT = "roll"
"""Condition of the cells on the third plant."""


def car_requirements(
    matter: str, summaries: Mapping[str, Summary], margins: FamilyMargins | None, limits: Limits
) -> tuple[Requirement, ...]:
    """Return the rows of one car of `codegen suite cars`.

    On the third plant the error to the map is a goal, because its tyres are not those of the map.
    """
    rows: list[Requirement] = []
    for plant, end in ((NOMINAL.name, ""), (ROLL_PLANT, ", roll plant")):
        if (summary := summaries.get(plant)) is not None:
            own = (
                _spins(summary, matter, 0),
                _worst(limits, summary, matter, "overshoot", "%", "overshoot_percent", "car_overshoot_percent"),
                _worst(limits, summary, matter, "settling time to 2 %", "s", "settling_time_s", "car_settling_s"),
                *_steady(limits, summary, matter, stretch=plant == ROLL_PLANT),
            )
            rows += [replace(row, figure=f"{row.figure}{end}") for row in own]
    return (*rows, *_margins(limits, margins, matter)[:2])


def all_passed(rows: Sequence[Requirement]) -> bool:
    """Return whether everything measured passes, stretch goals aside."""
    return all(row.passed is not False or row.stretch for row in rows)

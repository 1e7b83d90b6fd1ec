"""The comparison of references (`codegen suite references`) as text: one table, and where others are better."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from codegen.report.suite_tables import NO_FIGURE, condition_tables, path_table, rise_table, sine_table, wrapped
from codegen.text import text_table
from hil_sim.scenarios import PATH_SCENARIOS
from hil_sim.suite.cells import COMBINED, NOMINAL, lags
from hil_sim.suite.subjects import PASSIVE

if TYPE_CHECKING:
    from hil_sim.suite.references import ReferencesResult
    from hil_sim.suite.runs import CellResult

SLOW_KM_H, FAST_KM_H = 60.0, 80.0
"""Agility is wanted up to the first speed; from the second one on, stability."""

SINE_FREQUENCY_HZ = 1.0


@dataclass(frozen=True)
class Row:
    """One figure of every subject.

    Attributes:
        title: with the unit.
        value: of a subject; None if it has none.
        digits: decimals.
        better: 1 if more is better, -1 if less is, 0 if it depends on the purpose.
    """

    title: str
    value: Callable[[ReferencesResult, str], float | None]
    digits: int
    better: int = -1

    def text(self, result: ReferencesResult, name: str) -> str:
        """Return the figure as text."""
        value = self.value(result, name)
        return NO_FIGURE if value is None else f"{round(value, self.digits) + 0.0:.{self.digits}f}"


def _nominal(result: ReferencesResult, name: str) -> tuple[CellResult, ...]:
    return result.suite.results[name][NOMINAL.name]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None


def _largest(values: Sequence[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _over_passive(result: ReferencesResult, name: str, first: float, last: float) -> float | None:
    """Return the mean excess of the steady yaw rate over the passive car's in percent, where neither spins."""
    if name == PASSIVE:
        return None
    pairs = zip(_nominal(result, name), _nominal(result, PASSIVE), strict=True)
    ratios = [
        100.0 * (one.yaw_rate_steady_deg_s / other.yaw_rate_steady_deg_s - 1.0)
        for one, other in pairs
        if first <= one.cell.speed_km_h <= last and one.yaw_rate_steady_deg_s and other.yaw_rate_steady_deg_s
    ]
    return _mean(ratios)


def _rise(result: ReferencesResult, name: str, first: float, last: float) -> float | None:
    return _mean([each.rise_time_s for each in _nominal(result, name) if first <= each.cell.speed_km_h <= last])


def _inside_overshoot(result: ReferencesResult, name: str) -> float | None:
    """Return the largest overshoot in the cells in which the reference has a turn."""
    pairs = zip(_nominal(result, name), result.inside[name], strict=True)
    return _largest([each.overshoot_percent for each, inside in pairs if inside])


def _overshoot_under(result: ReferencesResult, name: str, condition: str) -> float | None:
    found = result.suite.results[name].get(condition)
    return None if found is None else _largest([each.overshoot_percent for each in found])


def _spins(result: ReferencesResult, name: str) -> float:
    return float(sum(each.spun for cells in result.suite.results[name].values() for each in cells))


def _unsettled(result: ReferencesResult, name: str) -> float:
    return float(sum(not each.settled for each in _nominal(result, name) if not each.spun))


def _path_error(scenario: str) -> Callable[[ReferencesResult, str], float | None]:
    return lambda result, name: result.suite.path_errors[name].get(scenario)


def _sine_lag(result: ReferencesResult, name: str) -> float | None:
    """Return the lag at the last speed, the largest."""
    last = [row.phase_deg for row in result.suite.sine[name] if row.frequency_hz == SINE_FREQUENCY_HZ][-1:]
    return -last[0] if last and last[0] is not None else None


INFINITE = float("inf")
ROWS = (
    Row("feasible part of the grid (%)", lambda result, name: result.feasible_percent[name], 1, better=1),
    Row("cells with a turn of the reference", lambda result, name: float(result.inside[name].sum()), 0, better=1),
    Row(
        f"yaw rate over the passive car's, to {SLOW_KM_H:g} km/h (%)",
        lambda result, name: _over_passive(result, name, 0.0, SLOW_KM_H),
        1,
        better=1,
    ),
    Row(
        f"the same from {FAST_KM_H:g} km/h (%)",
        lambda result, name: _over_passive(result, name, FAST_KM_H, INFINITE),
        1,
        better=0,
    ),
    Row("|sideslip|, largest of a run, mean (deg)", lambda r, name: _mean([e.sideslip_max_deg for e in _nominal(r, name)]), 2),
    Row("|sideslip|, largest of all (deg)", lambda r, name: _largest([e.sideslip_max_deg for e in _nominal(r, name)]), 2),
    Row("steady slip of its bound, largest (%)", lambda r, name: _largest([e.slip_percent for e in _nominal(r, name)]), 1),
    Row("overshoot, mean (%)", lambda r, name: _mean([e.overshoot_percent for e in _nominal(r, name)]), 1),
    Row("overshoot, largest (%)", lambda r, name: _largest([e.overshoot_percent for e in _nominal(r, name)]), 1),
    Row("overshoot, largest of the cells with a turn (%)", _inside_overshoot, 1),
    Row(
        "overshoot, largest, twice the actuator lag (%)",
        lambda result, name: _overshoot_under(result, name, lags(result.suite.actuator_lag_s)[-1].name),
        1,
    ),
    Row(f"overshoot, largest, {COMBINED.title} (%)", lambda result, name: _overshoot_under(result, name, COMBINED.name), 1),
    Row("settling to 2 %, slowest (s)", lambda r, name: _largest([e.settling_time_s for e in _nominal(r, name)]), 2),
    Row("cells that never settle", _unsettled, 0),
    Row(f"rise to 90 %, to {SLOW_KM_H:g} km/h, mean (s)", lambda r, name: _rise(r, name, 0.0, SLOW_KM_H), 2),
    Row(f"rise to 90 %, from {FAST_KM_H:g} km/h, mean (s)", lambda r, name: _rise(r, name, FAST_KM_H, INFINITE), 2),
    Row(f"lag of a sine of {SINE_FREQUENCY_HZ:g} Hz, largest speed (deg)", _sine_lag, 0),
    *(Row(f"path error in the {name}, rms (m)", _path_error(name), 3) for name in PATH_SCENARIOS),
    Row("spins under all conditions", _spins, 0),
)


def summary_table(result: ReferencesResult) -> str:
    """Return the table: a row for each figure, a column for each reference and the passive car.

    A reference that was not driven has the figures of the one with its map.
    """
    *driven, passive = result.suite.subjects
    names = (*driven, *result.same_as, passive)
    shown = [result.same_as.get(name, name) for name in names]
    return text_table(("", *names), [(row.title, *(row.text(result, name) for name in shown)) for row in ROWS])


def beaten(result: ReferencesResult) -> list[str]:
    """Return a line for each figure in which another subject is better than the first one, by more than the digits shown."""
    tested, *others = result.suite.subjects
    lines = []
    for row in ROWS:
        own = row.value(result, tested)
        if own is None or not row.better:
            continue
        found = [
            f"{name} {row.text(result, name)}"
            for name in others
            if (value := row.value(result, name)) is not None
            and row.better * (round(value, row.digits) - round(own, row.digits)) > 0.0
        ]
        if found:
            lines.append(f"{row.title}: {', '.join(found)}; {tested} {row.text(result, tested)}")
    return lines


def reference_sections(result: ReferencesResult) -> Iterator[tuple[str, str]]:
    """Yield titles and texts in reading order."""
    suite = result.suite
    tested = suite.subjects[0]
    yield f"References under the same controller, as configured: {len(suite.cells)} step steers", summary_table(result)
    if result.same_as:
        yield (
            "Not driven again",
            "\n".join(f"{name}: its map, and so its figures, are those of {other}" for name, other in result.same_as.items()),
        )
    yield f"Where {tested} is not the best", "\n".join(wrapped(line) for line in beaten(result)) or "nowhere"
    yield from condition_tables(suite)
    yield "Rise time to 90 % over the amplitudes, mean / largest (s)", rise_table(suite)
    yield "Sine at the steering wheel, 10 % of the largest front angle: gain over the map's / phase (deg)", sine_table(suite)
    yield "With a driver: rms path error (m)", path_table(suite)

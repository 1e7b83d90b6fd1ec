"""Results of the test set of rear-steering controllers as text of at most 120 columns. No printing, no plotting."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from codegen.text import text_table
from hil_sim.scenarios import PATH_SCENARIOS
from hil_sim.suite.cars import CARS_ANGLE_SHARES, CARS_SPEEDS_KM_H, PLANTS
from hil_sim.suite.cells import NOMINAL, lags
from hil_sim.suite.controller_properties import TIMINGS, compare_rise
from hil_sim.suite.tracking import STRUCTURE_SET

if TYPE_CHECKING:
    from hil_sim.suite.cars import CarResult, CarsResult
    from hil_sim.suite.controller_properties import MarginPoint, SineTracking
    from hil_sim.suite.requirements import Limits, Requirement
    from hil_sim.suite.runs import CellResult, Extreme, Summary
    from hil_sim.suite.tracking import SuiteResult

WIDTH = 120
SPUN, NO_FIGURE = "spin", "-"
BASELINE = "pi"
"""Baseline for the cost of a controller."""

SECONDS, DEGREES, SHARE, OVERSHOOT = 0.005, 0.5, 0.005, 2.0
"""Smallest differences that are reported."""


def sections(result: SuiteResult) -> Iterator[tuple[str, str]]:
    """Yield titles and texts in reading order."""
    yield f"Requirements, and results of {result.tested}", requirement_table(result.requirements)
    if why := explanation(result.requirements, result.limits):
        yield "Missed limits, and what they are for", why
    yield from condition_tables(result)
    yield "The paper's step, C1", c1_table(result)
    if result.margins:
        yield (
            "Margins over speed, the worst of the family without slow cars: gain (dB) / phase (deg) / peak sensitivity",
            margin_table(result),
        )
    if result.rise_times:
        yield "Rise time to 90 % over the amplitudes, mean / largest (s)", rise_table(result)
    yield "Sine at the steering wheel, 10 % of the largest front angle: gain over the map's / phase (deg)", sine_table(result)
    if BASELINE in result.subjects and result.tested != BASELINE:
        worse = (_slower(result), _lags_more(result), _overshoots_more(result))
        yield f"Where {result.tested} is worse", "\n".join(map(wrapped, worse))
    if result.timing:
        yield "Yaw moment of 2,000 N m at 90 km/h: rms yaw-rate error (deg/s), settled / from its onset", timing_table(result)
    if result.path_errors:
        yield "With a driver: rms path error (m)", path_table(result)
    if result.third_party:
        figures = "overshoot (%) / settling (s) / largest |sideslip| (deg)"
        yield f"Third party's multi-body car: {figures}", third_party_table(result, _cell)
        yield "Error to the map on the third party's car, steady / peak (%)", third_party_table(result, _map_errors)
    yield "Data used for tuning and for testing", sets_text(result)


# --- laying out --------------------------------------------------------------------------------------------------------


def wrapped(text: str) -> str:
    """Fill a text into lines of WIDTH."""
    return textwrap.fill(text, WIDTH, subsequent_indent="  ")


def _number(value: float | None, digits: int) -> str:
    return NO_FIGURE if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


# --- requirements ------------------------------------------------------------------------------------------------------

VERDICTS = {True: "met", False: "NOT MET", None: "not measured"}
NOTE_WIDTH = 40


def verdict(row: Requirement) -> str:
    """Verdict in words. Goals that may be missed are distinguished from requirements."""
    return "goal, missed" if row.stretch and row.passed is False else VERDICTS[row.passed]


def requirement_table(rows: Sequence[Requirement]) -> str:
    """Return a table with a line for each subject matter, and its figures below."""
    cells: list[tuple[str, ...]] = []
    for matter, group in groupby(rows, key=lambda row: row.subject_matter):
        cells.append((matter, "", "", "", ""))
        for row in group:
            note = "" if row.passed is None else textwrap.shorten(row.note, NOTE_WIDTH, placeholder=" ...")
            cells.append((f"  {row.figure}", row.asked, measured_text(row), verdict(row), note))
    return text_table(("", "required", "measured", "", ""), cells, left=5)


def measured_text(row: Requirement) -> str:
    """Return the value with its unit."""
    if row.measured is None:
        return NO_FIGURE
    digits = 0 if row.measured == int(row.measured) and not row.unit else 2
    return f"{_number(row.measured, digits)} {row.unit}".rstrip()


def explanation(rows: Sequence[Requirement], limits: Limits) -> str:
    """Return the reason of each missed limit, and how to change it; "" if none is missed."""
    keys = dict.fromkeys(row.key for row in rows if row.passed is False and row.key)
    if not keys:
        return ""
    told = "\n".join(wrapped(f"{key} = {getattr(limits, key):g}: {limits.why(key)}") for key in keys)
    return f"{told}\n{wrapped('To change a limit, write such a line into a TOML file and pass the file with `limits=`.')}"


def failures(rows: Sequence[Requirement]) -> list[str]:
    """Return a text for each figure that misses its requirement."""
    return [
        f"{row.subject_matter}: {row.figure} {measured_text(row)} ({row.asked})"
        for row in rows
        if row.passed is False and not row.stretch
    ]


# --- random cars -------------------------------------------------------------------------------------------------------

_CAR_FIGURES = (
    ("overshoot (%)", "overshoot_percent", 1),
    ("settling (s)", "settling_time_s", 2),
    ("t90 (s)", "rise_time_s", 2),
    ("|sideslip| (deg)", "sideslip_max_deg", 1),
    ("error to the map (%)", "map_error_percent", 2),
)


def car_sections(result: CarsResult) -> Iterator[tuple[str, str]]:
    """Yield titles and texts of `codegen suite cars`."""
    speeds, shares = (
        _listed([f"{value:g}" for value in values]) for values in (CARS_SPEEDS_KM_H, (100.0 * s for s in CARS_ANGLE_SHARES))
    )
    yield (
        "Random cars: mass, wheelbase, understeer gradient, largest rear angle, actuator lag",
        "\n".join(f"{car.title}: {'all limits met' if car.passed else _car_faults(car)}" for car in result.cars),
    )
    driven = [car for car in result.cars if car.summaries]
    for plant in PLANTS if driven else ():
        title = f"Largest of all cells, and where: {plant.title}{f' ({plant.what})' if plant.what else ''}"
        yield title, text_table(_CAR_HEADER, [_car_row(car, plant.name) for car in driven])
    told = f"Cells: step steers at {speeds} km/h with {shares} % of the largest feasible front angle, one sample of delay."
    limits = "; ".join(f"{row.figure} {row.asked}" for row in driven[0].requirements) if driven else ""
    yield "Limits of every car", wrapped(f"{limits}. {told}")
    if why := explanation([row for car in driven for row in car.requirements], result.limits):
        yield "Missed limits, and what they are for", why
    alone = ", ".join(f"{result.passed_on(plant)} {plant.title}" for plant in PLANTS)
    yield "Result", f"{result.passed} of {len(result.cars)} cars meet all limits; on each plant alone: {alone}"


_CAR_HEADER = ("", *(title for title, _, _ in _CAR_FIGURES), "slip (%)", "spins", "margins (dB / deg)")


def _car_row(car: CarResult, plant: str) -> tuple[str, ...]:
    summary, margins = car.summaries[plant], car.margins
    return (
        f"car {car.number}",
        *(_placed(getattr(summary, name), digits) for _, name, digits in _CAR_FIGURES),
        _placed(summary.slip_percent, 1),
        str(len(summary.spins)) if summary.spins else NO_FIGURE,
        NO_FIGURE if margins is None else f"{margins.gain_margin_db:.1f} / {margins.phase_margin_deg:.0f}",
    )


def _placed(found: Extreme | None, digits: int) -> str:
    """Return a figure and its cell: "4.8 at 120/50", km/h and percent of the feasible angle."""
    if found is None:
        return NO_FIGURE
    share = "" if found.cell.share is None else f"/{100.0 * found.cell.share:g}"
    return f"{_number(found.value, digits)} at {found.cell.speed_km_h:g}{share}"


def _car_faults(car: CarResult) -> str:
    return car.error or "; ".join(row.figure for row in car.requirements if row.passed is False)


def car_failures(result: CarsResult) -> list[str]:
    """Return a text for each limit that a car misses."""
    found = []
    for car in result.cars:
        found += [f"car {car.number}: {car.error}"] if car.error else failures(car.requirements)
    return found


# --- by condition ------------------------------------------------------------------------------------------------------


def condition_tables(result: SuiteResult) -> Iterator[tuple[str, str]]:
    """Yield one table for each figure: rows are conditions, columns are subjects."""
    if not result.conditions:
        return
    count = len(result.cells)
    figures: tuple[tuple[str, Callable[[Summary], str]], ...] = (
        ("Overshoot of the steady yaw rate over the cells, mean / largest (%)", _overshoot),
        ("Error to the map, largest over the cells: steady yaw rate / its peak (%)", _map_error),
        ("Settling time to 2 %, slowest cell (s); or how many cells never settle", _settling),
        ("Largest |sideslip| (deg)", lambda each: _extreme(each.sideslip_max_deg)),
        (f"Spins, of {count} cells", lambda each: str(len(each.spins)) if each.spins else NO_FIGURE),
    )
    for title, text in figures:
        rows = [
            (condition.title, *(text(result.summary(name, condition.name)) for name in result.subjects))
            for condition in result.conditions
        ]
        yield title, text_table(("", *result.subjects), rows)
    more = [f"{condition.title}: {condition.what}." for condition in result.conditions if condition.what]
    told = f"Cells: {_cells_text(result)}. A cell in which the car spins counts in the last table alone."
    yield "How to read these five tables", wrapped(" ".join([told, *more]))


def _overshoot(summary: Summary) -> str:
    if summary.overshoot_percent is None:
        return NO_FIGURE
    return f"{_number(summary.overshoot_mean_percent, 1)} / {_number(summary.overshoot_percent.value, 1)}"


def _map_error(summary: Summary) -> str:
    if summary.map_error_percent is None or summary.map_overshoot_percent is None:
        return NO_FIGURE
    return f"{summary.map_error_percent.value:+.1f} / {summary.map_overshoot_percent.value:+.1f}"


def _settling(summary: Summary) -> str:
    if summary.unsettled:
        return f"{len(summary.unsettled)} never"
    return _extreme(summary.settling_time_s)


def _extreme(found: Extreme | None) -> str:
    return NO_FIGURE if found is None else _number(found.value, 2)


def _cells_text(result: SuiteResult) -> str:
    speeds = [f"{speed:g}" for speed in dict.fromkeys(cell.speed_km_h for cell in result.cells)]
    shares = [f"{100.0 * share:g}" for share in dict.fromkeys(cell.share for cell in result.cells) if share is not None]
    return (
        f"step steers at {_listed(speeds)} km/h with {_listed(shares)} % of the largest feasible front angle, "
        f"{result.delay_text} in the computation"
    )


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def c1_table(result: SuiteResult) -> str:
    """Return a table with a row for each lag and figure."""
    figures = (
        ("overshoot", "%", "overshoot_percent", 1),
        ("error to the map, steady", "%", "map_error_percent", 1),
        ("overshoot of the map", "%", "map_overshoot_percent", 1),
        ("settling to 2 %", "s", "settling_time_s", 2),
        ("rise to 90 %", "s", "rise_time_s", 2),
        ("largest |sideslip|", "deg", "sideslip_max_deg", 2),
    )
    rows = []
    for lag in lags(result.actuator_lag_s):
        for place, (figure, unit, field, digits) in enumerate(figures):
            runs = [result.c1[subject][lag.name] for subject in result.subjects]
            texts = [SPUN if run.spun else _number(getattr(run, field), digits) for run in runs]
            rows.append(("" if place else lag.title, f"{figure} ({unit})", *texts))
    return text_table(("", "", *result.subjects), rows, left=2)


# --- margins -----------------------------------------------------------------------------------------------------------


def margin_table(result: SuiteResult) -> str:
    """Return the margins of the controller under test and the paper's: the configured car, and the worst of the family without
    its slow cars (`family_margins`)."""
    names = [name for name in dict.fromkeys((result.tested, BASELINE)) if name in result.margins]
    whose = ("the car itself", "worst of the family")
    header = ["", *(f"{name}: {text}" for name in names for text in whose)]
    rows = []
    for place, point in enumerate(result.margins[names[0]].points):
        row = [f"{point.speed_km_h:g} km/h"]
        for name in names:
            row += [_margins(result.margins[name].configured[place]), _margins(result.margins[name].points[place])]
        rows.append(row)
    return text_table(header, rows)


def _margins(point: MarginPoint) -> str:
    if not point.stable:
        return "unstable"
    return f"{point.gain_margin_db:.1f} / {point.phase_margin_deg:.0f} / {_number(point.sensitivity, 2)}"


# --- the price ---------------------------------------------------------------------------------------------------------


def rise_table(result: SuiteResult) -> str:
    """Return a table with a row for each speed."""
    rows = []
    for at in zip(*(result.rise_times[name] for name in result.subjects), strict=True):
        texts = [NO_FIGURE if one.mean_s is None else f"{one.mean_s:.2f} / {_number(one.largest_s, 2)}" for one in at]
        rows.append((f"{at[0].speed_km_h:g} km/h", *texts))
    return text_table(("", *result.subjects), rows)


def sine_table(result: SuiteResult) -> str:
    """Return a table with a row for each speed and frequency, if the grid reaches those speeds."""
    rows = []
    for at in zip(*(result.sine[name] for name in result.subjects), strict=True):
        rows.append((f"{at[0].speed_km_h:g} km/h, {at[0].frequency_hz:g} Hz", *map(_sine, at)))
    return text_table(("", *result.subjects), rows) if rows else "the grid ends below the speeds of this comparison"


def _sine(row: SineTracking) -> str:
    if row.gain_of_map is None or row.phase_deg is None:
        return SPUN
    return f"{row.gain_of_map:.2f} / {_number(row.phase_deg, 0)}"


def _slower(result: SuiteResult) -> str:
    nominal = NOMINAL.name
    if nominal not in result.results[result.tested]:
        return "Rise times were not compared in this run."
    pairs = compare_rise(result.results[result.tested][nominal], result.results[BASELINE][nominal])
    slower = [
        f"at {row.speed_km_h:g} km/h by {row.difference_s:.2f} s ({row.mean_s:.2f} against {row.other_mean_s:.2f})"
        for row in pairs
        if row.difference_s > SECONDS
    ]
    if not slower:
        return f"It rises no slower than {BASELINE} at any speed."
    return f"It rises to 90 % later than {BASELINE} {_listed(slower)}: means over the cells in which both stay on the road."


def _lags_more(result: SuiteResult) -> str:
    worse = []
    for one, other in zip(result.sine[result.tested], result.sine[BASELINE], strict=True):
        if one.phase_deg is None or one.gain_of_map is None or other.phase_deg is None or other.gain_of_map is None:
            continue
        place = f"{one.speed_km_h:g} km/h and {one.frequency_hz:g} Hz"
        told = []
        if other.phase_deg - one.phase_deg > DEGREES:
            told.append(f"phase {one.phase_deg:.0f} deg against {other.phase_deg:.0f}")
        if abs(one.gain_of_map - 1.0) - abs(other.gain_of_map - 1.0) > SHARE:
            told.append(f"gain {one.gain_of_map:.2f} of the map's against {other.gain_of_map:.2f}")
        if told:
            worse.append(f"at {place} {' and '.join(told)}")
    if not worse:
        return f"It follows a sine at the steering wheel no less well than {BASELINE}."
    return f"It follows a sine at the steering wheel less well than {BASELINE}: {'; '.join(worse)}."


def _overshoots_more(result: SuiteResult) -> str:
    worse = []
    for condition in result.conditions:
        others = [result.summary(name, condition.name) for name in result.subjects if name != result.tested]
        own = result.summary(result.tested, condition.name).overshoot_percent
        best = min((each for each in others if not each.spins and each.overshoot_percent), key=_largest, default=None)
        if own is not None and best is not None and own.value - _largest(best) > OVERSHOOT:
            worse.append(f"{condition.title} {own.value:.0f} % against {_largest(best):.0f} % of {best.subject}")
    if not worse:
        return "No controller whose car never spins overshoots less."
    return f"Its largest overshoot is above that of another whose car never spins: {'; '.join(worse)}."


def _largest(summary: Summary) -> float:
    return summary.overshoot_percent.value if summary.overshoot_percent is not None else math.inf


# --- elsewhere ---------------------------------------------------------------------------------------------------------


def timing_table(result: SuiteResult) -> str:
    """Return a table with a row for each timing of the frames."""
    rows = [
        (
            name,
            *(
                f"{math.degrees(runs[name].settled_rad_s):.3f} / {math.degrees(runs[name].whole_rad_s):.3f}"
                for runs in result.timing.values()
            ),
        )
        for name in TIMINGS
    ]
    return text_table(("", *result.timing), rows)


def path_table(result: SuiteResult) -> str:
    """Return a table with a row for each scenario."""
    rows = [
        (name, *(SPUN if errors[name] is None else _number(errors[name], 3) for errors in result.path_errors.values()))
        for name in PATH_SCENARIOS
    ]
    return text_table(("", *result.path_errors), rows)


def third_party_table(result: SuiteResult, text: Callable[[CellResult], str]) -> str:
    """Return a table with a row for each cell."""
    names = [name for name in result.subjects if name in result.third_party]
    rows = [(at[0].cell.title, *map(text, at)) for at in zip(*(result.third_party[name] for name in names), strict=True)]
    return text_table(("", *names), rows)


def _cell(result: CellResult) -> str:
    if result.spun:
        return SPUN
    settling = _number(result.settling_time_s, 2) if result.settled else "never"
    return f"{_number(result.overshoot_percent, 1)} / {settling} / {_number(result.sideslip_max_deg, 1)}"


def _map_errors(result: CellResult) -> str:
    return SPUN if result.spun else f"{_number(result.map_error_percent, 1)} / {_number(result.map_overshoot_percent, 1)}"


def sets_text(result: SuiteResult) -> str:
    """Return a description of design set and test set."""
    lines = [
        f"Gains (`codegen tune`): {result.design_set}.",
        f"Structure: {STRUCTURE_SET}.",
        f"Test: {_cells_text(result)}. No gain was chosen on them, nor anything on the third party's car.",
    ]
    return "\n".join(map(wrapped, lines))

"""Is the car better with the recommended controller than without? Map and drives of five cars and of random ones.

Measures no time. Each row is a requirement; rows marked LAW concern the control law rather than the map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from benchmarks.choices import chosen
from benchmarks.judged_car import (
    BUILD,
    CONTROLLED,
    FEEDFORWARD,
    PLANTS,
    TWO_TRACK,
    CarFigures,
    Dwell,
    PaperStep,
    judge_car,
    paper_steps,
)
from benchmarks.judged_cars import PAPER, SEED, five_cars, random_cars
from benchmarks.tables import CountReport, Row
from codegen.judgement.drives import SWEEP_RUNS
from codegen.judgement.lane_change import DRIVERS, STEP_KM_H
from codegen.judgement.rows import (
    DISPLACEMENT_ENOUGH_M,
    DISPLACEMENT_SHARE_MIN,
    GRIP_MIN,
    HIGH_MIN,
    LOW_MIN,
    SIDESLIP_SHARE_MAX,
)
from codegen.judgement.steady import SteadyFigures
from hil_sim.suite.background import Background

CARS, QUICK_CARS = 40, 4
"""Random cars by default."""
LAW = " (law)"

PAPER_GAIN_MIN = 1.092
"""C1 over C2 in the paper's table of its step."""
CARS_SHARE_MIN = 0.9
"""Share of the random cars that must meet every row."""


@dataclass(frozen=True)
class Criterion:
    """A requirement of one car.

    Attributes:
        title, goal: texts.
        reserve: how far a car is from the limit, negative where it misses it; the worst car has the least.
        shown: the measured figures as text.
        row: key of the figure in the judgement of the car.
    """

    title: str
    goal: str
    reserve: Callable[[CarFigures], float]
    shown: Callable[[CarFigures], str]
    row: str

    def is_met(self, car: CarFigures) -> bool:
        """Return whether a car meets it. One that could not be built misses everything."""
        return not car.error and self.reserve(car) >= 0.0


def _steady(car: CarFigures) -> SteadyFigures:
    assert car.steady is not None  # of a car that could be built
    return car.steady


def _grip(car: CarFigures) -> float:
    return _steady(car).grip


def _shown_grip(car: CarFigures) -> str:
    return f"{100.0 * _steady(car).grip:.1f} % ({_steady(car).largest_g:.3f} g; passive {_steady(car).passive_g:.3f} g)"


def _falling(car: CarFigures) -> float:
    return _steady(car).dead.falling_percent


def _shown_falling(car: CarFigures) -> str:
    steady = _steady(car)
    return f"{steady.dead.falling_percent:.1f} % ({steady.dead_on_ecu.falling_percent:.1f} % in the table of the ECU)"


def _low(car: CarFigures) -> float:
    return _steady(car).low.ratio


def _high(car: CarFigures) -> float:
    return _steady(car).high.ratio


def dwell_reserve(dwell: Dwell) -> float:
    """Return the distance in m of a displacement to its requirement, the easier of the two."""
    return dwell.displacement - min(DISPLACEMENT_ENOUGH_M, DISPLACEMENT_SHARE_MIN * dwell.passive)


def _dwell(car: CarFigures) -> float:
    return min(map(dwell_reserve, car.dwells))


def _shown_dwell(car: CarFigures) -> str:
    worst = min(car.dwells, key=dwell_reserve)
    return f"{worst.displacement:.2f} m ({worst.controller}, {worst.plant}; passive {worst.passive:.2f} m)"


def _shown_sweep(car: CarFigures) -> str:
    assert car.sweep is not None
    sweep = car.sweep
    return f"{sweep.short} of {sweep.passive} too short; {sweep.failed} miss a criterion that passive meets"


def _sweep(car: CarFigures) -> float:
    assert car.sweep is not None
    return -float(max(car.sweep.short, car.sweep.failed))


def _entry(car: CarFigures) -> float:
    return min(each.speed - each.passive_speed for each in car.lane_changes)


def _shown_entry(car: CarFigures) -> str:
    return ", ".join(f"{each.plant} {each.speed:.0f} km/h (passive {each.passive_speed:.0f})" for each in car.lane_changes)


def _sideslip(car: CarFigures) -> float:
    """Return the least reserve in deg; no driver who passes is a miss."""
    reserves = [SIDESLIP_SHARE_MAX * each.passive_sideslip - each.sideslip for each in car.lane_changes]
    return min(-math.inf if math.isnan(reserve) else reserve for reserve in reserves)


def _shown_sideslip(car: CarFigures) -> str:
    return ", ".join(f"{each.plant} {each.sideslip:.1f} deg (passive {each.passive_sideslip:.1f})" for each in car.lane_changes)


CRITERIA = (
    Criterion(
        "largest lateral acceleration of the map, of passive or the limit",
        f"at least {100.0 * GRIP_MIN:g} %",
        lambda car: _grip(car) - GRIP_MIN,
        _shown_grip,
        "lateral_acceleration",
    ),
    Criterion("steps of the map with falling yaw rate", "0", lambda car: -_falling(car), _shown_falling, "dead_steering_map"),
    Criterion(
        "yaw rate over passive, 20 to 60 km/h, up to the cap",
        f"at least {100.0 * LOW_MIN:g} %",
        lambda car: _low(car) - LOW_MIN,
        lambda car: f"{100.0 * _low(car):.1f} %",
        "yaw_rate_low",
    ),
    Criterion(
        "the same, 80 to 120 km/h, up to 0.4 g, passive or 100 km/h",
        f"at least {100.0 * HIGH_MIN:g} %",
        lambda car: _high(car) - HIGH_MIN,
        lambda car: f"{100.0 * _high(car):.1f} %",
        "yaw_rate_high",
    ),
    Criterion(
        "sine with dwell, displacement",
        f"at least {DISPLACEMENT_ENOUGH_M:g} m or {100.0 * DISPLACEMENT_SHARE_MIN:g} % of passive",
        _dwell,
        _shown_dwell,
        "dwell_displacement",
    ),
    Criterion(f"sine with dwell, runs that control misses{LAW}", "0", _sweep, _shown_sweep, "dwell_sweep"),
    Criterion("lane change, largest entry speed", "not below passive", _entry, _shown_entry, "lane_change_speed"),
    Criterion(
        f"lane change, peak sideslip{LAW}",
        f"at most {100.0 * SIDESLIP_SHARE_MAX:g} % of passive",
        _sideslip,
        _shown_sideslip,
        "lane_change_sideslip",
    ),
)


def run(
    quick: bool, say: Callable[[str], None], *, cars: int | None = None, seed: int = SEED, plant: str = ",".join(PLANTS)
) -> CountReport:
    """Judge five cars on the plants, and random ones on the two-track plant.

    Args:
        quick: whether to draw fewer random cars by default.
        say: called with the progress.
        cars: random cars.
        seed: of their draw.
        plant: names of PLANTS, separated by commas.

    Raises:
        WrongOption: there is no such plant.
        CodegenError: there is no C compiler.
    """
    plants = chosen("--plant", plant.split(","), PLANTS)
    count = (QUICK_CARS if quick else CARS) if cars is None else cars
    five = five_cars()
    with Background() as background:
        steps_job = background.call(paper_steps, five[PAPER], plants)
        jobs = [background.call(judge_car, name, config, plants, DRIVERS, True) for name, config in five.items()]
        drawn = enumerate(random_cars(seed, count), start=1)
        jobs += [
            background.call(judge_car, f"random car {number}", config, (TWO_TRACK,), DRIVERS, False) for number, config in drawn
        ]
        steps, judged = steps_job.get(), []
        for number, job in enumerate(jobs, start=1):
            judged.append(job.get())
            say(f"{judged[-1].name}: {number} of {len(jobs)} cars")
    return report(steps, judged[: len(five)], judged[len(five) :], seed)


def report(steps: Sequence[PaperStep], five: Sequence[CarFigures], drawn: Sequence[CarFigures], seed: int) -> CountReport:
    """Return the table of the requirements, and all figures of the five cars."""
    rows = [*_step_rows(steps), *(_criterion_row(criterion, five) for criterion in CRITERIA)]
    if drawn:
        rows.append(_random_row(drawn, seed))
    rows.append(_check_row(five))
    header = ("row", "measured, worst of the five cars", "car", "goal", "verdict")
    details = [Row((car.name, criterion.title, _shown(criterion, car))) for car in five for criterion in CRITERIA]
    drives = [Row((each.plant, each.controller, *_step_cells(each))) for each in steps]
    step_header = ("plant", "controller", "C1", "C2", "passive", "C1, sideslip", "passive, sideslip")
    tables = (
        (f"Better than passive: {BUILD.name} and four other cars, dry road", header, tuple(rows)),
        ("The paper's step, steady", step_header, tuple(drives)),
        ("Each of the five cars", ("car", "row", "measured"), tuple(details)),
    )
    return CountReport(tables, (*_notes(), *_failures(drawn)))


def _verdict(is_met: bool) -> str:
    return "met" if is_met else "MISSED"


def _shown(criterion: Criterion, car: CarFigures) -> str:
    text = f"not measured: {car.error}" if car.error else criterion.shown(car)
    return f"{text}: {_verdict(criterion.is_met(car))}"


def _step_cells(step: PaperStep) -> tuple[str, ...]:
    rates = (step.yaw_rate, step.front_steered, step.passive)
    return (*(f"{rate:.2f} deg/s" for rate in rates), f"{step.sideslip:.2f} deg", f"{step.passive_sideslip:.2f} deg")


def _step_rows(steps: Sequence[PaperStep]) -> list[Row]:
    """Return the rows of C1, each for the worst plant and controller."""
    goal = f"at least {100.0 * (PAPER_GAIN_MIN - 1.0):+.1f} %"
    rows = []
    ratios: tuple[tuple[str, Callable[[PaperStep], float]], ...] = (
        ("C2", lambda step: step.yaw_rate / step.front_steered),
        ("passive", lambda step: step.yaw_rate / step.passive),
    )
    for other, rate in ratios:
        worst = min(steps, key=rate)
        is_met = rate(worst) >= PAPER_GAIN_MIN
        measured = f"{100.0 * (rate(worst) - 1.0):+.1f} % ({worst.controller}, {worst.plant})"
        rows.append(Row((f"C1 over {other}, steady yaw rate", measured, PAPER, goal, _verdict(is_met)), is_met))
    worst = max(steps, key=lambda step: step.sideslip - step.passive_sideslip)
    is_met = worst.sideslip <= worst.passive_sideslip
    measured = f"{worst.sideslip:.2f} deg, passive {worst.passive_sideslip:.2f} ({worst.controller}, {worst.plant})"
    return [*rows, Row(("C1, steady sideslip", measured, PAPER, "no larger than passive", _verdict(is_met)), is_met)]


def _criterion_row(criterion: Criterion, cars: Sequence[CarFigures]) -> Row:
    worst = min(cars, key=lambda car: -math.inf if car.error else criterion.reserve(car))
    met = [criterion.is_met(car) for car in cars]
    text = f"not measured: {worst.error}" if worst.error else criterion.shown(worst)
    verdict = _verdict(all(met)) if all(met) or not any(met) else f"MISSED by {met.count(False)} of {len(met)}"
    return Row((criterion.title, text, worst.name, criterion.goal, verdict), all(met))


def _random_row(drawn: Sequence[CarFigures], seed: int) -> Row:
    needed = math.ceil(CARS_SHARE_MIN * len(drawn))
    every = sum(all(criterion.is_met(car) for criterion in CRITERIA) for car in drawn)
    of_map = sum(all(criterion.is_met(car) for criterion in CRITERIA if LAW not in criterion.title) for car in drawn)
    measured = f"{of_map} of {len(drawn)}; {every} with the rows of the law"
    title = f"random cars that meet every row above, seed {seed}"
    return Row((title, measured, "-", f"{needed}", _verdict(of_map >= needed)), of_map >= needed)


def as_checked(car: CarFigures) -> CarFigures:
    """Return the figures of a car on the plant and with the controller of `codegen check`, as far as they were measured."""
    dwells = tuple(each for each in car.dwells if (each.plant, each.controller) == (TWO_TRACK, CONTROLLED))
    lane_changes = tuple(each for each in car.lane_changes if each.plant == TWO_TRACK)
    return replace(car, dwells=dwells or car.dwells, lane_changes=lane_changes or car.lane_changes)


def _check_row(five: Sequence[CarFigures]) -> Row:
    """Return the row about `codegen check`: it must warn of the figure of each row that a car misses as `check` drives it."""
    missed = {car.name: {criterion.row for criterion in CRITERIA if not criterion.is_met(as_checked(car))} for car in five}
    unnamed = {car.name: sorted(missed[car.name] - car.named) for car in five if missed[car.name] - car.named}
    counts = ", ".join(f"{len(missed[car.name] & car.named)} of {len(missed[car.name])}" for car in five)
    left = "; ".join(f"{name}: {', '.join(rows)}" for name, rows in unnamed.items())
    return Row(
        (
            "`codegen check` on the five cars",
            f"missed rows that are named ({CONTROLLED}, {TWO_TRACK}): {counts}",
            left or "-",
            "each missed row is named",
            _verdict(not unnamed),
        ),
        not unnamed,
    )


def _failures(drawn: Sequence[CarFigures]) -> list[str]:
    notes = [f"{car.name} was not built: {car.error}" for car in drawn if car.error]
    built = [car for car in drawn if not car.error]
    if built:
        met = "; ".join(f"{criterion.title} {sum(map(criterion.is_met, built))}" for criterion in CRITERIA)
        notes.append(f"Random cars that meet each row, of {len(built)} built: {met}.")
    return notes


def _notes() -> tuple[str, ...]:
    return (
        f"Plants: {TWO_TRACK} is the car of the configuration; roll is the third plant, with other tyres, relaxation and "
        "sensor errors. The passive car is driven on the same plant. Commands act "
        "`plant.command_delay_samples` late, and at least one sample. C1 and the displacement are "
        f"the worst of the tuned controller and of {FEEDFORWARD} alone.",
        "Passive car of the map's rows: steady turns of the nonlinear car with straight rear wheels, up to 90 % of the slip of "
        "peak force. Yaw rates are those of the table of the ECU with its cap; the cap of these rows is 95 % of the smaller "
        "of the passive car's largest lateral acceleration and the configured limit.",
        f"Sweep of sines with dwell: {SWEEP_RUNS} runs at 80 km/h, 5 to 7 times the angle for 0.3 g, friction 0.7 to 0.9, no "
        "estimate, mass 90 to 120 %, two-track. Too short: passive reaches the displacement of FMVSS 126, control does not.",
        f"Lane change: ISO 3888-2:2011 at constant speed, {len(DRIVERS)} drivers (MacAdam 1981; preview, reaction, gain); "
        f"the largest speed, in steps of {STEP_KM_H:g} km/h, at which one driver passes. "
        "Peak sideslip: at the smaller entry speed of both cars, of the driver who passes with the least.",
    )

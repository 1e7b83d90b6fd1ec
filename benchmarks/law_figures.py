"""Figures of the benchmark `law`, one for each car, and their tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from benchmarks.tables import Row

MET, MISSED = "met", "MISSED"


@dataclass(frozen=True)
class Figure:
    """One figure of one car on one plant, or of all cars.

    Attributes:
        row: number of the row of the requirements.
        title, plant, goal: texts; the figures of several cars with the same three are a line of a table. Without a goal it is
            a detail, for a table of its own.
        car: letter of the car; "" for a figure that is not of one car.
        text: measured.
        is_met: whether the goal is met; not used if the goal is one of a sum.
        value: term of the sum of all cars, where the goal is one.
        sum_max: largest sum; None where every car has the goal.
    """

    row: int
    title: str
    plant: str
    goal: str
    car: str
    text: str
    is_met: bool = True
    value: float = 0.0
    sum_max: float | None = None


def header(cars: Sequence[str]) -> tuple[str, ...]:
    """Return the header of a table with columns for these cars."""
    return ("row", "figure", "plant", "goal", *cars, "all", "verdict")


def lines(figures: Iterable[Figure], cars: Sequence[str]) -> tuple[Row, ...]:
    """Return the lines of figures, by the number of their row."""
    grouped: dict[tuple[int, str, str, str], list[Figure]] = {}
    for each in figures:
        grouped.setdefault((each.row, each.title, each.plant, each.goal), []).append(each)
    return tuple(_line(key, grouped[key], cars) for key in sorted(grouped, key=lambda key: key[0]))


def _line(key: tuple[int, str, str, str], figures: Sequence[Figure], cars: Sequence[str]) -> Row:
    row, title, plant, goal = key
    texts, largest = {each.car: each.text for each in figures}, figures[0].sum_max
    is_met = all(each.is_met for each in figures)
    if largest is not None:
        total = sum(each.value for each in figures)
        is_met, texts[""] = total <= largest, f"{total:g}"
    verdict = "-" if not goal else MET if is_met else MISSED
    measured = (texts.get(car, "-") for car in (*cars, ""))
    return Row((str(row), title, plant, goal or "-", *measured, verdict), is_met or not goal)

"""The judgement of the car in a report: figures of the first screen, and the whole table."""

from __future__ import annotations

from collections.abc import Iterator

from codegen.judgement.lane_change import DRIVERS, STEP_KM_H
from codegen.judgement.model import FAULTS, JUDGEMENT_HEADER, WORDS, Judgement, Row, Stored, Verdict
from codegen.report.html.blocks import Block, Table, Text, Tile

FIRST_SCREEN = (
    ("lateral_acceleration",),
    ("dead_steering_map", "dead_steering_ecu"),
    ("yaw_rate_low",),
    ("yaw_rate_high",),
    ("overshoot_yaw_rate", "overshoot_lateral_acceleration"),
    ("rise_yaw_rate", "rise_lateral_acceleration"),
    ("dwell_displacement",),
    ("lane_change_speed", "lane_change_sideslip"),
)
"""Figures of the first screen. Of several in one place, the worst is shown."""
SEVERITY: tuple[Verdict, ...] = ("worse", "missed", "equal", "stated", "better")
LOOKS: dict[Verdict, str] = {"worse": "bad", "missed": "bad", "better": "good"}


def headline(stored: Stored) -> Text:
    """Return the sentence about the whole car, or a notice that there is none."""
    if stored.judgement is None:
        return Text(f"{stored.note[0].upper()}{stored.note[1:]}.", "notice")
    return Text(stored.judgement.sentence)


def tiles(judgement: Judgement) -> Iterator[Tile]:
    """Yield the figures of the first screen, each at its worst speed."""
    for keys in FIRST_SCREEN:
        rows = [row for key in keys if (row := judgement.row(key)) is not None]
        if rows:
            yield _tile(min(rows, key=lambda row: (SEVERITY.index(row.verdict), -(row.value or 0.0))))


def _tile(row: Row) -> Tile:
    passive = f"passive {row.passive_text}" if row.passive_text else ""
    detail = "; ".join(filter(None, (row.at, passive, f"required: {row.required}" if row.verdict in FAULTS else "")))
    return Tile(f"{row.title[0].upper()}{row.title[1:]}", row.value_text, detail, LOOKS.get(row.verdict, ""))


def judgement_blocks(stored: Stored) -> Iterator[Block]:
    """Yield the whole judgement."""
    judgement = stored.judgement
    if judgement is None:
        yield headline(stored)
        return
    _, rows = judgement.table()
    looks = {WORDS[verdict]: look for verdict, look in LOOKS.items()}
    yield Table(
        "The car with its controller and with straight rear wheels, dry road",
        JUDGEMENT_HEADER,
        rows,
        words=(0, 3, 4, 5),
        verdicts=looks,
    )
    if judgement.binding_percent:
        yield Text(f"What binds in the feasible cells of the map: {judgement.binding_text}.")
    yield Text(
        "Steady turns: the map, and what the ECU looks up, against the same car with straight rear wheels up to the peak of "
        "its tyres. Drives: the generated C around the two-track car, without an estimate of the friction. Steps and sines at "
        "60 and 80 km/h and the last speed of the map, of which the worst is shown. Sine with dwell: FMVSS 126. Lane change: "
        f"ISO 3888-2 at constant speed, the largest entry speed in steps of {STEP_KM_H:g} km/h at which one of {len(DRIVERS)} "
        "drivers passes."
    )
    for note in judgement.notes:
        yield Text(f"{note[0].upper()}{note[1:]}.", "notice")

"""First screen of a report: whether the car is better, its figures, its margins, its cost and its verification.

The table of the whole judgement, further down in a report, is here too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from codegen.configuration import Config
from codegen.design.margins import Weakest, margin_range_km_h
from codegen.emit.laws import is_untuned
from codegen.emit.manifest import read_build
from codegen.errors import CodegenError
from codegen.figures.data import Chart
from codegen.figures.maps import heat_map_charts
from codegen.figures.runs import PANELS
from codegen.figures.scenarios import time_chart
from codegen.judgement.build_warnings import folder_warnings
from codegen.judgement.car_warnings import Handling
from codegen.judgement.facts import all_warnings
from codegen.report.html import build as build_tables
from codegen.report.html.page import Block, Gallery, Text, Tile, Tiles
from codegen.units import KM_H

if TYPE_CHECKING:
    from codegen.report.html.report import Material


from codegen.judgement.lane_change import DRIVERS, STEP_KM_H
from codegen.judgement.model import FAULTS, JUDGEMENT_HEADER, WORDS, Judgement, Row, Stored, Verdict
from codegen.report.html.page import Table

PICTURE_HEIGHT = 195
"""Height in px."""


def verdict_blocks(material: Material) -> Iterator[Block]:
    """Yield a sentence, tiles with figures, two pictures, and the warnings."""
    if material.configured:
        yield headline(material.judgement)
    yield Text(_headline(material), "lead")
    if tiles := tuple(_tiles(material)):
        yield Tiles(tiles)
    yield Gallery(list(_pictures(material)))
    for note in (*material.notes, *_warnings(material)):
        yield Text(note, "notice")


def _headline(material: Material) -> str:
    """Return a sentence about the map or build, its car and its road."""
    reference_map, config = material.map.map, material.config
    case = f"case {reference_map.case}" if reference_map.case else "a map from another tool"
    speeds = f"{reference_map.speed[0] / KM_H:.0f} to {reference_map.speed[-1] / KM_H:.0f} km/h"
    of_map = f"{material.map.name}: {case}, {speeds}"
    if not material.configured:
        return f"{of_map}."
    kind = f", controller “{config.controller.kind}”" if material.build is not None else ""
    car = f"{config.vehicle.mass_kg:,.0f} kg, {Handling.from_config(config)}"
    return f"{of_map}, friction {config.road.friction:g}{kind}. Car: {car}."


def _tiles(material: Material) -> Iterator[Tile]:
    if material.configured and material.judgement.judgement is not None:
        yield from tiles(material.judgement.judgement)
    if material.configured and not is_untuned(material.config):
        yield _margins(material.margins, material.config)
    if material.build is not None:
        yield from _verification(material.build)


def _margins(found: Weakest | None, config: Config) -> Tile:
    title = "Least margins of the car itself"
    speeds = "{:g} to {:g} km/h".format(*margin_range_km_h(config))
    if found is None:
        return Tile(title, "no feedback", "so no margins")
    if found.unstable_from is not None:
        return Tile(title, "unstable", f"from {found.unstable_from / KM_H:.0f} km/h; {speeds}", "bad")
    look = "good" if found.enough else "bad"
    return Tile(title, f"{found.gain_margin_db:.1f} dB, {found.phase_margin_deg:.0f} deg", speeds, look)


def _verification(build: Any) -> Iterator[Tile]:
    record = build_tables.current_record(build)
    if record is None:
        yield Tile("Verified", "no", f"`codegen verify {build}` checks this build", "bad")
        return
    counts = record["counts"]
    passed, total = counts["passed"], sum(counts.values())
    quick = " in their quick form" if record.get("effort") == "quick" else ""
    look = "good" if passed == total else "bad"
    yield Tile("Verified", f"{passed} of {total} checks", f"passed{quick}; see What was verified", look)
    budgets: Mapping[str, Any] = record["checks"].get("budgets", {}).get("figures", {})
    if "functions" in budgets:
        steps = budgets["functions"]["controller_step"]["instructions_with_limiter"]["max"]
        code = sum(sizes.get(part, 0) for sizes in budgets["objects"].values() for part in ("text", "rodata"))
        yield Tile(
            "Cost on a Cortex-M4F",
            f"{steps:,} instructions",
            f"worst step with the limiter; {code / 1024:.0f} KiB of flash with the map",
        )


def _pictures(material: Material) -> Iterator[Chart]:
    first = heat_map_charts(material.map)[0]
    yield _named(first, "verdict-map")
    if material.runs and material.scenario is not None:
        chart = time_chart(material.scenario, material.config, material.runs, PANELS[:1])
        yield _named(chart, "verdict-run")


def _named(chart: Chart, name: str) -> Chart:
    caption, _, _ = chart.caption.partition(". ")
    return replace(chart, name=name, height=PICTURE_HEIGHT, caption=f"{caption.rstrip('.')}.")


def _warnings(material: Material) -> Iterator[str]:
    if not material.configured:
        return
    config = material.config
    try:
        manifest = None if material.build is None else read_build(material.build)
        found = list(all_warnings(config, material.map.map, manifest))
        if material.build is not None:
            found += folder_warnings(material.build)
    except CodegenError as error:
        found = [str(error)]
    yield from (f"{text[0].upper()}{text[1:]}." for text in dict.fromkeys(found))


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

"""The sections of a report, from a map, a build and runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.margins import Weakest, margin_range_km_h
from codegen.ecu_map.extend import extend
from codegen.ecu_map.total import RULE_TEXT, Rule
from codegen.emit.evidence import margins_of, margins_text
from codegen.emit.folder import verify_hashes
from codegen.emit.manifest import read_build
from codegen.errors import MapError
from codegen.figures.curves import front_angle_chart, slip_limit_text, tyre_charts
from codegen.figures.data import (
    BLUE,
    FRONT_ANGLE_TITLE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    SPEED_TITLE,
    VERMILION,
    Chart,
    axis,
    cell_edges,
    layout,
    patches,
)
from codegen.figures.maps import (
    NamedMap,
    category_trace,
    heat_map_charts,
    is_paper,
    tyre_note,
)
from codegen.figures.paper_tables import CASE_OF_RUN, PAPER_TABLE, TABLE_FRONT_ANGLE_DEG, optimum_rows, optimum_table, run_table
from codegen.judgement.model import Stored, of_manifest, of_map
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.report.bus_tables import FAULT_HEADER, FaultEntry, fault_cells
from codegen.report.html import maps
from codegen.report.html.build import manifest_blocks, verification_blocks
from codegen.report.html.inputs import BusTimes
from codegen.report.html.maps import loss_blocks
from codegen.report.html.page import Block, Gallery, Section, Table, Text
from codegen.report.html.robust import margins_chart, region_blocks
from codegen.report.html.runs import bus_blocks, handling_blocks, run_blocks
from codegen.report.html.verdict import judgement_blocks, verdict_blocks
from codegen.report.map_difference import (
    CAR_HEADER,
    DIFFERENCE_HEADER,
    POINT_HEADER,
    caveats,
    difference_charts,
    map_difference,
    same_car,
)
from codegen.report.summary import TYRE, map_summary
from codegen.sweep.region import Region
from codegen.units import KM_H
from hil_sim.metrics import step_metrics
from hil_sim.metrics.run import LookUp
from hil_sim.scenarios import Scenario


def difference_in_figures(one: NamedMap, other: NamedMap) -> Iterator[Block]:
    """Yield the tables of `codegen show --against`; a notice if the maps have no operating point in common."""
    try:
        found = map_difference(one.map, other.map)
    except MapError as error:
        yield Text(f"Not compared in figures: {error.what}.", "notice")
        return
    yield Text(
        f"First: {one.name}, second: {other.name}. Slip is that of the plant in the steady turn with the map's yaw rate."
        + "".join(f" {text[0].upper()}{text[1:]}." for text in caveats(one.map, other.map))
    )
    yield Table("Both maps in figures", CAR_HEADER, list(found.rows()))
    yield Table("Where both are feasible", DIFFERENCE_HEADER, [found.difference_row])
    if found.points:
        yield Table("Yaw rate r (deg/s) and rear angle (deg) at a few operating points", POINT_HEADER, found.point_rows)


YELLOW = "#F0E442"
"""Yellow of the palette in `codegen.figures.data`."""
LINEAR = ", from there linear to the first breakpoint"

RULES = {
    Rule.SOLVED: ("as in the map", BLUE),
    Rule.ZERO: ("linear, from zero", YELLOW),
    Rule.HOLD: ("held at ay_cap / vx", ORANGE),
    Rule.PASSIVE_SLOPE: ("continued with the passive gain", GREEN),
    Rule.BETWEEN: ("between feasible cells", PURPLE),
    Rule.NEIGHBOUR: ("between speeds", SKY),
    Rule.CONTINUED: ("beyond the cap, continued", VERMILION),
}
"""Short name for a legend, and colour; RULE_TEXT has the full names."""


def _cells(one: NamedMap, config: Config, build: Path | None) -> tuple[FloatArray, FloatArray, npt.NDArray[np.str_]]:
    """Return breakpoints (n,) in m/s and (m,) in rad, and the rule of each cell (n, m), as the manifest of a build lists them.

    Without a build, the map is extended.
    """
    if build is None:
        total = extend(one.map, config)
        return total.speed, total.front_angle, total.rule
    table = read_build(build)["map"]
    speed, front_angle = (np.array(table[key], dtype=np.float64) for key in ("speed_m_s", "front_angle_rad"))
    return speed, front_angle, np.array([list(row) for row in table["rule_by_speed_and_front_angle"]])


def extended(one: NamedMap, config: Config, build: Path | None = None) -> tuple[Chart, Table]:
    """Return a chart and a table of the ECU's cells: solved, or extended by which rule (`codegen.ecu_map.total`)."""
    speed, front_angle, of_cells = _cells(one, config, build)
    rules = [rule for rule in Rule if (of_cells == rule.value).any()]
    codes = np.zeros(of_cells.shape, dtype=np.uint8)
    for code, rule in enumerate(rules):
        codes[of_cells == rule.value] = code
    names, colours = zip(*(RULES[rule] for rule in rules), strict=True)
    edges = (cell_edges(speed / KM_H), cell_edges(np.degrees(front_angle)))
    trace = category_trace(*edges, codes, np.zeros(codes.shape, dtype=bool), names, colours)
    look = layout(
        xaxis=axis(SPEED_TITLE, zeroline=False, showgrid=False),
        yaxis=axis(FRONT_ANGLE_TITLE, zeroline=False, showgrid=False),
    )
    counts = [int((codes == code).sum()) for code in range(len(rules))]
    spoken = ", ".join(f"{count} {name}" for count, name in zip(counts, names, strict=True))
    figure = {"data": [trace, *patches(names, colours)], "layout": look}
    caption = "The whole domain that the ECU meets: cells that were solved, and those that were extended, by rule."
    chart = Chart("map-extended", figure, caption, f"Cells of the ECU's table by their origin: {spoken}.", 480)
    rows = [
        (name, RULE_TEXT[rule] + LINEAR * (rule is Rule.ZERO), f"{count:,}", f"{100.0 * count / codes.size:.1f} %")
        for rule, name, count in zip(rules, names, counts, strict=True)
    ]
    return chart, Table("Cells of the ECU's table by their origin", ("", "rule", "cells", "share"), rows, words=(0, 1))


WITHOUT_REAR_STEER = "fws"
"""Case of the map that is compared by default."""


@dataclass(frozen=True)
class Material:
    """Data of a report.

    Attributes:
        map: map with its name. others: maps to compare it with.
        config: configuration of the car. configured: whether it came with the map; a bare map has none.
        build: folder of the generated C; None without a build.
        runs: name -> recording (samples, 12). scenario: their scenario; None without runs.
        driven: scenario name -> runs, for the handling diagram and the frequency response.
        loops: name -> configuration of the controllers whose margins are shown. regions: their stability regions.
        logs: timing of the bus logs. faults: entries of `codegen faults --json`; None if not tested.
        notes: notes for the reader, such as omissions.
        look_up: map lookup of the build's C; None if no build is simulated.
        of_paper: whether the runs are the paper's C1 and C2.
    """

    map: NamedMap
    others: Sequence[NamedMap]
    config: Config
    configured: bool
    build: Path | None = None
    runs: Mapping[str, FloatArray] | None = None
    scenario: Scenario | None = None
    driven: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)
    loops: Mapping[str, Config] | None = None
    regions: Mapping[str, Region] = field(default_factory=dict)
    logs: Sequence[BusTimes] = ()
    faults: Sequence[FaultEntry] | None = None
    notes: Sequence[str] = ()
    look_up: LookUp | None = None
    of_paper: bool = False

    @cached_property
    def judgement(self) -> Stored:
        """The judgement of the car that is stored in the map or the build."""
        found = of_map(self.map.map, self.config)
        if found.judgement is not None or self.build is None:
            return found
        of_build = of_manifest(read_build(self.build), is_edited=bool(verify_hashes(self.build)))
        return of_build if of_build.state != "missing" else found

    @cached_property
    def margins(self) -> Weakest | None:
        """Smallest margins of the configured controller; None without feedback."""
        return margins_of(self.config)


def to_compare(one: ReferenceMap) -> NamedMap | None:
    """Return the map of the same car without rear steering, if the configuration has that case and this map is not it.

    It is solved with the tyre of this map, so that only the rear steering differs.
    """
    if one.config is None or one.case == WITHOUT_REAR_STEER or WITHOUT_REAR_STEER not in one.config.cases:
        return None
    return NamedMap(WITHOUT_REAR_STEER.upper(), solve_case(one.config.with_tyre_model(one.tyre_model), WITHOUT_REAR_STEER))


def sections(material: Material) -> Iterator[Section]:
    """Yield all sections. A section without content contains a notice that explains how to add it."""
    yield Section("verdict", "Verdict", list(verdict_blocks(material)), is_open=True)
    if material.configured:
        yield Section("judgement", "Better than without the controller?", list(judgement_blocks(material.judgement)))
    yield Section("map", "The map", list(_map(material)))
    if material.others:
        yield Section("compared", "Maps compared", list(_compared(material)))
    beyond = (*extended(material.map, material.config, material.build), *loss_blocks(material.map, material.config))
    yield Section("beyond", "Beyond the solved cells, and without the function", beyond)
    yield Section("optimum", f"The optimum at {TABLE_FRONT_ANGLE_DEG:g} deg, and the tyres", list(_optimum(material)))
    runs: Iterable[Block] = [NO_RUN]
    if material.runs and material.scenario is not None:
        runs = run_blocks(material.runs, material.config, material.scenario, material.look_up)
    yield Section("runs", "Runs", list(runs))
    handling = handling_blocks(material.driven, material.runs, material.config)
    yield Section("handling", "Handling and frequency response", list(handling))
    yield Section("margins", "Margins over speed", list(_margins(material)))
    if material.regions:
        yield Section("region", "Where the loop is stable", list(region_blocks(material.regions)))
    yield Section("faults", "Faults on the bus", list(_faults(material.faults)))
    yield Section("timing", "Timing on the bus", list(bus_blocks(material.logs)) if material.logs else [NO_LOG])
    build = material.build
    verified = [NO_BUILD] if build is None else list(verification_blocks(build))
    yield Section("verification", "What was verified", verified)
    yield Section("axes", "Axes, values and the car", list(_axes(material)))
    yield Section("manifest", "Manifest", [NO_BUILD] if build is None else list(manifest_blocks(build)))


NO_BUILD = Text("No build: name one with `--build`.", "notice")
NO_RUN = Text("No run: name a build with `--build`, or recordings with `--run`.", "notice")
NO_LOG = Text(
    "No log of a bus: `codegen hil --build DIR --bus socketcan:vcan0 --ecu native --log run.blf` writes one, and "
    "`--run run.blf` shows it here.",
    "notice",
)


def _axes(material: Material) -> Iterator[Block]:
    summary = map_summary(material.map.map)
    yield Text(f"{material.map.name}: {summary.headline}.")
    if summary.tyre_line:
        yield Text(f"{summary.tyre_line.capitalize()}.")
    if summary.tightening_line:
        yield Text(f"{summary.tightening_line.capitalize()}.")
    yield Table("Axes", ("", "from", "to", "unit", "points"), summary.axis_rows, words=(0, 3))
    yield Table("Values, where feasible", ("", "from", "to", "unit"), summary.value_rows, words=(0, 3))
    if summary.binding_rows:
        yield Table("What binds", ("constraints", "cells", "share"), summary.binding_rows)
    if summary.acceleration_rows:
        of_moving = ("longitudinal acceleration (m/s²)", "feasible cells", "share", "largest lateral (m/s²)", "like friction")
        yield Table("Maps for longitudinal accelerations", of_moving, summary.acceleration_rows)
    if summary.stack_rows:
        header = ("friction", "feasible cells", "share", "lateral acceleration, largest (m/s²)")
        yield Table("Maps for lower frictions", header, summary.stack_rows)
    if material.configured:
        yield Table("The car", ("", ""), list(_car(material.config)), words=(0, 1))


def _car(config: Config) -> Iterator[tuple[str, str]]:
    vehicle, limits = config.vehicle, config.limits
    yield "mass", f"{vehicle.mass_kg:g} kg"
    yield "yaw inertia", f"{vehicle.yaw_inertia_kg_m2:g} kg m²"
    yield "centre of gravity to axles", f"{vehicle.cg_to_front_axle_m:g} m, {vehicle.cg_to_rear_axle_m:g} m"
    yield "road friction", f"{config.road.friction:g}"
    yield "limit of the rear angle", f"{limits.rear_angle_max_deg:g} deg"
    yield "limit of the sideslip", f"{limits.sideslip_max_deg:g} deg"
    yield "limit of the lateral acceleration", f"{limits.lateral_acceleration_max_g:g} g"
    yield "limit of the slip angles", slip_limit_text(limits)
    if limits.yaw_gain_floor > 0.0:
        speed = limits.reference_characteristic_speed_km_h
        yield "floor of the yaw rate", f"{100.0 * limits.yaw_gain_floor:g} % of passive; from 80 km/h at most of {speed:g} km/h"


def _map(material: Material) -> Iterator[Block]:
    one = material.map
    if one.map.rear_angle is None:
        yield Text("The yaw rate for each speed and front angle of a left turn.")
    else:
        yield Text(SOLVED)
    yield Gallery(heat_map_charts(one))
    yield maps.cuts([one, *material.others])


SOLVED = (
    "The largest safe yaw rate for each speed and front angle of a left turn, and the sideslip and rear angle that go with "
    "it. δr > 0 steers the rear wheels like the front wheels. δr = 0 is the line of phase conversion: there the rear "
    "wheels pass from the opposite to the same direction."
)


def _compared(material: Material) -> Iterator[Block]:
    for number, other in enumerate(material.others, start=1):
        yield Text(
            f"{material.map.name} beside {other.name}{_same_car(material.map.map, other.map)}{_tyres(material.map, other)}."
        )
        yield Gallery(difference_charts(material.map, other, number))
        yield from difference_in_figures(material.map, other)


def _same_car(one: ReferenceMap, other: ReferenceMap) -> str:
    """Return a text on whether two maps are of the same car."""
    same = same_car(one, other)
    if same is None:
        return "; the car of a bare map is not known"
    return ", the same car on the same road" if same else ": another car, or another road"


def _tyres(one: NamedMap, other: NamedMap) -> str:
    """Return a text about the tyres of two optimisations if one of them is not linear."""
    models = (one.map.tyre_model, other.map.tyre_model)
    if not any(tyre_note(model) for model in models):
        return ""
    if models[0] == models[1]:
        return f"; {TYRE} of both: {models[0]}"
    return f"; {TYRE}: {models[0] or 'not known'} of {one.name}, {models[1] or 'not known'} of {other.name}"


def _optimum(material: Material) -> Iterator[Block]:
    if not material.configured:
        yield Text(
            "A bare map contains no car, so there is nothing to optimise. `codegen solve` writes a map with its car.", "notice"
        )
        return
    paper = is_paper(material.map.map) and PAPER_TABLE.keys() <= material.config.cases.keys()
    yield front_angle_chart(
        material.config.with_tyre_model(material.map.map.tyre_model), TABLE_FRONT_ANGLE_DEG, paper, material.map.map.case
    )
    if paper:
        header, rows = optimum_table(optimum_rows(material.config))
        yield Table("The optimum and the paper's table, at the printed speed and at the speed that fits its rows", header, rows)
        found = _paper_runs(material)
        if found:
            header, rows = run_table(found)
            yield Table("Closed loop and the paper's figures", header, rows)
    yield Gallery(tyre_charts(material.config))


def _paper_runs(material: Material) -> dict[str, dict[str, Any]]:
    if not material.of_paper or material.runs is None or material.scenario is None:
        return {}
    at, ratio = material.scenario.steer_time, material.config.steering.ratio
    return {name: step_metrics(record, at, ratio) for name, record in material.runs.items() if name in CASE_OF_RUN}


def _margins(material: Material) -> Iterator[Block]:
    chart = margins_chart(material.loops or {})
    if chart is None:
        yield Text("No controller with feedback is part of this report: name a build with `--build`.", "notice")
        return
    yield chart
    for name, config in (material.loops or {}).items():
        least = margins_text(material.margins if config is material.config else margins_of(config)).replace("**", "")
        yield Text(f"{name}, least margins of the car itself up to {margin_range_km_h(config)[1]:g} km/h: {least}.")


def _faults(faults: Sequence[FaultEntry] | None) -> Iterator[Block]:
    if faults is None:
        yield Text(
            "Not tested: name a build with `--build`, or pass the output of `codegen faults --json` with `--run`.", "notice"
        )
        return
    yield Text("Each fault of the catalogue in the same turn-in; times from the moment it was injected.")
    rows = [fault_cells(entry) for entry in faults]
    yield Table("Faults on the bus", FAULT_HEADER, rows, words=(0, 1, 7, 8), verdicts={"yes": "good"})

"""Safety manual of a build, `verify.md`: conditions of use, results of the checks, and limitations.

The manual is a view of the manifest and of the verification record. The template holds the text. This module supplies the facts
of the build and formats the results of the checks as tables.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any, TypeVar

from codegen import configuration
from codegen.configuration import Config
from codegen.configuration.budgets import KEY_OF_FUNCTION
from codegen.ecu_map.total import Rule
from codegen.emit.can_view import DIAGNOSTIC_CAUSES
from codegen.emit.controller_view import REFERENCE_OVERSHOOT
from codegen.emit.laws import LAWS
from codegen.emit.render import render
from codegen.emit.supervision import CAUSES, EXCEPTIONS, STATES, causes_of_bit, reaction_of, status_text
from codegen.errors import one_line
from codegen.units import DEGREE, KM_H
from codegen.verify.requirements import ON_THE_CAR, REQUIREMENT_HEADER

Figures = Mapping[str, Any]
Formatted = TypeVar("Formatted")

OFF = "off"
TOOL_NAMES = {
    "cppcheck": "Cppcheck",
    "unicorn": "Unicorn",
    "capstone": "Capstone",
    "ziglang": "ziglang (zig's clang)",
}
CALLED = {"controller_step": "controller_step, without the limiter", "cycle": "cycle: reception of both frames, and the task"}
"""Description of a function where its name is not enough."""
SUITES = {
    "scenarios": "scenarios in closed loop, by calls and through CAN frames",
    "faults": "faults of the catalogue",
    "steps": "steps of the drives",
    "look_ups": "look-ups on every road",
}
"""Figures of the sanitizers."""


@dataclass(frozen=True)
class Table:
    """Some results of a check."""

    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def manual(record: Figures, manifest: Figures, titles: Mapping[str, str]) -> str:
    """Return the text of `verify.md`, in Markdown.

    Args:
        record: content of `verify.json`.
        manifest: manifest of the build.
        titles: titles of the checks by name.
    """
    config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    sources = {path: digest for path, digest in record["files"].items() if re.match(r"(include|src)/.*\.[ch]\Z", path)}
    context = {
        "record": record,
        "build": record["build"],
        "manifest": manifest,
        "checks": [_check(name, titles.get(name, name), found) for name, found in record["checks"].items()],
        "requirements": Table(REQUIREMENT_HEADER, tuple(tuple(row.values()) for row in record["requirements"])),
        "supervision": _supervision(),
        "on_the_car": Table(("id", "requirement on the other nodes"), ON_THE_CAR),
        "counts": {verdict.replace(" ", "_"): count for verdict, count in record["counts"].items()},
        "map": manifest["map"],
        "frictions": [f"{value:g}" for value in manifest["map"]["frictions"]],
        "accelerations": [f"{value:g}" for value in manifest["map"].get("longitudinal_accelerations", ())],
        "km_h": KM_H,
        "degree": DEGREE,
        "case": _ascii(manifest["inputs"].get("map", {}).get("case") or ""),
        "source": _ascii(manifest["inputs"]["configuration"]["source"]),
        "covered": _tolerant(_covered, manifest["map"]),
        "cells": _tolerant(_cells, manifest["map"]),
        "law": LAWS[config.controller.kind],
        "overshoot": f"{100.0 * (REFERENCE_OVERSHOOT - 1.0):.0f}",
        "config": config,
        "rates": _rates(config),
        "period_ms": 1e3 * config.controller.sampling_time_s,
        "files": sources,
    }
    return render("verify/manual.md.j2", context).decode("ascii")


def _check(name: str, title: str, found: Figures) -> dict[str, Any]:
    """Return the record of a check as the manual prints it: in ASCII, with its title, and its figures as tables."""
    formatted = (_tolerant(formatter, found["figures"]) for formatter in FIGURE_TABLES.get(name, ()))
    return {
        "name": name,
        "title": title,
        "verdict": found["verdict"],
        "shows": _ascii(found["shows"]),
        "figure": _ascii(found["figure"]) or "-",
        "findings": [_ascii(text) for text in found["findings"]],
        "limits": [_ascii(text) for text in found["limits"]],
        "tools": _ascii(", ".join(_tool(*each) for each in found["tools"].items())),
        "tables": [table for table in formatted if table and table.rows],
    }


def _supervision() -> dict[str, Table]:
    """Return the table of the supervision by cause, by state and by bit of `Diagnostics`."""
    causes = tuple(
        (cause.name, row.text, row.leads_to.name, status_text(row.leads_to), reaction_of(cause))
        for cause, row in CAUSES.items()
    )
    exceptions = tuple((state.name, cause.name, leads_to.name) for (state, cause), leads_to in EXCEPTIONS.items())
    states = tuple((state.name, row.text, status_text(state), row.reaction.value) for state, row in STATES.items())
    bits = tuple((each.name, ", ".join(cause.name for cause in causes_of_bit(each.name))) for each in DIAGNOSTIC_CAUSES)
    return {
        "causes": Table(("cause, the most urgent first", "meaning", "next state", "status", "reaction"), causes),
        "exceptions": Table(("state", "cause", "next state"), exceptions),
        "states": Table(("state", "when", "status", "reaction"), states),
        "bits": Table(("bit of Diagnostics", "causes with which it is set"), bits),
    }


def _tool(name: str, version: str) -> str:
    """Format a tool and its version. A bare number gets the tool's name; a program's own version line has it."""
    if version.lower().startswith(name.lower()):
        return version
    return f"{TOOL_NAMES.get(name, name)} {version}" if version[:1] in "0123456789?" else f"{version} as {name}"


def _ascii(text: str) -> str:
    """Return text on one line, for a Markdown table."""
    return one_line(text, limit=1000).encode("ascii", "replace").decode("ascii")


def _text(value: int | str) -> str:
    """Format a value. Raises ValueError for other types."""
    return _ascii(value) if isinstance(value, str) else f"{value:,d}"


def _covered(table: Figures) -> str:
    """Return the range of the map itself, which placed breakpoints do not show."""
    if "placement" in table:
        speeds = [speed / KM_H for speed in table["placement"]["own_speed_range_m_s"]]
        angles = [degrees(angle) for angle in table["placement"]["own_front_angle_range_rad"]]
    else:
        rows, axis = table["rule_by_speed_and_front_angle"], table["front_angle_rad"]
        speeds = [speed / KM_H for speed, row in zip(table["speed_m_s"], rows, strict=True) if Rule.SOLVED in row]
        angles = [degrees(angle) for k, angle in enumerate(axis) if any(row[k] == Rule.SOLVED for row in rows)]
    return f"{speeds[0]:.4g} to {speeds[-1]:.4g} km/h and {angles[0]:.4g} to {angles[-1]:.4g} deg at the front wheels"


def _cells(table: Figures) -> Table:
    """Return the number of cells of the map itself, then of those by rules."""
    own = "solved by the optimisation" if table["solved"] else "given by the table"
    rules = sorted(table["rules"].items(), key=lambda rule: rule[0] != Rule.SOLVED)
    rows = ((_text(found["cells"]), own if name == Rule.SOLVED else _text(found["text"])) for name, found in rules)
    return Table(("cells", "value"), tuple(rows))


def _rates(config: Config) -> dict[str, str]:
    """Return the rate limits in deg/s, or "off", of the limiter and of the control law, which uses the lower one."""
    behind = config.limiter.rear_rate_max_deg_s
    own = [rate for rate in (config.controller.rear_rate_max_deg_s, behind) if rate != OFF]
    return {"limiter": OFF if behind == OFF else f"{behind:g}", "law": f"{min(own):g}" if own else OFF}


def _tolerant(formatter: Callable[[Figures], Formatted], figures: Figures) -> Formatted | None:
    """Format figures; None if they are missing, as a check may end early."""
    try:
        return formatter(figures)
    except (LookupError, TypeError, ValueError, AttributeError):
        return None


def _pairs(heading: tuple[str, str], name: str) -> Callable[[Figures], Table]:
    """Return a formatter for a figure that is itself a table."""
    return lambda figures: Table(heading, tuple((_text(key), _text(value)) for key, value in figures[name].items()))


def _compilations(figures: Figures) -> Table:
    needed: dict[str, list[str]] = {}
    for core, names in figures["needed_of_others"].items():
        needed.setdefault(", ".join(f"`{name}`" for name in names) or "nothing", []).append(core)
    return Table(
        ("what", "result"),
        (
            ("compilations", f"{len(figures['compilations']):,}"),
            ("warnings, each an error", " ".join(f"`{flag}`" for flag in figures["warnings"] if flag != "-Werror")),
            ("mixtures of builds rejected", f"{figures['mixtures_refused']:,} of {figures['mixtures']:,}"),
            ("sources that must reject `-ffast-math`", _text(figures["sources_that_refuse_fast_math"])),
            *((f"library symbols needed for {'; '.join(cores)}", names) for names, cores in needed.items()),
        ),
    )


def _streams(figures: Figures) -> Table:
    cores = figures["mismatches"]
    return Table(
        ("calls", "rows", "words compared in each", *(f"mismatches on {core}" for core in cores)),
        tuple(
            (name, f"{rows:,}", _text(figures["words"][name]), *(f"{counts[name]:,}" for counts in cores.values()))
            for name, rows in figures["rows"].items()
        ),
    )


def _dynamics(figures: Figures) -> Table:
    heading = ("vehicle dynamics on", "points", "largest difference, as a share of its bound")
    rows = ((core, f"{each['points']:,}", f"{each['share_of_bound']:.0%}") for core, each in figures["dynamics"].items())
    return Table(heading, tuple(rows))


def _instructions(figures: Figures) -> Table:
    rows = []
    for name, found in figures["functions"].items():
        counted, whole = found["instructions"], found.get("instructions_with_limiter")
        most = f"{counted['max']:,}" + (f" (bound {found['instructions_bound']:,})" if "instructions_bound" in found else "")
        budget = figures["budgets"].get(KEY_OF_FUNCTION.get(name, ""), "-")
        rows.append((CALLED.get(name, name), most, f"{counted['mean']:,.0f}", _text(budget)))
        if whole:
            rows.append((f"{name}, with the limiter", f"{whole['max']:,}", f"{whole['mean']:,.0f}", "-"))
    heading = ("function", "instructions, worst", f"mean over {_text(figures['mean_over'])}", "budget of instructions")
    return Table(heading, tuple(rows))


def _stack(figures: Figures) -> Table:
    budgets = {"cycle": f"{figures['budgets']['task_stack_bytes_max']:,} B"}
    rows = (
        (name, f"{each['watermark']:,} B", f"{each['bound']:,} B", budgets.get(name, "-"))
        for name, each in figures["stack_bytes"].items()
    )
    return Table(("stack of", "measured maximum", "bound from the compiler's frames", "budget"), tuple(rows))


def _memory(figures: Figures) -> Table:
    budgets, structs = figures["budgets"], figures["struct_bytes"]
    of, keys = {"parameters": "a set of parameters, in flash as shipped"}, {"controller": "state_bytes_max"}
    rows = [(of.get(name, f"RAM of one {name}"), size, keys.get(name, "")) for name, size in structs.items()]
    rows.append(("flash of all objects, with tables and default parameters", figures["flash_bytes"], "flash_bytes_max"))
    formatted = ((text, f"{size:,} B", f"{budgets[key]:,} B" if key in budgets else "-") for text, size, key in rows)
    return Table(("memory", "size", "budget"), tuple(formatted))


def _ran(heading: tuple[str, str], texts: Mapping[str, str]) -> Callable[[Figures], Table]:
    """Return a formatter for the available figures."""
    return lambda figures: Table(
        heading, tuple((text, _text(figures[name])) for name, text in texts.items() if name in figures)
    )


def _fuzzed(figures: Figures) -> Table:
    keys = ("inputs", "seeds", "corpus", "edges")
    rows = [(name, *(f"{each[key]:,}" for key in keys)) for name, each in figures["fuzzing"].items()]
    return Table(("fuzz harness", "inputs", "seeds", "inputs kept for new coverage", "edges reached"), tuple(rows))


FIGURE_TABLES: Mapping[str, Sequence[Callable[[Figures], Table]]] = {
    "compiles": (_compilations,),
    "static-analysis": (_pairs(("found by", "findings"), "findings"), _pairs(("rule", "deviations"), "deviations")),
    "processor-in-the-loop": (_streams, _pairs(("random steps that ended in", "steps"), "statuses"), _dynamics),
    "budgets": (_instructions, _stack, _memory),
    "generator": (_pairs(("stream", "calls"), "calls"),),
    "sanitizers": (_ran(("what ran", "result"), SUITES), _fuzzed),
    "contracts": (_pairs(("contract of, or lemma", "result"), "harnesses"),),
    "memory": (_pairs(("alarms of the kind", "number"), "alarms"),),
}
"""Tables by name of the check."""

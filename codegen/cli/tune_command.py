"""The command that designs the feedback gains."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from codegen import console
from codegen.cli.base import cli, example, json_option
from codegen.cli.options import configuration_file, map_file, map_to_write
from codegen.errors import CodegenError, ConfigError, MapError, within
from codegen.text_table import text_table

if TYPE_CHECKING:
    from codegen.configuration import Config
    from codegen.design.margins import Weakest
    from codegen.design.tune import Design
    from codegen.judgement.model import Judgement
    from codegen.map_file.map import ReferenceMap
    from codegen.tuning.transient import Response
    from codegen.tuning.tune import FailSafeRate, Tuned

MADE_FROM = ("vehicle", "tyre", "road", "limits", "grid", "tightening")
"""Tables of the configuration from which a map is solved. Storing other ones in the map would misdescribe it."""

MARGINS = ("gain_margin_db", "phase_margin_deg", "sensitivity")
DEMANDS = ("gain_margin_db", "phase_margin_deg", "sensitivity_max")

DECIMALS_MAX = 6
"""Decimals beyond which a figure counts as equal to its limit."""
GAIN_COLUMNS = {
    "speed km/h": "{speed_km_h:g}",
    "Kp s": "{proportional_gain_s:.4g}",
    "Ki": "{integral_gain:.4g}",
    "gain margin dB": "{gain_margin_db:.2f}",
    "phase margin deg": "{phase_margin_deg:.2f}",
    "sensitivity": "{sensitivity:.2f}",
    "cars": "{cars}",
    "slow cars": "{slow}",
    "nearest to a demand, without slow cars": "{limiting}",
}
RESPONSE_COLUMNS = {
    "speed km/h": "{speed_km_h:g}",
    "lead ms": "{lead_ms:.0f}",
    "response gain s": "{response_gain_s:.3f}",
    "overshoot %": "{overshoot_percent:.1f}",
    "settling s": "{settling_s:.2f}",
    "t90 s": "{rise_s:.2f}",
    "of other cars, overshoot %": "{family_overshoot_percent:.1f}",
}
FAIL_SAFE_COLUMNS = {
    "rate deg/s": "{rate_deg_s:g}{mark}",
    "spins": "{spins}",
    "of other cars, spins": "{family}",
    "sideslip deg": "{sideslip_max_deg:.1f}",
}
"""Header of each column, and the format of its cells."""


def _table(columns: Mapping[str, str], rows: Iterable[Mapping[str, Any]]) -> str:
    return text_table(tuple(columns), [[text.format(**row) for text in columns.values()] for row in rows])


@cli.command(short_help="Design the gains of a map's controller.", epilog=example("codegen tune --map map.npz -o map.npz"))
@click.option("--map", "map_path", required=True, type=map_file, metavar="MAP.npz")
@click.option("--config", "config_path", type=configuration_file, help="ars.toml; by default the map's own configuration.")
@click.option(
    "-o",
    "--output",
    required=True,
    type=map_to_write,
    metavar="MAP.npz",
    help="The map to write; may be the input map.",
)
@json_option
def tune(map_path: Path, config_path: Path | None, output: Path, as_json: bool) -> None:
    """Design the gains over speed such that the whole family of [tuning] keeps its margins, and store them in the map.

    Deviations that codegen identify measured replace those of [tuning].

    For a solved map, step responses of the simulated car determine the lead of the front angle and the response gain, and
    simulated losses of all signals determine the rate of the fail-safe. For a map of the nonlinear tyre, the trim is raised
    until its slip bounds are kept in steady state.

    Finally the car is driven with the tuned controller and without it. The judgement is stored in the map, for
    codegen check, show, build, report and explore.
    """
    from codegen.design.margins import gains_of, weakest
    from codegen.emit.outputs import check_output
    from codegen.map_file import map as npz
    from codegen.map_file.archive import read_map_file
    from codegen.map_file.judged import KEY, with_judgement
    from codegen.map_file.map import choose_config
    from codegen.plausibility.build import schedule_warnings
    from codegen.plausibility.car import car_warnings
    from codegen.plausibility.map import map_warnings
    from codegen.tuning.tune import tune as tune_map

    check_output(output, ".npz", (config_path,))
    data = read_map_file(map_path)
    reference_map = npz.from_bytes(data, map_path)
    if reference_map.config is None and config_path is None:
        raise MapError(
            "it contains no configuration, and so no car to design for",
            where=map_path,
            remedy="name one with --config ars.toml",
        )
    chosen = choose_config(reference_map, config_path)
    if config_path is not None:
        _check_same_origin(reference_map, chosen.config, config_path)
    with within(config_path or map_path), console.progress("tuning") as progress:
        tuned = tune_map(reference_map, chosen.config, progress, config_path or map_path)
    config, made = tuned.config, tuned.design
    with console.progress("judging the car") as progress:
        judgement, unjudged = _judgement(reference_map, tuned, progress)
    facts_of_car = None if judgement is None else judgement.to_dict()
    # Tuning takes half a minute, during which another program may write the same map.
    replaces = data if output.exists() and output.samefile(map_path) else ...
    npz.save(with_judgement(reference_map.with_config(config), facts_of_car), output, replaces=replaces)
    least = weakest(config, gains_of(made.schedule))
    trim = _trim_facts(tuned, chosen.config.controller.tracking.trim_max_percent)
    warnings = [*car_warnings(config), *schedule_warnings(config), *map_warnings(reference_map, config)]
    warnings += [text for text in (_stability_note(tuned), _target_note(tuned.responses)) if text]
    warnings += unjudged if judgement is None else judgement.warnings
    if as_json:
        facts = {"map": str(output), "configuration": chosen.source, "notes": list(chosen.notes), "warnings": warnings}
        responses = {
            "responses": [{**dataclasses.asdict(one), "is_met": one.is_met} for one in tuned.responses],
            "response_ahead_s": config.controller.tracking.response_ahead_s,
            **({} if tuned.fail_safe is None else {"fail_safe": dataclasses.asdict(tuned.fail_safe)}),
        }
        console.print_json({**facts, **_to_dict(config, made, least), **responses, **trim, KEY: facts_of_car})
        return
    console.note(*chosen.notes)
    console.warn(*warnings)
    _print(output, config, made, least)
    if tuned.responses:
        _print_responses(tuned.responses, config.controller.tracking.response_ahead_s)
    if tuned.fail_safe is not None:
        _print_fail_safe(tuned.fail_safe)
    if trim:
        console.say(_trim_text(trim))
    if judgement is not None:
        console.say(*judgement.lines())


def _judgement(reference_map: ReferenceMap, tuned: Tuned, progress: console.Tell) -> tuple[Judgement | None, list[str]]:
    """Return the judgement of the tuned car; None and a warning for a map that cannot be judged, whose gains are kept."""
    from codegen.judgement.judge import judge_tuned

    try:
        return judge_tuned(reference_map, tuned, progress), []
    except CodegenError as error:
        return None, [f"the car is not judged: {error}"]


def _check_same_origin(reference_map: ReferenceMap, config: Config, config_path: Path) -> None:
    own, case = reference_map.config, reference_map.case
    if own is None:
        return
    differing = [f"[{table}]" for table in MADE_FROM if getattr(own, table) != getattr(config, table)]
    if case is not None and own.case(case) != config.case(case, f"{config_path}: [cases]"):
        differing.append(f"[cases.{case}]")
    if differing:
        raise ConfigError(
            f"{', '.join(differing)} differ from what the map was solved with",
            where=config_path,
            remedy="solve the map again with this file, then tune it",
        )


def _stability_note(made: Tuned) -> str:
    """Return a warning if computed and simulated stability of the tuned loop disagree; else, or without a simulation, ""."""
    from codegen.sweep.region import confirm_with, region
    from codegen.tuning.tune import tuned_parameters

    linear = region(made.config)
    if made.software is None or linear is None:
        return ""
    parameters = tuned_parameters(made.software, made.config)
    return confirm_with(linear, made.software, made.config, parameters).disagreement


def _target_note(responses: Sequence[Response]) -> str:
    """Return a warning about speeds at which the configured car misses a target of its step response; "" without one."""
    from codegen.tuning.transient import OVERSHOOT_MAX_PERCENT, OVERSHOOT_PERCENT, SETTLING_MAX_S, SETTLING_S

    missed = [one for one in responses if not one.is_on_target]
    if not missed:
        return ""
    figures = ", ".join(
        f"{one.speed_km_h:g} km/h: {_above(one.overshoot_percent, OVERSHOOT_PERCENT, 1)} % and "
        f"{_above(one.settling_s, SETTLING_S, 2)} s"
        for one in missed
    )
    beyond = [
        f"{one.speed_km_h:g}"
        for one in missed
        if one.overshoot_percent > OVERSHOOT_MAX_PERCENT or one.settling_s > SETTLING_MAX_S
    ]
    exceeded = f", and exceeded at {', '.join(beyond)} km/h" if beyond else ""
    return (
        f"the step responses miss their target of at most {OVERSHOOT_PERCENT:g} % overshoot and {SETTLING_S:g} s settling time "
        f"({figures}); up to {OVERSHOOT_MAX_PERCENT:g} % and {SETTLING_MAX_S:g} s are acceptable{exceeded}"
    )


def _above(value: float, limit: float, digits: int) -> str:
    """Return a number with so many decimals, and more where rounding would hide that it is above a limit."""
    while value > limit and float(f"{value:.{digits}f}") <= limit and digits < DECIMALS_MAX:
        digits += 1
    return f"{value:.{digits}f}"


def _trim_facts(made: Tuned, before: float) -> dict[str, Any]:
    """Return the facts about the trim; empty if it suffices as it was, before tuning, or is not used."""
    from codegen.units import KM_H

    excess, trim = made.excess, made.config.controller.tracking.trim_max_percent
    if excess is None or (trim == before and made.trim_is_enough):
        return {}
    return {
        "trim_max_percent": trim,
        "trim_max_percent_before": before,
        "trim_is_enough": made.trim_is_enough,
        "reference_model_excess_percent": excess.percent,
        "excess_at_km_h": round(excess.speed / KM_H, 1),
        "excess_at_front_angle_deg": round(math.degrees(excess.front_angle), 2),
        "excess_at_friction": excess.friction,
        **({"excess_at_longitudinal_acceleration_m_s2": excess.acceleration} if excess.acceleration else {}),
    }


def _trim_text(told: dict[str, Any]) -> str:
    from codegen.ecu_map.model_excess import COARSE

    speed, front_angle = told["excess_at_km_h"], told["excess_at_front_angle_deg"]
    place = f"{speed:.0f} km/h, {front_angle:.1f} deg, friction {told['excess_at_friction']:g}"
    if acceleration := told.get("excess_at_longitudinal_acceleration_m_s2"):
        place += f", longitudinal acceleration {acceleration:g} m/s^2"
    percent = told["reference_model_excess_percent"]
    excess = f"in steady state the reference model turns up to {percent:.1f} % more than this map allows ({place})"
    after, before = told["trim_max_percent"], told["trim_max_percent_before"]
    changed = f"controller.tracking.trim_max_percent: {after:g}" + ("" if after == before else f" instead of {before:g}")
    if not told["trim_is_enough"]:
        return f"{changed}, the largest, and not enough: {excess}; {COARSE}"
    return f"{changed}; {excess}, and would exceed a slip bound there"


def _rows(made: Design) -> list[dict[str, Any]]:
    columns = {key: value for key, value in made.schedule.model_dump().items() if value is not None}
    rows = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
    for row, counted, limiting, slow in zip(rows, made.counted, made.limiting, made.slow, strict=True):
        row["cars"] = counted
        row["limiting"] = dataclasses.asdict(limiting)
        row["slow"] = None if slow is None else dict(zip(MARGINS, slow, strict=True))
    return rows


def _slow_text(margins: Mapping[str, float] | None) -> str:
    if margins is None:
        return "-"
    gain, phase, peak = margins.values()
    return f"{gain:.2f} dB, {phase:.2f} deg, {peak:.2f}"


def _to_dict(config: Config, made: Design, least: Weakest) -> dict[str, Any]:
    from codegen.design.family import origin

    tuning = config.tuning
    return {
        "demands": {key: getattr(tuning, key) for key in DEMANDS},
        "demands_on_slow": {key: getattr(tuning, f"slow_{key}") for key in DEMANDS},
        "delay_samples": config.designed_delay_samples,
        "family": made.family_size,
        **({"family_from": told} if (told := origin(config)) else {}),
        "breakpoints": _rows(made),
        "configured_car": {**dataclasses.asdict(least), "enough": least.enough},
    }


def _print(output: Path, config: Config, made: Design, least: Weakest) -> None:
    from codegen.design.family import origin
    from codegen.units import KM_H

    tuning = config.tuning
    console.say(
        f"{output}: {made.family_size} cars, delay of {config.designed_delay_samples} samples; required: at least "
        f"{tuning.gain_margin_db:g} dB, {tuning.phase_margin_deg:g} deg, and a peak sensitivity of at most "
        f"{tuning.sensitivity_max:g}; slow cars, with twice the lag and a relaxation length, "
        f"{tuning.slow_gain_margin_db:g} dB, {tuning.slow_phase_margin_deg:g} deg and {tuning.slow_sensitivity_max:g}"
    )
    console.say(*(f"family: {told}" for told in (origin(config),) if told))
    if config.top_speed_km_h > config.grid.last_speed_km_h:
        console.say(
            "Up to the last speed of the grid, every car meets these requirements. At higher speeds they apply only to the "
            "cars counted in the table: the configured car, and those that are stable with their rear wheels held."
        )
    console.say(f"The design ends at {config.top_speed_km_h:g} km/h. At higher speeds the C holds the last gains.")
    rows = zip(_rows(made), made.limiting, strict=True)
    shown = ({**row, "limiting": limiting, "slow": _slow_text(row["slow"])} for row, limiting in rows)
    console.say(_table(GAIN_COLUMNS, shown))
    console.say(
        f"the configured car: at least {least.gain_margin_db:.1f} dB (at {least.gain_margin_speed / KM_H:.0f} km/h) "
        f"and {least.phase_margin_deg:.1f} deg (at {least.phase_margin_speed / KM_H:.0f} km/h)"
    )
    if 0 in made.counted:
        first = made.schedule.speed_km_h[made.counted.index(0)]
        console.note(f"from {first:g} km/h on, no gains suffice even for the configured car; the last gains are held")


def _print_responses(responses: Sequence[Response], ahead: float) -> None:
    from codegen.tuning.transient import OVERSHOOT_PERCENT, SETTLING_S

    console.say(
        f"step responses of the simulated car: target at most {OVERSHOOT_PERCENT:g} % and {SETTLING_S:g} s, then the shortest "
        "t90"
    )
    console.say(_table(RESPONSE_COLUMNS, ({**dataclasses.asdict(one), "lead_ms": 1e3 * one.lead_s} for one in responses)))
    console.say(f"controller.tracking.response_ahead_s: {ahead:g}: prediction horizon of the model's yaw rate")
    missed = [f"{one.speed_km_h:g}" for one in responses if not one.is_met]
    if missed:
        console.note(f"around {', '.join(missed)} km/h no lead and response gain keep both limits; the nearest ones are used")


def _print_fail_safe(found: FailSafeRate) -> None:
    first, *_ = found.outcomes
    others = max(one.family_runs for one in found.outcomes)
    console.say(
        f"loss of all signals: {first.runs} runs of the configured car at each rate, {others} of others at those with the "
        "fewest spins"
    )
    rows = (
        {
            **dataclasses.asdict(one),
            "mark": " *" if one.rate_deg_s == found.rate_deg_s else "",
            "family": "-" if one.family_spins is None else one.family_spins,
        }
        for one in sorted(found.outcomes, key=lambda outcome: outcome.rate_deg_s)
    )
    console.say(_table(FAIL_SAFE_COLUMNS, rows))
    before = first.rate_deg_s
    changed = "" if found.rate_deg_s == before else f" instead of {before:g}"
    console.say(f"controller.fail_safe.rate_deg_s: {found.rate_deg_s:g}{changed}")

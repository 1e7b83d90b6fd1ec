"""Tune the controller of a map, judge the car with it, and describe the result."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from codegen.configuration import Config
from codegen.design.family import origin
from codegen.design.gains import Design
from codegen.design.lead import OVERSHOOT_MAX_PERCENT, OVERSHOOT_PERCENT, SETTLING_MAX_S, SETTLING_S, Response
from codegen.design.margins import Weakest, gains_of, weakest
from codegen.design.tune import FailSafeRate, Tuned, tuned_parameters
from codegen.design.tune import tune as tune_map
from codegen.ecu_map.model_excess import COARSE
from codegen.errors import CodegenError, ConfigError, MapError, within
from codegen.judgement.build_warnings import schedule_warnings
from codegen.judgement.car_warnings import car_warnings
from codegen.judgement.judge import judge_tuned
from codegen.judgement.map_warnings import map_warnings
from codegen.judgement.model import Judgement
from codegen.library.configurations import ConfigLike, given_config, name_of
from codegen.library.maps import Map, MapLike, map_of, place_of
from codegen.library.result import Progress, Work, public
from codegen.map_file import map as npz
from codegen.map_file.judged import KEY, with_judgement
from codegen.map_file.map import Chosen, ReferenceMap, choose_config
from codegen.sweep.region import confirm_with, region
from codegen.text import text_table
from codegen.units import KM_H

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


class TunedMap(Map):
    """A map with a tuned controller and the judgement of the car, and how both came about.

    Attributes:
        gains: the schedule over speed: key of `[controller.tracking.schedule]` -> list.
        responses: step response at each speed that was driven.
        source: where the configuration came from: a file name, "map" or "given".
    """

    def __init__(self, before: Map, tuned: Tuned, chosen: Chosen, judgement: Judgement | None, unjudged: Sequence[str]) -> None:
        config, reference_map = tuned.config, before.reference_map
        self._facts = None if judgement is None else judgement.to_dict()
        super().__init__(with_judgement(reference_map.with_config(config), self._facts))
        self.source, self._before, self._tuned = chosen.source, before, tuned
        self._least = weakest(config, gains_of(tuned.design.schedule))
        self._trim = _trim_facts(tuned, chosen.config.controller.tracking.trim_max_percent)
        self.gains = {key: value for key, value in tuned.design.schedule.model_dump().items() if value is not None}
        self.responses = tuned.responses
        self.notes = (*chosen.notes, *_notes(tuned.design, tuned.responses))
        warnings = [*car_warnings(config), *schedule_warnings(config), *map_warnings(reference_map, config)]
        warnings += [text for text in (_stability_note(tuned), _target_note(tuned.responses)) if text]
        self.warnings = (*warnings, *(unjudged if judgement is None else judgement.warnings))

    def _write(self, path: Path) -> None:
        # Tuning takes half a minute, during which another program may write the same map.
        is_input = self._before.path is not None and path.exists() and path.samefile(self._before.path)
        npz.save(self.reference_map, path, replaces=self._before.data if is_input else ...)

    def lines(self) -> list[str]:
        """Return the design, the step responses, the loss of signals and the judgement."""
        tuned, judgement = self._tuned, self.judgement
        lines = [*_design_lines(str(self.path or "map"), tuned.config, tuned.design, self._least)]
        lines += (
            [*_response_lines(tuned.responses, tuned.config.controller.tracking.response_ahead_s)] if tuned.responses else []
        )
        lines += [] if tuned.fail_safe is None else _fail_safe_lines(tuned.fail_safe)
        lines += [_trim_text(self._trim)] if self._trim else []
        return lines if judgement is None else [*lines, *judgement.lines()]

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts, as `codegen tune --json` prints them."""
        tuned, tuning = self._tuned, self._tuned.config.tuning
        found = tuned.fail_safe
        return {
            "map": None if self.path is None else str(self.path),
            "configuration": self.source,
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            "demands": {key: getattr(tuning, key) for key in DEMANDS},
            "demands_on_slow": {key: getattr(tuning, f"slow_{key}") for key in DEMANDS},
            "delay_samples": tuned.config.designed_delay_samples,
            "family": tuned.design.family_size,
            **({"family_from": told} if (told := origin(tuned.config)) else {}),
            "breakpoints": _rows(tuned.design),
            "configured_car": {**dataclasses.asdict(self._least), "enough": self._least.enough},
            "responses": [{**dataclasses.asdict(one), "is_met": one.is_met} for one in tuned.responses],
            "response_ahead_s": tuned.config.controller.tracking.response_ahead_s,
            **({} if found is None else {"fail_safe": dataclasses.asdict(found)}),
            **self._trim,
            KEY: self._facts,
        }


@public
def tune(map: MapLike, config: ConfigLike | None = None, *, progress: Progress | None = None) -> TunedMap:
    """Design the gains of a map's controller, judge the car with it, and return the map with both.

    Args:
        map: a map with a configuration, or its path.
        config: another configuration of the same car; by default the map's own.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: the map was solved with other values, or no gains meet the demands of `[tuning]`.
    """
    before, given, work = map_of(map), given_config(config), Work(progress, "tuning", "judging the car")
    reference_map, place = before.reference_map, place_of(before)
    if reference_map.config is None and given is None:
        remedy = "name one with `config=`"
        raise MapError("it contains no configuration, and so no car to design for", where=place, remedy=remedy)
    chosen = choose_config(reference_map, given)
    where = place if given is None else name_of(given)
    if given is not None:
        _check_same_origin(reference_map, chosen.config, where)
    with within(where), work.stage("tuning") as tell:
        tuned = tune_map(reference_map, chosen.config, tell, where)
    with work.stage("judging the car") as tell:
        try:
            judgement, unjudged = judge_tuned(reference_map, tuned, tell), []
        except CodegenError as error:  # the gains of a map that cannot be judged are kept
            judgement, unjudged = None, [f"the car is not judged: {error}"]
    return TunedMap(before, tuned, chosen, judgement, unjudged)


def _check_same_origin(reference_map: ReferenceMap, config: Config, where: str) -> None:
    own, case = reference_map.config, reference_map.case
    if own is None:
        return
    differing = [f"[{table}]" for table in MADE_FROM if getattr(own, table) != getattr(config, table)]
    if case is not None and own.case(case) != config.case(case, f"{where}: [cases]"):
        differing.append(f"[cases.{case}]")
    if differing:
        raise ConfigError(
            f"{', '.join(differing)} differ from what the map was solved with",
            where=where,
            remedy="solve the map again with this file, then tune it",
        )


def _stability_note(made: Tuned) -> str:
    """Return a warning if computed and simulated stability of the tuned loop disagree; else, or without a simulation, ""."""
    linear = region(made.config)
    if made.software is None or linear is None:
        return ""
    parameters = tuned_parameters(made.software, made.config)
    return confirm_with(linear, made.software, made.config, parameters).disagreement


def _target_note(responses: Sequence[Response]) -> str:
    """Return a warning about speeds at which the configured car misses a target of its step response; "" without one."""
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


def _notes(made: Design, responses: Sequence[Response]) -> Iterator[str]:
    """Yield where the design ends, and where the step responses exceed their limits."""
    if 0 in made.counted:
        first = made.schedule.speed_km_h[made.counted.index(0)]
        yield f"from {first:g} km/h on, no gains suffice even for the configured car; the last gains are held"
    if missed := [f"{one.speed_km_h:g}" for one in responses if not one.is_met]:
        yield f"around {', '.join(missed)} km/h no lead and response gain keep both limits; the nearest ones are used"


def _design_lines(name: str, config: Config, made: Design, least: Weakest) -> Iterator[str]:
    tuning = config.tuning
    yield (
        f"{name}: {made.family_size} cars, delay of {config.designed_delay_samples} samples; required: at least "
        f"{tuning.gain_margin_db:g} dB, {tuning.phase_margin_deg:g} deg, and a peak sensitivity of at most "
        f"{tuning.sensitivity_max:g}; slow cars, with twice the lag and a relaxation length, "
        f"{tuning.slow_gain_margin_db:g} dB, {tuning.slow_phase_margin_deg:g} deg and {tuning.slow_sensitivity_max:g}"
    )
    yield from (f"family: {told}" for told in (origin(config),) if told)
    if config.top_speed_km_h > config.grid.last_speed_km_h:
        yield (
            "Up to the last speed of the grid, every car meets these requirements. At higher speeds they apply only to the "
            "cars counted in the table: the configured car, and those that are stable with their rear wheels held."
        )
    yield f"The design ends at {config.top_speed_km_h:g} km/h. At higher speeds the C holds the last gains."
    rows = zip(_rows(made), made.limiting, strict=True)
    shown = ({**row, "limiting": limiting, "slow": _slow_text(row["slow"])} for row, limiting in rows)
    yield _table(GAIN_COLUMNS, shown)
    yield (
        f"the configured car: at least {least.gain_margin_db:.1f} dB (at {least.gain_margin_speed / KM_H:.0f} km/h) "
        f"and {least.phase_margin_deg:.1f} deg (at {least.phase_margin_speed / KM_H:.0f} km/h)"
    )


def _response_lines(responses: Sequence[Response], ahead: float) -> Iterator[str]:
    yield (
        f"step responses of the simulated car: target at most {OVERSHOOT_PERCENT:g} % and {SETTLING_S:g} s, then the shortest "
        "t90"
    )
    yield _table(RESPONSE_COLUMNS, ({**dataclasses.asdict(one), "lead_ms": 1e3 * one.lead_s} for one in responses))
    yield f"controller.tracking.response_ahead_s: {ahead:g}: prediction horizon of the model's yaw rate"


def _fail_safe_lines(found: FailSafeRate) -> Iterator[str]:
    first, *_ = found.outcomes
    others = max(one.family_runs for one in found.outcomes)
    yield (
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
    yield _table(FAIL_SAFE_COLUMNS, rows)
    before = first.rate_deg_s
    changed = "" if found.rate_deg_s == before else f" instead of {before:g}"
    yield f"controller.fail_safe.rate_deg_s: {found.rate_deg_s:g}{changed}"

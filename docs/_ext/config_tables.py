"""The tables of `ars.toml` as Markdown: every key with type, range, unit, default and meaning, from the models."""

from __future__ import annotations

import json
import re
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Le
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from codegen.configuration import Config, preset_text
from codegen.configuration.section import Breakpoints, Range, RangeOrZero

MEANINGS = {
    "schema_version": "version of the format of this file",
    "vehicle.mass_kg": "m, with the load of normal operation",
    "vehicle.yaw_inertia_kg_m2": "Iz, about the vertical axis through the centre of gravity",
    "vehicle.cg_to_front_axle_m": "lf",
    "vehicle.cg_to_rear_axle_m": "lr",
    "road.gravity_m_s2": "g",
    "tyre.shape_factor_c": "C",
    "tyre.curvature_factor_e": "E",
    "tyre.peak_factor_p1": "p1: peak friction at the static load, as a share of the friction of the road",
    "tyre.peak_load_sensitivity_p2": "p2: change of the peak friction with the load",
    "tyre.stiffness_factor_b_per_rad": "B, instead of the cornering stiffness",
    "limits.sideslip_max_deg": "bound on |β|",
    "limits.lateral_acceleration_max_g": "bound on |ay|",
    "limits.slip_departure_percent": "largest departure of the tyre curve from its tangent at zero; bounds the slip angles",
    "cases.rear_steering": "whether the rear wheels steer",
    "cases.sideslip_weight_per_s2": "λ of the objective",
    "cases.passive_safe": "exclude turns that the car cannot drive without rear steering",
    "cases.tyre_model": "model of the steady turn: linear single-track car, or four loaded wheels with the whole Magic Formula",
    "grid.speed_min_km_h": "first breakpoint",
    "grid.speed_max_km_h": "last breakpoint",
    "grid.speed_points": "number of breakpoints",
    "grid.speed_breakpoints_km_h": "list of breakpoints, instead of the three keys above",
    "grid.front_angle_max_deg": "last breakpoint",
    "grid.front_angle_points": "number of breakpoints",
    "grid.front_angle_breakpoints_deg": "list of breakpoints, instead of the three keys above",
    "rear_actuator.angle_max_deg": "largest angle of the actuator",
    "rear_actuator.rate_max_deg_s": "largest rate of the actuator",
    "controller.kind": "control law, see [Controllers](controllers.md)",
    "controller.sampling_time_s": "period of the task and of all three messages",
    "controller.proportional_gain_s": "Kp of kind `pi`: rad of rear angle for each rad/s of yaw-rate error",
    "controller.integral_gain": "Ki of kind `pi`: rad of rear angle for each rad of integrated error",
    "controller.inputs.speed_max_km_h": "largest valid speed in either direction",
    "controller.inputs.front_angle_max_deg": "largest valid angle to either side",
    "controller.inputs.yaw_rate_max_deg_s": "largest valid yaw rate to either side",
    "controller.inputs.rear_angle_max_deg": "largest valid angle to either side",
    "controller.inputs.friction_max": "largest valid friction estimate",
    "controller.inputs.lateral_acceleration_max_m_s2": "limit of the road on speed times yaw rate",
    "controller.inputs.acceleration_max_m_s2": "largest valid rate of change of the speed",
    "controller.inputs.front_angle_rate_max_deg_s": "largest valid rate of change of the front angle",
    "controller.inputs.yaw_acceleration_max_deg_s2": "largest valid rate of change of the yaw rate",
    "controller.fail_safe.rate_deg_s": "rate of the ramp to zero",
    "controller.tracking.lead_s": "look-ahead of the front angle that enters the map, unless the schedule has a lead",
    "controller.tracking.lead_max_deg": "bound of this look-ahead",
    "controller.tracking.response_ahead_s": "look-ahead of the model's yaw rate for the response gain",
    "controller.tracking.trim_time_s": "time constant of this correction",
    "controller.tracking.schedule.speed_km_h": "breakpoints of the gains, at most 32",
    "controller.tracking.schedule.proportional_gain_s": "Kp at each breakpoint",
    "controller.tracking.schedule.integral_gain": "Ki at each breakpoint",
    "controller.tracking.schedule.lead_s": "lead of the front angle at each breakpoint",
    "controller.tracking.schedule.response_gain_s": "rad of rear angle for each rad/s that the model lacks, at each breakpoint",
    "controller.tracking.schedule.gain_margin_db": "smallest gain margin of the family, from `codegen tune`; for information",
    "controller.tracking.schedule.phase_margin_deg": "smallest phase margin, likewise",
    "controller.tracking.schedule.sensitivity": "largest peak of the sensitivity, likewise",
    "tuning.speed_km_h": "speeds for which the gains are designed",
    "tuning.actuator_lag_s": "lags of the rear actuator",
    "tuning.mass_percent": "deviations of mass and yaw inertia",
    "tuning.relaxation_length_m": "relaxation lengths of all tyres",
    "tuning.phase_margin_deg": "minimum for every member",
    "tuning.sensitivity_max": "largest peak of the sensitivity of any member",
    "controller.disable_speed_km_h": "control ends below this speed",
    "sensors.speed": "noise: standard deviation; resolution: step between values, 0 for none; delay: samples of the controller",
    "sensors.front_angle": "the same, at the road wheels",
    "sensors.yaw_rate": "the same, of the gyroscope",
    "sensors.rear_angle": "the same, of the actuator",
    "sensors.lateral_acceleration": "the same, of the accelerometer",
    "controller.enable_speed_km_h": "control starts at this speed; reverse is always standby",
    "controller.tracking.grip_recovery_m_s3": "rate at which the assumed grip recovers in a turn",
    "controller.tracking.grip_recovery_idle_m_s3": "rate while less than half of that grip is demanded",
    "controller.rear_rate_max_deg_s": 'limit on the rate of the command, or `"off"` as in the paper',
    "limits.rear_angle_max_deg": "bound on |δr| in the map; the limit of the actuator is in `[rear_actuator]`",
    "limiter.opposite_phase_speed_km_h": 'breakpoints of the next key, or `"from-car"` to derive them from the car',
    "limiter.opposite_phase_lateral_acceleration_m_s2": "for `from-car`",
    "plant.sampling_time_s": "time step of the plant; the controller's sampling time must be a whole multiple",
    "can.bitrate_kbit_s": "bit rate for the setup of a real bus; `vcan` has none",
    "can.message.name": "name in the DBC",
    "can.message.byte_order": "byte order of the signals",
    "can.message.crc_name": "name in the DBC of the CRC in byte 0",
    "can.message.counter_name": "name in the DBC of the counter in the low nibble of byte 1",
    "can.message.data_id": "data id of the E2E protection, by default the `id` of the message",
    "can.message.cycle_time_ms": "must equal `controller.sampling_time_s`",
    "can.rear_steer_command.status": "`ars_status_t`",
    "signal.name": "name in the DBC",
    "signal.start_bit": "start bit as in a DBC",
    "signal.length": "number of bits",
    "signal.factor": "value = factor * code + offset, in the SI unit",
    "signal.offset": "offset in the SI unit",
    "signal.signed": "whether the code is signed. The lowest signed or the highest unsigned code means “not available”",
    "budgets.lookup_instructions_max": "instructions of `ars_map_yaw_rate_on_road`",
    "budgets.reference_instructions_max": "instructions of `ars_map_reference`: a lookup with the rear angle",
    "budgets.step_instructions_max": "instructions of `ars_controller_step`, without the limiter",
    "budgets.limiter_instructions_max": "instructions of `ars_limiter_step`",
    "budgets.task_instructions_max": "instructions of one period: two frames received, the step, one frame sent",
    "budgets.task_stack_bytes_max": "largest stack of one period",
    "budgets.state_bytes_max": "memory of one controller",
    "budgets.flash_bytes_max": "code and constants of all objects together",
}
"""Meanings of keys without a suitable comment in the presets. `message` and `signal` cover every message and signal."""

SHARED = (
    (re.compile(r"^tyre\.(front|rear)\."), "tyre."),
    (re.compile(r"^cases\.[^.]+\."), "cases."),
    (re.compile(r"^can\.(vehicle_motion|vehicle_conditions|rear_steer_command)\."), "can.message."),
)
TABLE = re.compile(r"^\[+([\w.-]+)\]+\s*(?:#.*)?$")
KEY = re.compile(r"""^(?P<key>\w+)\s*=\s*(?:"[^"]*"|\{[^}]*\}|\[[^\]]*\]|[^#"]*?)\s*(?:\#\s*(?P<comment>.*))?$""")


def _shared(path: str) -> str:
    for pattern, name in SHARED:
        path = pattern.sub(name, path)
    return path


def comments() -> dict[str, str]:
    """What the presets say of each key: full path (`tyre.mass_kg`) -> comment. The paper's preset goes before the other."""
    found: dict[str, str] = {}
    for preset in ("paper", "recommended"):
        table = ""
        for line in preset_text(preset).splitlines():
            if header := TABLE.match(line):
                table = f"{header[1]}."
            elif (key := KEY.match(line)) and key["comment"]:
                path = f"{table}{key['key']}"
                found.setdefault(path, key["comment"].strip())
                found.setdefault(_shared(path), key["comment"].strip())
    return found


def meaning(path: str, said: dict[str, str]) -> str:
    """A few words of the key at `path`; raises LookupError where there are none, so that no key is left without."""
    for name in (path, _shared(path)):
        if name in MEANINGS:
            return MEANINGS[name]
        if name in said:
            return said[name]
    raise LookupError(f"ars.toml: nothing is said of {path}; add it to MEANINGS in {__name__}.py")


def _number(value: float) -> str:
    return f"{value:.10g}"


def _between(metadata: tuple[Any, ...]) -> str:
    """The range that annotations give, with its unit; empty where there is none."""
    for one in metadata:
        if isinstance(one, Range):
            unit = f" {one.unit.split(' (')[0].split(' for ')[0]}" if one.unit and not one.unit.startswith("(") else ""
            zero = ", or 0" if isinstance(one, RangeOrZero) else ""
            return f"{_number(one.low)} to {_number(one.high)}{unit}{zero}"
        if isinstance(one, Breakpoints):
            return f"increasing, {_number(one.low)} to {_number(one.high)} {one.unit}"
        if isinstance(one, FieldInfo) and one.metadata:
            return _between(tuple(one.metadata))
    low, high = (next((getattr(one, side) for one in metadata if hasattr(one, side)), None) for side in ("ge", "le"))
    assert all(isinstance(one, Ge | Le) for one in metadata if hasattr(one, "ge") or hasattr(one, "le"))
    return "" if low is None or high is None else f"{_number(low)} to {_number(high)}"


def described(annotation: Any, metadata: tuple[Any, ...] = ()) -> str:
    """A type with its range, in words. Raises TypeError for one that is not known here."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return described(arguments[0], (*arguments[1:], *metadata))
    if origin in (Union, types.UnionType):
        parts = [described(one, metadata) for one in arguments if one is not type(None)]
        return ", or ".join(dict.fromkeys(parts))
    if origin is Literal:
        return " or ".join(f"`{json.dumps(one)}`" for one in arguments)
    within = _between(metadata)
    if origin is list:
        inner = described(arguments[0])
        return f"list of numbers, {within}" if within else f"list, each a {inner}"
    names = {float: "number", int: "whole number", bool: "`true` or `false`", str: "text, a name of the DBC"}
    if annotation not in names:
        raise TypeError(f"no words for {annotation!r}")
    return f"{names[annotation]}, {within}" if within else names[annotation]


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "*needed*"
    if value is None:
        return "–"
    if isinstance(value, BaseModel):
        return ", ".join(f"`{key} = {json.dumps(one)}`" for key, one in value.model_dump().items())
    if isinstance(value, float):
        return f"`{_number(value)}`"
    return f"`{json.dumps(value)}`"


def _section_of(annotation: Any) -> type[BaseModel] | None:
    """The model that an annotation stands for, also as `Model | None`."""
    candidates = [annotation, *get_args(annotation)]
    return next((one for one in candidates if isinstance(one, type) and issubclass(one, BaseModel)), None)


def _is_inline(model: type[BaseModel]) -> bool:
    """Whether a model is written as an inline table: a signal or a sensor."""
    return any(base.__name__ in ("Signal", "Sensor") for base in model.__mro__)


def _rows(model: type[BaseModel], path: str, said: dict[str, str]) -> Iterator[tuple[str, FieldInfo, str]]:
    for key, field in model.model_fields.items():
        section = _section_of(field.annotation)
        if section is None or _is_inline(section):
            yield key, field, meaning(f"{path}{key}", said)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("[cases.", "\\[cases.")


def _table(rows: list[tuple[str, str, str, str]]) -> list[str]:
    lines = ["| key | type and range | default | meaning |", "|---|---|---|---|"]
    return [*lines, *(f"| {' | '.join(_cell(one) for one in row)} |" for row in rows), ""]


def _plain_docstring(model: type[BaseModel]) -> str:
    text = " ".join((model.__doc__ or "").split())
    return re.sub(r"(?<!`)\b(\w+_\w+)\b(?!`)", r"`\1`", text)


def sections(model: type[BaseModel] = Config, path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every table with its name in the file, in the file's order; `cases.NAME` and the tyre of an axle once."""
    yield path.rstrip("."), model
    for key, field in model.model_fields.items():
        name = "cases.NAME" if path + key == "cases" else path + key
        section = _section_of(field.annotation) or (_section_of(get_args(field.annotation)[1]) if key == "cases" else None)
        if section is None or _is_inline(section) or name == "tyre.rear":
            continue
        if len(section.model_fields) and section.__name__ == "Tyres":
            yield from sections(section.model_fields["front"].annotation, "tyre.front.")  # type: ignore[arg-type]
        else:
            yield from sections(section, f"{name}.")


def inline_tables() -> Iterator[tuple[str, type[BaseModel]]]:
    """The inline tables: a name for each kind, and its model."""
    from codegen.configuration.can import RealSignal, Signal

    yield "A signal that is a number of its own", Signal
    yield "A signal that is a physical value", RealSignal


def markdown() -> str:
    """The whole reference, a heading for each table."""
    said, lines = comments(), []
    for name, model in sections():
        rows = [
            (f"`{key}`", _typed(field), _default(field), text)
            for key, field, text in _rows(model, f"{name}." if name else "", said)
        ]
        if not rows:
            continue
        title = {"": "Top level", "tyre.front": "`[tyre.front]` and `[tyre.rear]`"}.get(name, f"`[{name}]`")
        lines += [f"## {title}", "", *([] if not name else [_plain_docstring(model), ""]), *_table(rows)]
    for title, model in inline_tables():
        rows = [
            (f"`{key}`", described(field.annotation, tuple(field.metadata)), _default(field), MEANINGS[f"signal.{key}"])
            for key, field in model.model_fields.items()
        ]
        lines += [f"## {title}", "", _plain_docstring(model), "", *_table(rows)]
    return "\n".join(lines)


def _typed(field: FieldInfo) -> str:
    section = _section_of(field.annotation)
    if section is None:
        return described(field.annotation, tuple(field.metadata))
    keys = (f"`{key}`: {described(one.annotation, tuple(one.metadata))}" for key, one in section.model_fields.items())
    return "inline table" if section.__name__.endswith("Signal") else f"inline table; {'; '.join(keys)}"

"""Read and validate `ars.toml`, including the rules between its tables."""

from __future__ import annotations

import functools
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from codegen.configuration.budgets import Budgets
from codegen.configuration.can import Can, RealSignal
from codegen.configuration.car import (
    REFERENCE_CASES,
    Case,
    Grid,
    Limits,
    Longitudinal,
    Plant,
    RearActuator,
    Road,
    Sensor,
    Sensors,
    Steering,
    Tyre,
    Tyres,
    Vehicle,
)
from codegen.configuration.controller import (
    RESPONSE_AHEAD_FACTORS,
    RESPONSE_AHEAD_MAX_S,
    Controller,
    FailSafe,
    Inputs,
    Kind,
    Limiter,
    Schedule,
    Tracking,
    Tuning,
)
from codegen.configuration.identified import Identified
from codegen.configuration.section import Meaning, Section, check_name, first_fault
from codegen.configuration.tightening import Tightening
from codegen.configuration.xcp import Xcp
from codegen.errors import CodegenError, ConfigError, suggestion
from codegen.files import read_text
from codegen.units import KM_H

__all__ = [
    "REFERENCE_CASES",
    "Budgets",
    "Can",
    "Case",
    "Config",
    "Controller",
    "FailSafe",
    "Grid",
    "Identified",
    "Inputs",
    "Kind",
    "Limiter",
    "Limits",
    "Longitudinal",
    "Plant",
    "RearActuator",
    "Road",
    "Schedule",
    "Sensor",
    "Sensors",
    "Steering",
    "Tightening",
    "Tracking",
    "Tuning",
    "Tyre",
    "Tyres",
    "Vehicle",
    "Xcp",
    "check_name",
    "load",
    "parse",
    "preset",
    "preset_text",
]


Preset = Literal["paper", "recommended"]

CONFIG_BYTES_MAX = 2**20
"""Size limit of an ars.toml, hundreds of times the size of one with listed breakpoints."""

MAX_LINE = 2**14
"""Largest number of characters on a line of TOML."""

RELAXATION_STEP_MAX = 2.5
"""Largest distance that a wheel rolls in a step of the plant, over its relaxation length: Runge-Kutta is stable up to 2.79."""

IDEAL_PLANT: Mapping[str, Any] = {
    f"plant.{name}": Plant.model_fields[name].default
    for name in (
        "relaxation_length_m",
        "rear_relaxation_factor",
        "slippery_stiffness_share",
        "roll_deg_per_g",
        "actuator_motor_share",
        "backlash_deg",
        "command_delay_samples",
    )
} | {
    "sensors.speed.bias_km_h": 0.0,
    "sensors.front_angle.bias_deg": 0.0,
    "sensors.yaw_rate.bias_deg_s": 0.0,
    "sensors.rear_angle.bias_deg": 0.0,
    "sensors.lateral_acceleration.bias_m_s2": 0.0,
}
"""Keys of the ideal car, with their values: no relaxation, no roll, an actuator of first order without play, and no delay; and
no bias of the sensors."""

STEPS_MIN = 50
"""Least number of steps of a CAN signal over its required range; fewer mean a wrong factor."""

MISSING_REMEDY = "; `codegen init DIR` writes a complete file"

STORED_XCP_IDS = ("receive_id", "transmit_id")
"""Keys of `[xcp]` that maps and builds have as `xcp_receive_id` and `xcp_transmit_id` under `can`."""


def _whole_number(value: object) -> object:
    # In Python, True and 1.0 equal 1.
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"a whole number is needed, not {value!r}")
    return value


class Config(Section):
    """The whole of `ars.toml`.

    Data of a particular car have no default: a car with the mass of another is a fault that no figure shows.
    """

    schema_version: Annotated[Literal[1], BeforeValidator(_whole_number), Meaning("version of the format of this file")] = 1
    vehicle: Vehicle
    road: Road = Road()
    tyre: Tyres
    limits: Limits = Limits()
    grid: Grid = Grid()
    cases: dict[Annotated[str, AfterValidator(check_name)], Case] = Field(
        default_factory=lambda: {
            "fws": Case(rear_steering=False, sideslip_weight_per_s2=100.0, tyre_model="magic-formula"),
            "4ws-1": Case(sideslip_weight_per_s2=100.0, tyre_model="magic-formula"),
            "4ws-2": Case(sideslip_weight_per_s2=3000.0, tyre_model="magic-formula"),
        }
    )
    # Omitted where unset, so that maps and builds without a stack over acceleration do not change.
    longitudinal: Longitudinal = Field(default=Longitudinal(), exclude_if=lambda own: own == Longitudinal())
    steering: Steering
    rear_actuator: RearActuator
    controller: Controller = Controller()
    tuning: Tuning = Tuning()
    limiter: Limiter = Limiter()
    plant: Plant = Plant()
    sensors: Sensors = Sensors()
    can: Can = Can()
    # Omitted where unset, like the budgets below; see `_stored`.
    xcp: Xcp = Field(default=Xcp(), exclude_if=lambda xcp: xcp == Xcp())
    # Omitted where unset, so that maps and builds without budgets of their own do not change.
    budgets: Budgets = Field(default=Budgets(), exclude_if=lambda budgets: budgets == Budgets())
    # Omitted where unset, like the budgets.
    identified: Identified = Field(default=Identified(), exclude_if=lambda identified: identified == Identified())
    tightening: Tightening = Field(default=Tightening(), exclude_if=lambda own: own == Tightening())

    @model_validator(mode="before")
    @classmethod
    def _accept_stored_ids(cls, data: Any) -> Any:
        """Accept the identifiers of XCP under `can`, where maps, builds and older files have them."""
        if not isinstance(data, Mapping) or not isinstance(data.get("can"), Mapping):
            return data
        stored = {key: data["can"][f"xcp_{key}"] for key in STORED_XCP_IDS if f"xcp_{key}" in data["can"]}
        xcp = data.get("xcp", {})
        if not stored or not isinstance(xcp, Mapping):
            return data
        for key, value in stored.items():
            if xcp.get(key, value) != value:
                raise ValueError(f"can.xcp_{key} and xcp.{key} differ; remove can.xcp_{key}")
        can = {key: value for key, value in data["can"].items() if key.removeprefix("xcp_") not in stored}
        return {**data, "can": can, "xcp": {**stored, **xcp}}

    @model_serializer(mode="wrap")
    def _stored(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write the identifiers of XCP under `can` too, so that maps and builds without an `[xcp]` do not change."""
        written: dict[str, Any] = write(self)
        if "can" in written:
            ids = {f"xcp_{key}": getattr(self.xcp, key) for key in STORED_XCP_IDS}
            bitrate = written["can"].pop("bitrate_kbit_s")
            written["can"] = {"bitrate_kbit_s": bitrate, **ids, **written["can"]}
        return written

    @model_validator(mode="after")
    def _xcp_distinct(self) -> Self:
        taken = {message.id: message.name for message in self.can.messages().values()}
        for key in STORED_XCP_IDS:
            identifier = getattr(self.xcp, key)
            if identifier in taken and self.xcp.extended_ids == self.can.extended_ids:
                raise ValueError(f"xcp.{key} is the id of {taken[identifier]}, 0x{identifier:X}; change one")
        return self

    @model_validator(mode="after")
    def _data_phase_is_faster(self) -> Self:
        for table, rate in (("can", self.can.bitrate_kbit_s), ("xcp", self.xcp.bitrate_kbit_s or self.can.bitrate_kbit_s)):
            data_rate = getattr(self, table).data_bitrate_kbit_s
            if data_rate is not None and data_rate < rate:
                raise ValueError(
                    f"{table}.data_bitrate_kbit_s is {data_rate:g}, below the bit rate of {rate:g}; "
                    "raise it: the data phase of CAN FD is at least as fast"
                )
        return self

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        samples = self.controller.sampling_time_s / self.plant.sampling_time_s
        if abs(samples - round(samples)) > 1e-9 * samples or round(samples) < 1:
            raise ValueError("controller.sampling_time_s must be a whole multiple of plant.sampling_time_s")
        relaxation = self.plant.relaxation_length_m * min(1.0, self.plant.rear_relaxation_factor)
        if (
            relaxation
            and self.plant.sampling_time_s * self.controller.inputs.speed_max_km_h * KM_H > RELAXATION_STEP_MAX * relaxation
        ):
            raise ValueError(
                "plant.sampling_time_s is too long for plant.relaxation_length_m; shorten it, or lengthen the relaxation"
            )
        if self.plant.roll_deg_per_g and self.plant.load_transfer != "moment-balance":
            raise ValueError(
                'plant.load_transfer must be "moment-balance" with plant.roll_deg_per_g, because the springs move the load'
            )
        last_angle = self.grid.front_angle_max_deg
        if self.grid.front_angle_breakpoints_deg is not None:
            last_angle = self.grid.front_angle_breakpoints_deg[-1]
        if self.steering.front_angle_stop_deg < last_angle:
            raise ValueError("steering.front_angle_stop_deg must not be below the grid's largest front angle")
        inputs = self.controller.inputs
        if self.rear_angle_valid_max_deg < self.rear_actuator.angle_max_deg:
            raise ValueError("controller.inputs.rear_angle_max_deg must not be below rear_actuator.angle_max_deg")
        if inputs.front_angle_max_deg < self.steering.front_angle_stop_deg:
            raise ValueError("controller.inputs.front_angle_max_deg must not be below steering.front_angle_stop_deg")
        if self.controller.friction_min > self.road.friction:
            raise ValueError("controller.friction_min must not be above road.friction")
        if min(self.steering.lag_s, self.rear_actuator.lag_s) < 2.0 * self.plant.sampling_time_s * (1.0 - 1e-9):
            raise ValueError("steering.lag_s and rear_actuator.lag_s must be at least twice plant.sampling_time_s")
        motor_lag = self.plant.actuator_motor_share * self.rear_actuator.lag_s
        if motor_lag and motor_lag < self.plant.sampling_time_s * (1.0 - 1e-9):
            raise ValueError(
                "plant.sampling_time_s is too long for plant.actuator_motor_share; "
                "it must not exceed that share of rear_actuator.lag_s"
            )
        top = self.vehicle.top_speed_km_h
        controller = self.controller
        if top is not None and not controller.feedback_speeds_km_h[1] < top <= inputs.speed_max_km_h:
            least = "controller.enable_speed_km_h" if controller.waits_for_speed else "twice controller.slow_speed_km_h"
            raise ValueError(
                f"vehicle.top_speed_km_h is {top:g}; it must be above {least} and not above "
                f"controller.inputs.speed_max_km_h ({controller.feedback_speeds_km_h[1]:g} and {inputs.speed_max_km_h:g} km/h)"
            )
        if inputs.friction_max < self.road.friction:
            raise ValueError("controller.inputs.friction_max must not be below road.friction")
        return self

    @model_validator(mode="after")
    def _sendable(self) -> Self:
        period_ms = self.controller.sampling_time_s * 1e3
        for role, message in self.can.messages().items():
            if message.cycle_time_ms is not None and abs(message.cycle_time_ms - period_ms) > 1e-9 * period_ms:
                raise ValueError(f"can.{role}.cycle_time_ms must equal controller.sampling_time_s, {period_ms:g} ms")
        for place, signal, smallest, largest in self._carried():
            carried = (
                f"can.{place} carries {signal.physical_low:.4g} to {signal.physical_high:.4g} in steps of {signal.factor:.4g}"
            )
            if signal.physical_low > smallest or signal.physical_high < largest:
                raise ValueError(f"{carried}, but needs {smallest:.4g} to {largest:.4g}; enlarge its factor or length")
            if signal.factor > (largest - smallest) / STEPS_MIN:
                raise ValueError(f"{carried}, which is too coarse for {smallest:.4g} to {largest:.4g}; reduce its factor")
        return self

    @model_validator(mode="after")
    def _identified_keys_exist(self) -> Self:
        for key in self.identified.keys:
            value: object = self
            for part in key.split("."):
                value = getattr(value, part, None) if isinstance(value, Section) and part in type(value).model_fields else None
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"identified.keys names {key}, which is not a number of this file; remove or correct it")
        return self

    def _carried(self) -> Iterator[tuple[str, RealSignal, float, float]]:
        """Yield key and signal with the range (SI) that the controller accepts or commands, which the signal must cover."""
        can, inputs = self.can, self.controller.inputs
        yaw_rate = math.radians(inputs.yaw_rate_max_deg_s)
        both_signs = (
            ("vehicle_motion.speed", can.vehicle_motion.real("speed"), inputs.speed_max_km_h * KM_H),
            ("vehicle_motion.front_angle", can.vehicle_motion.real("front_angle"), math.radians(inputs.front_angle_max_deg)),
            ("vehicle_motion.yaw_rate", can.vehicle_motion.real("yaw_rate"), yaw_rate),
            (
                "vehicle_conditions.rear_angle",
                can.vehicle_conditions.real("rear_angle"),
                math.radians(self.rear_angle_valid_max_deg),
            ),
            ("rear_steer_command.rear_angle", can.rear_steer_command.real("rear_angle"), self.rear_actuator.angle_max),
            ("rear_steer_command.yaw_rate_reference", can.rear_steer_command.real("yaw_rate_reference"), yaw_rate),
        )
        for place, signal, largest in both_signs:
            yield place, signal, -largest, largest
        yield "vehicle_conditions.friction", can.vehicle_conditions.real("friction"), 0.0, inputs.friction_max
        for role in ("lateral_acceleration", "longitudinal_acceleration"):
            if role in can.vehicle_conditions.signals():
                largest = getattr(inputs, f"{role}_max_m_s2")
                yield f"vehicle_conditions.{role}", can.vehicle_conditions.real(role), -largest, largest

    def case(self, name: str, where: object = "") -> Case:
        """Return the case called `name`. Raises ConfigError, with the nearest name.

        A case of REFERENCE_CASES that the configuration does not have itself has the tyre model that all others share, else the
        linear one.
        """
        if name in self.cases:
            return self.cases[name]
        if name in REFERENCE_CASES:
            models = {case.tyre_model for case in self.cases.values()}
            return REFERENCE_CASES[name].model_copy(update={"tyre_model": models.pop() if len(models) == 1 else "linear"})
        known = list(dict.fromkeys((*self.cases, *REFERENCE_CASES)))
        raise ConfigError(
            f"there is no case {name!r}",
            where=where or "[cases]",
            remedy=f"known cases: {', '.join(known)}{suggestion(name, known)}",
        )

    @property
    def top_speed_km_h(self) -> float:
        """Largest speed for which the controller is designed, in km/h: that of the car, else the last one of the grid."""
        top = self.vehicle.top_speed_km_h or self.grid.last_speed_km_h
        return min(top, self.controller.inputs.speed_max_km_h)

    @property
    def rear_angle_valid_max_deg(self) -> float:
        """Largest measured rear angle in deg that is valid."""
        configured, actuator = self.controller.inputs.rear_angle_max_deg, self.rear_actuator
        return actuator.angle_max_deg + actuator.tolerated_error_deg if isinstance(configured, str) else configured

    @property
    def actuator_lags_s(self) -> tuple[float, ...]:
        """Lags of the rear actuator, in s, for which gains are designed."""
        factors = self.tuning.actuator_lag_factor
        if factors is None:
            return tuple(self.tuning.actuator_lag_s or ())
        # Nine decimals: 0.4 times 0.05 s is 0.02 s.
        return tuple(round(factor * self.rear_actuator.lag_s, 9) for factor in factors)

    @property
    def driven_delay_samples(self) -> int:
        """Samples between computing a command and its acting in the drives of suites and judgement, and in the ECU's model.

        At least one, because an ECU sends its command one period after sampling.
        """
        return max(1, self.plant.command_delay_samples)

    @property
    def designed_delay_samples(self) -> int:
        """Delay for which the controller is tuned: `tuning.delay_samples`, or that of the plant where it is longer."""
        return max(self.tuning.delay_samples, self.plant.command_delay_samples)

    @property
    def response_aheads_s(self) -> tuple[float, ...]:
        """Look-aheads on the model, in s, that `codegen tune` tries: multiples of the time from a command to the wheels."""
        least = self.rear_actuator.lag_s + self.driven_delay_samples * self.controller.sampling_time_s
        return tuple(round(min(factor * least, RESPONSE_AHEAD_MAX_S), 4) for factor in RESPONSE_AHEAD_FACTORS)

    @property
    def rear_steer_case(self) -> str | None:
        """Name of the last optimised case with rear steering, else of the last one with a law; None without any."""
        steered = [name for name, case in reversed(self.cases.items()) if case.rear_steering]
        return max(steered, key=lambda name: self.cases[name].reference == "optimum", default=None)

    def with_case(self, name: str) -> Config:
        """Return the configuration with the case `name` among its own cases. Raises ConfigError: see `case`."""
        case = self.case(name)
        return self if name in self.cases else self.model_copy(update={"cases": {**self.cases, name: case}})

    @property
    def with_whole_limits(self) -> Config:
        """The same configuration without `[tightening]`: the limits themselves."""
        return self if self.tightening == Tightening() else self.model_copy(update={"tightening": Tightening()})

    def with_tyre_model(self, tyre_model: str | None) -> Config:
        """Return the configuration with this tyre model, "linear" or "magic-formula", in all cases; None changes nothing."""
        if tyre_model is None:
            return self
        cases = {name: case.model_copy(update={"tyre_model": tyre_model}) for name, case in self.cases.items()}
        return self.model_copy(update={"cases": cases})

    def with_ideal_plant(self) -> Config:
        """Return the configuration with the ideal car: see IDEAL_PLANT."""
        return self.unchecked(IDEAL_PLANT)

    def replace(self, changes: Mapping[str, Any], where: object = "") -> Config:
        """Return the configuration with other values, validated as a whole.

        Args:
            changes: dotted key of `ars.toml` -> value, such as {"vehicle.mass_kg": 2100.0}. A mapping changes those keys of a
                table that it names, and so do mappings in it; a section replaces the whole table.
            where: location for the error message.

        Raises:
            ConfigError: there is no such key, or it cannot have this value.
        """
        if not isinstance(changes, Mapping) or not all(isinstance(key, str) for key in changes):
            raise ConfigError(
                "the changes are no dictionary with texts as keys", where=where, remedy="give dotted keys of ars.toml"
            )
        data: dict[str, Any] = {name: getattr(self, name) for name in Config.model_fields}
        for key, value in changes.items():
            name, *rest = parts = key.split(".")
            if not all(parts):
                raise ConfigError(f"{key!r} is no key", where=where, remedy="give dotted keys of ars.toml, as vehicle.mass_kg")
            data[name] = _merged(data.get(name), functools.reduce(lambda inner, part: {part: inner}, reversed(rest), value))
        return parse(data, where)

    def unchecked(self, changes: Mapping[str, Any]) -> Config:
        """Return the configuration with other values at dotted keys, not validated: for arrays, or a check that follows.

        Raises:
            ConfigError: there is no such key.
        """
        config: Config = self
        for key, value in changes.items():
            path = key.split(".")
            sections: list[Any] = [config]
            for name in path:
                if name not in getattr(type(sections[-1]), "model_fields", ()):
                    raise ConfigError("there is no such key", where=key, remedy="docs/ars-toml.md lists all keys")
                sections.append(getattr(sections[-1], name))
            config = functools.reduce(
                lambda child, place: sections[place].model_copy(update={path[place]: child}), reversed(range(len(path))), value
            )
        return config

    def value(self, key: str) -> Any:
        """Return the value of a dotted key. Raises AttributeError if there is none."""
        return functools.reduce(getattr, key.split("."), self)

    def to_json(self) -> str:
        """Return canonical JSON: the same configuration gives the same bytes."""
        return json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _merged(old: Any, new: Any) -> Any:
    """Return `new`, with the keys that it does not name from `old` if both are tables."""
    if isinstance(new, Section):
        return new.model_dump()  # to be validated: `model_copy` does not
    if not isinstance(new, Mapping):
        return new
    old = old.model_dump() if isinstance(old, Section) else old if isinstance(old, Mapping) else {}
    return {**old, **{key: _merged(old.get(key), value) for key, value in new.items()}}


def parse(data: Mapping[str, Any], where: object) -> Config:
    """Validate a mapping as read from TOML or JSON.

    Args:
        data: the tables and keys.
        where: location for the error message, usually a file; "" if there is none.

    Raises:
        ConfigError: the first fault, with its key.
    """
    try:
        return Config.model_validate(dict(data))
    except ValidationError as error:
        raise first_fault(error, where, Config, ConfigError, missing_remedy=MISSING_REMEDY) from None


def parse_toml(text: str, where: object, kind: type[CodegenError]) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises `kind` for the first line that is not TOML."""
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > MAX_LINE:  # the parser's time grows with the square of the number of parts of a key
            raise kind(f"longer than {MAX_LINE >> 10} KiB", where=f"{where}, line {number}", remedy="split the line")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise kind(f"TOML syntax: {error}", where=where, remedy=_toml_remedy(str(error), text)) from None
    except (ValueError, RecursionError) as error:
        # Numbers of thousands of digits and thousands of nested brackets are valid TOML, but the parser rejects them.
        raise kind(f"cannot be read as TOML ({error})", where=where, remedy="correct the number or the nesting") from None


_TOML_LINE = re.compile(r"\(at line (\d+), column \d+\)|\(at end of document\)")
_COMMA = r"[+-]?\d+(?:[._]\d{3})*,\d+(?:[eE][+-]?\d+)?"
"""A number with a decimal comma, and points or underscores between its thousands."""
_ENTRY = rf"(?:{_COMMA}|[+-]?\d[\d.eE+-]*)"
_DECIMAL_COMMA = re.compile(rf"=[ \t]*({_COMMA})(?=[ \t]*(?:[,}}#\r]|\Z))")
_LIST_WITH_COMMAS = re.compile(
    rf"^[ \t]*(?:[\w-]+\.)*([\w-]+)[ \t]*=[ \t]*\[\s*({_ENTRY}(?:,\s+{_ENTRY})+),?\s*\]", re.MULTILINE
)
"""Lists whose commas divide entries, with space after them, and decimals, without. They are valid TOML with more entries."""


def _with_point(number: re.Match[str]) -> str:
    return number[0].replace(".", "").replace("_", "").replace(",", ".")


def _comma_named(error: ConfigError, text: str) -> ConfigError:
    """Return the error of a configuration, with another remedy if a list that it is about has decimal commas in the text."""
    about = re.findall(r"[\w-]+", f"{error.where} {error.what}")
    for key, entries in _LIST_WITH_COMMAS.findall(re.sub(r"#.*", "", text)):
        pointed = re.sub(_COMMA, _with_point, " ".join(entries.split()))
        if key in about and pointed.count(",") < entries.count(","):
            return ConfigError(error.what, where=error.where, remedy=f"write decimal points: {key} = [{pointed}]")
    return error


def _toml_remedy(error: str, text: str) -> str:
    """Return what to do about a line that is not TOML."""
    match = _TOML_LINE.search(error)
    lines = text.split("\n")
    line = lines[int(match[1]) - 1] if match and match[1] else lines[-1]
    if comma := _DECIMAL_COMMA.search(line):
        pointed = re.sub(_COMMA, _with_point, comma[1])
        return f"write a decimal point{', and none between thousands' if '.' in comma[1] else ''}: {pointed}"
    if "Cannot overwrite a value" in error:
        return "give each key once; this line has one that is there already"
    if "Cannot declare" in error and "twice" in error:
        return "give each table once"
    return "correct that line"


def load(path: Path) -> Config:
    """Read and validate an `ars.toml`. Raises ConfigError."""
    text = read_text(path, CONFIG_BYTES_MAX, "name an ars.toml; `codegen init DIR` writes one", ConfigError)
    try:
        return parse(parse_toml(text, path, ConfigError), path)
    except ConfigError as error:
        raise _comma_named(error, text) from None


def preset_text(name: Preset = "paper") -> str:
    """Return the commented text of a preset `ars.toml`."""
    folder = resources.files("codegen.configuration").joinpath("presets")
    parts = (f"{name}-header", "car", f"{name}-cases", f"{name}-controller", "inputs", f"{name}-plant", "bench", "budgets")
    return "".join(folder.joinpath(f"{part}.toml").read_text(encoding="utf-8") for part in parts)


def preset(name: Preset = "paper") -> Config:
    """Return a preset of the published vehicle: with the paper's controller, or with the recommended one."""
    return parse(tomllib.loads(preset_text(name)), f"preset {name}")

"""`names.toml`: which signal of a log is which quantity, with its unit, sign, offset, limits and sampling time.

    sampling_time_s = 0.01              # step of the drives

    [vx]
    signal = "ESP_01.VehicleSpeed"      # or a list: the first one that a log has

    [yaw_rate]
    signal = "YawRate"
    unit = "deg/s"                      # if the log does not contain it
    sign = -1                           # it is positive to the right

Quantities that are not named are found by common names. `without` leaves them out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from codegen.configuration import parse_toml
from codegen.configuration.section import Meaning, Range, Section, first_fault
from codegen.errors import ConfigError
from codegen.files import read_text
from codegen.identify.quantities import LOG_QUANTITIES
from codegen.importing.quantities import unit_of

NAMES_BYTES_MAX = 2**20
VALUE_MAX = 1e9
"""Largest magnitude of an offset or a limit, in any unit."""

_Value = Annotated[float, Range(-VALUE_MAX, VALUE_MAX, "in the unit of the signal")]
_Text = Annotated[str, Field(min_length=1, max_length=1000)]


class SignalChoice(Section):
    """The signal of one quantity. `value = sign * (signal - offset)`, then in SI."""

    signal: Annotated[
        _Text | Annotated[list[_Text], Field(min_length=1, max_length=100)],
        Meaning("name of the signal, channel or column; a name that occurs twice needs its message or group: `ESP_01.Speed`"),
    ]
    unit: Annotated[_Text | None, Meaning("unit, if the log does not contain it or contains a wrong one")] = None
    sign: Annotated[
        Literal[1, -1] | _Text,
        Meaning(
            "-1 if the signal is positive to the right; or the name of a signal of the same message that is not 0 where the "
            "value is negative"
        ),
    ] = 1
    offset: Annotated[_Value, Meaning("subtracted, in the unit of the signal")] = 0.0
    low: Annotated[_Value | None, Meaning("lower limit of the sensor, in the unit of the signal; values there are lost")] = None
    high: Annotated[_Value | None, Meaning("upper limit of the sensor")] = None
    sampling_time_s: Annotated[
        Annotated[float, Range(0.0001, 60.0, "s")] | None,
        Meaning("time from one sample to the next; by default the median of the log. Longer pauses are gaps"),
    ] = None

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signal, first choice first."""
        return (self.signal,) if isinstance(self.signal, str) else tuple(self.signal)

    @property
    def factor(self) -> int:
        """-1 if the signal is positive to the right, else 1."""
        return -1 if self.sign == -1 else 1

    @model_validator(mode="after")
    def _has_a_range(self) -> Self:
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low = {self.low:g} is not below high = {self.high:g}; exchange them")
        return self


NO_SETTINGS = SignalChoice(signal="any")
"""Settings of a signal that names.toml does not name."""


class Names(Section):
    """Quantities and their signals, and the step of the drives."""

    sampling_time_s: Annotated[
        float, Range(0.0001, 1.0, "s"), Meaning("step of the drives; faster signals are filtered, without delay")
    ] = 0.01
    time: Annotated[_Text | None, Meaning("column of the time in a table; by default `time`, `t` or `timestamp`")] = None
    time_unit: Annotated[
        Literal["s", "ms", "us", "ns"] | None, Meaning("unit of that column, if its name does not contain it; by default s")
    ] = None
    channel: Annotated[
        _Text | None,
        Meaning("channel of the log of a bus whose frames are used, as the log names it: `can0`, `1`; by default all channels"),
    ] = None
    without: Annotated[
        tuple[str, ...], Field(strict=False), Meaning("quantities that are not read, although a log has them")
    ] = ()
    vx: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["vx"].meaning)] = None
    yaw_rate: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["yaw_rate"].meaning)] = None
    lateral_acceleration: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["lateral_acceleration"].meaning)] = None
    steering_wheel_angle: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["steering_wheel_angle"].meaning)] = None
    delta_f: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["delta_f"].meaning)] = None
    delta_r: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["delta_r"].meaning)] = None
    delta_r_command: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["delta_r_command"].meaning)] = None
    sideslip: Annotated[SignalChoice | None, Meaning(LOG_QUANTITIES["sideslip"].meaning)] = None

    @property
    def choices(self) -> Mapping[str, SignalChoice]:
        """Quantity -> the signal that the user named."""
        return {key: choice for key in LOG_QUANTITIES if (choice := getattr(self, key)) is not None}

    @model_validator(mode="after")
    def _has_known_units(self) -> Self:
        for key, choice in self.choices.items():
            if choice.unit is not None and unit_of(choice.unit) not in LOG_QUANTITIES[key].units:
                fitting = ", ".join(LOG_QUANTITIES[key].units)
                raise ValueError(f"{choice.unit!r} is no unit for {key}; give one of {fitting}")
            if key in self.without:
                raise ValueError(f"{key} is named, and left out by `without`; remove one")
        unknown = next((key for key in self.without if key not in LOG_QUANTITIES), None)
        if unknown is not None:
            raise ValueError(f"`without` has {unknown!r}, which is no quantity; give some of {', '.join(LOG_QUANTITIES)}")
        return self


def load_names(path: Path) -> Names:
    """Read and validate a `names.toml`. Raises ConfigError."""
    text = read_text(path, NAMES_BYTES_MAX, "name a names.toml; the guide has an example", ConfigError)
    try:
        return Names.model_validate(parse_toml(text, path, ConfigError))
    except ValidationError as error:
        raise first_fault(error, path, Names, ConfigError) from None


def line_of(key: str, signals: Sequence[str], unit: str | None) -> str:
    """Return a line of a names.toml that names the signals of a quantity, first choice first."""
    in_unit = f", unit = {_quoted(unit)}" if unit else ""
    quoted = [_quoted(signal) for signal in signals]
    choice = quoted[0] if len(quoted) == 1 else f"[{', '.join(quoted)}]"
    return f"{key} = {{ signal = {choice}{in_unit} }}"


def _quoted(text: str) -> str:
    """Return a TOML string: literal, unless it contains a quote or a control character."""
    import tomlkit

    return tomlkit.item(text).as_string()

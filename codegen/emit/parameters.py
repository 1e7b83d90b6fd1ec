"""Parameters and state of the generated controller: values, ranges and meaning, and their C text."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

from codegen.configuration import Config
from codegen.configuration.section import Range, Section
from codegen.emit.text import Precision, lines_of, literal

RATE_OFF = 1000.0
"""Rate limit in rad/s that never acts on a rear axle, which moves by a few degrees."""


def rate_key(rate: float) -> float | str:
    """Return a rate limit in rad/s as a key in deg/s, which is "off" if it never acts."""
    return "off" if rate >= RATE_OFF else math.degrees(rate)


def lag_of(share: float, period: float) -> float:
    """Return the time constant in s of a low-pass filter with the weight `share` of a new sample; 0 if it does not filter."""
    return -period / math.log1p(-share) if share < 1.0 else 0.0


@dataclass(frozen=True)
class Parameter:
    """One field of a parameter struct in SI units, with its allowed range. An integer is an unsigned count.

    A tuple is an array. `points` is the C name of its size, and `increasing` states that its values must increase.

    `key` is the key of `ars.toml` that sets it alone, such as "controller.enable_speed_km_h", and `to_key` returns the value of
    this key for a value of the parameter. Parameters without such a key follow from the car.
    """

    name: str
    value: float | int | tuple[float, ...]
    comment: str
    low: float
    high: float
    points: str = ""
    increasing: bool = False
    key: str = ""
    to_key: Callable[[float], float | str] = field(default=float, compare=False)


@functools.cache
def table_of(section: type[Section]) -> str:
    """Return the dotted name of a table of `ars.toml` that occurs once. Raises LookupError: there is no such table."""

    def below(model: type[Section], place: str) -> Iterator[str]:
        for name, info in model.model_fields.items():
            if isinstance(info.annotation, type) and issubclass(info.annotation, Section):
                if info.annotation is section:
                    yield f"{place}{name}"
                yield from below(info.annotation, f"{place}{name}.")

    found = list(below(Config, ""))
    if len(found) != 1:
        raise LookupError(section.__name__)
    return found[0]


def configured(section: Section, name: str, key: str, comment: str, scale: float = 1.0, high: float | None = None) -> Parameter:
    """Return the parameter for a key of `ars.toml`. `scale` converts the unit of the key to SI.

    The range is that of the key, up to `high` if given: calibration may widen a check that the ECU makes elsewhere.
    """
    range_ = next(item for item in type(section).model_fields[key].metadata if isinstance(item, Range))
    highest = range_.high * scale if high is None else high
    return Parameter(
        name,
        getattr(section, key) * scale,
        comment,
        range_.low * scale,
        highest,
        key=f"{table_of(type(section))}.{key}",
        to_key=lambda value: value / scale,
    )


@dataclass(frozen=True)
class ParameterView:
    """A parameter as C text."""

    type: str
    name: str
    value: str
    comment: str
    low: str
    high: str
    points: str
    increasing: bool

    @property
    def is_count(self) -> bool:
        """Whether it is an unsigned count."""
        return self.type == "uint16_t"

    @property
    def declaration(self) -> str:
        """Declaration as a field of a struct."""
        return f"{self.type} {self.name}{f'[{self.points}]' if self.points else ''};"


@dataclass(frozen=True)
class Field:
    """One field of a state struct. The `kind` "real" is the number type of the build.

    Attributes:
        bound: largest magnitude of a real number after any call, SI units; `verify/` proves it for the state of a law.
    """

    kind: str
    name: str
    comment: str
    bound: float = 4096.0


def search_strides(points: int) -> tuple[int, ...]:
    """Return the strides of the search for a cell among `points` breakpoints.

    Each stride halves the remaining range. Their sum reaches the last cell.

    >>> search_strides(14)
    (6, 3, 2, 1)
    """
    left = points - 2
    strides: list[int] = []
    while left > 0:
        strides.append((left + 1) // 2)
        left //= 2
    return tuple(strides)


def parameter_view(parameter: Parameter, precision: Precision, real: str) -> ParameterView:
    """Return the C text of a parameter."""
    if isinstance(parameter.value, int):
        value, low, high = (f"{int(number)}u" for number in (parameter.value, parameter.low, parameter.high))
        return ParameterView("uint16_t", parameter.name, value, parameter.comment, low, high, "", False)
    low, high = (literal(bound, precision) for bound in (parameter.low, parameter.high))
    if isinstance(parameter.value, tuple):
        value = _braced(lines_of([literal(number, precision) for number in parameter.value]))
    else:
        value = literal(parameter.value, precision)
    return ParameterView(real, parameter.name, value, parameter.comment, low, high, parameter.points, parameter.increasing)


def parameter_views(parameters: Iterable[Parameter], prefix: str, precision: Precision, real: str) -> tuple[ParameterView, ...]:
    """Return the C text of all parameters of a struct, with the prefix in the names of array sizes."""
    views = (parameter_view(parameter, precision, real) for parameter in parameters)
    return tuple(replace(view, points=view.points.format(PREFIX=prefix.upper())) for view in views)


def _braced(lines: tuple[str, ...]) -> str:
    if len(lines) == 1:
        return f"{{ {lines[0]} }}"
    rows = "\n".join(f"        {line}" for line in lines)
    return f"{{\n{rows}\n    }}"

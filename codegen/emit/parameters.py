"""Parameters and state of the generated controller: values, ranges and meaning, and their C text."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from codegen.configuration.section import Range, Section
from codegen.emit.text import Precision, lines_of, literal

RATE_OFF = 1000.0
"""rad/s: a rate limit that never acts, for a rear axle that moves a few degrees."""


@dataclass(frozen=True)
class Parameter:
    """One field of a parameter struct, SI units, with its allowed range; an integer is an unsigned count, from zero.

    A tuple is an array, whose size the C knows by the name `points`; `increasing` where its values must rise.
    """

    name: str
    value: float | int | tuple[float, ...]
    comment: str
    low: float
    high: float
    points: str = ""
    increasing: bool = False


def configured(section: Section, name: str, key: str, comment: str, scale: float = 1.0, high: float | None = None) -> Parameter:
    """A parameter that is a key of `ars.toml` in SI units, `scale` of them for one of the key's.

    Its range is the key's, or goes up to `high`: a calibration may open a check that the ECU makes elsewhere.
    """
    range_ = next(item for item in type(section).model_fields[key].metadata if isinstance(item, Range))
    highest = range_.high * scale if high is None else high
    return Parameter(name, getattr(section, key) * scale, comment, range_.low * scale, highest)


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
    """One field of a state struct; `kind` "real" is the build's number type."""

    kind: str
    name: str
    comment: str


def search_strides(points: int) -> tuple[int, ...]:
    """Strides of the search for a cell between so many breakpoints: each halves what is left, all together reach the last one.

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
    """The C text of a parameter."""
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
    """The C text of all parameters of a struct, the names of their sizes with the prefix."""
    views = (parameter_view(parameter, precision, real) for parameter in parameters)
    return tuple(replace(view, points=view.points.format(PREFIX=prefix.upper())) for view in views)


def _braced(lines: tuple[str, ...]) -> str:
    if len(lines) == 1:
        return f"{{ {lines[0]} }}"
    rows = "\n".join(f"        {line}" for line in lines)
    return f"{{\n{rows}\n    }}"

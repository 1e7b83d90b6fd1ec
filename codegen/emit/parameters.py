"""Parameters and state of the generated controller: values, units, ranges and meaning."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from codegen.configuration import Config
from codegen.configuration.section import Range, Section
from codegen.units import Unit

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
    """One field of a parameter struct.

    Attributes:
        value: in its unit. An integer is an unsigned count, a tuple an array.
        unit, meaning: of the value; the meaning has at most twelve words.
        low, high: allowed range.
        points: C name of the size of an array, without the prefix of the build.
        increasing: whether the values of an array must increase.
        key: key of `ars.toml` that sets it alone, such as "controller.enable_speed_km_h"; "" if it follows from the car.
        to_key: function that returns the value of this key for a value of the parameter.
    """

    name: str
    value: float | int | tuple[float, ...]
    unit: Unit
    meaning: str
    low: float
    high: float
    points: str = ""
    increasing: bool = False
    key: str = ""
    to_key: Callable[[float], float | str] = field(default=float, compare=False)

    @property
    def is_count(self) -> bool:
        """Whether it is an unsigned count."""
        return isinstance(self.value, int)

    @property
    def kind(self) -> str:
        """Kind of its C type, as that of a `Field`."""
        return "uint16_t" if self.is_count else "real"

    @property
    def values(self) -> tuple[float, ...]:
        """Its values, one or several."""
        return self.value if isinstance(self.value, tuple) else (self.value,)


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


def configured(
    section: Section, name: str, key: str, unit: Unit, meaning: str, scale: float = 1.0, high: float | None = None
) -> Parameter:
    """Return the parameter for a key of `ars.toml`. `scale` converts the unit of the key to `unit`.

    The range is that of the key, up to `high` if given: calibration may widen a check that the ECU makes elsewhere.
    """
    range_ = next(item for item in type(section).model_fields[key].metadata if isinstance(item, Range))
    highest = range_.high * scale if high is None else high
    return Parameter(
        name,
        getattr(section, key) * scale,
        unit,
        meaning,
        range_.low * scale,
        highest,
        key=f"{table_of(type(section))}.{key}",
        to_key=lambda value: value / scale,
    )


@dataclass(frozen=True)
class Field:
    """One field of a state struct.

    Attributes:
        kind: C type; "real" is the number type of the build.
        unit, meaning: of the value; the meaning has at most twelve words.
        bound: largest magnitude of a real number after any call, SI units; `verify/` proves it for the state of a law.
    """

    kind: str
    name: str
    unit: Unit
    meaning: str
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

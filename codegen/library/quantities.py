"""Numbers that are written with their unit, such as "0.05deg/s" and "4KiB"."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from codegen.errors import CodegenError

_WRITTEN = re.compile(r"(?P<number>-?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?)\s*(?P<unit>[A-Za-z/]*)", re.ASCII)


@dataclass(frozen=True)
class Amount:
    """A number in SI (bytes for memory), and its text as written."""

    value: float
    words: str


@dataclass(frozen=True)
class Kind:
    """A kind of quantity.

    Attributes:
        name: its name.
        units: unit as written -> its size in SI.
        shown: example.
    """

    name: str
    units: Mapping[str, float]
    shown: str

    def read(self, text: object) -> Amount:
        """Read a positive number with its unit. Raises CodegenError."""
        found = _WRITTEN.fullmatch(str(text).strip())
        unit = found["unit"] if found else ""
        if found is None or unit not in self.units:
            what = "has no number" if found is None else f"is in {unit!r}" if unit else "has no unit"
            raise CodegenError(f"{text!r} {what}", remedy=f"give a number and {' or '.join(self.units)}, such as {self.shown}")
        size = float(found["number"]) * self.units[unit]
        if not 0.0 < size < math.inf:
            raise CodegenError(f"{text!r} must be above zero, and finite", remedy=f"such as {self.shown}")
        return Amount(size, found["number"] + unit)


YAW_RATE_KIND = Kind("yaw rate", {"deg/s": math.pi / 180.0, "rad/s": 1.0}, "0.05deg/s")
MEMORY_KIND = Kind("size", {"B": 1.0, "kB": 1e3, "KiB": 1024.0, "MB": 1e6, "MiB": 1048576.0}, "4KiB")

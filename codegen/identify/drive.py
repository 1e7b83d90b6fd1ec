"""Measured drives on a uniform time grid in SI units, and findings about the input of an identification."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from codegen.arrays import FloatArray
from codegen.errors import CodegenError, parts_of


@dataclass(frozen=True)
class Drive:
    """One measured drive.

    Attributes:
        name: name of the log, for messages.
        time: (n,) s, uniform.
        signals: quantity -> (n,) in its SI unit; NaN where no value is known. Quantities: "vx" m/s, "yaw_rate" rad/s,
            "lateral_acceleration" m/s^2, "steering_wheel_angle" rad, "delta_f" rad, "delta_r" rad, "delta_r_command" rad,
            "sideslip" rad.
    """

    name: str
    time: FloatArray
    signals: Mapping[str, FloatArray]


CLOCK = "clock"
GAP = "gap"
RESERVED = "not available"
SATURATED = "saturation"
IMPOSSIBLE = "impossible value"
JUMP = "jump"
FROZEN = "frozen"
OFFSET = "offset"
SIGN = "sign or unit"
CONTRADICTION = "contradiction"
NOT_USED = "not used"
REMARK = "remark"


@dataclass(frozen=True)
class Finding:
    """Something in the data of a drive that a user should know.

    Attributes:
        drive: name of the drive.
        quantity: key of QUANTITIES, or several with commas; "" for the whole log.
        kind: one of the constants of this module.
        text: one line: what, where, and a remedy if there is one.
        lost: number of samples (of the log) of each quantity that became NaN because of it.
    """

    drive: str
    quantity: str
    kind: str
    text: str
    lost: int = 0

    def __str__(self) -> str:
        place = f"{self.drive}: {self.quantity}" if self.quantity else self.drive
        return f"{place}: {self.text}"


def merged(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings in which quantities of one drive with the same finding share it."""
    found: dict[Finding, list[str]] = {}
    for each in findings:
        found.setdefault(replace(each, quantity=""), []).append(each.quantity)
    return [replace(each, quantity=", ".join(quantities)) for each, quantities in found.items()]


def refuse_contradictions(findings: Iterable[Finding]) -> None:
    """Raise CodegenError if signals of a drive contradict each other."""
    for each in findings:
        if each.kind == CONTRADICTION:
            what, remedy = parts_of(each.text)
            raise CodegenError(what, where=f"{each.drive}: {each.quantity}", remedy=f"{remedy} in names.toml, for `signals=`")

"""Table of the signals between car and controller: names, units, ranges, frames, sources and meanings.

The fields of the three payload classes form the table; `SIGNALS` lists them. The default layout of `[can]` in `ars.toml`, the
C structs and their packing, the DBC, the ARXML, the measurements of the A2L, the variables of the FMUs, the columns of a run,
the inputs of the checks and the tables of the guide are derived from it.

To add a signal that the controller does not use, add it here only. The controller receives it in its measurement and forwards
it.
"""

from __future__ import annotations

import enum
import math
from dataclasses import MISSING, dataclass, fields, replace
from functools import lru_cache
from typing import Annotated, Any, get_args, get_type_hints

from codegen.units import M_S, M_S2, NONE, RAD, RAD_S, Unit

STATUSES = {
    "TRACKING": "following the reference",
    "LIMITED": "following, with the command at a limit: angle, rate, distance to the measured angle, or the limiter's",
    "STANDBY": "no speed yet, or inhibited for good, then the rear angle returns to zero; kind pi: also too slow or reversing",
    "DEGRADED": "following, with one signal estimated or shortly predicted, or with held integrator: the loop is impaired",
    "FAIL_SAFE": "neither front angle nor yaw rate is valid: the rear angle returns to zero",
}
"""Names of the controller's status, from code 0, with their meanings."""


class Status(enum.IntEnum):
    """Status of a controller step, in the order of STATUSES; the C enum `<prefix>_status_t`."""

    TRACKING = 0
    LIMITED = 1
    STANDBY = 2
    DEGRADED = 3
    FAIL_SAFE = 4


@dataclass(frozen=True)
class SignalDefinition:
    """One signal.

    Attributes:
        name: name in the DBC.
        start_bit, length: default position in the frame, in the DBC's bit numbers for Intel byte order.
        meaning: phrase for comments and descriptions.
        unit: SI unit.
        factor: default resolution, in the unit; None: a whole number. `factor`, `length` and `signed` determine the range.
        signed: whether a real signal has both signs.
        values: names of the codes of a whole number, from 0.
        source: source in the bench: "scenario.", "state." or "output." (of the plant), then the name there. With "", the bench
            sends "not available".
        is_used: whether the controller uses it. Other signals are only forwarded and recorded.
        is_extra: whether only those builds have it whose `[can]` places it in a frame.
        in_measurement: comment in the controller's measurement struct; "" derives it from unit and meaning.
        in_layout: comment at its key in `[can]`; "" derives it from unit and meaning.
        message: role of its message; filled in from the payload class.
        role: its name in code; filled in from the field.
        kind: Python type of its value; filled in from the field.
        is_optional: whether the controller works without it; filled in from the field's default.
    """

    name: str
    start_bit: int
    length: int
    meaning: str
    unit: Unit = NONE
    factor: float | None = None
    signed: bool = True
    values: tuple[str, ...] = ()
    source: str = ""
    is_used: bool = False
    is_extra: bool = False
    in_measurement: str = ""
    in_layout: str = ""
    message: str = ""
    role: str = ""
    kind: type = float
    is_optional: bool = False

    @property
    def is_real(self) -> bool:
        """Whether it is scaled."""
        return self.factor is not None

    @property
    def is_flag(self) -> bool:
        """Whether it is one bit, true or false."""
        return self.kind is bool

    @property
    def c_type(self) -> str:
        """C type of an unscaled signal; "" for a real signal, whose type is that of the build's numbers."""
        if self.is_real:
            return ""
        return "bool" if self.is_flag else f"uint{8 if self.length <= 8 else 16}_t"

    @property
    def comment(self) -> str:
        """Comment in the controller's measurement struct."""
        return self.in_measurement or self._unit_and_meaning + ("; NaN: not measured" if self.is_real else "")

    @property
    def layout_comment(self) -> str:
        """Comment at its key in `[can]` of `ars.toml`."""
        return self.in_layout or self._unit_and_meaning

    @property
    def _unit_and_meaning(self) -> str:
        return f"{self.unit}, {self.meaning}" if self.unit else self.meaning

    @property
    def variable(self) -> str:
        """Name with unit suffix, for columns of a run and variables of an FMU."""
        return f"{self.role}{self.unit.suffix}"

    @property
    def origin(self) -> str:
        """Source in the bench: "scenario", "state", "output" or ""."""
        return self.source.partition(".")[0]

    @property
    def origin_name(self) -> str:
        """Name at the source."""
        return self.source.partition(".")[2]

    @property
    def is_of_plant(self) -> bool:
        """Whether the simulated car provides it, so that a run records it."""
        return self.origin in ("state", "output")


@dataclass(frozen=True)
class VehicleMotion:
    """Payload from the car: speed (m/s), front angle (rad, road wheel), yaw rate (rad/s); NaN if not available."""

    speed: Annotated[
        float,
        SignalDefinition(
            "Speed",
            start_bit=16,
            length=16,
            factor=0.005,
            unit=M_S,
            meaning="speed, negative in reverse",
            source="scenario.speed",
            is_used=True,
            in_measurement="m/s, negative in reverse",
            in_layout="m/s",
        ),
    ]
    front_angle: Annotated[
        float,
        SignalDefinition(
            "FrontAngle",
            start_bit=32,
            length=16,
            factor=5e-5,
            unit=RAD,
            meaning="front angle at the road wheel, positive to the left",
            source="output.front_angle",
            is_used=True,
            in_measurement="rad, at the road wheel",
            in_layout="rad, road wheel",
        ),
    ]
    yaw_rate: Annotated[
        float,
        SignalDefinition(
            "YawRate",
            start_bit=48,
            length=16,
            factor=2e-4,
            unit=RAD_S,
            meaning="yaw rate, positive to the left",
            source="state.yaw_rate",
            is_used=True,
            in_measurement="rad/s",
            in_layout="rad/s",
        ),
    ]


@dataclass(frozen=True)
class VehicleConditions:
    """Payload from the car: achieved rear angle (rad), peak friction, lateral and longitudinal acceleration (m/s^2), each NaN
    if unknown, and whether ESC or ABS is acting."""

    rear_angle: Annotated[
        float,
        SignalDefinition(
            "RearAngle",
            start_bit=16,
            length=16,
            factor=5e-5,
            unit=RAD,
            meaning="rear angle at the road wheel, positive to the left",
            source="output.measured_rear_angle",
            is_used=True,
            in_measurement="rad, achieved by the actuator; NaN where it is not measured",
            in_layout="rad, achieved by the actuator",
        ),
    ] = math.nan
    friction: Annotated[
        float,
        SignalDefinition(
            "Friction",
            start_bit=32,
            length=8,
            factor=0.01,
            signed=False,
            meaning="estimated peak friction",
            source="scenario.friction_estimate",
            is_used=True,
            in_measurement="estimated peak friction; NaN where unknown: the map's own is taken",
        ),
    ] = math.nan
    lateral_acceleration: Annotated[
        float,
        SignalDefinition(
            "LateralAcceleration",
            start_bit=48,
            length=16,
            factor=0.001,
            unit=M_S2,
            meaning="lateral acceleration at the centre of gravity, positive to the left",
            source="output.measured_lateral_acceleration",
            is_used=True,
            in_measurement="m/s^2 at the centre of gravity; NaN: not measured",
            in_layout="m/s^2, centre of gravity",
        ),
    ] = math.nan
    inhibit: Annotated[
        bool,
        SignalDefinition(
            "Inhibit",
            start_bit=12,
            length=1,
            meaning="1 = ESC or ABS is acting, the integrator holds",
            values=("free", "acting"),
            source="scenario.inhibit",
            is_used=True,
            in_measurement="ESC or ABS is acting: the integrator holds",
            in_layout="ESC or ABS is acting",
        ),
    ] = False
    longitudinal_acceleration: Annotated[
        float,
        SignalDefinition(
            "LongitudinalAcceleration",
            start_bit=40,
            length=8,
            factor=0.1,
            unit=M_S2,
            meaning="longitudinal acceleration, negative while the car brakes",
            source="scenario.longitudinal_acceleration",
            is_used=True,
            is_extra=True,
            in_measurement="m/s^2, negative while the car brakes; NaN: not measured",
            in_layout="m/s^2, for a map with a stack over it; not given: the frame has no such signal",
        ),
    ] = math.nan


@dataclass(frozen=True)
class RearSteerCommand:
    """Payload from the controller: rear angle (rad) and reference yaw rate (rad/s), each NaN if not available, status, and a
    bit for each diagnosed cause."""

    rear_angle: Annotated[
        float,
        SignalDefinition(
            "RearAngleCommand",
            start_bit=16,
            length=16,
            factor=5e-5,
            unit=RAD,
            meaning="rear angle at the road wheel, positive to the left",
            in_layout="rad",
        ),
    ]
    yaw_rate_reference: Annotated[
        float,
        SignalDefinition(
            "YawRateReference",
            start_bit=32,
            length=16,
            factor=2e-4,
            unit=RAD_S,
            meaning="reference yaw rate from the map",
            in_layout="rad/s",
        ),
    ]
    status: Annotated[
        int,
        SignalDefinition(
            "Status",
            start_bit=12,
            length=4,
            meaning="what the controller did",
            values=tuple(STATUSES),
            in_layout="`ars_status_t`",
        ),
    ] = 0
    diagnostics: Annotated[
        int,
        SignalDefinition(
            "Diagnostics",
            start_bit=48,
            length=16,
            meaning="one bit for each cause of trouble",
            in_layout="one bit for each diagnosed cause",
        ),
    ] = 0


@dataclass(frozen=True)
class Measurement(VehicleConditions, VehicleMotion):
    """One sample of the controller's inputs: the signals of both messages from the car, those of VehicleMotion first."""


Payload = VehicleMotion | VehicleConditions | RearSteerCommand

PAYLOADS: dict[str, type[VehicleMotion] | type[VehicleConditions] | type[RearSteerCommand]] = {
    "vehicle_motion": VehicleMotion,
    "vehicle_conditions": VehicleConditions,
    "rear_steer_command": RearSteerCommand,
}
"""Payload classes of the messages, by their role in the configuration."""


def _definitions(message: str, payload: type[Any]) -> tuple[SignalDefinition, ...]:
    hints = get_type_hints(payload, include_extras=True)
    found = []
    for field in fields(payload):
        kind, definition = get_args(hints[field.name])
        optional = field.default is not MISSING
        found.append(replace(definition, message=message, role=field.name, kind=kind, is_optional=optional))
    return tuple(found)


SIGNALS = tuple(each for message, payload in PAYLOADS.items() for each in _definitions(message, payload))
"""All signals, in the order of the messages and of their fields."""

MEASURED = tuple(each for each in SIGNALS if each.message != "rear_steer_command")
"""Signals from the car, in the order of `Measurement` and of the C struct. `Can.measured` has those of one configuration."""

CARRIED = tuple(each for each in MEASURED if not each.is_used)
"""Signals from the car that the controller only forwards."""

RECORDED = tuple(each for each in CARRIED if each.is_of_plant)
"""Forwarded signals that a run records in a column of their own."""

RECORD_COLUMNS = (
    "time_s",
    "speed_m_s",
    "front_angle_rad",
    "yaw_rate_rad_s",
    "yaw_rate_reference_rad_s",
    "sideslip_rad",
    "lateral_acceleration_m_s2",
    "rear_angle_command_rad",
    "rear_angle_rad",
    "slip_front_rad",
    "slip_rear_rad",
    *(each.variable for each in RECORDED),
    "status",
)
"""Columns of a run, in order. All values belong to the time of the sample."""


@lru_cache
def signals_of(message: str) -> tuple[SignalDefinition, ...]:
    """Return the signals of one message, by its role."""
    return tuple(each for each in SIGNALS if each.message == message)

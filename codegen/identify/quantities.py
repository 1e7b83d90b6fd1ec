"""Table of the quantities of a measured drive: units, common names, ranges that no car leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from codegen.importing.quantities import (
    ACCELERATION_KIND,
    ANGLE_KIND,
    FRONT_MAX_HIGH,
    RATE_KIND,
    REAR_MAX_HIGH,
    SPEED_KIND,
    SPEED_MAX_HIGH,
    UNIT_FACTORS,
    YAW_MAX_HIGH,
    Name,
)
from codegen.units import STANDARD_GRAVITY


@dataclass(frozen=True)
class LogQuantity:
    """A quantity of a drive. Signs follow ISO 8855: positive to the left.

    Attributes:
        key: name in `Drive.signals` and in names.toml.
        kind: kind of unit, a key of FACTORS.
        meaning: for the guide and for a names.toml.
        names: common names, letters and digits only, separated by spaces. A signal with one of them need not be named.
        words: parts of the names of candidates, if no name is common.
        largest: largest plausible magnitude in SI; a value beyond it is an error of the sensor or of the unit.
        is_held: whether each sample holds until the next one, as a command does; else the value changes in between.
        offset_noted: smallest offset that is reported, in SI.
    """

    key: str
    kind: str
    meaning: str
    names: str
    words: str
    largest: float
    offset_noted: float
    is_held: bool = False

    @property
    def units(self) -> Mapping[str, float]:
        """Unit -> its size in SI."""
        return UNIT_FACTORS[self.kind]

    @property
    def si_unit(self) -> str:
        """Its SI unit."""
        return next(unit for unit, size in self.units.items() if size == 1.0)

    def is_candidate(self, name: Name, unit: str | None) -> bool:
        """Return whether a name, and its unit where it is known, may denote this quantity."""
        return (unit is None or unit in self.units) and any(word in name.base for word in self.words.split())

    def is_named(self, name: Name) -> bool:
        """Return whether a name denotes this quantity by itself."""
        return name.base in self.names.split()


STEERING_WHEEL_MAX = 25.0
"""rad: four turns to one side; trucks have up to three."""
LATERAL_MAX = 3.0 * STANDARD_GRAVITY
"""m/s^2, with the peaks that rough roads add to the 1.2 g of road tyres."""
SIDESLIP_MAX = math.radians(60.0)
"""rad: beyond it the car spins."""

_DEGREE = math.radians(1.0)

LOG_QUANTITIES: Mapping[str, LogQuantity] = {
    quantity.key: quantity
    for quantity in (
        LogQuantity(
            "vx",
            SPEED_KIND,
            "speed along the car's axis, negative in reverse",
            "vx v speed velocity vehiclespeed vehspeed vehspd vehiclevelocity longitudinalspeed longitudinalvelocity "
            "wheelbasedvehiclespeed",
            "vx speed spd veloc",
            SPEED_MAX_HIGH,
            math.inf,
        ),
        LogQuantity(
            "yaw_rate",
            RATE_KIND,
            "yaw rate, positive to the left",
            "yawrate yawvelocity psidot psip omegaz r",
            "yaw psi gyroz omegaz",
            YAW_MAX_HIGH,
            0.1 * _DEGREE,
        ),
        LogQuantity(
            "lateral_acceleration",
            ACCELERATION_KIND,
            "lateral acceleration at the centre of gravity, positive to the left",
            "lateralacceleration lateralaccel lateralacc latacceleration lataccel latacc ay accelerationy accely accy",
            "lat ay accy accely",
            LATERAL_MAX,
            0.05,
        ),
        LogQuantity(
            "steering_wheel_angle",
            ANGLE_KIND,
            "angle of the steering wheel, positive to the left",
            "steeringwheelangle steerwheelangle strgwhlang strwhlang stwhlang steeringwheelpos swa",
            "steer strg stw swa whlang",
            STEERING_WHEEL_MAX,
            1.0 * _DEGREE,
        ),
        LogQuantity(
            "delta_f",
            ANGLE_KIND,
            "steer angle of the front road wheels, positive to the left",
            "deltaf frontangle frontsteer frontsteerangle frontsteeringangle frontwheelangle roadwheelangle",
            "front deltaf roadwheel",
            FRONT_MAX_HIGH,
            0.1 * _DEGREE,
        ),
        LogQuantity(
            "delta_r",
            ANGLE_KIND,
            "steer angle of the rear road wheels, positive to the left",
            "deltar rearangle rearsteer rearsteerangle rearsteeringangle rearwheelangle",
            "rear deltar",
            REAR_MAX_HIGH,
            0.1 * _DEGREE,
        ),
        LogQuantity(
            "delta_r_command",
            ANGLE_KIND,
            "steer angle of the rear road wheels that the controller requests, positive to the left",
            "deltarcommand deltarcmd rearanglecommand rearanglerequest rearsteercommand rearsteeranglecommand",
            "command cmd request target setpoint",
            REAR_MAX_HIGH,
            math.inf,
            is_held=True,
        ),
        LogQuantity(
            "sideslip",
            ANGLE_KIND,
            "sideslip angle at the centre of gravity, positive to the left",
            "sideslip sideslipangle beta",
            "slip beta",
            SIDESLIP_MAX,
            math.inf,
        ),
    )
}
"""Key -> quantity. `largest` of the quantities of a map: see their bounds in `codegen.importing.quantities`."""

REQUIRED = (("vx",), ("yaw_rate",), ("steering_wheel_angle", "delta_f"))
"""Quantities that every drive needs, one of each group."""

"""The tables of `ars.toml` about the car, its road, the optimisation, the plant and its sensors, with units, ranges and
defaults."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticKnownError

from codegen.configuration.section import MAX_BREAKPOINTS, MAX_CELLS, Breakpoints, Meaning, Range, RangeOrZero, Section
from codegen.units import GRAVITY, KM_H


class Vehicle(Section):
    """Mass and geometry. Only the share of the load transfer has a default: it is rarely measured, and cars differ little.

    Gains and margins are designed up to `top_speed_km_h`, and charts end there. By default it is the last speed of the map. At
    higher speeds the controller holds the gains of the last one.
    """

    mass_kg: Annotated[float, Range(200.0, 60_000.0, "kg"), Meaning("m, with the load of normal operation")]
    yaw_inertia_kg_m2: Annotated[
        float, Range(50.0, 500_000.0, "kg m^2"), Meaning("Iz, about the vertical axis through the centre of gravity")
    ]
    cg_height_m: Annotated[float, Range(0.05, 3.0, "m"), Meaning("centre of gravity above the road")]
    track_m: Annotated[float, Range(0.5, 3.5, "m"), Meaning("full track, the same on both axles")]
    cg_to_front_axle_m: Annotated[float, Range(0.2, 10.0, "m"), Meaning("lf")]
    cg_to_rear_axle_m: Annotated[float, Range(0.2, 10.0, "m"), Meaning("lr")]
    front_roll_share: Annotated[
        float, Range(0.0, 1.0), Meaning("share of the lateral load transfer on the front axle, 0 to 1")
    ] = 0.6
    # Omitted where unset, so that maps and builds without it do not change.
    top_speed_km_h: Annotated[
        Annotated[float, Range(20.0, 500.0, "km/h")] | None,
        Meaning("largest speed of the car, by default the last one of the map; the design of gains and margins ends there"),
    ] = Field(default=None, exclude_if=lambda speed: speed is None)

    @property
    def wheelbase(self) -> float:
        """Wheelbase L in m."""
        return self.cg_to_front_axle_m + self.cg_to_rear_axle_m


class Road(Section):
    """Friction and gravity that the map assumes."""

    friction: Annotated[float, Range(0.05, 1.5), Meaning("peak friction that the map assumes: dry asphalt")] = 0.9
    gravity_m_s2: Annotated[float, Range(1.0, 30.0, "m/s^2"), Meaning("g")] = GRAVITY


class Tyre(Section):
    """Magic Formula of one tyre of an axle (H. B. Pacejka, Tire and Vehicle Dynamics, section 4.3).

    The slope at zero slip is given either as `cornering_stiffness_n_per_rad` (of one tyre at its static load and the
    nominal friction) or by the factor B itself.
    """

    one_of: ClassVar[tuple[str, ...]] = ("cornering_stiffness_n_per_rad", "stiffness_factor_b_per_rad")
    curve: ClassVar[str] = "magic-formula"
    """Name in `vehicle.tyre.CURVES`; with a second curve this becomes a key."""
    cornering_stiffness_n_per_rad: Annotated[
        Annotated[float, Range(3_000.0, 2_000_000.0, "N/rad for one tyre")] | None,
        Meaning("one tyre, slope at zero slip; or give stiffness_factor_b_per_rad"),
    ] = None
    stiffness_factor_b_per_rad: Annotated[
        Annotated[float, Range(0.5, 100.0, "1/rad")] | None, Meaning("B, instead of the cornering stiffness")
    ] = None
    shape_factor_c: Annotated[float, Range(0.5, 2.5), Meaning("C")] = 1.3
    curvature_factor_e: Annotated[float, Range(-20.0, 1.0), Meaning("E")] = -0.5
    peak_factor_p1: Annotated[
        float, Range(0.2, 3.0), Meaning("p1: peak friction at the static load, as a share of the friction of the road")
    ] = 1.0
    peak_load_sensitivity_p2: Annotated[float, Range(-1.0, 1.0), Meaning("p2: change of the peak friction with the load")] = 0.0
    horizontal_shift_deg: Annotated[float, Range(-3.0, 3.0, "deg"), Meaning("SH")] = 0.0
    vertical_shift_n: Annotated[float, Range(-5_000.0, 5_000.0, "N"), Meaning("SV")] = 0.0

    @model_validator(mode="after")
    def _one_stiffness(self) -> Self:
        given = [key for key in self.one_of if getattr(self, key) is not None]
        if not given:
            raise PydanticKnownError("missing")
        if len(given) > 1:
            raise ValueError(f"give exactly one of {' and '.join(self.one_of)}")
        return self


class Tyres(Section):
    """The tyres of both axles."""

    front: Tyre
    rear: Tyre


class Limits(Section):
    """Constraints of the optimisation: those of the paper's problem, and those with which the nonlinear tyre uses its grip.

    With `grip_use_max`, a map of the nonlinear tyre approaches its largest lateral acceleration smoothly, and never falls with
    the front angle. Without it, such a map keeps to the linear range of the tyre.
    """

    sideslip_max_deg: Annotated[float, Range(0.2, 20.0, "deg"), Meaning("bound on |β|")] = 3.0
    lateral_acceleration_max_g: Annotated[float, Range(0.05, 2.0, "g"), Meaning("bound on |ay|")] = 0.8
    rear_angle_max_deg: Annotated[
        float, Range(0.1, 20.0, "deg"), Meaning("bound on |δr| in the map; the limit of the actuator is in `[rear_actuator]`")
    ] = 3.5
    slip_departure_percent: Annotated[
        float,
        Range(0.5, 50.0, "%"),
        Meaning("linear tyre: largest departure of the tyre curve from its tangent at zero; bounds the slip angles"),
    ] = 10.0
    grip_use_max: Annotated[
        Annotated[float, Range(0.3, 0.995)] | None,
        Meaning("nonlinear tyre: largest share of the lateral force that an axle can carry; bounds the slip angles instead"),
    ] = Field(default=None, exclude_if=lambda use: use is None)
    yaw_gain_floor: Annotated[
        float, Range(0.0, 1.5), Meaning("least yaw rate of the map, as a share of that with straight rear wheels")
    ] = Field(default=0.0, exclude_if=lambda floor: floor == 0.0)
    reference_characteristic_speed_km_h: Annotated[
        float,
        Range(40.0, 400.0, "km/h"),
        Meaning("from 80 km/h, `yaw_gain_floor` refers to a car of this characteristic speed where that turns less"),
    ] = Field(default=100.0, exclude_if=lambda speed: speed == 100.0)
    envelope_rear_slip_deg: Annotated[
        Annotated[float, Range(0.2, 30.0, "deg")] | None,
        Meaning("for a case with `envelope`: bound on the slip that the rear axle would have with its wheels straight"),
    ] = Field(default=None, exclude_if=lambda slip: slip is None)

    @property
    def sideslip_max(self) -> float:
        """Bound on sideslip in rad."""
        return math.radians(self.sideslip_max_deg)

    @property
    def rear_angle_max(self) -> float:
        """Bound of the map on the rear angle in rad. It may be tighter than the actuator's."""
        return math.radians(self.rear_angle_max_deg)


class Case(Section):
    """One optimisation: rear steering on or off, and the weight of sideslip (lambda of the objective).

    `passive_safe` excludes turns that the car cannot drive without rear steering. `tyre_model` selects the model of the steady
    turn: the linear single-track car, as in the paper, or the plant's four loaded wheels with the whole Magic Formula.

    `reference` replaces the optimisation by a published law for the rear angle, within the same bounds. "zero-sideslip" keeps
    the sideslip of the steady turn at zero. "variable-wheelbase" lets the car turn like one with `wheelbase_factor` times its
    wheelbase, linear over speed between the points of `wheelbase_speed_km_h`. `envelope` adds the bounds of the stable handling
    envelope, by default with the slip of the rear tyre's peak force.
    """

    rear_steering: Annotated[bool, Meaning("whether the rear wheels steer")] = True
    sideslip_weight_per_s2: Annotated[float, Range(0.0, 1e7, "1/s^2"), Meaning("λ of the objective")] = 3000.0
    passive_safe: Annotated[bool, Meaning("exclude turns that the car cannot drive without rear steering")] = False
    # Omitted where linear, so that older maps and builds do not change.
    tyre_model: Annotated[
        Literal["linear", "magic-formula"],
        Meaning("model of the steady turn: linear single-track car, or four loaded wheels with the whole Magic Formula"),
    ] = Field(default="linear", exclude_if=lambda model: model == "linear")
    reference: Annotated[
        Literal["optimum", "zero-sideslip", "variable-wheelbase"], Meaning("the optimisation, or a law for the rear angle")
    ] = Field(default="optimum", exclude_if=lambda reference: reference == "optimum")
    wheelbase_speed_km_h: Annotated[
        list[float] | None, Breakpoints(1.0, 400.0, "km/h"), Meaning("speeds of `wheelbase_factor`")
    ] = Field(default=None, exclude_if=lambda speeds: speeds is None)
    wheelbase_factor: Annotated[
        list[Annotated[float, Range(0.3, 5.0)]] | None,
        Meaning("virtual over real wheelbase: below 1 the rear wheels steer against the front wheels, above 1 with them"),
    ] = Field(default=None, exclude_if=lambda factors: factors is None)
    envelope: Annotated[
        bool, Meaning("bound the yaw rate, and the slip that the rear axle would have with its wheels straight")
    ] = Field(default=False, exclude_if=lambda envelope: not envelope)

    @model_validator(mode="after")
    def _whole_law(self) -> Self:
        if self.reference != "optimum" and not self.rear_steering:
            raise ValueError(f'reference = "{self.reference}" needs rear_steering = true')
        keys = self.wheelbase_speed_km_h, self.wheelbase_factor
        if self.reference != "variable-wheelbase":
            if keys != (None, None):
                raise ValueError('wheelbase_speed_km_h and wheelbase_factor need reference = "variable-wheelbase"')
        elif self.wheelbase_speed_km_h is None or self.wheelbase_factor is None:
            raise ValueError('reference = "variable-wheelbase" needs wheelbase_speed_km_h and wheelbase_factor; add both')
        elif len(self.wheelbase_speed_km_h) != len(self.wheelbase_factor):
            raise ValueError("wheelbase_speed_km_h and wheelbase_factor differ in length; give a factor for each speed")
        return self


REFERENCE_CASES: dict[str, Case] = {
    "zero-sideslip": Case(reference="zero-sideslip"),
    "variable-wheelbase": Case(
        reference="variable-wheelbase", wheelbase_speed_km_h=[20.0, 60.0, 120.0], wheelbase_factor=[0.75, 1.0, 4.0 / 3.0]
    ),
    "envelope": Case(envelope=True),
}
"""Cases that every configuration has, for comparison with the optimisation; a case with the same name in the file replaces it.

The source of the variable wheelbase leaves the wheelbase to the designer. These factors suit the preset's car. Three quarters
at 20 km/h steer a third of the front angle, 3.3 of the rear axle's 3.5 deg at the largest front angle of the grid. At 60 km/h
it is the car's own wheelbase, near the 64 km/h at which the sideslip vanishes by itself. At 120 km/h it is the reciprocal.
"""


class Grid(Section):
    """Breakpoints of the map: evenly spaced by default, or listed."""

    speed_min_km_h: Annotated[float, Range(1.0, 400.0, "km/h"), Meaning("first breakpoint")] = 20.0
    speed_max_km_h: Annotated[float, Range(1.0, 400.0, "km/h"), Meaning("last breakpoint")] = 120.0
    speed_points: Annotated[int, Meaning("number of breakpoints")] = Field(default=101, ge=2, le=MAX_BREAKPOINTS)
    speed_breakpoints_km_h: Annotated[
        list[float] | None, Breakpoints(1.0, 400.0, "km/h"), Meaning("list of breakpoints, instead of the three keys above")
    ] = None
    front_angle_min_deg: Annotated[float, Range(0.01, 45.0, "deg"), Meaning("at the road wheel")] = 0.1
    front_angle_max_deg: Annotated[float, Range(0.5, 45.0, "deg"), Meaning("last breakpoint")] = 10.0
    front_angle_points: Annotated[int, Meaning("number of breakpoints")] = Field(default=100, ge=2, le=MAX_BREAKPOINTS)
    front_angle_breakpoints_deg: Annotated[
        list[float] | None, Breakpoints(0.01, 45.0, "deg"), Meaning("list of breakpoints, instead of the three keys above")
    ] = None

    @property
    def speed_ends_km_h(self) -> tuple[float, float]:
        """First and last breakpoint of the speed axis, in km/h."""
        listed = self.speed_breakpoints_km_h
        return (listed[0], listed[-1]) if listed else (self.speed_min_km_h, self.speed_max_km_h)

    @property
    def first_speed_km_h(self) -> float:
        """First breakpoint of the speed axis, in km/h."""
        return self.speed_ends_km_h[0]

    @property
    def last_speed_km_h(self) -> float:
        """Last breakpoint of the speed axis, in km/h."""
        return self.speed_ends_km_h[1]

    @property
    def front_angle_ends_deg(self) -> tuple[float, float]:
        """First and last breakpoint of the front angle axis, in deg."""
        listed = self.front_angle_breakpoints_deg
        return (listed[0], listed[-1]) if listed else (self.front_angle_min_deg, self.front_angle_max_deg)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.speed_min_km_h >= self.speed_max_km_h:
            raise ValueError("speed_min_km_h must be below speed_max_km_h")
        if self.front_angle_min_deg >= self.front_angle_max_deg:
            raise ValueError("front_angle_min_deg must be below front_angle_max_deg")
        speeds, angles = self.speed_breakpoints_km_h, self.front_angle_breakpoints_deg
        cells = (len(speeds) if speeds else self.speed_points) * (len(angles) if angles else self.front_angle_points)
        if cells > MAX_CELLS:
            raise ValueError(f"{cells} cells are too many for one map; use fewer breakpoints, at most {MAX_CELLS} cells")
        return self


class Longitudinal(Section):
    """Distribution of brake and drive forces, for `codegen solve --longitudinal-acceleration`.

    By default the front axle brakes with 65 %. The front axle of the preset's car then reaches its grip before the rear axle
    at all decelerations up to 0.8 g, as UN Regulation 13-H (annex 5) requires. The drive force is shared equally.
    """

    brake_front_share: Annotated[float, Range(0.0, 1.0), Meaning("share of the brake force on the front axle")] = 0.65
    drive_front_share: Annotated[float, Range(0.0, 1.0), Meaning("share of the drive force on the front axle")] = 0.5


class Steering(Section):
    """Front steering: from the driver's hands to the road wheels."""

    ratio: Annotated[float, Range(1.0, 40.0), Meaning("steering wheel over road wheel: 13.3 turns 90 deg into 6.75 deg")]
    wheel_rate_max_deg_s: Annotated[
        float, Range(10.0, 3_000.0, "deg/s"), Meaning("largest rate at which the driver turns the steering wheel")
    ] = 300.0
    lag_s: Annotated[float, Range(0.002, 1.0, "s"), Meaning("from the steering wheel to the road wheels, first order")] = 0.005
    front_angle_stop_deg: Annotated[
        float, Range(1.0, 60.0, "deg"), Meaning("mechanical stop at the road wheel; the map is extended up to it")
    ]

    @property
    def front_angle_stop(self) -> float:
        """Mechanical stop in rad at the road wheel."""
        return math.radians(self.front_angle_stop_deg)


class RearActuator(Section):
    """The rear-steering actuator: its limits, its model in the plant (first-order lag, rate limit), and its reaction to missing
    commands: it holds the last one or returns to zero.

    The task reports it as stuck where the measured angle differs from the lagged command by more than `stuck_error_deg` for
    `stuck_time_s`. "from-actuator" means a tenth of the largest angle, and the time from one stop to the other at the largest
    rate plus ten lags.
    """

    angle_max_deg: Annotated[float, Range(0.1, 20.0, "deg"), Meaning("largest angle of the actuator")]
    rate_max_deg_s: Annotated[float, Range(1.0, 500.0, "deg/s"), Meaning("largest rate of the actuator")]
    lag_s: Annotated[float, Range(0.002, 1.0, "s"), Meaning("first order")]
    on_command_loss: Annotated[
        Literal["hold", "return"],
        Meaning('reaction to missing commands: "hold", or "return" to zero (which can make the car spin)'),
    ] = "hold"
    command_loss_samples_max: Annotated[int, Meaning("missing commands that are bridged by holding in either case")] = Field(
        default=3, ge=0, le=1_000
    )
    return_rate_deg_s: Annotated[float, Range(0.1, 500.0, "deg/s"), Meaning('for "return"')] = 5.0
    stuck_error_deg: Annotated[
        Annotated[float, Range(0.05, 20.0, "deg")] | Literal["from-actuator"],
        Meaning("difference from the lagged command at which the actuator counts as stuck"),
    ] = "from-actuator"
    stuck_time_s: Annotated[
        Annotated[float, Range(0.01, 10.0, "s")] | Literal["from-actuator"],
        Meaning("after this time"),
    ] = "from-actuator"

    @property
    def angle_max(self) -> float:
        """Largest angle in rad."""
        return math.radians(self.angle_max_deg)

    @property
    def tolerated_error_deg(self) -> float:
        """Difference in deg from the lagged command that is not yet an error."""
        return 0.1 * self.angle_max_deg if isinstance(self.stuck_error_deg, str) else self.stuck_error_deg


def _is_zero(value: float) -> bool:
    return value == 0.0


class Plant(Section):
    """The simulated car."""

    sampling_time_s: Annotated[
        float,
        Range(1e-5, 0.01, "s"),
        Meaning("time step of the plant; the controller's sampling time must be a whole multiple"),
    ] = 0.001
    load_transfer: Annotated[
        Literal["moment-balance", "paper"], Meaning('or "paper": the printed formula, which gives half the transfer')
    ] = "moment-balance"
    relaxation_length_m: Annotated[
        float, RangeOrZero(0.05, 2.0, "m"), Meaning("of all tyres; 0: the force follows the slip without delay")
    ] = 0.0
    # The keys that follow are omitted where they are not used, so that maps and builds of the ideal car do not change.
    rear_relaxation_factor: Annotated[
        float, Range(0.2, 5.0), Meaning("relaxation length of the rear tyres over relaxation_length_m")
    ] = Field(default=1.0, exclude_if=lambda factor: factor == 1.0)
    slippery_stiffness_share: Annotated[
        float,
        Range(0.0, 1.0),
        Meaning("on a slippery road: 0: B is kept, and the stiffness falls with the friction; 1: only the peak falls"),
    ] = Field(default=0.0, exclude_if=_is_zero)
    roll_deg_per_g: Annotated[
        float, RangeOrZero(0.1, 15.0, "deg/g"), Meaning("steady roll angle for each g of lateral acceleration; 0: no roll")
    ] = Field(default=0.0, exclude_if=_is_zero)
    actuator_motor_share: Annotated[
        float,
        RangeOrZero(0.05, 1.0),
        Meaning("time constant of the rate of the rear actuator's motor over lag_s; 0: actuator of first order"),
    ] = Field(default=0.0, exclude_if=_is_zero)
    backlash_deg: Annotated[
        float, Range(0.0, 2.0, "deg"), Meaning("play between the motor of the rear actuator, which is measured, and the wheels")
    ] = Field(default=0.0, exclude_if=_is_zero)
    command_delay_samples: Annotated[
        int,
        Meaning("control samples between the computation of a command and its effect"),
    ] = Field(default=0, ge=0, le=20)


class Sensor(Section):
    """Keys of every sensor; subclasses add noise, resolution and bias in their unit."""

    delay_samples: Annotated[int, Field(ge=0, le=100)] = 0

    @property
    @abstractmethod
    def noise(self) -> float:
        """Standard deviation, SI unit."""

    @property
    @abstractmethod
    def resolution(self) -> float:
        """Step between two values, SI unit; 0 if the sensor has none."""

    @property
    @abstractmethod
    def bias(self) -> float:
        """Constant error, SI unit."""


class SpeedSensor(Sensor):
    """Speed of the car."""

    noise_km_h: Annotated[float, Range(0.0, 20.0, "km/h")] = 0.1
    resolution_km_h: Annotated[float, Range(0.0, 20.0, "km/h")] = 0.05
    bias_km_h: Annotated[float, Range(-20.0, 20.0, "km/h")] = Field(default=0.0, exclude_if=_is_zero)

    @property
    def noise(self) -> float:
        """Standard deviation in m/s."""
        return self.noise_km_h * KM_H

    @property
    def resolution(self) -> float:
        """Step between two values in m/s."""
        return self.resolution_km_h * KM_H

    @property
    def bias(self) -> float:
        """Constant error in m/s."""
        return self.bias_km_h * KM_H


class AngleSensor(Sensor):
    """An angle at the road wheels."""

    noise_deg: Annotated[float, Range(0.0, 5.0, "deg")] = 0.01
    resolution_deg: Annotated[float, Range(0.0, 5.0, "deg")] = 0.01
    bias_deg: Annotated[float, Range(-5.0, 5.0, "deg")] = Field(default=0.0, exclude_if=_is_zero)

    @property
    def noise(self) -> float:
        """Standard deviation in rad."""
        return math.radians(self.noise_deg)

    @property
    def resolution(self) -> float:
        """Step between two values in rad."""
        return math.radians(self.resolution_deg)

    @property
    def bias(self) -> float:
        """Constant error in rad."""
        return math.radians(self.bias_deg)


class YawRateSensor(Sensor):
    """The gyroscope."""

    delay_samples: Annotated[int, Field(ge=0, le=100)] = 1
    noise_deg_s: Annotated[float, Range(0.0, 20.0, "deg/s")] = 0.1
    resolution_deg_s: Annotated[float, Range(0.0, 20.0, "deg/s")] = 0.05
    bias_deg_s: Annotated[float, Range(-20.0, 20.0, "deg/s")] = Field(default=0.0, exclude_if=_is_zero)

    @property
    def noise(self) -> float:
        """Standard deviation in rad/s."""
        return math.radians(self.noise_deg_s)

    @property
    def resolution(self) -> float:
        """Step between two values in rad/s."""
        return math.radians(self.resolution_deg_s)

    @property
    def bias(self) -> float:
        """Constant error in rad/s."""
        return math.radians(self.bias_deg_s)


class AccelerationSensor(Sensor):
    """The accelerometer."""

    noise_m_s2: Annotated[float, Range(0.0, 5.0, "m/s^2")] = 0.05
    resolution_m_s2: Annotated[float, Range(0.0, 5.0, "m/s^2")] = 0.01
    bias_m_s2: Annotated[float, Range(-5.0, 5.0, "m/s^2")] = Field(default=0.0, exclude_if=_is_zero)

    @property
    def noise(self) -> float:
        """Standard deviation in m/s^2."""
        return self.noise_m_s2

    @property
    def resolution(self) -> float:
        """Step between two values in m/s^2."""
        return self.resolution_m_s2

    @property
    def bias(self) -> float:
        """Constant error in m/s^2."""
        return self.bias_m_s2


class Sensors(Section):
    """The sensors of the bench. The defaults are examples; use the data sheets of your sensors."""

    speed: Annotated[
        SpeedSensor,
        Meaning(
            "noise: standard deviation; resolution: step between values, 0 for none; delay: samples of the controller; "
            "bias: constant error"
        ),
    ] = SpeedSensor()
    front_angle: Annotated[AngleSensor, Meaning("the same, at the road wheels")] = AngleSensor()
    yaw_rate: Annotated[YawRateSensor, Meaning("the same, of the gyroscope")] = YawRateSensor()
    rear_angle: Annotated[AngleSensor, Meaning("the same, of the actuator")] = AngleSensor()
    lateral_acceleration: Annotated[AccelerationSensor, Meaning("the same, of the accelerometer")] = AccelerationSensor()

"""The tables of `ars.toml` about the controller: its kinds, its gains, its inputs, and the limiter behind it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from codegen.configuration.section import Breakpoints, Meaning, NotEmpty, Range, RangeOrZero, Section

SCHEDULE_POINTS_MAX = 32
SPEED_MAX_LEAST_KM_H = 50.0
"""Smallest value of `inputs.speed_max_km_h`."""
DEGRADED_TIME_MAX_S, RECOVERY_SAMPLES_MAX = 1.0, 4_000
"""Beyond these limits the fail-safe would almost never act, or never end."""
PROPORTIONAL_GAIN_MAX_S, INTEGRAL_GAIN_MIN, INTEGRAL_GAIN_MAX = 2.0, 0.01, 20.0
"""Without an integral part the car does not reach the map; above the upper limits no loop with a rear actuator is stable."""
LEAD_MAX_S, RESPONSE_GAIN_MAX_S, RESPONSE_AHEAD_MAX_S = 0.2, 2.0, 1.0
"""Upper limits of lead, response gain and look-ahead. A negative lead delays the feedforward."""
RESPONSE_AHEAD_FACTORS = (1.0, 1.35, 1.75, 2.5)
"""Multiples of the actuator's lag plus one sample that `codegen tune` tries for `response_ahead_s`. It uses the first with
which the configured car keeps its limits; a slow actuator or a strongly understeering car needs more."""
REAR_RATE_MIN_DEG_S = 1.0
"""At slower rates the rear wheels have no effect in a manoeuvre."""
TRIM_MAX_PERCENT = 20.0
"""Largest trim, in percent of the map's yaw rate."""

Kind = Literal["tracking", "pi", "feedforward", "proportional"]
"""Kinds of controller; `emit.laws` chooses their parameters and templates."""


class Inputs(Section):
    """Ranges of accepted measurements, and substitutes for the others.

    Each measurement has a range and a largest rate of change. A yaw rate is accepted up to the limit of the road plus a
    tolerance. It counts as frozen if its bits do not change while the expected yaw rate moves away from it. The expected yaw
    rate is that of the reference model; for kinds without one, and for slow cars, that of the linear car. A rejected signal is
    accepted again once it agrees with the others. yaw_rate_lag_s is the lag of the linear car's yaw rate behind the front
    angle. friction_recovery_1_s is the rate at which a lost friction estimate is forgotten. The offsets of yaw rate and
    lateral acceleration are learned from each other on straights, and slowly where both show the same, with the time constant
    yaw_rate_correction_time_s; that of the acceleration in turns too, where a banked road changes it; both up to their limits.
    A difference to the expected yaw rate above yaw_rate_offset_max_deg_s is a disturbance and is not learned. That time
    constant also applies to the substitute of a yaw rate. A road counts as straight while the front wheels alone cause at most
    straight_yaw_rate_deg_s.
    """

    speed_max_km_h: Annotated[
        float, Range(SPEED_MAX_LEAST_KM_H, 500.0, "km/h"), Meaning("largest valid speed in either direction")
    ] = 400.0
    front_angle_max_deg: Annotated[float, Range(10.0, 60.0, "deg"), Meaning("largest valid angle to either side")] = 45.0
    yaw_rate_max_deg_s: Annotated[float, Range(25.0, 600.0, "deg/s"), Meaning("largest valid yaw rate to either side")] = 150.0
    rear_angle_max_deg: Annotated[
        Annotated[float, Range(0.1, 45.0, "deg")] | Literal["from-actuator"],
        Meaning('largest valid angle to either side; "from-actuator" adds the tolerated error to its largest angle'),
    ] = "from-actuator"
    friction_max: Annotated[float, Range(0.5, 2.0), Meaning("largest valid friction estimate")] = 1.5
    yaw_rate_tolerance_deg_s: Annotated[
        float, Range(5.0, 180.0, "deg/s"), Meaning("beyond lateral_acceleration_max_m_s2 / speed")
    ] = 30.0
    lateral_acceleration_max_m_s2: Annotated[
        float, Range(3.0, 100.0, "m/s^2"), Meaning("limit of the road on speed times yaw rate")
    ] = 12.0
    acceleration_max_m_s2: Annotated[
        float, Range(12.0, 1_000.0, "m/s^2"), Meaning("largest valid rate of change of the speed")
    ] = 50.0
    front_angle_rate_max_deg_s: Annotated[
        float, Range(60.0, 5_000.0, "deg/s"), Meaning("largest valid rate of change of the front angle")
    ] = 100.0
    yaw_acceleration_max_deg_s2: Annotated[
        float, Range(200.0, 100_000.0, "deg/s^2"), Meaning("largest valid rate of change of the yaw rate")
    ] = 570.0
    yaw_rate_frozen_deg_s: Annotated[
        float,
        Range(0.5, 600.0, "deg/s"),
        Meaning("tolerated divergence of measured and expected yaw rate while yaw rate or front angle is frozen"),
    ] = 3.0
    yaw_rate_lag_s: Annotated[
        float, Range(0.01, 2.0, "s"), Meaning("lag of the linear car's yaw rate behind the front angle")
    ] = 0.15
    speed_agreement_km_h: Annotated[
        float,
        Range(0.1, 100.0, "km/h"),
        Meaning("a rejected speed is accepted again within this plus a quarter of its substitute"),
    ] = 3.6
    yaw_rate_agreement_deg_s: Annotated[
        float,
        Range(0.1, 10.0, "deg/s"),
        Meaning("a rejected front angle or yaw rate is accepted again within this, in a turn of over twice that"),
    ] = 1.7
    straight_yaw_rate_deg_s: Annotated[
        float, Range(0.0, 10.0, "deg/s"), Meaning("largest yaw rate from the front wheels alone that counts as a straight")
    ] = 0.3
    yaw_rate_offset_max_deg_s: Annotated[
        float, Range(0.0, 10.0, "deg/s"), Meaning("largest learned offset of the yaw rate")
    ] = 0.5
    lateral_acceleration_offset_max_m_s2: Annotated[
        float,
        Range(0.0, 10.0, "m/s^2"),
        Meaning("largest learned offset of the lateral acceleration, of the sensor or of a banked road"),
    ] = 0.8
    yaw_rate_correction_time_s: Annotated[
        float, Range(0.1, 1_000.0, "s"), Meaning("time constant of the learned offsets, and of a substitute yaw rate")
    ] = 1.0
    speed_fall_m_s2: Annotated[float, Range(0.0, 20.0, "m/s^2"), Meaning("assumed deceleration of a lost speed")] = 0.5
    friction_recovery_1_s: Annotated[
        float, Range(0.001, 10.0, "1/s"), Meaning("rate at which a lost estimate is forgotten")
    ] = 0.1
    longitudinal_acceleration_max_m_s2: Annotated[
        float,
        Range(1.0, 20.0, "m/s^2"),
        Meaning("largest valid braking or traction, for a map with a stack over longitudinal acceleration"),
    ] = Field(default=12.0, exclude_if=lambda largest: largest == 12.0)
    longitudinal_acceleration_loss_m_s3: Annotated[
        float,
        Range(0.01, 100.0, "m/s^3"),
        Meaning("rate at which a lost longitudinal acceleration moves to the strongest braking of the stack"),
    ] = Field(default=2.0, exclude_if=lambda rate: rate == 2.0)


class FailSafe(Section):
    """Number of samples that inputs may be missing, number of good samples that end the fail-safe, and rate at which the rear
    angle returns to zero."""

    degraded_samples_max: Annotated[
        int, Meaning("missing samples minus twice the good ones that are predicted before a signal is replaced")
    ] = Field(default=3, ge=0, le=1_000)
    recovery_samples: Annotated[
        int,
        Meaning("good samples minus missing ones that end it; lost frames count until their message is valid again (can.e2e)"),
    ] = Field(default=10, ge=1, le=RECOVERY_SAMPLES_MAX)
    rate_deg_s: Annotated[float, Range(0.2, 100.0, "deg/s"), Meaning("rate of the ramp to zero")] = 3.0


def _is_none(value: object) -> bool:
    return value is None


class Schedule(Section):
    """Gains of the kind "tracking" over speed, and their design margins over the family of cars.

    `codegen tune` writes this table. The gains are interpolated between breakpoints and constant beyond them. The margins are
    for information only: the smallest of the family at each breakpoint.
    """

    speed_km_h: Annotated[list[float], Breakpoints(1.0, 500.0, "km/h"), Meaning("breakpoints of the gains, at most 32")]
    proportional_gain_s: Annotated[
        list[Annotated[float, Range(0.0, PROPORTIONAL_GAIN_MAX_S, "s (rad of rear angle for each rad/s of error)")]],
        Meaning("Kp at each breakpoint"),
    ]
    integral_gain: Annotated[
        list[
            Annotated[
                float, Range(INTEGRAL_GAIN_MIN, INTEGRAL_GAIN_MAX, "(rad of rear angle for each rad of integrated error)")
            ]
        ],
        Meaning("Ki at each breakpoint"),
    ]
    # Omitted where not tuned: then `controller.tracking.lead_s` applies at all speeds, without response gain.
    lead_s: Annotated[
        list[Annotated[float, Range(-LEAD_MAX_S, LEAD_MAX_S, "s")]] | None,
        Meaning("lead of the front angle at each breakpoint"),
    ] = Field(default=None, exclude_if=_is_none)
    response_gain_s: Annotated[
        list[Annotated[float, Range(0.0, RESPONSE_GAIN_MAX_S, "s (rad of rear angle for each rad/s that the model lacks)")]]
        | None,
        Meaning("rad of rear angle for each rad/s that the model lacks, at each breakpoint"),
    ] = Field(default=None, exclude_if=_is_none)
    gain_margin_db: Annotated[
        list[float] | None, Meaning("smallest gain margin of the family, from `codegen tune`; for information")
    ] = None
    phase_margin_deg: Annotated[
        list[float] | None, Meaning("smallest phase margin of the family, from `codegen tune`; for information")
    ] = None
    sensitivity: Annotated[
        list[float] | None, Meaning("largest peak of the sensitivity in the family, from `codegen tune`; for information")
    ] = None

    @model_validator(mode="after")
    def _one_length(self) -> Self:
        points = len(self.speed_km_h)
        if points > SCHEDULE_POINTS_MAX:
            raise ValueError(f"{points} breakpoints; at most {SCHEDULE_POINTS_MAX} are supported")
        for name in type(self).model_fields:
            values = getattr(self, name)
            if values is not None and len(values) != points:
                raise ValueError(f"{name} has {len(values)} values for {points} speeds; give one for each speed")
        return self


_TRACKING_PAIRS: Mapping[str, tuple[str, int]] = {
    "yaw_increasing_wide_deg": ("yaw_increasing_max_deg", 1),
    "grip_recovery_idle_m_s3": ("grip_recovery_m_s3", 1),
}
_TUNING_PAIRS: Mapping[str, tuple[str, int]] = {
    "slow_gain_margin_db": ("gain_margin_db", -1),
    "slow_phase_margin_deg": ("phase_margin_deg", -1),
    "slow_sensitivity_max": ("sensitivity_max", 1),
}
"""Key -> key that it must not be stricter than, and the sign of the looser direction: 1 is upwards."""


def _with_looser(model: type[Section], data: Any, pairs: Mapping[str, tuple[str, int]]) -> Any:
    """Return the data of a table; a file without a key of `pairs`, like older ones, has the other value if that is looser."""
    if not isinstance(data, Mapping):
        return data
    numbers = {key: value for key, value in data.items() if isinstance(value, int | float)}
    looser = {
        key: numbers[other]
        for key, (other, sign) in pairs.items()
        if key not in data and other in numbers and sign * numbers[other] > sign * model.model_fields[key].default
    }
    return {**data, **looser}


def _require_looser(table: Section, pairs: Mapping[str, tuple[str, int]]) -> None:
    """Raise ValueError for a key of `pairs` that is stricter than the other."""
    for key, (other, sign) in pairs.items():
        value, least = getattr(table, key), getattr(table, other)
        if sign * value < sign * least:
            side, change, most = ("below", "raise", "at least") if sign > 0 else ("above", "lower", "at most")
            raise ValueError(f"{key} is {value:g}, {side} {other}; {change} it to {most} {least:g}")


class Tracking(Section):
    """The kind "tracking": feedforward of the map, a reference model, and scheduled PI feedback of bounded authority.

    `lead_s` predicts the front angle that enters the map, unless the schedule has a lead for each speed. `response_ahead_s`
    predicts the model's yaw rate for the response gain of the schedule. `yaw_increasing_max_deg` and
    `yaw_increasing_wide_deg` limit feedback that increases the yaw rate; in the other direction feedback is free up to the
    limits of the actuator and of the rear tyres. The trim moves the model's yaw rate towards the map's. The turn_margin_* and
    grip_* keys limit the yaw rate by the lateral acceleration that the car reaches.
    """

    lead_s: Annotated[
        float,
        Range(-LEAD_MAX_S, LEAD_MAX_S, "s"),
        Meaning("look-ahead of the front angle that enters the map, unless the schedule has a lead"),
    ] = 0.032
    lead_smoothing_s: Annotated[
        float, Range(0.002, 0.2, "s"), Meaning("time constant of the front angle's rate, against the noise of its sensor")
    ] = 0.015
    lead_max_deg: Annotated[float, Range(0.0, 10.0, "deg"), Meaning("bound of this look-ahead")] = 1.5
    response_ahead_s: Annotated[
        float, Range(0.0, RESPONSE_AHEAD_MAX_S, "s"), Meaning("look-ahead of the model's yaw rate for the response gain")
    ] = 0.06
    yaw_increasing_max_deg: Annotated[
        float, Range(0.0, 20.0, "deg"), Meaning("limit of feedback that increases the yaw rate; the other direction is free")
    ] = 1.0
    yaw_increasing_wide_deg: Annotated[
        float, Range(0.0, 20.0, "deg"), Meaning("the same limit without sideslip out of the turn, at least as large")
    ] = 2.5
    sideslip_max_deg: Annotated[
        float,
        Range(0.5, 20.0, "deg"),
        Meaning("sideslip out of the turn at which only yaw_increasing_max_deg is left, and beyond which the reference falls"),
    ] = 3.0
    turn_margin_deg_s: Annotated[
        float, Range(0.0, 20.0, "deg/s"), Meaning("by which the reference may exceed the turn of the lateral acceleration")
    ] = 0.5
    turn_margin_m_s2: Annotated[
        float, Range(0.0, 10.0, "m/s^2"), Meaning("smallest such margin, against noise and offset of the acceleration")
    ] = 0.1
    trim_max_percent: Annotated[
        float,
        Range(0.0, TRIM_MAX_PERCENT, "%"),
        Meaning("largest correction of the model's yaw rate towards the map's, in percent of the map's yaw rate"),
    ] = 1.0
    trim_time_s: Annotated[float, Range(0.05, 60.0, "s"), Meaning("time constant of this correction")] = 1.0
    grip_shortfall_m_s2: Annotated[
        float, Range(0.1, 20.0, "m/s^2"), Meaning("shortfall of lateral acceleration that does not count as a loss of grip")
    ] = 0.4
    grip_shortfall_share: Annotated[
        float, Range(0.0, 1.0), Meaning("share of the model's acceleration that is added to it while little grip is used")
    ] = 0.25
    grip_loss_time_s: Annotated[
        float, Range(0.02, 10.0, "s"), Meaning("time constant with which the assumed grip follows a larger shortfall")
    ] = 0.05
    grip_memory_s: Annotated[
        float,
        Range(0.05, 60.0, "s"),
        Meaning("time for which a reached lateral acceleration counts; the assumed grip is never below it"),
    ] = 3.0
    grip_recovery_m_s3: Annotated[
        float, Range(0.01, 100.0, "m/s^3"), Meaning("rate at which the assumed grip recovers in a turn")
    ] = 0.5
    grip_recovery_idle_m_s3: Annotated[
        float, Range(0.01, 100.0, "m/s^3"), Meaning("rate while less than half of that grip is demanded")
    ] = 4.0
    schedule: Schedule | None = None

    @model_validator(mode="before")
    @classmethod
    def _older_files(cls, data: Any) -> Any:
        return _with_looser(cls, data, _TRACKING_PAIRS)

    @model_validator(mode="after")
    def _wide_enough(self) -> Self:
        _require_looser(self, _TRACKING_PAIRS)
        return self


class Tuning(Section):
    """The family of cars for which `codegen tune` designs the gains, and the margins that each must keep.

    All combinations of the listed deviations are members. Lags, masses and stiffnesses are relative to the configured car. The
    stiffnesses of front and rear axle vary independently, and the yaw inertia changes in proportion to the mass. Deviations
    with an uncertainty in `[identified]` come from there instead.

    The speeds are followed up to the top speed of the car. If they end below it, further ones are inserted up to there.
    `actuator_lag_s` belongs to older files and maps, in which the lags do not follow the car.
    """

    speed_km_h: Annotated[
        list[float],
        Breakpoints(1.0, 500.0, "km/h"),
        Meaning("speeds for which the gains are designed"),
    ] = Field(default_factory=lambda: [15.0, 20.0, 30.0, 42.5, 60.0, 80.0, 100.0, 120.0])
    # One of the two is None, and omitted.
    actuator_lag_factor: Annotated[
        Annotated[list[Annotated[float, Range(0.05, 20.0)]], NotEmpty()] | None,
        Meaning("lags of the rear actuator, as factors of `rear_actuator.lag_s`"),
    ] = Field(default_factory=lambda: [0.4, 1.0, 2.0], exclude_if=_is_none)
    actuator_lag_s: Annotated[
        Annotated[list[Annotated[float, Range(0.002, 1.0, "s")]], NotEmpty()] | None,
        Meaning("lags in s instead, as older files have them"),
    ] = Field(default=None, exclude_if=_is_none)
    mass_percent: Annotated[
        list[Annotated[float, Range(-50.0, 100.0, "%")]],
        NotEmpty(),
        Meaning("deviations of mass and yaw inertia"),
    ] = Field(default_factory=lambda: [-20.0, 0.0, 20.0])
    stiffness_percent: Annotated[
        list[Annotated[float, Range(-60.0, 100.0, "%")]], NotEmpty(), Meaning("of front and rear tyres, independently")
    ] = Field(default_factory=lambda: [-20.0, 0.0, 15.0])
    relaxation_length_m: Annotated[
        list[Annotated[float, RangeOrZero(0.05, 2.0, "m")]],
        NotEmpty(),
        Meaning("relaxation lengths of all tyres"),
    ] = Field(default_factory=lambda: [0.0, 0.3, 0.6])
    delay_samples: Annotated[
        int, Meaning("between the computation of a command and its effect; at least `plant.command_delay_samples` is used")
    ] = Field(default=1, ge=0, le=20)
    gain_margin_db: Annotated[float, Range(1.0, 40.0, "dB"), Meaning("minimum for every member but slow ones")] = 8.0
    phase_margin_deg: Annotated[float, Range(5.0, 89.0, "deg"), Meaning("minimum for every member but slow ones")] = 45.0
    sensitivity_max: Annotated[
        float, Range(1.05, 10.0), Meaning("largest peak of the sensitivity of any member but slow ones")
    ] = 1.8
    # Left out of files that do not set them, so that existing maps and builds do not change.
    slow_gain_margin_db: Annotated[
        float,
        Range(1.0, 40.0, "dB"),
        Meaning("smallest gain margin of a slow member: at least twice the lag *and* a relaxation length"),
    ] = Field(default=6.0, exclude_if=lambda value: value == 6.0)
    slow_phase_margin_deg: Annotated[float, Range(5.0, 89.0, "deg"), Meaning("smallest phase margin of a slow member")] = Field(
        default=35.0, exclude_if=lambda value: value == 35.0
    )
    slow_sensitivity_max: Annotated[float, Range(1.05, 10.0), Meaning("largest peak of the sensitivity of a slow member")] = (
        Field(default=2.1, exclude_if=lambda value: value == 2.1)
    )

    @model_validator(mode="before")
    @classmethod
    def _one_of_the_lags(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or data.get("actuator_lag_s") is None:
            return data
        if data.get("actuator_lag_factor") is not None:
            raise ValueError("actuator_lag_factor and actuator_lag_s exclude each other; remove actuator_lag_s")
        return {**data, "actuator_lag_factor": None}

    @model_validator(mode="before")
    @classmethod
    def _older_files(cls, data: Any) -> Any:
        return _with_looser(cls, data, _TUNING_PAIRS)

    @model_validator(mode="after")
    def _has_lags(self) -> Self:
        if self.actuator_lag_factor is None and self.actuator_lag_s is None:
            raise ValueError("no lags of the rear actuator; give actuator_lag_factor")
        _require_looser(self, _TUNING_PAIRS)
        return self


class Controller(Section):
    """The yaw-rate controller. The paper's PI is kind "pi"; proportional_gain_s and integral_gain are its gains."""

    kind: Annotated[Kind, Meaning("control law, see [Controllers](controllers.md)")] = "tracking"
    proportional_gain_s: Annotated[
        float,
        Range(0.0, PROPORTIONAL_GAIN_MAX_S, "s (rad of rear angle for each rad/s of error)"),
        Meaning("Kp of kind `pi`: rad of rear angle for each rad/s of yaw-rate error"),
    ] = 0.01
    integral_gain: Annotated[
        float,
        Range(INTEGRAL_GAIN_MIN, INTEGRAL_GAIN_MAX, "(rad of rear angle for each rad of integrated error)"),
        Meaning("Ki of kind `pi`: rad of rear angle for each rad of integrated error"),
    ] = 1.0
    sampling_time_s: Annotated[float, Range(0.001, 0.1, "s"), Meaning("period of the task and of all three messages")] = 0.01
    rear_rate_max_deg_s: Annotated[
        Annotated[float, Range(REAR_RATE_MIN_DEG_S, 500.0, "deg/s")] | Literal["off"],
        Meaning('limit on the rate of the command, or `"off"` as in the paper'),
    ] = 25.0
    rear_angle_error_max_deg: Annotated[
        float, Range(0.1, 20.0, "deg"), Meaning("anti-windup: largest lead of the command over the measured rear angle")
    ] = 2.0
    friction_min: Annotated[float, Range(0.02, 0.5), Meaning("lower friction estimates are raised to this value")] = 0.1
    enable_speed_km_h: Annotated[
        float, Range(0.5, 100.0, "km/h"), Meaning("kind `pi`: control starts at this speed; reverse is always standby")
    ] = 15.0
    disable_speed_km_h: Annotated[float, Range(0.1, 100.0, "km/h"), Meaning("kind `pi`: control ends below this speed")] = 12.0
    standby_rate_deg_s: Annotated[
        float, Range(0.2, 100.0, "deg/s"), Meaning("kind `pi`: rate at which the rear wheels return to zero in standby")
    ] = 5.0
    # Left out of files that do not set them, so that existing maps and builds do not change.
    slow_speed_km_h: Annotated[
        float,
        Range(2.0, 50.0, "km/h"),
        Meaning("other kinds: no feedback up to this speed and in reverse; whole from twice this speed on"),
    ] = Field(default=7.5, exclude_if=lambda speed: speed == 7.5)
    fade_distance_m: Annotated[
        float,
        Range(0.5, 50.0, "m"),
        Meaning("other kinds: least distance that a slow car drives while its rear wheels turn from straight to their limit"),
    ] = Field(default=4.0, exclude_if=lambda distance: distance == 4.0)
    inhibit_time_s: Annotated[
        float,
        Range(0.5, 300.0, "s"),
        Meaning("Inhibit that is set for longer counts as permanent: STANDBY, the rear wheels return to zero"),
    ] = Field(default=10.0, exclude_if=lambda time: time == 10.0)
    tracking: Tracking = Tracking()
    inputs: Inputs = Inputs()
    fail_safe: FailSafe = FailSafe()

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        samples_max = self.fail_safe.degraded_samples_max
        if self.disable_speed_km_h >= self.enable_speed_km_h:
            raise ValueError("disable_speed_km_h must be below enable_speed_km_h")
        if samples_max * self.sampling_time_s > DEGRADED_TIME_MAX_S:
            raise ValueError(
                f"fail_safe.degraded_samples_max is {samples_max * self.sampling_time_s:g} s without a sample; "
                f"at most {DEGRADED_TIME_MAX_S:g} s"
            )
        return self

    @property
    def waits_for_speed(self) -> bool:
        """Whether control is off at low speed and in reverse, as in the paper; the other kinds run from standstill."""
        return self.kind == "pi"

    @property
    def feedback_speeds_km_h(self) -> tuple[float, float]:
        """Speeds at which feedback ends, and from which it is whole, in km/h."""
        if self.waits_for_speed:
            return self.disable_speed_km_h, self.enable_speed_km_h
        return self.slow_speed_km_h, 2.0 * self.slow_speed_km_h


class Limiter(Section):
    """The safety limiter, last in the chain for every controller: limits of angle, rate, and opposite-phase angle.

    In opposite phase, front and rear wheels turn to different sides and the car turns more, so this limit falls with speed. In
    phase, the whole angle is free once the front wheels are turned by `in_phase_from_front_angle_deg`. With the front wheels
    straight ahead, the opposite-phase limit applies to both sides. "from-car" derives the limit from the linear car: the rear
    angle that alone causes the lateral acceleration a = `opposite_phase_lateral_acceleration_m_s2`, which is
    a (L + K vx^2) / vx^2. The speeds "from-car" begin where that angle equals the actuator's limit; below, the whole angle is
    free.
    """

    rear_rate_max_deg_s: Annotated[
        Annotated[float, Range(REAR_RATE_MIN_DEG_S, 500.0, "deg/s")] | Literal["off"],
        Meaning("at most the rate of the actuator"),
    ] = 30.0
    opposite_phase_speed_km_h: Annotated[
        Annotated[list[float], Breakpoints(1.0, 500.0, "km/h")] | Literal["from-car"],
        Meaning('breakpoints of the next key, or `"from-car"` to derive them from the car'),
    ] = "from-car"
    opposite_phase_max_deg: Annotated[
        list[Annotated[float, Range(0.0, 20.0, "deg")]] | Literal["from-car", "off"],
        Meaning('or a list, one for each of opposite_phase_speed_km_h = [...]; or "from-car", with'),
    ] = "from-car"
    opposite_phase_lateral_acceleration_m_s2: Annotated[float, Range(0.5, 10.0, "m/s^2"), Meaning("for `from-car`")] = 4.0
    in_phase_from_front_angle_deg: Annotated[
        float, Range(0.05, 20.0, "deg"), Meaning("front angle from which the whole rear angle is free in phase")
    ] = 1.0

    @model_validator(mode="after")
    def _one_length(self) -> Self:
        speeds, angles = self.opposite_phase_speed_km_h, self.opposite_phase_max_deg
        if isinstance(speeds, str):
            if not isinstance(angles, str):
                raise ValueError(
                    "opposite_phase_max_deg is a list; give opposite_phase_speed_km_h as a list of the same length"
                )
        elif not isinstance(angles, str) and len(angles) != len(speeds):
            raise ValueError(
                f"opposite_phase_max_deg has {len(angles)} values for {len(speeds)} speeds; give one for each speed"
            )
        return self

    @property
    def in_phase_from_front_angle(self) -> float:
        """Front angle in rad from which the whole angle is free in phase."""
        return math.radians(self.in_phase_from_front_angle_deg)

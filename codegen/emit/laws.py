"""Table of the kinds of controller, the only place that selects by kind.

A law defines its parameters, its state and its requirements on the rest of the build. Its C is in the template folder
`law/<kind>/`: the functions `<prefix>_law_init` and `<prefix>_law_step` of the unit `<prefix>_law`, which the controller calls
for every kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from codegen.configuration import Config, Schedule
from codegen.configuration.controller import (
    INTEGRAL_GAIN_MAX,
    INTEGRAL_GAIN_MIN,
    LEAD_MAX_S,
    PROPORTIONAL_GAIN_MAX_S,
    RESPONSE_GAIN_MAX_S,
    TRIM_MAX_PERCENT,
)
from codegen.design.margins import Gains, gains_of
from codegen.emit.dynamics_view import SIDESLIP_MAX
from codegen.emit.parameters import Field, Parameter, configured, lag_of
from codegen.errors import BuildError
from codegen.units import DEGREE, KM_H, M_S, M_S2, M_S3, NONE, PER_S, RAD, RAD_S, RAD_S2_M, M, S
from codegen.vehicle.single_track import SingleTrack

SAMPLE_RANGES = {"speed": (-200.0, 200.0), "front_angle": (-1.5, 1.5), "yaw_rate": (-20.0, 20.0)}
"""Ranges of the checked sample that the control law accepts, in SI units: the widest that valid parameters allow."""

REAR_ANGLE_MAX_RAD = 1.0
"""Bound on the last command passed to the control law: the largest rear angle that valid limiter parameters allow."""

YAW_RATE_ERROR_MAX_RAD_S = 1000.0
"""Bound on the last yaw-rate error passed to the control law, far above the error of any law."""


@dataclass(frozen=True)
class Law:
    """A kind of controller.

    Attributes:
        title: short description.
        parameters: function that returns the law's own parameters for a configuration.
        state: fields of the law's own state.
        gains: function that returns the feedback gains over speed, for the margins; None if there is no feedback.
        scheduled: whether the gains come from controller.tracking.schedule, which `codegen tune` writes.
        uses_rear_angle: whether the law looks up the rear angle of the optimum.
        uses_reference_model: whether the law needs the units `<prefix>_reference_model` and `<prefix>_grip`.
        waits_for_speed: whether the law runs only from a speed on; see `Controller.waits_for_speed`.
    """

    kind: str
    title: str
    parameters: Callable[[Config], tuple[Parameter, ...]]
    state: tuple[Field, ...] = ()
    gains: Callable[[Config], Gains | None] = lambda _: None
    scheduled: bool = False
    uses_rear_angle: bool = False
    uses_reference_model: bool = False
    waits_for_speed: bool = False

    @property
    def sample_ranges(self) -> Mapping[str, tuple[float, float]]:
        """Ranges of the checked sample that the law accepts: a law that waits for a speed gets none in reverse."""
        return {**SAMPLE_RANGES, "speed": (0.01, SAMPLE_RANGES["speed"][1])} if self.waits_for_speed else SAMPLE_RANGES


def law_of(config: Config) -> Law:
    """Return the law that the configuration names. Raises BuildError if the configuration lacks a table that the law needs."""
    law = LAWS[config.controller.kind]
    law.parameters(config)
    return law


def is_untuned(config: Config) -> bool:
    """Return whether this configuration needs `codegen tune` before a build."""
    return LAWS[config.controller.kind].scheduled and config.controller.tracking.schedule is None


def _lead_over_actuator(config: Config) -> Parameter:
    return configured(
        config.controller,
        "rear_angle_error_max",
        "rear_angle_error_max_deg",
        RAD,
        "largest lead of the demand over the measured rear angle",
        DEGREE,
        1.0,
    )


def _pi_parameters(config: Config) -> tuple[Parameter, ...]:
    controller = config.controller
    return (
        configured(
            controller,
            "proportional_gain",
            "proportional_gain_s",
            S,
            "proportional gain: rear angle for a yaw-rate error of 1 rad/s",
        ),
        configured(
            controller, "integral_gain", "integral_gain", NONE, "integral gain: rear angle per integrated yaw-rate error"
        ),
        _lead_over_actuator(config),
    )


def _pi_gains(config: Config) -> Gains:
    proportional, integral = config.controller.proportional_gain_s, config.controller.integral_gain
    return lambda speed: (np.full_like(speed, proportional), np.full_like(speed, integral))


def schedule_of(config: Config) -> Schedule:
    """Return the gain schedule of kind "tracking". Raises BuildError if there is none."""
    schedule = config.controller.tracking.schedule
    if schedule is None:
        raise BuildError(
            'the kind "tracking" has no gain schedule yet',
            where="controller.tracking.schedule",
            remedy="tune the map (with `config=` if ars.toml was edited), and build from the map without `config=`",
        )
    return schedule


def _tracking_parameters(config: Config) -> tuple[Parameter, ...]:
    tracking, schedule = config.controller.tracking, schedule_of(config)
    points = "SCHEDULE_POINTS"
    return (
        Parameter(
            "schedule_speed",
            tuple(speed * KM_H for speed in schedule.speed_km_h),
            M_S,
            "speeds of the gain schedule; the outermost gains hold beyond them",
            0.0,
            200.0,
            points,
            increasing=True,
            key="controller.tracking.schedule.speed_km_h",
            to_key=lambda speed: speed / KM_H,
        ),
        Parameter(
            "proportional_gain",
            tuple(schedule.proportional_gain_s),
            S,
            "proportional gain: rear angle for a yaw-rate error of 1 rad/s",
            0.0,
            PROPORTIONAL_GAIN_MAX_S,
            points,
            key="controller.tracking.schedule.proportional_gain_s",
        ),
        Parameter(
            "integral_gain",
            tuple(schedule.integral_gain),
            NONE,
            "integral gain: rear angle per integrated yaw-rate error",
            INTEGRAL_GAIN_MIN,
            INTEGRAL_GAIN_MAX,
            points,
            key="controller.tracking.schedule.integral_gain",
        ),
        Parameter(
            "lead_time",
            tuple(schedule.lead_s or [tracking.lead_s] * len(schedule.speed_km_h)),
            S,
            "prediction time of the front angle for the map",
            -LEAD_MAX_S,
            LEAD_MAX_S,
            points,
            key="controller.tracking.schedule.lead_s",
        ),
        Parameter(
            "response_gain",
            tuple(schedule.response_gain_s or [0.0] * len(schedule.speed_km_h)),
            S,
            "gain on the difference between map and model yaw rate",
            0.0,
            RESPONSE_GAIN_MAX_S,
            points,
            key="controller.tracking.schedule.response_gain_s",
        ),
        Parameter(
            "lead_smoothing",
            1.0 - math.exp(-config.controller.sampling_time_s / tracking.lead_smoothing_s),
            NONE,
            "weight of a new front-angle rate in its low-pass filter",
            0.01,
            1.0,
            key="controller.tracking.lead_smoothing_s",
            to_key=lambda share: lag_of(share, config.controller.sampling_time_s),
        ),
        Parameter(
            "lead_angle_max",
            math.radians(tracking.lead_max_deg),
            RAD,
            "largest predicted change of the front angle",
            0.0,
            0.5,
            key="controller.tracking.lead_max_deg",
            to_key=math.degrees,
        ),
        configured(
            tracking,
            "response_samples",
            "response_ahead_s",
            NONE,
            "prediction time of the model's yaw rate, in samples",
            1.0 / config.controller.sampling_time_s,
        ),
        Parameter(
            "yaw_increasing_max",
            math.radians(tracking.yaw_increasing_max_deg),
            RAD,
            "largest feedback that increases the yaw rate, at sideslip_max",
            0.0,
            1.0,
            key="controller.tracking.yaw_increasing_max_deg",
            to_key=math.degrees,
        ),
        Parameter(
            "yaw_increasing_wide",
            math.radians(tracking.yaw_increasing_wide_deg),
            RAD,
            "largest feedback that increases the yaw rate, without outward sideslip",
            0.0,
            1.0,
            key="controller.tracking.yaw_increasing_wide_deg",
            to_key=math.degrees,
        ),
        Parameter(
            "sideslip_max",
            math.radians(tracking.sideslip_max_deg),
            RAD,
            "outward sideslip at which yaw_increasing_max applies; beyond it, the reference falls",
            0.005,
            1.0,
            key="controller.tracking.sideslip_max_deg",
            to_key=math.degrees,
        ),
        Parameter(
            "turn_margin_rate",
            math.radians(tracking.turn_margin_deg_s),
            RAD_S,
            "largest excess of the reference over the yaw rate from lateral acceleration",
            0.0,
            1.0,
            key="controller.tracking.turn_margin_deg_s",
            to_key=math.degrees,
        ),
        Parameter(
            "turn_margin",
            tracking.turn_margin_m_s2,
            M_S2,
            "lower limit of turn_margin_rate times the speed",
            0.0,
            10.0,
            key="controller.tracking.turn_margin_m_s2",
        ),
        Parameter(
            "trim_share",
            tracking.trim_max_percent / 100.0,
            NONE,
            "largest trim as a share of the map's yaw rate",
            0.0,
            TRIM_MAX_PERCENT / 100.0,
            key="controller.tracking.trim_max_percent",
            to_key=lambda share: 100.0 * share,
        ),
        Parameter(
            "trim_rate",
            1.0 / tracking.trim_time_s,
            PER_S,
            "inverse time constant of the trim",
            0.01,
            20.0,
            key="controller.tracking.trim_time_s",
            to_key=lambda rate: 1.0 / rate,
        ),
        Parameter(
            "grip_shortfall",
            tracking.grip_shortfall_m_s2,
            M_S2,
            "missing lateral acceleration that does not count as lost grip",
            0.1,
            20.0,
            key="controller.tracking.grip_shortfall_m_s2",
        ),
        Parameter(
            "grip_shortfall_share",
            tracking.grip_shortfall_share,
            NONE,
            "share of the model's acceleration added to grip_shortfall in gentle turns",
            0.0,
            1.0,
            key="controller.tracking.grip_shortfall_share",
        ),
        Parameter(
            "grip_loss_rate",
            1.0 / tracking.grip_loss_time_s,
            PER_S,
            "inverse time constant with which the assumed grip falls",
            0.1,
            50.0,
            key="controller.tracking.grip_loss_time_s",
            to_key=lambda rate: 1.0 / rate,
        ),
        Parameter(
            "grip_forgetting",
            1.0 / tracking.grip_memory_s,
            PER_S,
            "inverse time constant for forgetting the largest lateral acceleration",
            0.01,
            50.0,
            key="controller.tracking.grip_memory_s",
            to_key=lambda rate: 1.0 / rate,
        ),
        Parameter(
            "grip_recovery",
            tracking.grip_recovery_m_s3,
            M_S3,
            "rise of the assumed grip in a turn",
            0.01,
            100.0,
            key="controller.tracking.grip_recovery_m_s3",
        ),
        Parameter(
            "grip_recovery_idle",
            tracking.grip_recovery_idle_m_s3,
            M_S3,
            "rise of the assumed grip while under half is used",
            0.01,
            100.0,
            key="controller.tracking.grip_recovery_idle_m_s3",
        ),
        _lead_over_actuator(config),
    )


def _proportional_parameters(config: Config) -> tuple[Parameter, ...]:
    car = SingleTrack.from_config(config)
    return (
        Parameter("rear_arm", car.rear_arm, M, "distance from centre of gravity to rear axle", 0.1, 20.0),
        Parameter(
            "rear_slip_per_acceleration",
            car.rear_slip_per_lateral_acceleration,
            RAD_S2_M,
            "rear slip angle per lateral acceleration",
            0.0,
            1.0,
        ),
    )


LAWS = {
    law.kind: law
    for law in (
        Law(
            kind="tracking",
            title="feedforward of the optimum, reference model, scheduled feedback",
            parameters=_tracking_parameters,
            state=(
                Field("real", "trim", RAD_S, "correction towards the map's yaw rate", 16.0),
                Field("real", "sideslip", RAD, "observed sideslip angle", SIDESLIP_MAX),
                Field("real", "integral", RAD, "integral part of the rear angle"),
                Field("real", "front_angle", RAD, "front angle of the last sample", SAMPLE_RANGES["front_angle"][1]),
                Field("real", "front_rate", RAD_S, "smoothed rate of the front angle"),
                Field("real", "previous_model_yaw_rate", RAD_S, "yaw rate of the model one sample ago"),
                Field("uint16_t", "missed_samples", NONE, "predicted samples since the last good one"),
                Field("real", "yaw_rate", RAD_S, "yaw rate of the last sample", SAMPLE_RANGES["yaw_rate"][1]),
            ),
            gains=lambda config: gains_of(schedule_of(config)),
            scheduled=True,
            uses_rear_angle=True,
            uses_reference_model=True,
        ),
        Law(
            kind="pi",
            title="the paper's PI on the yaw-rate error",
            parameters=_pi_parameters,
            state=(Field("real", "integral", RAD, "integral part of the rear angle"),),
            gains=_pi_gains,
            waits_for_speed=True,
        ),
        Law(
            kind="feedforward",
            title="the optimum's own rear angle, without feedback",
            parameters=lambda _: (),
            uses_rear_angle=True,
        ),
        Law(
            kind="proportional",
            title="rear angle in proportion to the front angle, for no sideslip in steady turns",
            parameters=_proportional_parameters,
        ),
    )
}

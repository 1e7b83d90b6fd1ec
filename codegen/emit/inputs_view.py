"""View model of the monitoring of the inputs: its parameters."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from codegen.configuration import Config
from codegen.configuration.controller import DEGRADED_TIME_MAX_S, RECOVERY_SAMPLES_MAX
from codegen.emit.parameters import Parameter, ParameterView, configured, lag_of, parameter_views
from codegen.emit.text import Precision, literal
from codegen.units import DEGREE, GRAVITY, KM_H
from codegen.vehicle.single_track import SingleTrack

UNDERSTEER_CHANGE_MAX = math.radians(2.0) / GRAVITY
"""Largest change of the understeer coefficient by calibration, in s^2/m: 2 deg/g cover variants of the car, not other cars."""
AMBIGUOUS_SHARE = 0.0625
"""Share of an offset that is learned where a turn would look the same: a gust of 1.5 s leaves little of itself."""
SHORT_SHARE = 0.75
"""Share of a turn's yaw rate below which a measured one is wrong: half the value is found, a small error of scale is not."""
BANK_RATE = 0.6
"""m/s^3, of the lateral acceleration: a bank of 6 % (0.59 m/s^2) that the road takes within a second."""
FRICTION_UNKNOWN = 2.0
"""Value for an unknown friction, above the peak friction of any road: the map uses its own friction."""


@dataclass(frozen=True)
class InputsView:
    """Everything that the templates of the inputs print."""

    parameters: tuple[ParameterView, ...]
    ranged: tuple[ParameterView, ...]
    counts: tuple[ParameterView, ...]
    friction_unknown: str
    ambiguous_share: str
    short_share: str
    bank_step: str
    recovery_samples_max: str


def inputs_parameters(config: Config) -> tuple[Parameter, ...]:
    """Return the fields of `<prefix>_inputs_parameters_t`, in order."""
    inputs, fail_safe, period = config.controller.inputs, config.controller.fail_safe, config.controller.sampling_time_s
    car = SingleTrack.from_config(config)
    wheelbase, understeer = car.wheelbase, car.understeer_coefficient
    of_key = functools.partial(configured, inputs)
    moving = (
        of_key("longitudinal_acceleration_max", "longitudinal_acceleration_max_m_s2", "m/s^2, range"),
        of_key(
            "longitudinal_acceleration_loss",
            "longitudinal_acceleration_loss_m_s3",
            "m/s^2, change of a lost acceleration in a sample",
            period,
        ),
    )
    return (
        of_key("speed_max", "speed_max_km_h", "m/s, range", KM_H, 200.0),
        of_key("front_angle_max", "front_angle_max_deg", "rad, range", DEGREE, 1.5),
        of_key("yaw_rate_max", "yaw_rate_max_deg_s", "rad/s, range", DEGREE, 20.0),
        Parameter(
            "rear_angle_max",
            math.radians(config.rear_angle_valid_max_deg),
            "rad, range",
            math.radians(0.1),
            math.radians(45.0),
            key="controller.inputs.rear_angle_max_deg",
            to_key=math.degrees,
        ),
        of_key("friction_max", "friction_max", "range"),
        of_key("speed_step", "acceleration_max_m_s2", "m/s, largest change in a sample", period, 200.0),
        of_key("front_angle_step", "front_angle_rate_max_deg_s", "rad, largest change in a sample", DEGREE * period, 3.0),
        of_key("yaw_rate_step", "yaw_acceleration_max_deg_s2", "rad/s, largest change in a sample", DEGREE * period, 40.0),
        Parameter("wheelbase", wheelbase, "m, linear car", 0.5 * wheelbase, 2.0 * wheelbase),
        Parameter(
            "understeer_coefficient",
            understeer,
            "s^2/m, linear car",
            understeer - UNDERSTEER_CHANGE_MAX,
            understeer + UNDERSTEER_CHANGE_MAX,
        ),
        Parameter(
            "expected_share",
            1.0 - math.exp(-period / inputs.yaw_rate_lag_s),
            "weight of the steady yaw rate in the low-pass filter of the expected one",
            1e-3,
            1.0,
            key="controller.inputs.yaw_rate_lag_s",
            to_key=lambda share: lag_of(share, period),
        ),
        of_key(
            "yaw_rate_tolerance",
            "yaw_rate_tolerance_deg_s",
            "rad/s, by which a yaw rate may exceed the limit of every road",
            DEGREE,
            20.0,
        ),
        of_key("lateral_acceleration_max", "lateral_acceleration_max_m_s2", "m/s^2, range, and bound for any road"),
        of_key(
            "yaw_rate_frozen",
            "yaw_rate_frozen_deg_s",
            "rad/s, more deviation from the expected yaw rate, at which a signal that is constant to the bit counts as frozen",
            DEGREE,
            20.0,
        ),
        of_key(
            "speed_agreement",
            "speed_agreement_km_h",
            "m/s, added to a quarter of the replacement: a rejected speed within this distance is accepted again",
            KM_H,
            200.0,
        ),
        of_key(
            "yaw_rate_agreement",
            "yaw_rate_agreement_deg_s",
            "rad/s, the same for a front angle or yaw rate, in a turn of at least twice as much",
            DEGREE,
        ),
        of_key(
            "straight_yaw_rate",
            "straight_yaw_rate_deg_s",
            "rad/s, largest yaw rate by the front wheels that counts as straight",
            DEGREE,
            1.0,
        ),
        of_key("yaw_rate_offset_max", "yaw_rate_offset_max_deg_s", "rad/s, largest offset that is learned", DEGREE, 1.0),
        of_key(
            "lateral_acceleration_offset_max",
            "lateral_acceleration_offset_max_m_s2",
            "m/s^2, the same of the lateral acceleration",
        ),
        Parameter(
            "yaw_rate_correction_share",
            period / inputs.yaw_rate_correction_time_s,
            "share of an offset, of a correction of the yaw rate, or of a wrong speed that is removed in a sample",
            1e-6,
            0.25,
            key="controller.inputs.yaw_rate_correction_time_s",
            to_key=lambda share: period / share,
        ),
        of_key("speed_fall", "speed_fall_m_s2", "m/s, decrease of a lost speed in a sample", period, 1.0),
        of_key("friction_recovery", "friction_recovery_1_s", "increase of a lost estimate in a sample", period, 1.0),
        *(moving if config.can.vehicle_conditions.signals().get("longitudinal_acceleration") else ()),
        Parameter(
            "missing_samples_max",
            fail_safe.degraded_samples_max,
            "missing samples, less good ones, before a signal is replaced",
            0,
            round(DEGRADED_TIME_MAX_S / period),
            key="controller.fail_safe.degraded_samples_max",
            to_key=int,
        ),
        Parameter(
            "recovery_samples",
            fail_safe.recovery_samples,
            "good samples, less missing ones, until it is used again",
            1,
            RECOVERY_SAMPLES_MAX,
            key="controller.fail_safe.recovery_samples",
            to_key=int,
        ),
    )


def inputs_view(config: Config, prefix: str, precision: Precision, real: str) -> InputsView:
    """Return the view of a configuration's monitoring."""
    parameters = parameter_views(inputs_parameters(config), prefix, precision, real)
    return InputsView(
        parameters=parameters,
        ranged=tuple(view for view in parameters if not view.is_count),
        counts=tuple(view for view in parameters if view.is_count),
        friction_unknown=literal(FRICTION_UNKNOWN, precision),
        ambiguous_share=literal(AMBIGUOUS_SHARE, precision),
        short_share=literal(SHORT_SHARE, precision),
        bank_step=literal(BANK_RATE * config.controller.sampling_time_s, precision),
        recovery_samples_max=f"{RECOVERY_SAMPLES_MAX}u",
    )

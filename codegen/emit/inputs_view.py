"""View model of the monitoring of the inputs: its parameters."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from codegen.configuration import Config
from codegen.configuration.controller import DEGRADED_TIME_MAX_S, RECOVERY_SAMPLES_MAX
from codegen.emit.parameters import Parameter, configured, lag_of
from codegen.units import DEGREE, GRAVITY, KM_H, M_S, M_S2, NONE, RAD, RAD_S, S2_M, M
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


def inputs_parameters(config: Config) -> tuple[Parameter, ...]:
    """Return the fields of `<prefix>_inputs_parameters_t`, in order."""
    inputs, fail_safe, period = config.controller.inputs, config.controller.fail_safe, config.controller.sampling_time_s
    car = SingleTrack.from_config(config)
    wheelbase, understeer = car.wheelbase, car.understeer_coefficient
    of_key = functools.partial(configured, inputs)
    moving = (
        of_key(
            "longitudinal_acceleration_max",
            "longitudinal_acceleration_max_m_s2",
            M_S2,
            "largest valid longitudinal acceleration",
        ),
        of_key(
            "longitudinal_acceleration_loss",
            "longitudinal_acceleration_loss_m_s3",
            M_S2,
            "change of a lost longitudinal acceleration per sample",
            period,
        ),
    )
    return (
        of_key("speed_max", "speed_max_km_h", M_S, "largest valid speed", KM_H, 200.0),
        of_key("front_angle_max", "front_angle_max_deg", RAD, "largest valid front angle", DEGREE, 1.5),
        of_key("yaw_rate_max", "yaw_rate_max_deg_s", RAD_S, "largest valid yaw rate", DEGREE, 20.0),
        Parameter(
            "rear_angle_max",
            math.radians(config.rear_angle_valid_max_deg),
            RAD,
            "largest valid rear angle",
            math.radians(0.1),
            math.radians(45.0),
            key="controller.inputs.rear_angle_max_deg",
            to_key=math.degrees,
        ),
        of_key("friction_max", "friction_max", NONE, "largest valid friction estimate"),
        of_key("speed_step", "acceleration_max_m_s2", M_S, "largest valid change of the speed per sample", period, 200.0),
        of_key(
            "front_angle_step",
            "front_angle_rate_max_deg_s",
            RAD,
            "largest valid change of the front angle per sample",
            DEGREE * period,
            3.0,
        ),
        of_key(
            "yaw_rate_step",
            "yaw_acceleration_max_deg_s2",
            RAD_S,
            "largest valid change of the yaw rate per sample",
            DEGREE * period,
            40.0,
        ),
        Parameter("wheelbase", wheelbase, M, "wheelbase of the linear car", 0.5 * wheelbase, 2.0 * wheelbase),
        Parameter(
            "understeer_coefficient",
            understeer,
            S2_M,
            "understeer coefficient of the linear car",
            understeer - UNDERSTEER_CHANGE_MAX,
            understeer + UNDERSTEER_CHANGE_MAX,
        ),
        Parameter(
            "expected_share",
            1.0 - math.exp(-period / inputs.yaw_rate_lag_s),
            NONE,
            "weight of the steady yaw rate in the expected yaw rate's filter",
            1e-3,
            1.0,
            key="controller.inputs.yaw_rate_lag_s",
            to_key=lambda share: lag_of(share, period),
        ),
        of_key(
            "yaw_rate_tolerance",
            "yaw_rate_tolerance_deg_s",
            RAD_S,
            "allowed excess of the yaw rate over the road's limit",
            DEGREE,
            20.0,
        ),
        of_key(
            "lateral_acceleration_max",
            "lateral_acceleration_max_m_s2",
            M_S2,
            "largest valid lateral acceleration, and the limit of every road",
        ),
        of_key(
            "yaw_rate_frozen",
            "yaw_rate_frozen_deg_s",
            RAD_S,
            "yaw-rate deviation at which an unchanged signal counts as frozen",
            DEGREE,
            20.0,
        ),
        of_key(
            "speed_agreement",
            "speed_agreement_km_h",
            M_S,
            "rejected speed is accepted within this plus a quarter of its substitute",
            KM_H,
            200.0,
        ),
        of_key(
            "yaw_rate_agreement",
            "yaw_rate_agreement_deg_s",
            RAD_S,
            "yaw-rate deviation in a turn that counts as agreement",
            DEGREE,
        ),
        of_key(
            "straight_yaw_rate",
            "straight_yaw_rate_deg_s",
            RAD_S,
            "largest yaw rate from the front wheels on a straight",
            DEGREE,
            1.0,
        ),
        of_key(
            "yaw_rate_offset_max", "yaw_rate_offset_max_deg_s", RAD_S, "largest learned offset of the yaw rate", DEGREE, 1.0
        ),
        of_key(
            "lateral_acceleration_offset_max",
            "lateral_acceleration_offset_max_m_s2",
            M_S2,
            "largest learned offset of the lateral acceleration",
        ),
        Parameter(
            "yaw_rate_correction_share",
            period / inputs.yaw_rate_correction_time_s,
            NONE,
            "share of an offset or deviation that one sample corrects",
            1e-6,
            0.25,
            key="controller.inputs.yaw_rate_correction_time_s",
            to_key=lambda share: period / share,
        ),
        of_key("speed_fall", "speed_fall_m_s2", M_S, "decrease of a lost speed per sample", period, 1.0),
        of_key(
            "friction_recovery", "friction_recovery_1_s", NONE, "increase of a lost friction estimate per sample", period, 1.0
        ),
        *(moving if config.can.vehicle_conditions.signals().get("longitudinal_acceleration") else ()),
        Parameter(
            "missing_samples_max",
            fail_safe.degraded_samples_max,
            NONE,
            "missing samples minus twice the good ones until a signal is replaced",
            0,
            round(DEGRADED_TIME_MAX_S / period),
            key="controller.fail_safe.degraded_samples_max",
            to_key=int,
        ),
        Parameter(
            "recovery_samples",
            fail_safe.recovery_samples,
            NONE,
            "good samples minus missing ones until a signal is used again",
            1,
            RECOVERY_SAMPLES_MAX,
            key="controller.fail_safe.recovery_samples",
            to_key=int,
        ),
    )


@dataclass(frozen=True)
class InputsView:
    """Values that the templates of the inputs print, in SI units."""

    config: Config

    friction_unknown = FRICTION_UNKNOWN
    ambiguous_share = AMBIGUOUS_SHARE
    short_share = SHORT_SHARE
    recovery_samples_max = RECOVERY_SAMPLES_MAX

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Fields of `<prefix>_inputs_parameters_t`."""
        return inputs_parameters(self.config)

    @property
    def bank_step(self) -> float:
        """Largest change of the lateral acceleration by the bank of a road in a sample."""
        return BANK_RATE * self.config.controller.sampling_time_s

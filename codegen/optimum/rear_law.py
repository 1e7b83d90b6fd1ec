"""Published laws for the rear angle, which a case may follow instead of the optimisation.

Both give a quantity of the steady turn as a share of the front angle. The rear angle stays within its bound. Where a turn of
the law violates another bound, it is infeasible: a law does not evade.

**Zero sideslip.** The car moves where it points: beta = 0 in the steady turn (Y. Furukawa et al., A review of four-wheel
steering studies from the viewpoint of vehicle dynamics and control, Vehicle System Dynamics 18, 1989; M. Abe, Vehicle Handling
Dynamics, chapter 8).

**Variable wheelbase.** The car turns like one whose wheelbase is s L (Variable wheelbase reference for vehicle with active
front and rear-wheel steering, Vehicle System Dynamics 60(8), 2022, pp. 2758-2774, doi 10.1080/00423114.2021.1921814). There
yaw rate and sideslip follow the virtual car by steering both axles. The rear axle alone can follow the yaw rate. With both arms
s times as long and the same tyres, K stays, and the virtual car has r = vx delta_f / (s L + K vx^2). The car itself has
r = vx (delta_f - delta_r) / (L + K vx^2), so that

    delta_r = k delta_f,    k = (s - 1) L / (s L + K vx^2)

At low speed k = 1 - 1/s, from the geometry alone: the rolling car turns about a point at s L behind the front axle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Case
from codegen.errors import ConfigError
from codegen.map_file.bounds import BOUNDS, Binding, Bound
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack


@dataclass(frozen=True)
class RearLaw:
    """A law: the value of `bound` (sideslip or rear angle) is `share` times the front angle.

    `share` takes speeds in m/s, any shape.
    """

    bound: Bound
    share: Callable[[npt.ArrayLike], FloatArray]

    def value(self, speed: FloatArray, front_angle: FloatArray) -> FloatArray:
        """Return the wanted value in rad at speeds in m/s and front angles in rad that broadcast."""
        return self.share(speed) * front_angle


def _bound(flag: Binding) -> Bound:
    return next(bound for bound in BOUNDS if bound.flag is flag)


def _zero(speed: npt.ArrayLike) -> FloatArray:
    return np.zeros(np.shape(speed))


STRAIGHT = RearLaw(_bound(Binding.REAR_ANGLE), _zero)
"""Law of a car that does not steer its rear wheels."""

ZERO_SIDESLIP = RearLaw(_bound(Binding.SIDESLIP), _zero)


def law_of(case: Case, car: SingleTrack, fastest: float) -> RearLaw | None:
    """Return the law of a case; None for an optimisation.

    Raises ConfigError if the car of the virtual wheelbase is unstable at a speed up to `fastest` (m/s).
    """
    if case.reference == "zero-sideslip":
        return ZERO_SIDESLIP
    if case.reference == "variable-wheelbase":
        assert case.wheelbase_speed_km_h is not None  # the case was validated
        assert case.wheelbase_factor is not None
        return _variable_wheelbase(np.array(case.wheelbase_speed_km_h) * KM_H, np.array(case.wheelbase_factor), car, fastest)
    return None


def _variable_wheelbase(speed: FloatArray, factor: FloatArray, car: SingleTrack, fastest: float) -> RearLaw:
    def gradient(v: FloatArray) -> FloatArray:
        """Front angle of the virtual car for each rad/s of yaw rate, times the speed: s L + K vx^2 in m."""
        result: FloatArray = np.interp(v, speed, factor) * car.wheelbase + car.understeer_coefficient * v * v
        return result

    # Between two points of the list it is smallest at one of them: s is linear, and K below zero where this can fail.
    points = np.append(speed[speed < fastest], fastest)
    unstable = np.flatnonzero(gradient(points) <= 0.0)
    if unstable.size:
        raise ConfigError(
            f"the car of the virtual wheelbase is unstable at {points[unstable[0]] / KM_H:.4g} km/h",
            where="wheelbase_factor",
            remedy="raise the factors for high speeds, or end the grid before",
        )

    def share(v: npt.ArrayLike) -> FloatArray:
        v = np.asarray(v, dtype=np.float64)
        result: FloatArray = (np.interp(v, speed, factor) - 1.0) * car.wheelbase / gradient(v)
        return result

    return RearLaw(_bound(Binding.REAR_ANGLE), share)

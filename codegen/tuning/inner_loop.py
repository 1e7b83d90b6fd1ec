"""The loop inside the ECU of kind "tracking": response gain and reference model, without the car.

The response gain turns the rear wheels of the model by the yaw rate that the model will lack. With a gain that is too large for
lag and look-ahead, the model swings by itself, and the car follows it.
"""

from __future__ import annotations

from codegen.configuration.controller import RESPONSE_GAIN_MAX_S
from codegen.sil.batch import BatchSoftware

MARGIN = 0.6
"""Share of the gain at which the loop no longer decays: a gain margin of 4.4 dB. Nothing in this loop is uncertain."""
DURATION_S = 4.0
DECAYED = 0.05
"""Share of its first yaw rate to which the model must come within that time."""
FIRST_RAD_S = 1e-3
"""Small, so that the tyres are linear."""
HALVINGS = 8


def largest_response_gain(software: BatchSoftware, speed: float, ahead: float) -> float:
    """Return the largest response gain in s with MARGIN, at a speed in m/s and with a look-ahead in s."""
    low, high = 0.0, RESPONSE_GAIN_MAX_S / MARGIN
    if _decays(software, speed, ahead, high):
        return RESPONSE_GAIN_MAX_S
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _decays(software, speed, ahead, middle) else (low, middle)
    return MARGIN * low


def _decays(software: BatchSoftware, speed: float, ahead: float, gain: float) -> bool:
    """Return whether the model with a first yaw rate comes to rest, the wheels straight."""
    unit, config = software.software, software.config
    model, given = unit.new("reference_model"), unit.new("reference_model_input")
    given.speed, given.front_angle = speed, 0.0
    for name in ("friction", "front_friction", "rear_friction"):
        if hasattr(given, name):
            setattr(given, name, config.road.friction)
    period, step = config.controller.sampling_time_s, unit.function("reference_model_step")
    unit.function("reference_model_start")(model, speed, FIRST_RAD_S, 0.0)
    samples, before = round(DURATION_S / period), model.yaw_rate
    yaw_rates: list[float] = []
    for _ in range(samples):
        expected = model.yaw_rate + ahead / period * (model.yaw_rate - before)
        before, given.rear_angle = model.yaw_rate, gain * expected
        step(model, given)
        yaw_rates.append(abs(model.yaw_rate))
    return max(yaw_rates[-samples // 4 :]) < DECAYED * FIRST_RAD_S

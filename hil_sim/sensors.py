"""Sensors with delay, noise and resolution. The same seed gives the same run."""

from __future__ import annotations

from collections import deque

import numpy as np

from codegen.configuration import Sensor, Sensors

SIGNALS = ("speed", "front_angle", "yaw_rate", "rear_angle", "lateral_acceleration")


class SensorModel:
    """All sensors of one run.

    Args:
        sensors: their settings.
        seed: of the noise; the same seed gives the same run.
    """

    def __init__(self, sensors: Sensors, seed: int = 0) -> None:
        streams = np.random.default_rng(seed).spawn(
            len(SIGNALS)
        )  # so that the settings of one sensor do not affect the noise of others
        self._models = {name: _Model(getattr(sensors, name), stream) for name, stream in zip(SIGNALS, streams, strict=True)}

    def measure(self, name: str, value: float) -> float:
        """Return the measured value of the signal `name` in SI units. Call it once a sample."""
        return self._models[name].measure(value)


class _Model:
    def __init__(self, sensor: Sensor, stream: np.random.Generator) -> None:
        self._noise, self._step = sensor.noise, sensor.resolution
        self._stream = stream
        self._waiting: deque[float] = deque(maxlen=sensor.delay_samples + 1)

    def measure(self, value: float) -> float:
        self._waiting.append(value)
        result = self._waiting[0]  # until the queue is full: the first one
        if self._noise > 0.0:
            result += self._noise * float(self._stream.standard_normal())
        return self._step * round(result / self._step) if self._step > 0.0 else result

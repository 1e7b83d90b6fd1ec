"""The tables `[sensors]` of `ars.toml`: errors of the bench's simulated sensors."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated

from pydantic import Field

from codegen.configuration.section import Meaning, Range, Section
from codegen.units import KM_H


class Sensor(Section):
    """Keys of every sensor; subclasses add noise and resolution in their unit."""

    delay_samples: Annotated[int, Field(ge=0, le=100)] = 0

    @property
    @abstractmethod
    def noise(self) -> float:
        """Standard deviation, SI unit."""

    @property
    @abstractmethod
    def resolution(self) -> float:
        """Step between two values, SI unit; 0 if the sensor has none."""


class SpeedSensor(Sensor):
    """Speed of the car."""

    noise_km_h: Annotated[float, Range(0.0, 20.0, "km/h")] = 0.1
    resolution_km_h: Annotated[float, Range(0.0, 20.0, "km/h")] = 0.05

    @property
    def noise(self) -> float:
        """Standard deviation in m/s."""
        return self.noise_km_h * KM_H

    @property
    def resolution(self) -> float:
        """Step between two values in m/s."""
        return self.resolution_km_h * KM_H


class AngleSensor(Sensor):
    """An angle at the road wheels."""

    noise_deg: Annotated[float, Range(0.0, 5.0, "deg")] = 0.01
    resolution_deg: Annotated[float, Range(0.0, 5.0, "deg")] = 0.01

    @property
    def noise(self) -> float:
        """Standard deviation in rad."""
        return math.radians(self.noise_deg)

    @property
    def resolution(self) -> float:
        """Step between two values in rad."""
        return math.radians(self.resolution_deg)


class YawRateSensor(Sensor):
    """The gyroscope."""

    delay_samples: Annotated[int, Field(ge=0, le=100)] = 1
    noise_deg_s: Annotated[float, Range(0.0, 20.0, "deg/s")] = 0.1
    resolution_deg_s: Annotated[float, Range(0.0, 20.0, "deg/s")] = 0.05

    @property
    def noise(self) -> float:
        """Standard deviation in rad/s."""
        return math.radians(self.noise_deg_s)

    @property
    def resolution(self) -> float:
        """Step between two values in rad/s."""
        return math.radians(self.resolution_deg_s)


class AccelerationSensor(Sensor):
    """The accelerometer."""

    noise_m_s2: Annotated[float, Range(0.0, 5.0, "m/s^2")] = 0.05
    resolution_m_s2: Annotated[float, Range(0.0, 5.0, "m/s^2")] = 0.01

    @property
    def noise(self) -> float:
        """Standard deviation in m/s^2."""
        return self.noise_m_s2

    @property
    def resolution(self) -> float:
        """Step between two values in m/s^2."""
        return self.resolution_m_s2


class Sensors(Section):
    """The sensors of the bench. The defaults are examples; use the data sheets of your sensors."""

    speed: Annotated[
        SpeedSensor,
        Meaning("noise: standard deviation; resolution: step between values, 0 for none; delay: samples of the controller"),
    ] = SpeedSensor()
    front_angle: Annotated[AngleSensor, Meaning("the same, at the road wheels")] = AngleSensor()
    yaw_rate: Annotated[YawRateSensor, Meaning("the same, of the gyroscope")] = YawRateSensor()
    rear_angle: Annotated[AngleSensor, Meaning("the same, of the actuator")] = AngleSensor()
    lateral_acceleration: Annotated[AccelerationSensor, Meaning("the same, of the accelerometer")] = AccelerationSensor()

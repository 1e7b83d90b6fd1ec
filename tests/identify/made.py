"""Drives with known signals, written as logs by libraries that the package does not read with: python-can's writers, cantools'
encoder, asammdf's writer and pandas."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import asammdf
import can
import cantools
import numpy as np
import pandas as pd

from codegen.arrays import FloatArray
from codegen.identify.reading import Reading

DURATION = 8.0
FREQUENCY = 0.5
"""Hz, of the steering."""
START = 1.7e9
"""Unix time of the start of bus logs."""

Wave = Callable[[FloatArray], FloatArray]


def wave(mean: float, amplitude: float, lag: float = 0.0) -> Wave:
    """Return a sine around a mean, some s late."""
    return lambda time: mean + amplitude * np.sin(2.0 * np.pi * FREQUENCY * (time - lag))


SIGNALS: Mapping[str, Wave] = {
    "vx": wave(25.0, 1.5, 0.3),
    "yaw_rate": wave(0.0, 0.2, 0.08),
    "lateral_acceleration": wave(0.0, 5.0, 0.1),
    "steering_wheel_angle": wave(0.0, 0.8),
    "delta_r": wave(0.0, 0.03, 0.15),
}
"""Quantity -> value in SI at a time in s. Speed times yaw rate is the lateral acceleration on average."""

# Intel and Motorola byte order, signed and unsigned, a multiplexed one, a reserved value, and a limit.
DBC = """VERSION ""
NS_ :
BS_:
BU_: ESP EPS Logger
BO_ 288 Motion: 8 ESP
 SG_ VehicleSpeed : 0|16@1+ (0.01,0) [0|300] "km/h" Logger
 SG_ YawRate : 23|16@0- (0.01,0) [-150|150] "deg/s" Logger
 SG_ LateralAcceleration : 32|16@1- (0.001,0) [-2|2] "g" Logger
BO_ 2566856834 Steering: 8 EPS
 SG_ Page M : 0|4@1+ (1,0) [0|15] "" Logger
 SG_ SteeringWheelAngle m0 : 8|16@1- (0.1,0) [-900|900] "deg" Logger
 SG_ MotorTorque m1 : 8|16@1- (0.1,0) [-900|900] "Nm" Logger
BO_ 290 Rear: 8 EPS
 SG_ RearAngle : 7|12@0- (0.01,0) [-5|5] "deg" Logger
VAL_ 290 RearAngle -2048 "SNA" 2047 "Init" ;
"""
PERIODS = {"Motion": 0.01, "Steering": 0.02, "Rear": 0.02}
"""Message -> its sampling time in s."""
DELAYS = {"Motion": 0.0, "Steering": 0.003, "Rear": 0.0075}
"""Message -> time of its first frame in s."""
RESOLUTION = {
    "vx": 0.01 / 3.6,
    "yaw_rate": np.radians(0.01),
    "lateral_acceleration": 0.001 * 9.80665,
    "steering_wheel_angle": np.radians(0.1),
    "delta_r": np.radians(0.01),
}
"""Quantity -> resolution of its signal in DBC, in SI."""

Frames = list[can.Message]


def frames(signals: Mapping[str, Wave] = SIGNALS, duration: float = DURATION) -> Frames:
    """Return the frames of a drive in order of time."""
    database = cantools.database.load_string(DBC, "dbc")
    made: Frames = []

    def add(name: str, time: float, values: dict[str, float]) -> None:
        message = database.get_message_by_name(name)
        made.append(
            can.Message(
                timestamp=START + time,
                arbitration_id=message.frame_id,
                is_extended_id=message.is_extended_frame,
                data=message.encode(values, strict=False),
                is_rx=True,
            )
        )

    def value(key: str, time: float) -> float:
        return float(signals[key](np.array(time)))

    for time in stamps("Motion", duration):
        speed, yaw_rate = 3.6 * value("vx", time), np.degrees(value("yaw_rate", time))
        lateral = value("lateral_acceleration", time) / 9.80665
        add("Motion", time, {"VehicleSpeed": speed, "YawRate": yaw_rate, "LateralAcceleration": lateral})
    for time in stamps("Steering", duration):
        add("Steering", time, {"Page": 0, "SteeringWheelAngle": np.degrees(value("steering_wheel_angle", time))})
        add("Steering", time + 0.001, {"Page": 1, "MotorTorque": 3.0})
    for time in stamps("Rear", duration):
        add("Rear", time, {"RearAngle": np.degrees(value("delta_r", time))})
    return sorted(made, key=lambda frame: frame.timestamp)


def stamps(message: str, duration: float = DURATION) -> list[float]:
    """Return the times of the frames of a message in s."""
    return list(np.arange(DELAYS[message], duration, PERIODS[message]))


def write_bus(path: Path, made: Frames) -> Path:
    """Write a log with python-can, in the format of the extension, and `car.dbc` beside it."""
    with can.Logger(path) as log:
        for frame in made:
            log.on_message_received(frame)
    path.with_name("car.dbc").write_text(DBC, encoding="ascii")
    return path


def write_mf4(path: Path, signals: Mapping[str, Wave] = SIGNALS) -> Path:
    """Write a measurement with a group of channels for each sampling time."""
    fast, slow = np.arange(0.0, DURATION, 0.005), np.arange(0.0065, DURATION, 0.02)
    with asammdf.MDF() as mdf:
        mdf.append(
            [
                asammdf.Signal(3.6 * signals["vx"](fast), fast, name="VehicleSpeed", unit="km/h"),
                asammdf.Signal(np.degrees(signals["yaw_rate"](fast)), fast, name="YawRate", unit="°/s"),
                asammdf.Signal(signals["lateral_acceleration"](fast), fast, name="ay", unit="m/s²"),
            ],
            acq_name="ESP",
        )
        angles = [
            asammdf.Signal(np.degrees(signals["steering_wheel_angle"](slow)), slow, name="SteeringWheelAngle", unit="deg"),
            asammdf.Signal(np.degrees(signals["delta_r"](slow)), slow, name="RearAngle", unit="deg"),
        ]
        mdf.append(angles, acq_name="EPS")
        mdf.save(path, overwrite=True)
    return path


def table(signals: Mapping[str, Wave] = SIGNALS, time: str = "time_s") -> pd.DataFrame:
    """Return a table of two sampling times: the cells of the slow signals are empty in between."""
    fast, slow = np.arange(0.0, DURATION, 0.01), np.arange(0.0, DURATION, 0.02)
    columns = {
        "speed_km_h": pd.Series(3.6 * signals["vx"](fast), fast),
        "yaw_rate [rad/s]": pd.Series(signals["yaw_rate"](fast), fast),
        "ay_m_s2": pd.Series(signals["lateral_acceleration"](fast), fast),
        "steering_wheel_angle_deg": pd.Series(np.degrees(signals["steering_wheel_angle"](slow)), np.round(slow, 9)),
        "delta_r (rad)": pd.Series(signals["delta_r"](slow), np.round(slow, 9)),
    }
    made = pd.DataFrame({name: column.set_axis(np.round(column.index, 9)) for name, column in columns.items()})
    return made.rename_axis(time).reset_index()


def interpolation_error(key: str, period: float) -> float:
    """Return the largest error of linear interpolation of a signal: h^2/8 times the largest second derivative."""
    amplitude = float(np.ptp(SIGNALS[key](np.linspace(0.0, 2.0, 2001)))) / 2.0
    return period**2 / 8.0 * amplitude * (2.0 * np.pi * FREQUENCY) ** 2


def kinds(reading: Reading) -> list[tuple[str, str]]:
    """Return quantity and kind of all findings."""
    return [(finding.quantity, finding.kind) for finding in reading.findings]


def shown(lines: Sequence[object]) -> str:
    return "\n".join(map(str, lines))

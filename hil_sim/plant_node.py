"""The car on the bus: in each cycle it sends two frames, receives the command, and advances to the next cycle.

It is independent of clocks and interfaces: `hil_sim.bench` transfers its frames.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from codegen.configuration import Config, Sensor, Sensors
from codegen.configuration.can import RealSignal
from codegen.configuration.signals import RECORDED, signals_of
from codegen.emit.text import Precision
from codegen.sil.plant import Plant, PlantInput, PlantSample
from codegen.sil.software import RECORD_COLUMNS, Status
from hil_sim.codec import Codec, Frame, RearSteerCommand, VehicleConditions, VehicleMotion, frame_of, is_configured
from hil_sim.e2e import E2eStatus, Receiver, next_counter, protect, received_counter
from hil_sim.faults import Injector
from hil_sim.scenarios import Scenario

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
        self._noise, self._step, self._bias = sensor.noise, sensor.resolution, sensor.bias
        self._stream = stream
        self._waiting: deque[float] = deque(maxlen=sensor.delay_samples + 1)

    def measure(self, value: float) -> float:
        self._waiting.append(value)
        result = self._waiting[0] + self._bias  # until the queue is full: the first one
        if self._noise > 0.0:
            result += self._noise * float(self._stream.standard_normal())
        return self._step * round(result / self._step) if self._step > 0.0 else result


USABLE = (E2eStatus.OK, E2eStatus.INITIAL, E2eStatus.OK_SOME_LOST)
"""Checks after which the data of a frame are used, as in the generated task."""


@dataclass
class Received:
    """Counts of the command's reception."""

    commands: int = 0
    refused: int = 0
    cycles_without: int = 0
    lost: int = 0

    def to_dict(self) -> dict[str, int]:
        """Return the counts by name."""
        return dict(vars(self))


class PlantNode:
    """The simulated car with its sensors, its actuator's supervision and its side of the frames.

    Args:
        config: configuration of car, actuator and frames.
        scenario: scenario of the run.
        precision: precision of the controller. Sent values are rounded to it first, as on the other side.
        sensors: whether to simulate the configured sensors; otherwise only the frames limit the resolution.
        seed: seed of noise and random faults.
    """

    def __init__(
        self,
        config: Config,
        scenario: Scenario,
        *,
        precision: Precision = "single",
        sensors: bool = False,
        seed: int = 0,
    ) -> None:
        self._config, self.can = config, config.can
        self._profile = config.can.e2e.definition
        self._per_sample = round(config.controller.sampling_time_s / config.plant.sampling_time_s)
        self.sampling_time = config.plant.sampling_time_s * self._per_sample
        inputs = scenario.inputs(config)
        self.cycles = len(inputs) // self._per_sample
        self._rows = inputs[: self.cycles * self._per_sample].tolist()
        self._driver = scenario.driver(config)
        self._rear_angle_commands = scenario.rear_angle_commands(config)
        self._plant = Plant(config)
        self._codec = Codec(config.can, precision)
        self._sensors = SensorModel(config.sensors, seed) if sensors else None
        self.injector = Injector(scenario.faults, config.can, self.sampling_time, seed)
        self._actuator = _ActuatorSupervision(config, self.sampling_time)
        self._waiting: deque[float] = deque([0.0] * (config.plant.command_delay_samples * self._per_sample))
        clocks = scenario.clocks
        self.is_free_running = clocks.are_free_running
        self.sending_times = clocks.sending_times(self.cycles + 1, self.sampling_time, seed)
        self.task_starts = clocks.task_starts(self.cycles, self.sampling_time, seed)
        self.received = Received()
        self.command: RearSteerCommand | None = None
        self.command_id = config.can.rear_steer_command.id
        self._reference = 0.0  # last available one in rad/s
        self._warm_up()
        self._restart()

    def _warm_up(self) -> None:
        """Run each operation of a cycle once, so that the first cycle, from which an ECU takes its phase, is not slower."""
        self._plant.sample(self._acting(0, 0.0))
        for message, payload in (
            (self.can.vehicle_motion, VehicleMotion(0.0, 0.0, 0.0)),
            (self.can.vehicle_conditions, VehicleConditions(0.0, 0.0)),
            (self.can.rear_steer_command, RearSteerCommand(0.0, 0.0)),
        ):
            data = protect(message.e2e_data_id, 0, self._codec.encode(payload), self._profile)
            Receiver(self.can.e2e, self.can.frame_bytes).check(message.e2e_data_id, data)
            self._codec.decode(message.id, data)

    def _restart(self) -> None:
        self._motion_counter = self._conditions_counter = 0
        self._receiver = Receiver(self.can.e2e, self.can.frame_bytes)
        self._was_off = False
        self._arrived: list[Frame] = []
        self._begin_cycle()

    def _begin_cycle(self) -> None:
        self._fresh = self._heard = False
        self._moved = 0  # finished plant steps of this cycle
        self.diagnostics = 0

    def outgoing(self, cycle: int) -> list[Frame]:
        """Return the frames that the node sends in `cycle`, with the faults applied."""
        self._sample = self._plant.sample(self._acting(cycle * self._per_sample, 0.0))
        self._begin_cycle()
        if self._driver is not None:
            wheel = self._driver.steer(self._plant.position, self._sample.sideslip_angle, self._sample.yaw_rate)
            for row in range(cycle * self._per_sample, (cycle + 1) * self._per_sample):
                self._rows[row][1] = wheel
        off = self.injector.plant_off(cycle)
        if self._was_off and not off:
            self._restart()  # a node that was switched on again starts with counters of zero
        self._was_off = off
        if off:
            return self.injector.outgoing(cycle, [])
        speed, _, _, estimate, _, inhibit, acceleration = self._rows[cycle * self._per_sample]
        sample = self._sample
        measured = {
            name: self._sensors.measure(name, value) if self._sensors else value
            for name, value in {
                "speed": speed,
                "front_angle": sample.front_angle,
                "yaw_rate": sample.yaw_rate,
                "rear_angle": sample.measured_rear_angle,
                "lateral_acceleration": sample.measured_lateral_acceleration,
            }.items()
        }
        measured |= {"friction": estimate, "longitudinal_acceleration": acceleration, **sample.recorded}
        frames = [self._motion(cycle, measured), self._conditions(cycle, measured, inhibit != 0.0)]
        return self.injector.outgoing(cycle, frames)

    def _motion(self, cycle: int, measured: dict[str, float]) -> Frame:
        message = self.can.vehicle_motion
        names = [signal.role for signal in signals_of("vehicle_motion")]
        values = self.injector.signals(cycle, message.name, {name: measured[name] for name in names})
        data = self._codec.encode(VehicleMotion(*(values[name] for name in names)))
        data = protect(message.e2e_data_id, self._motion_counter, data, self._profile)
        self._motion_counter = next_counter(self._motion_counter, self._profile)
        return frame_of(self.can, message.id, data)

    def _conditions(self, cycle: int, measured: dict[str, float], inhibit: bool) -> Frame:
        message = self.can.vehicle_conditions
        names = [name for name, signal in message.signals().items() if isinstance(signal, RealSignal)]
        values = self.injector.signals(cycle, message.name, {name: measured.get(name, math.nan) for name in names})
        data = self._codec.encode(VehicleConditions(**values, inhibit=inhibit))
        data = protect(message.e2e_data_id, self._conditions_counter, data, self._profile)
        self._conditions_counter = next_counter(self._conditions_counter, self._profile)
        return frame_of(self.can, message.id, data)

    def bypass(self, cycle: int, frame: Frame) -> Frame:
        """Return a frame from the bus as the actuator receives it: a command with the rear angle of the scenario, if it has
        one. Other frames, and damaged ones, are unchanged."""
        message, profile = self.can.rear_steer_command, self._profile
        if self._rear_angle_commands is None or not is_configured(self.can, frame) or frame.id != message.id:
            return frame
        if Receiver(self.can.e2e, self.can.frame_bytes).check(message.e2e_data_id, frame.data) != E2eStatus.INITIAL:
            return frame
        decoded = self._codec.decode(message.id, frame.data)
        assert isinstance(decoded, RearSteerCommand)  # the payload of this message
        data = self._codec.encode(replace(decoded, rear_angle=float(self._rear_angle_commands[cycle])))
        return replace(frame, data=protect(message.e2e_data_id, received_counter(frame.data, profile), data, profile))

    def receive(self, frame: Frame) -> bool:
        """Process a frame from the bus. Return whether it was a command, valid or not; other frames are ignored."""
        if not is_configured(self.can, frame) or frame.id != self.can.rear_steer_command.id:
            return False
        self._arrived.append(frame)
        return True

    def _take(self, data: bytes) -> bool:
        """Check a command. Return whether it has an angle for the actuator."""
        message = self.can.rear_steer_command
        status = self._receiver.check(message.e2e_data_id, data)
        decoded = self._codec.decode(message.id, data)
        if status not in USABLE or not isinstance(decoded, RearSteerCommand):
            self.received.refused += 1
            return False
        self.received.commands += 1
        self.received.lost += status == E2eStatus.OK_SOME_LOST
        self.command = decoded
        self.diagnostics |= decoded.diagnostics
        if not math.isnan(decoded.yaw_rate_reference):
            self._reference = decoded.yaw_rate_reference
        if math.isnan(decoded.rear_angle):
            return False
        self._actuator.command(decoded.rear_angle)
        return True

    def advance(self, cycle: int, elapsed: float) -> None:
        """Move the car to a time (s) within the cycle, with the commands that came before it."""
        self._take_arrived(cycle)
        step = round(elapsed / self._config.plant.sampling_time_s)
        self._move(cycle, self._actuator.angle, min(step, self._per_sample))

    def finish(self, cycle: int) -> list[float]:
        """Finish a cycle: advance the car with the acting command and return the row of the recording (RECORD_COLUMNS)."""
        self._take_arrived(cycle)
        if not (self._heard or self._was_off):
            self._receiver.no_new_data()
        if not self._fresh:
            self.received.cycles_without += 1
        commanded = self._actuator.close(self._fresh)
        self._move(cycle, commanded, self._per_sample)
        return self._row(cycle, commanded)

    def _take_arrived(self, cycle: int) -> None:
        arrived, self._arrived = self._arrived, []
        if not self._was_off:
            for frame in self.injector.incoming(cycle, arrived):
                self._heard = True
                self._fresh |= self._take(frame.data)

    def _move(self, cycle: int, commanded: float, end: int) -> None:
        """Advance to a plant step of the cycle. Delayed commands act after their delay."""
        first = cycle * self._per_sample
        for step in range(self._moved, end):
            self._waiting.append(commanded)
            self._plant.advance([self._acting(first + step, self._waiting.popleft())])
        self._moved = max(self._moved, end)

    def _row(self, cycle: int, commanded: float) -> list[float]:
        sample: PlantSample = self._sample
        row = {
            "time_s": self.sampling_time * cycle,
            "speed_m_s": self._rows[cycle * self._per_sample][0],
            "front_angle_rad": sample.front_angle,
            "yaw_rate_rad_s": sample.yaw_rate,
            "yaw_rate_reference_rad_s": self._reference,
            "sideslip_rad": sample.sideslip_angle,
            "lateral_acceleration_m_s2": sample.lateral_acceleration,
            "rear_angle_command_rad": commanded,
            "rear_angle_rad": sample.rear_angle,
            "slip_front_rad": sample.slip_front,
            "slip_rear_rad": sample.slip_rear,
            **dict(zip((signal.variable for signal in RECORDED), sample.recorded_values(), strict=True)),
            "status": float(self._status()),
        }
        return [row[name] for name in RECORD_COLUMNS]

    def _status(self) -> int:
        """Return the controller's status, or the actuator's if no good command came."""
        own = self._actuator.status
        if own is not None:
            return own
        return Status.STANDBY if self.command is None else self.command.status

    def _acting(self, row: int, rear_angle_command: float) -> PlantInput:
        speed, wheel, friction, _, moment, *_ = self._rows[row]
        return PlantInput(speed, wheel, rear_angle_command, friction, moment)


class _ActuatorSupervision:
    """Supervision of the rear actuator: it holds the last command, and after a longer loss acts as configured."""

    def __init__(self, config: Config, sampling_time: float) -> None:
        actuator = config.rear_actuator
        self._returns = actuator.on_command_loss == "return"
        self._samples_max = actuator.command_loss_samples_max
        self._step = math.radians(actuator.return_rate_deg_s) * sampling_time
        self._angle, self._silent = 0.0, 0

    def command(self, angle: float) -> None:
        """Accept a good command in rad."""
        self._angle = angle

    @property
    def angle(self) -> float:
        """Target angle of the actuator in rad."""
        return self._angle

    @property
    def status(self) -> Status | None:
        """Status after a loss of commands; None after a good command."""
        if self._silent == 0:
            return None
        return Status.DEGRADED if self._silent <= self._samples_max else Status.FAIL_SAFE

    def close(self, fresh: bool) -> float:
        """Finish a cycle with or without a good command and return the actuator's target angle in rad."""
        self._silent = 0 if fresh else self._silent + 1
        if self._returns and self._silent > self._samples_max:
            self._angle -= math.copysign(min(self._step, abs(self._angle)), self._angle)
        return self._angle

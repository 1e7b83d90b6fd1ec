"""Named scenarios for car and bus, and the user's own from files.

Each names its source. Inputs are arrays with a row for each plant step; columns and units:
`codegen.sil.closed_loop.INPUT_COLUMNS`. The driver's inputs are defined in `hil_sim.manoeuvres`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.sil.closed_loop import INPUT_COLUMNS
from hil_sim import manoeuvres
from hil_sim.faults import Fault
from hil_sim.manoeuvres import Manoeuvre, PathOf, PreviewDriver, RoadPath
from hil_sim.settings import Settings


@dataclass(frozen=True)
class Clocks:
    """Deviation of the car's clock from the ECU's. Zeros: both run in step.

    Attributes:
        drift_ppm: rate of the car's clock less that of the ECU's, in parts per million.
        jitter_ms: the largest departure of each sending, and of each start of the task, from its own clock; uniform.
    """

    drift_ppm: float = 0.0
    jitter_ms: float = 0.0

    @property
    def are_free_running(self) -> bool:
        """Whether there are two clocks."""
        return self.drift_ppm != 0.0 or self.jitter_ms != 0.0

    def sending_times(self, count: int, period: float, seed: int = 0) -> FloatArray:
        """Return the times (count,) in s of the ECU's clock at which the car sends; both clocks tick together in the middle.

        Args:
            period: s, the nominal one of both.
            seed: of the jitter.

        Raises:
            CodegenError: the jitter could exchange two frames of a message.
        """
        jitter = 1e-3 * self.jitter_ms
        if 2.0 * jitter >= period:
            raise CodegenError(
                f"{self.jitter_ms:g} ms is half of the period of {1e3 * period:g} ms or more",
                where="`jitter_ms=`",
                remedy="choose less: frames of a message keep their order",
            )
        ticks, middle = np.arange(count, dtype=np.float64), 0.5 * count
        drifted = (ticks - middle) / (1.0 + 1e-6 * self.drift_ppm) + middle
        return period * drifted + jitter * np.random.default_rng((seed, 0)).uniform(-1.0, 1.0, count)

    def task_starts(self, cycles: int, period: float, seed: int = 0) -> list[tuple[float, ...]]:
        """Return the starts of the task in s after its tick, up to two, for each cycle of the car from one sending to the
        next.

        A start before the first sending is omitted. Arguments and errors as in `sending_times`.
        """
        if not self.are_free_running:
            return [(0.0,)] * cycles
        sent = self.sending_times(cycles, period, seed)
        starts = period * np.arange(cycles) + 1e-3 * self.jitter_ms * np.random.default_rng((seed, 1)).uniform(
            -1.0, 1.0, cycles
        )
        found: list[tuple[float, ...]] = [()] * cycles
        ticks = Clocks(self.drift_ppm).sending_times(cycles, period)
        end = ticks[-1] + period / (1.0 + 1e-6 * self.drift_ppm)  # of a car that is ahead of the ECU
        for cycle, start in zip(np.searchsorted(sent, starts, side="right") - 1, starts, strict=True):
            if cycle >= 0 and start <= end:
                found[cycle] += (float(start - ticks[cycle]),)
        return found


IN_STEP = Clocks()
"""One clock."""
HALF_RATE = Clocks(drift_ppm=1e6)
"""A task that the ECU calls at half the rate of the car's messages."""
FREE_RUNNING = Clocks(drift_ppm=100.0, jitter_ms=0.7)
"""Two quartz oscillators of 50 ppm each, the usual tolerance, and the jitter of a task and of a bus that others share."""


DEFAULT_SCENARIO = "step-steer"

MAX_STEPS = 10_000_000
"""Plant steps of one run: 2.8 hours at 1 ms, and half a gigabyte of inputs."""

Kind = Literal["step", "ramp", "sine-with-dwell", "frequency", "speed-ramp", "straight", "corner", "path", "recording"]
"""Kind of a scenario, which selects its metrics; see `hil_sim.metrics`."""

DEPARTURE_TIME_S = 2.0
"""Time in s of driving straight before a path begins."""

STEERING_KEYS = frozenset({"speed_km_h", "steering_wheel_angle_deg", "friction", "friction_estimate"})


@dataclass(frozen=True)
class Scenario:
    """One scenario.

    Attributes:
        name: name on the command line.
        subject, what: short title, and a line for the list.
        source: the paper or standard that describes it.
        duration: s.
        steer_time: s, when the driver starts to steer or to brake.
        kind: kind of figures reported for it.
        drive: inputs of driver and road.
        settings: the values of this scenario that a scenario file may change.
        angle_text: steering angle as text, if it follows from the car.
        adjustable: keys that a scenario file may set.
        faults: faults on the bus.
        clocks: clocks of car and ECU.
        path: path of a driver; None if `drive` turns the steering wheel.
        rear_angle: rear angle commands (n,) in rad at times (n,) in s, instead of the controller's; None for the controller's.
    """

    name: str
    subject: str
    what: str
    source: str
    duration: float
    steer_time: float
    kind: Kind
    drive: Manoeuvre
    settings: Settings = field(default_factory=Settings)
    angle_text: str = ""
    adjustable: frozenset[str] = STEERING_KEYS
    faults: tuple[Fault, ...] = ()
    clocks: Clocks = IN_STEP
    path: PathOf | None = None
    rear_angle: Callable[[FloatArray], FloatArray] | None = None

    @property
    def step_time(self) -> float | None:
        """Time of the steering step in s; None for a scenario of another kind."""
        return self.steer_time if self.kind == "step" else None

    @property
    def title(self) -> str:
        """The subject with its angle, speed and road, for plots and the console."""
        settings, parts = self.settings, []
        if settings.steering_wheel_angle_deg is not None:
            parts.append(f"{settings.steering_wheel_angle_deg:g} deg at the steering wheel")
        elif self.angle_text:
            parts.append(self.angle_text)
        if settings.speed_km_h is not None:
            parts.append(f"{settings.speed_km_h:g} km/h")
        if settings.friction is not None:
            parts.append(f"friction {settings.friction:g}")
        if settings.friction_estimate is not None:
            parts.append(f"estimated {settings.friction_estimate:g}")
        return f"{self.subject}: {', '.join(parts)}" if parts else self.subject

    def with_clocks(self, drift_ppm: float | None, jitter_ms: float | None) -> Scenario:
        """Return the scenario with two clocks if one of the values is given."""
        if drift_ppm is None and jitter_ms is None:
            return self
        return replace(self, clocks=Clocks(drift_ppm or 0.0, jitter_ms or 0.0))

    def road_path(self, config: Config) -> RoadPath | None:
        """Return the path for a car, DEPARTURE_TIME_S from the beginning; None if there is none."""
        return None if self.path is None else self.path(config, DEPARTURE_TIME_S * self.settings.speed)

    def driver(self, config: Config) -> PreviewDriver | None:
        """Return a driver of the path, at rest; None if there is none."""
        path = self.road_path(config)
        if path is None:
            return None
        return PreviewDriver(config, path, self.settings.speed, config.controller.sampling_time_s)

    def rear_angle_commands(self, config: Config) -> FloatArray | None:
        """Return the rear angle commands (samples,) in rad that replace those of the controller; None if there are none."""
        if self.rear_angle is None:
            return None
        period = config.controller.sampling_time_s
        return self.rear_angle(np.arange(max(round(self.duration / period), 1), dtype=np.float64) * period)

    def inputs(self, config: Config) -> FloatArray:
        """Return the inputs (steps, 7) of the whole scenario for a car, columns INPUT_COLUMNS.

        The longitudinal acceleration is that of the speed.

        Raises:
            CodegenError: the car cannot drive it, or it has more than MAX_STEPS steps.
        """
        step = config.plant.sampling_time_s
        per_sample = round(config.controller.sampling_time_s / step)
        steps = max(round(self.duration / config.controller.sampling_time_s), 1) * per_sample
        if steps > MAX_STEPS:
            raise CodegenError(
                f"{steps} plant steps are more than {MAX_STEPS}",
                where=f"scenario {self.name}",
                remedy="shorten it, or raise plant.sampling_time_s",
            )
        time = np.arange(steps, dtype=np.float64) * step
        columns: dict[str, Any] = {
            "friction": config.road.friction if self.settings.friction is None else self.settings.friction,
            "friction_estimate": np.nan if self.settings.friction_estimate is None else self.settings.friction_estimate,
            **self.drive(config, self.settings, time),
        }
        inputs = np.zeros((steps, len(INPUT_COLUMNS)))
        for name, values in columns.items():
            inputs[:, INPUT_COLUMNS.index(name)] = values
        speed = inputs[:, INPUT_COLUMNS.index("speed")]
        inputs[:, INPUT_COLUMNS.index("longitudinal_acceleration")] = np.gradient(speed, step)
        return inputs


_HELD = STEERING_KEYS | {"duration_s"}
_LOW_FRICTION = Scenario(
    name="low-friction",
    subject="Low friction",
    what="a step on a slippery road; the controller assumes a dry one",
    source="ISO 7401:2011, clause 10 (step input), on a road of friction 0.5",
    duration=12.0,
    steer_time=2.0,
    kind="step",
    drive=manoeuvres.step(2.0, front_angle_deg=2.0),
    settings=Settings(speed_km_h=80.0, friction=0.5),
    angle_text="2 deg at the front wheels",
    adjustable=_HELD,
)

SCENARIOS: Mapping[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        Scenario(
            name=DEFAULT_SCENARIO,
            subject="Step steer",
            what="a step at the steering wheel, as in the paper",
            source="Ryu, Hwang, Yoon, Choi, section Validation Setup; ISO 7401:2011, clause 10 (step input)",
            duration=15.0,
            steer_time=10.0,
            kind="step",
            drive=manoeuvres.step(10.0),
            settings=Settings(speed_km_h=42.5, steering_wheel_angle_deg=90.0),
            adjustable=_HELD,
        ),
        Scenario(
            name="ramp-steer",
            subject="Ramp steer",
            what="slowly increasing steer at constant speed: understeer gradient",
            source="ISO 4138:2021, constant-speed method with steadily increasing steering",
            duration=62.0,
            steer_time=2.0,
            kind="ramp",
            drive=manoeuvres.ramp(2.0, 62.0),
            settings=Settings(speed_km_h=80.0),
            angle_text="up to 6 m/s^2 in a linear car",
        ),
        Scenario(
            name="sine-with-dwell",
            subject="Sine with dwell",
            what="severe lane change: yaw-rate ratios and lateral displacement",
            source="FMVSS 126 (49 CFR 571.126), S5.2 and S7.9; UN R140, paragraphs 7 and 9",
            duration=6.0,
            steer_time=1.0,
            kind="sine-with-dwell",
            drive=manoeuvres.sine_with_dwell(1.0),
            settings=Settings(speed_km_h=80.0),
            angle_text="5 times the steering angle for 0.3 g",
        ),
        Scenario(
            name="sine-sweep",
            subject="Sine sweep",
            what="0.1 to 4 Hz at the steering wheel: frequency response",
            source="ISO 7401:2011, clause 14 (continuous sinusoidal input), its frequency rising steadily",
            duration=85.0,
            steer_time=1.0,
            kind="frequency",
            drive=manoeuvres.sine_sweep(1.0, 81.0),
            settings=Settings(speed_km_h=80.0),
            angle_text="the steering angle for 2 m/s^2",
        ),
        Scenario(
            name="speed-ramp",
            subject="Speed ramp",
            what="speed up through the speeds at which feedback begins, and down again, steering held",
            source="controller.slow_speed_km_h; for kind pi controller.enable_speed_km_h and disable_speed_km_h",
            duration=20.0,
            steer_time=0.5,
            kind="speed-ramp",
            drive=manoeuvres.speed_ramp((2.0, 8.0, 12.0, 18.0)),
            settings=Settings(steering_wheel_angle_deg=45.0),
        ),
        _LOW_FRICTION,
        replace(
            _LOW_FRICTION,
            name="low-friction-estimated",
            what="the same step with the friction of the road given to the controller",
            settings=Settings(speed_km_h=80.0, friction=0.5, friction_estimate=0.5),
        ),
        Scenario(
            name="split-friction",
            subject="Split friction",
            what="braking with one side on a slippery road: its yaw moment, steering held straight",
            source="ISO 14512 (straight-ahead braking on split friction); UN R13-H, annex 6; forces: hil_sim.manoeuvres",
            duration=8.0,
            steer_time=2.0,
            kind="straight",
            drive=manoeuvres.split_friction(2.0, 5.0),
            settings=Settings(speed_km_h=80.0),
            angle_text="braking for 3 s",
            adjustable=frozenset({"speed_km_h", "friction_estimate"}),
        ),
        Scenario(
            name="yaw-moment",
            subject="Yaw moment",
            what="a lasting yaw moment from outside, steering held straight",
            source="ISO 12021:2010 (sensitivity to lateral wind), the yaw moment alone",
            duration=8.0,
            steer_time=1.0,
            kind="straight",
            drive=manoeuvres.yaw_moment(1.0, 2000.0),
            settings=Settings(speed_km_h=90.0),
            angle_text="2,000 N m",
            adjustable=_HELD - {"steering_wheel_angle_deg"},
        ),
        Scenario(
            name="ecu-loss",
            subject="Loss of the ECU in a corner",
            what="the ECU dies in a corner at 100 km/h and comes back a second later",
            source="ISO 26262-4:2018 (fault injection test), in a steady corner as of ISO 4138:2021",
            duration=14.0,
            steer_time=2.0,
            kind="corner",
            drive=manoeuvres.corner(2.0, 4.0, front_angle_deg=4.0),
            settings=Settings(speed_km_h=100.0),
            angle_text="4 deg at the front wheels",
            adjustable=_HELD,
            faults=(Fault(kind="ecu-restart", start=9.0, duration=1.0),),
        ),
    )
}

_FOLLOWED = frozenset({"speed_km_h", "friction", "friction_estimate", "duration_s"})
PATH_SCENARIOS: Mapping[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        Scenario(
            name="double-lane-change",
            subject="Double lane change",
            what="obstacle avoidance by a driver who follows a path through its three lanes",
            source="ISO 3888-2:2011 (track); MacAdam 1981 (driver)",
            duration=9.0,
            steer_time=1.0,
            kind="path",
            drive=manoeuvres.straight,
            settings=Settings(speed_km_h=60.0),
            angle_text="by a driver",
            adjustable=_FOLLOWED,
            path=manoeuvres.double_lane_change,
        ),
        Scenario(
            name="slalom",
            subject="Slalom",
            what="six cones 36 m apart, by a driver who follows a sine around them",
            source="MacAdam 1981 (driver); no standard fixes the cones",
            duration=16.0,
            steer_time=1.0,
            kind="path",
            drive=manoeuvres.straight,
            settings=Settings(speed_km_h=80.0),
            angle_text="by a driver",
            adjustable=_FOLLOWED,
            path=manoeuvres.slalom,
        ),
    )
}
"""Scenarios with a driver model in the loop: their steering is not known in advance."""
BUILT_IN: Mapping[str, Scenario] = {**SCENARIOS, **PATH_SCENARIOS}


@dataclass(frozen=True)
class Listed:
    """An entry of the list of scenarios, with its faults as text."""

    name: str
    what: str
    source: str
    duration_s: float
    faults: tuple[str, ...]


def listing() -> tuple[Listed, ...]:
    """Return the built-in scenarios, the default first."""
    return tuple(
        Listed(
            scenario.name,
            scenario.what,
            scenario.source,
            scenario.duration,
            tuple(f"{fault.kind} at {fault.start:g} s for {fault.duration:g} s" for fault in scenario.faults),
        )
        for scenario in BUILT_IN.values()
    )

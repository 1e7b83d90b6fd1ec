"""The recommended controller with one signal lost or wrong in a corner, and with all of them lost, while the driver acts.

The car goes on with what its controller believes; the same drive without the fault is what its path is compared with. Measures
no time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.tables import CountReport, Row
from codegen.configuration import Case, Config
from codegen.metrics.runs import SPIN_REAR_SLIP, SPIN_SIDESLIP
from codegen.sil.plant import Plant, PlantInput
from codegen.sil.software import Measurement, Software
from codegen.units import KM_H
from hil_sim.suite.cells import cells, front_angle
from hil_sim.suite.subjects import recommended

STEER_TIME, FAULT_TIME, DRIVER_TIME, DURATION = 0.3, 2.0, 2.2, 5.0
"""s: the driver steers in, the signal fails, the driver acts, the run ends."""
STRAIGHT_TIME = 0.1
"""s: a signal that fails before the driver steers in, and so without a jump."""
SPEEDS_KM_H, SPEEDS_ALL_KM_H, SHARES = (50.0, 80.0, 110.0), (80.0, 90.0, 100.0, 110.0, 120.0), (0.6, 0.9)
"""Shares of the front angle at which the map reaches what it allows at that speed; in ALL_LARGEST of the largest feasible."""
DEVIATION_MAX = 2.0
"""m, of the median path."""

OFFSET = math.radians(10.0)
"""rad/s."""
WAYS: dict[str, tuple[float, float, float]] = {
    "lost": (math.nan, 0.0, 0.0),
    "frozen": (0.0, 1.0, 0.0),
    "sign flipped": (-1.0, 0.0, 0.0),
    "half": (0.5, 0.0, 0.0),
    "zero": (0.0, 0.0, 0.0),
    "10 deg/s more": (1.0, 0.0, OFFSET),
}
"""Shares of a value and of what it was when the fault began, and what is added."""
ALL, ALL_LARGEST = "all", "all, largest angles"
"""Faults of all signals. With the largest feasible angles, twice the others at 100 km/h, the rear wheels turn in phase, and the
passive car spins in some of these cells too."""
FAULTS = {
    "yaw_rate": tuple(WAYS),
    "front_angle": ("lost", "frozen", "sign flipped", "half", "zero"),
    "speed": ("lost", "sign flipped", "half", "zero"),
    "lateral_acceleration": ("lost", "frozen", "sign flipped", "half", "zero"),
    ALL: ("lost",),
    ALL_LARGEST: ("lost",),
}
SIGNALS = ("speed", "front_angle", "yaw_rate", "rear_angle", "lateral_acceleration")

BIAS, BIAS_SPEED, BIAS_DURATION, DRIFT_MAX_DEG = math.radians(0.25), 128.0 * KM_H, 7.0, 0.3
"""rad/s, m/s, s, deg: an offset of the yaw rate on a straight, and how far it may turn the car."""


def keep(seconds: float) -> float:
    """Return the fraction of the front angle at a time after the driver acts: unchanged."""
    del seconds
    return 1.0


def straighten(seconds: float) -> float:
    """Straighten within 0.3 s."""
    return max(0.0, 1.0 - seconds / 0.3)


def counter_steer(seconds: float) -> float:
    """Countersteer to 0.6 of the angle within 0.4 s, hold it for half a second, and straighten within 0.3 s."""
    return max(-0.6, 1.0 - 1.6 * seconds / 0.4) if seconds < 0.9 else min(0.0, -0.6 + 2.0 * (seconds - 0.9))


DRIVERS = (keep, straighten, counter_steer)


@dataclass(frozen=True)
class Drive:
    """Place of the car at the end, in m, and whether it has spun."""

    x: float
    y: float
    spun: bool


def drive(
    software: Software,
    speed: float,
    front_angle: float,
    driver: Callable[[float], float],
    signal: str,
    way: str,
    fault_time: float = FAULT_TIME,
) -> Drive:
    """Run at a speed (m/s) with a front angle (rad); `signal`, if not empty, fails at `fault_time` (s)."""
    config = software.config
    plant, controller = Plant(config), software.controller()
    period, ratio = config.controller.sampling_time_s, config.steering.ratio
    steps = round(period / config.plant.sampling_time_s)
    command, spun, before = 0.0, False, dict[str, float]()
    for sample in range(round(DURATION / period)):
        time = sample * period
        share = min(max((time - STEER_TIME) / 0.3, 0.0), 1.0) if time < DRIVER_TIME else driver(time - DRIVER_TIME)
        acting = PlantInput(speed, share * front_angle * ratio, command, config.road.friction)
        car = plant.sample(acting)
        measured = Measurement(
            speed, car.front_angle, car.yaw_rate, car.rear_angle, lateral_acceleration=car.lateral_acceleration
        )
        if signal and time >= fault_time - 0.5 * period:
            for name in SIGNALS if signal in (ALL, ALL_LARGEST) else (signal,):
                now = float(getattr(measured, name))
                share_now, share_before, added = WAYS[way]
                wrong = share_now * now + share_before * before.setdefault(name, now) + added
                measured = replace(measured, **{name: wrong})  # type: ignore[arg-type]
        command = controller.step(measured).rear_angle
        spun = spun or (abs(car.sideslip_angle) > SPIN_SIDESLIP and abs(car.slip_rear) > SPIN_REAR_SLIP)
        plant.advance([acting] * steps)
    x, y, _ = plant.position
    return Drive(x, y, spun)


def drift(software: Software, bias: float) -> tuple[float, float]:
    """Return heading (deg) and lateral deviation (m) at the end of a drive; `bias` (rad/s) is added to the yaw rate."""
    config = software.config
    plant, controller = Plant(config), software.controller()
    period, command = config.controller.sampling_time_s, 0.0
    steps = round(period / config.plant.sampling_time_s)
    for _ in range(round(BIAS_DURATION / period)):
        acting = PlantInput(BIAS_SPEED, 0.0, command, config.road.friction)
        car = plant.sample(acting)
        measured = (BIAS_SPEED, car.front_angle, car.yaw_rate + bias, car.rear_angle)
        command = controller.step(Measurement(*measured, lateral_acceleration=car.lateral_acceleration)).rear_angle
        plant.advance([acting] * steps)
    _, beside, heading = plant.position
    return math.degrees(heading), beside


def _straight(software: Software) -> Row:
    heading, beside = drift(software, BIAS)
    met = abs(heading) <= DRIFT_MAX_DEG
    return Row((f"{heading:.2f}", f"{beside:.2f}", f"at most {DRIFT_MAX_DEG:g} deg: {'met' if met else 'MISSED'}"), met)


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Compare each fault in each cell with each driver; `quick` takes one speed."""
    comparison = recommended().comparison()
    subject = comparison.tested
    software = subject.around(subject.config)
    edges = {ALL_LARGEST: _feasible_edges(subject.config, comparison.case)}
    sound: dict[tuple[float, float, str], Drive] = {}
    rows: dict[float, list[Row]] = {FAULT_TIME: [], STRAIGHT_TIME: []}
    starts = [(FAULT_TIME, *fault) for fault in FAULTS.items()]
    starts += [(STRAIGHT_TIME, *fault) for fault in FAULTS.items() if fault[0] in SIGNALS]
    for start, signal, ways in starts:
        all_lost = signal in (ALL, ALL_LARGEST)
        speeds = SPEEDS_ALL_KM_H if all_lost else SPEEDS_KM_H
        for way in ways:
            say(f"{signal.replace('_', ' ')} {way}, from {start:g} s on")
            spins, apart = 0, []
            for speed_km_h in speeds[-1:] if quick else speeds:
                speed = speed_km_h * KM_H
                edge = edges[signal][speed_km_h] if signal in edges else _edge(software, speed)
                for share in SHARES:
                    for driver in DRIVERS:
                        case = (software, speed, share * edge, driver)
                        key = (speed_km_h, share * edge, driver.__name__)
                        sound[key] = sound[key] if key in sound else drive(*case, "", "")
                        found = drive(*case, signal, way, start)
                        spins += found.spun and not sound[key].spun
                        apart.append(math.hypot(found.x - sound[key].x, found.y - sound[key].y))
            median = float(np.median(apart))
            only_spins = all_lost or start == STRAIGHT_TIME
            met = spins == 0 and (only_spins or median <= DEVIATION_MAX)
            asked = "no spin" if only_spins else f"no spin, median at most {DEVIATION_MAX:g} m"
            texts = (signal.replace("_", " "), way, str(len(apart)), str(spins), f"{median:.2f}", f"{max(apart):.2f}")
            rows[start].append(Row((*texts, f"{asked}: {'met' if met else 'MISSED'}"), met))
    header = ("signal", "fault", "runs", "spins", "path, median [m]", "largest [m]", "required")
    notes = (
        f"Path: distance, {DURATION - FAULT_TIME:g} s after the fault, from the car that has none and the same driver, "
        f"who keeps the wheel, straightens it or counter-steers {DRIVER_TIME - FAULT_TIME:g} s after the fault.",
        "Faults of one signal at 50, 80 and 110 km/h, of all at 80 to 120 km/h. A spin of the sound car too is not counted.",
    )
    straight = (
        f"{BIAS_DURATION:g} s straight ahead at {BIAS_SPEED / KM_H:g} km/h, the yaw rate {math.degrees(BIAS):g} deg/s too large"
    )
    return CountReport(
        (
            ('A signal lost or wrong in a corner, kind "tracking"', header, tuple(rows[FAULT_TIME])),
            ("The same before the corner, where it does not jump", header, tuple(rows[STRAIGHT_TIME])),
            (straight, ("heading [deg]", "beside the straight [m]", "required"), (_straight(software),)),
        ),
        notes,
    )


def _feasible_edges(config: Config, case: Case) -> dict[float, float]:
    """Return the largest feasible front angle, in rad, at each of SPEEDS_ALL_KM_H."""
    return {cell.speed_km_h: front_angle(cell) for cell in cells(config, case, SPEEDS_ALL_KM_H, (1.0,))}


def _edge(software: Software, speed: float) -> float:
    """Return the front angle, in rad, from which the map has the largest lateral acceleration that it allows at a speed."""
    angles = np.radians(np.linspace(0.1, 30.0, 600))
    yaw_rate = software.map_yaw_rate(speed, angles)
    return float(angles[int(np.argmax(yaw_rate >= 0.999 * yaw_rate.max()))])

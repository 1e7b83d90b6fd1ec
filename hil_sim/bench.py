"""The bench: carries the car's frames to an ECU and its commands back, cycle by cycle, with one of three clocks.

- lock-step: the car waits for the answer to each of its samples; time is simulated, as fast as the machine allows;
- real time: cycles begin at absolute deadlines; the command that came within the cycle acts over it, else the last one holds;
- in process: no bus at all; the task is called after the frames of each cycle, delivered or not, or by a clock of its own
(`hil_sim.scenarios`): time is simulated.

Where no frame is lost or late and the clocks run in step, all three give the same bits.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.errors import CodegenError
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Software
from hil_sim.codec import Frame, RearSteerCommand, frame_of, is_configured
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import Scenario

if TYPE_CHECKING:
    from hil_sim.bus import Bus
    from hil_sim.logs import BusLog


ANSWER_TIMEOUT = 2.0
"""Time in s to wait for an answer in lock-step before the ECU counts as lost."""


class Ecu(Protocol):
    """An ECU that the bench can stop and restart."""

    def kill(self) -> None:
        """Stop the ECU as a power failure does."""

    def start(self) -> None:
        """Start the ECU again; return at once."""


@dataclass(frozen=True)
class Cycle:
    """State of one cycle during a run: `row` as in the recording, times in s."""

    number: int
    row: list[float]
    command: RearSteerCommand | None
    duration: float
    without_command: int
    late: int


@dataclass(frozen=True)
class BenchResult:
    """Result of a run.

    Attributes:
        record: (cycles, columns), RECORD_COLUMNS.
        diagnostics: (cycles,) bits of the commands received in the cycle; 0 if none was received.
        response: (cycles,) s from sending to the command's arrival; NaN without a command in the cycle, or in simulated time.
        lateness: (cycles,) s that the cycle began after its deadline.
        late_cycles: cycles that began a period or more late.
        wall_time: s.
        received: counts of the received commands.
        send_errors: frames that the interface rejected.
    """

    record: FloatArray
    diagnostics: npt.NDArray[np.uint16]
    response: FloatArray
    lateness: FloatArray
    late_cycles: int
    wall_time: float
    received: dict[str, int]
    send_errors: int


Observer = Callable[[Cycle], None]


@dataclass
class _Recorder:
    """Collects the results of the cycles."""

    node: PlantNode
    observe: Observer | None
    rows: list[list[float]] = field(default_factory=list)
    diagnostics: list[int] = field(default_factory=list)
    response: list[float] = field(default_factory=list)
    lateness: list[float] = field(default_factory=list)
    late: int = 0
    send_errors: int = 0
    begun: float = field(default_factory=time.monotonic)
    closed: float = field(default_factory=time.monotonic)

    def close_cycle(self, cycle: int, lateness: float, response: float) -> None:
        node = self.node
        row = node.finish(cycle)
        self.rows.append(row)
        self.diagnostics.append(node.diagnostics)
        self.response.append(response)
        self.lateness.append(lateness)
        if self.observe is not None:
            now = time.monotonic()
            without = node.received.cycles_without
            self.observe(Cycle(cycle, row, node.command, now - self.closed, without, self.late))
            self.closed = now

    def result(self) -> BenchResult:
        return BenchResult(
            np.array(self.rows),
            np.array(self.diagnostics, dtype=np.uint16),
            np.array(self.response),
            np.array(self.lateness),
            self.late,
            time.monotonic() - self.begun,
            self.node.received.to_dict(),
            self.send_errors,
        )


def run_in_process(
    node: PlantNode, software: Software, *, log: BusLog | None = None, observe: Observer | None = None
) -> BenchResult:
    """Run without a bus: call the generated task in this process once a cycle, or by a clock of its own."""
    recorder, task = _Recorder(node, observe), software.task()
    running = True
    for cycle in range(node.cycles):
        now = cycle * node.sampling_time
        off = node.injector.ecu_off(cycle)
        if not off and not running:
            task = software.task()  # after a restart it has no state
        running = not off
        for frame in node.outgoing(cycle):
            _note(log, frame, now, received=False)
            if running and is_configured(node.can, frame):
                task.on_can_frame(frame.id, frame.data)
        for elapsed in node.task_starts[cycle] if running else ():
            node.advance(cycle, elapsed)
            answer = node.bypass(cycle, frame_of(node.can, *task.run()))
            _note(log, answer, now + elapsed, received=True)
            node.receive(answer)
        recorder.close_cycle(cycle, 0.0, np.nan)
    return recorder.result()


def run_in_lock_step(node: PlantNode, bus: Bus, *, log: BusLog | None = None, observe: Observer | None = None) -> BenchResult:
    """Run on a bus in simulated time.

    Raises:
        CodegenError: the scenario has faults, which would leave the ECU without a complete set of frames, or two clocks; or no
            answer comes.
    """
    if node.injector.faults:
        raise CodegenError(
            "bus faults cannot be simulated in lock-step: without a complete set of frames, the task does not run",
            where="`lock_step=True`",
            remedy="use `lock_step=False`",
        )
    if node.is_free_running:
        raise CodegenError("in lock-step there is one clock", where="`lock_step=True`", remedy="use `lock_step=False`")
    recorder = _Recorder(node, observe)
    _drain(bus)
    for cycle in range(node.cycles):
        now = cycle * node.sampling_time
        for frame in node.outgoing(cycle):
            recorder.send_errors += not bus.send(frame)
            _note(log, frame, now, received=False)
        deadline = time.monotonic() + ANSWER_TIMEOUT
        while True:
            received = bus.receive(deadline - time.monotonic())
            if received is None:
                if time.monotonic() < deadline:
                    continue
                raise _no_answer(bus, now)
            received = node.bypass(cycle, received)
            _note(log, received, now, received=True)
            if node.receive(received):
                break
        recorder.close_cycle(cycle, 0.0, np.nan)
        if node.received.refused:
            raise CodegenError(
                f"a command at {now:.2f} s was not in sequence: another node sends 0x{node.command_id:03X} here",
                where=str(bus.address),
                remedy="leave one ECU and one plant on this bus",
            )
    return recorder.result()


def run_in_real_time(
    node: PlantNode,
    bus: Bus,
    *,
    ecu: Ecu | None = None,
    log: BusLog | None = None,
    observe: Observer | None = None,
) -> BenchResult:
    """Run on a bus in real time with the drift and jitter of the scenario. `ecu` is stopped and restarted as the faults
    require."""
    period, recorder = node.sampling_time, _Recorder(node, observe)
    after_first = (node.sending_times - node.sending_times[0]).tolist()
    running = True
    _drain(bus)
    with _no_pauses():
        start = origin = time.monotonic() + period
        for cycle in range(node.cycles):
            deadline = origin + after_first[cycle]
            _wait(deadline)
            lateness = time.monotonic() - deadline
            if lateness >= period:  # continue with the next deadline in the same phase, without a burst to catch up
                recorder.late += 1
                origin += math.ceil(lateness / period) * period
                _wait(origin + after_first[cycle])
            running = _switch(ecu, running, node.injector.ecu_off(cycle))
            sent = time.monotonic()
            for frame in node.outgoing(cycle):
                recorder.send_errors += not bus.send(frame)
                _note(log, frame, sent - start, received=False)
            deadline = origin + after_first[cycle + 1]
            response = np.nan
            while (left := deadline - time.monotonic()) > 0.0:
                received = bus.receive(left)
                if received is None:
                    continue
                now = time.monotonic()
                received = node.bypass(cycle, received)
                _note(log, received, now - start, received=True)
                if node.receive(received) and np.isnan(response):
                    response = now - sent
            recorder.close_cycle(cycle, lateness, response)
    return recorder.result()


def _switch(ecu: Ecu | None, running: bool, off: bool) -> bool:
    """Kill or start the ECU if its power changes. Return whether it runs."""
    if ecu is not None and running == off:
        if off:
            ecu.kill()
        else:
            ecu.start()
    return not off


def _note(log: BusLog | None, frame: Frame, now: float, *, received: bool) -> None:
    if log is not None:
        timed = replace(frame, time=now)
        log.write(timed, received=received)


def _drain(bus: Bus) -> None:
    """Discard frames received before the run."""
    while bus.receive(0.0) is not None:
        pass


def _wait(deadline: float) -> None:
    left = deadline - time.monotonic()
    if left > 0.0:
        time.sleep(left)


@contextmanager
def _no_pauses() -> Iterator[None]:
    """Disable the garbage collector, which could stop the run for longer than a cycle. A run allocates a bounded amount."""
    collecting = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _no_answer(bus: Bus, now: float) -> CodegenError:
    return CodegenError(
        f"no answer to the frames of {now:.2f} s within {ANSWER_TIMEOUT:g} s",
        where=str(bus.address),
        remedy="check that an ECU runs on this bus in lock-step, and that the interface is up",
    )


def run(software: Software, scenario: Scenario, *, controlled: bool = True) -> npt.NDArray[np.float64]:
    """Return a recording (samples, columns) of a scenario, RECORD_COLUMNS; `controlled=False` is the passive car.

    Raises:
        CodegenError: the scenario needs a bus (faults or two clocks) and the car is not passive.
    """
    if controlled:
        refuse_bus(scenario)
    loop = ClosedLoop(software, LoopOptions(controlled=controlled))
    driver, inputs = scenario.driver(software.config), scenario.inputs(software.config)
    commands = scenario.rear_angle_commands(software.config)
    if driver is None and commands is None:
        return loop.run(inputs)
    return loop.run_stepped(inputs, None if driver is None else driver.steer, commands)


def refuse_bus(scenario: Scenario) -> None:
    """Raise CodegenError where a scenario has faults on the bus or two clocks, for a run without a bus."""
    if scenario.faults or scenario.clocks.are_free_running:
        kinds = ", ".join(fault.kind for fault in scenario.faults) or "two clocks"
        raise CodegenError(
            f"it has faults on the bus ({kinds}), and this run has no bus",
            where=f"scenario {scenario.name}",
            remedy="run it on a bus (codegen hil), or with `through_can=True`",
        )


def run_through_can(software: Software, scenario: Scenario, *, sensors: bool = False, seed: int = 0) -> BenchResult:
    """Run a scenario through the generated task and its CAN frames, faults included, in this process.

    Args:
        sensors: whether to simulate the configured sensors.
        seed: seed of noise and random faults.
    """
    node = PlantNode(software.config, scenario, precision=software.precision, sensors=sensors, seed=seed)
    return run_in_process(node, software)

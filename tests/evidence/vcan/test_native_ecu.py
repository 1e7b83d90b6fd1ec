"""The native ECU on SocketCAN: the generated task's answers, in lock-step and in real time, and recovery from failures."""

import os
import shlex
import signal
import socket
import statistics
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from codegen.sil.software import Software, Status
from hil_sim import ecu_process
from hil_sim.codec import Codec, Frame, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.e2e import next_counter, protect
from hil_sim.ecu_process import EcuProcess
from tests import builds
from tests.evidence.vcan.conftest import FOLDER
from tests.evidence.vcan.interfaces import add_vcan, remove, set_interface

CONFIG = builds.CONFIG
MOTION, CONDITIONS, COMMAND = (
    message.id for message in (CONFIG.can.vehicle_motion, CONFIG.can.vehicle_conditions, CONFIG.can.rear_steer_command)
)
PERIOD = CONFIG.controller.sampling_time_s
EXTENDED, REMOTE = 0x80000000, 0x40000000  # linux/can.h: CAN_EFF_FLAG, CAN_RTR_FLAG
TIMEOUT_S = 10.0
"""Timeout in s; only a failure waits this long."""
GOOD = (Status.TRACKING, Status.LIMITED, Status.STANDBY)
STEADY_TURN, STRAIGHT_REAR = VehicleMotion(speed=15.0, front_angle=0.02, yaw_rate=0.1), VehicleConditions(rear_angle=0.0)
MISSING, WRONG_CRC, YAW_RATE_REPLACED = 1 << 0 | 1 << 3, 1 << 1 | 1 << 4, 1 << 9


class RawSocket:
    """A raw socket on the bus, with the kernel's frames. It does not receive its own frames."""

    layout = struct.Struct("=IB3x8s")

    def __init__(self, interface: str) -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.bind((interface,))

    def send(self, *frames: tuple[int, bytes]) -> None:
        for identifier, data in frames:
            self._socket.send(self.layout.pack(identifier, len(data), data))

    def receive(self, timeout: float = TIMEOUT_S) -> Frame | None:
        """Return the next frame, or None at the timeout."""
        self._socket.settimeout(max(timeout, 1e-6))
        try:
            identifier, length, data = self.layout.unpack(self._socket.recv(self.layout.size))
        except TimeoutError:
            return None
        return Frame(identifier, data[:length])

    def __enter__(self) -> "RawSocket":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()


@dataclass
class Car:
    """Frames of a car in a steady turn. The counters continue from set to set."""

    counter: int = 0

    def frames(
        self, motion: VehicleMotion = STEADY_TURN, conditions: VehicleConditions = STRAIGHT_REAR
    ) -> list[tuple[int, bytes]]:
        codec, counter = Codec(CONFIG.can), self.counter
        self.counter = next_counter(counter)
        codes = ((MOTION, codec.encode(motion)), (CONDITIONS, codec.encode(conditions)))
        return [(identifier, protect(identifier, counter, data)) for identifier, data in codes]

    def command(self, frame: Frame | None) -> RearSteerCommand:
        """Decode an answer."""
        assert frame is not None, "no answer"
        return Codec(CONFIG.can).decode(frame.id, frame.data)

    def takes_control(self, wire: RawSocket) -> bool:
        """Send a set for each command, until a command comes from an active controller."""
        limit = time.monotonic() + TIMEOUT_S
        while time.monotonic() < limit:
            wire.send(*self.frames())
            frame = wire.receive(2.0 * PERIOD)
            if frame is not None and self.command(frame).status in GOOD and not np.isnan(self.command(frame).rear_angle):
                return True
        return False


@pytest.fixture
def wire(vcan: str) -> Iterator[RawSocket]:
    with RawSocket(vcan) as wire:
        yield wire


@contextmanager
def started(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    """Start a process with pipes; kill it at the end."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(params=[True, False], ids=["lock-step", "real-time"])
def running(request: pytest.FixtureRequest, vcan: str) -> Iterator[tuple[subprocess.Popen[str], bool]]:
    """Start an ECU; return it and whether it is in lock-step."""
    with started(ecu_process.command(FOLDER, vcan, lock_step=request.param, parent=os.getpid())) as process:
        assert process.stdout.readline() == "ready\n"
        yield process, request.param


def end(ecu: subprocess.Popen[str], number: signal.Signals = signal.SIGTERM) -> str:
    """End an ECU with a signal; return its line of counters or its error."""
    ecu.send_signal(number)
    return ecu.communicate(timeout=TIMEOUT_S)[1]


def foreign_frames(rng: np.random.Generator) -> list[tuple[int, bytes]]:
    """Return frames that an ECU must ignore: other nodes' frames, other kinds of frames, a command from another sender."""
    data = rng.bytes(8)
    frames = [
        (int(rng.integers(0x100)), data),
        (0x7FF, b""),
        *((identifier | EXTENDED, data) for identifier in (MOTION, CONDITIONS, COMMAND, 0x18FEF100)),
        (MOTION | REMOTE, bytes(8)),
        (CONDITIONS | REMOTE, b""),
        (COMMAND, data),
    ]
    return [frames[index] for index in rng.permutation(len(frames))[:3]]


def random_set(rng: np.random.Generator, car: Car) -> list[tuple[int, bytes]]:
    """Return both frames, some with a missing signal or a flipped bit, some after conditions that start no set or have a wrong
    length."""
    yaw_rate = rng.uniform(-0.8, 0.8) if rng.random() < 0.95 else float("nan")
    motion = VehicleMotion(rng.uniform(-2.0, 40.0), rng.uniform(-0.3, 0.3), yaw_rate)
    conditions = VehicleConditions(rng.uniform(-0.05, 0.05), float(rng.choice([0.3, 0.9, np.nan])), bool(rng.random() < 0.1))
    frames = car.frames(motion, conditions)
    if rng.random() < 0.05:
        identifier, data = frames[0]
        frames[0] = (identifier, data[:3] + bytes((data[3] ^ 0x10,)) + data[4:])
    if rng.random() < 0.2:
        frames.insert(0, frames[1])
    if rng.random() < 0.1:
        wrong_length = rng.bytes(int(rng.integers(8)))
        # Either counts as received: conditions would end the set after the motion, and start none before it.
        place, identifier = (0, CONDITIONS) if rng.random() < 0.5 else (len(frames) - 1, MOTION)
        frames.insert(place, (identifier, wrong_length))
    return frames


def test_each_set_is_answered_once_with_the_bits_of_the_task(vcan: str, wire: RawSocket, software: Software) -> None:
    rng, car, sets, seen = np.random.default_rng(1), Car(), 500, 0
    task = software.task()
    with EcuProcess(ecu_process.command(FOLDER, vcan, lock_step=True, parent=os.getpid())) as ecu:
        for number in range(sets):
            for identifier, data in random_set(rng, car):
                wire.send(*foreign_frames(rng), (identifier, data))
                task.on_can_frame(identifier, data)
            assert task.is_complete
            answer = Frame(*task.run())
            assert wire.receive() == answer, number
            seen |= car.command(answer).diagnostics
        wire.send(car.frames()[0])  # half a set is not answered
        assert wire.receive(0.05) is None
        counts = ecu_process.counters(ecu.stop())
    assert (counts["cycles"], counts["sent"], counts["send_errors"], counts["late"]) == (sets, sets, 0, 0)
    assert (counts["late_samples"], counts["early_samples"]) == (task.counters()["late_cycles"], 0)
    assert counts["lost_samples"] == task.counters()["lost_samples"] > 0  # the flipped bits
    assert seen & WRONG_CRC


def test_every_period_has_exactly_one_command(wire: RawSocket, vcan: str) -> None:
    """Before the first frames every signal is `not available`."""
    begun, car = time.monotonic(), Car()
    with EcuProcess(ecu_process.command(FOLDER, vcan, parent=os.getpid())) as ecu:
        answers = [wire.receive() for _ in range(8)]
        for command in map(car.command, answers):
            assert np.isnan((command.rear_angle, command.yaw_rate_reference)).all()
            assert command.diagnostics & MISSING == MISSING
        while len(answers) < 100:
            wire.send(*car.frames())
            answers.append(wire.receive())
        counts = ecu_process.counters(ecu.stop())
    elapsed = time.monotonic() - begun
    answers += iter(lambda: wire.receive(0.0), None)
    found = [(answer.id, answer.data[1] & 0x0F) for answer in answers if answer is not None]
    assert found == [(COMMAND, number % 15) for number in range(len(answers))]
    assert counts["cycles"] == counts["sent"] == len(answers)
    # One run at the start of each period, and one more when the phase was set.
    assert counts["cycles"] <= elapsed / PERIOD + 2


def test_silence_degrades_then_fails_safe_and_ends(wire: RawSocket, vcan: str) -> None:
    car = Car()
    with EcuProcess(ecu_process.command(FOLDER, vcan, parent=os.getpid())):
        assert car.takes_control(wire)
        commands = [car.command(wire.receive()) for _ in range(12)]
        statuses = [command.status for command in commands]
        while any(status in GOOD for status in statuses):  # the last set may still be under way
            del statuses[0]
        tolerated = CONFIG.controller.fail_safe.degraded_samples_max
        assert statuses[:tolerated] == [Status.DEGRADED] * tolerated
        assert set(statuses[tolerated:]) == {Status.FAIL_SAFE}
        assert commands[-1].diagnostics & YAW_RATE_REPLACED
        assert commands[-1].diagnostics & MISSING == MISSING
        assert car.takes_control(wire)


def response_times(wire: RawSocket, car: Car, cycles: int) -> list[float]:
    """Send sets at absolute deadlines, and return the time from each deadline to the first answer of its cycle."""
    responses, begun = [], time.monotonic()
    for cycle in range(cycles):
        wire.send(*car.frames())
        answers = []
        while (left := begun + (cycle + 1) * PERIOD - time.monotonic()) > 0.0:
            if wire.receive(left) is not None:
                answers.append(time.monotonic() - begun - cycle * PERIOD)
        responses += answers[:1]
    return responses


@pytest.mark.long
def test_the_phase_is_half_a_period_after_the_frames_and_set_again_after_silence(wire: RawSocket, vcan: str) -> None:
    """The car always starts right after a run of the timer: with an unchanged phase the answers come a whole period later.

    Frames of other nodes do not end the silence. A late first set, as on a busy machine, defers the phase to the next silence.
    One phase in eight must be right; a timer that keeps its own phase never is.
    """
    car, medians = Car(), []
    with EcuProcess(ecu_process.command(FOLDER, vcan, parent=os.getpid())):
        for _ in range(8):
            for _ in range(6):  # silence for longer than four periods
                wire.send((MOTION | EXTENDED, bytes(8)), (CONDITIONS | REMOTE, bytes(8)))
                assert wire.receive() is not None
            while wire.receive(0.0) is not None:
                pass
            assert wire.receive() is not None
            medians.append(statistics.median(response_times(wire, car, 25)))
            if 0.2 * PERIOD < medians[-1] < 0.8 * PERIOD:
                return
    pytest.fail(f"the answers came after {medians} s; half of {PERIOD} s is required")


@contextmanager
def stopped(ecu: subprocess.Popen[str], wire: RawSocket, silence: float) -> Iterator[None]:
    """Stop the ECU's process during the block, after `silence` seconds without frames on the bus."""
    ecu.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, ecu.pid, os.WSTOPPED)
    while wire.receive(silence) is not None:
        pass
    yield
    ecu.send_signal(signal.SIGCONT)


def test_a_pause_is_counted_and_its_frames_are_discarded(wire: RawSocket, vcan: str) -> None:
    """Thirty consecutive samples arrive while the ECU is stopped. They are outdated when it resumes."""
    car, begun = Car(), time.monotonic()
    with started(ecu_process.command(FOLDER, vcan, parent=os.getpid())) as ecu:
        assert car.takes_control(wire)
        before = car.command(wire.receive())
        with stopped(ecu, wire, 20.0 * PERIOD):
            for _ in range(30):
                wire.send(*car.frames(VehicleMotion(speed=15.0, front_angle=-0.05, yaw_rate=-0.2)))
        answers = [car.command(wire.receive()) for _ in range(8)]
        counts = ecu_process.counters(end(ecu))
    elapsed = time.monotonic() - begun
    assert before.yaw_rate_reference > 0.0
    assert all(answer.yaw_rate_reference >= 0.0 for answer in answers)  # the thirty turn right
    assert answers[-1].status == Status.FAIL_SAFE
    assert counts["discarded"] == 60
    assert counts["late"] >= 1
    assert counts["lateness_max_us"] >= 19 * PERIOD * 1e6
    assert counts["cycles"] <= elapsed / PERIOD - 18


def wait_for_runs(ecu: int, count: int) -> None:
    """Wait until a process has slept `count` more times: an ECU sleeps after each run and each check of the bus."""

    def sleeps() -> int:
        (line,) = (line for line in Path(f"/proc/{ecu}/status").read_text().splitlines() if line.startswith("voluntary_ctxt"))
        return int(line.split()[1])

    wanted, limit = sleeps() + count, time.monotonic() + TIMEOUT_S
    while sleeps() < wanted:
        assert time.monotonic() < limit, "it no longer runs"
        time.sleep(PERIOD / 2.0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("fail", "repair"),
    [(lambda name: set_interface(name, up=False), lambda name: set_interface(name, up=True)), (remove, add_vcan)],
    ids=["down", "removed"],
)
def test_it_recovers_when_the_interface_is_back(
    vcan: str,
    running: tuple[subprocess.Popen[str], bool],
    fail: Callable[[str], None],
    repair: Callable[[str], None],
) -> None:
    car, (ecu, lock_step) = Car(), running
    with RawSocket(vcan) as wire:
        assert car.takes_control(wire)
    fail(vcan)
    try:
        wait_for_runs(ecu.pid, 10)
    finally:
        repair(vcan)
    with RawSocket(vcan) as wire:
        assert car.takes_control(wire)
    counts = ecu_process.counters(end(ecu))
    assert (counts["send_errors"] == 0) == lock_step  # there was no request
    assert counts["cycles"] == counts["sent"] + counts["send_errors"]


def test_it_waits_for_an_interface_that_is_down_and_misses_no_later_set(vcan: str) -> None:
    car = Car()
    set_interface(vcan, up=False)
    with EcuProcess(ecu_process.command(FOLDER, vcan, lock_step=True, parent=os.getpid())):
        set_interface(vcan, up=True)
        with RawSocket(vcan) as wire:
            assert car.takes_control(wire)
        for _ in range(3):
            set_interface(vcan, up=False)
            set_interface(vcan, up=True)
            with RawSocket(vcan) as wire:
                wire.send(*car.frames())
                assert car.command(wire.receive()).status in GOOD


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_its_counters(running: tuple[subprocess.Popen[str], bool], number: signal.Signals) -> None:
    names = "cycles late late_samples early_samples lost_samples discarded sent send_errors lateness_mean_us lateness_max_us"
    assert list(ecu_process.counters(end(running[0], number))) == names.split()
    assert running[0].returncode == 0


def test_it_ends_with_its_parent(vcan: str) -> None:
    """A killed shell cannot end its children; they must detect it themselves."""
    script = f"{shlex.join(ecu_process.command(FOLDER, vcan, lock_step=True))} --parent $$ & wait"
    with started(["sh", "-c", script]) as shell:
        assert shell.stdout.readline() == "ready\n"
        shell.kill()
        _, errors = shell.communicate(timeout=TIMEOUT_S)  # until the last process with the pipes has ended
    assert ecu_process.counters(errors)["cycles"] == 0


@pytest.mark.parametrize(
    ("interface", "message"),
    [
        ("vcan77", "no such CAN interface; make one: sudo ip link add dev vcan77 type vcan && sudo ip link set up vcan77"),
        ("lo", "not a CAN interface"),
    ],
)
def test_an_interface_that_cannot_be_used_is_named(interface: str, message: str) -> None:
    result = subprocess.run(
        ecu_process.command(FOLDER, interface), capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    assert (result.returncode, result.stdout, result.stderr) == (2, "", f"error: {interface}: {message}\n")


def test_priority_is_set_or_rejected(vcan: str) -> None:
    with started([*ecu_process.command(FOLDER, vcan, lock_step=True, parent=os.getpid()), "--priority", "7"]) as ecu:
        if ecu.stdout.readline() == "ready\n":
            assert os.sched_getscheduler(ecu.pid) == os.SCHED_FIFO
            assert os.sched_getparam(ecu.pid).sched_priority == 7
            assert "VmLck:\t       0 kB" not in Path(f"/proc/{ecu.pid}/status").read_text()
            assert ecu_process.counters(end(ecu))["cycles"] == 0
        else:
            assert end(ecu).startswith("error: --priority: Operation not permitted; run it as root, or with")

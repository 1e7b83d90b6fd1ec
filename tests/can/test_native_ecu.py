"""The native ECU on real SocketCAN: the answers of the generated task, by the clock and in lock-step, through every mishap."""

from __future__ import annotations

import errno
import functools
import os
import shlex
import signal
import socket
import statistics
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.emit.write import write_folder
from codegen.sil.software import Status, load
from codegen.sil.toolchain import compiler_command
from hil_sim import native
from hil_sim.codec import Codec, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.e2e import next_counter, protect
from hil_sim.ecu_process import EcuProcess
from hil_sim.frames import Frame
from tests import builds
from tests.can.interfaces import add_vcan, set_interface

pytestmark = pytest.mark.vcan

CONFIG = builds.CONFIG
MOTION, CONDITIONS, COMMAND = (
    message.id for message in (CONFIG.can.vehicle_motion, CONFIG.can.vehicle_conditions, CONFIG.can.rear_steer_command)
)
PERIOD = CONFIG.controller.sampling_time_s
EXTENDED, REMOTE = 0x80000000, 0x40000000  # linux/can.h: CAN_EFF_FLAG, CAN_RTR_FLAG
PATIENCE = 10.0
"""s: far longer than anything here takes; only a failure waits so long."""
GOOD = (Status.TRACKING, Status.LIMITED, Status.STANDBY)
TASK_EARLY, WRONG_LENGTH, TIMEOUT = 1 << 13, 1 << 14, 1 << 15

Variant = tuple[Precision, str]


class Wire:
    """A raw socket on the bus: kernel frames as they are. It does not hear itself."""

    layout = struct.Struct("=IB3x8s")

    def __init__(self, interface: str) -> None:
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.bind((interface,))

    def send(self, identifier: int, data: bytes) -> None:
        self._socket.send(self.layout.pack(identifier, len(data), data))

    def receive(self, timeout: float = PATIENCE) -> Frame | None:
        """The next frame; None where none comes in time."""
        self._socket.settimeout(max(timeout, 1e-6))
        try:
            identifier, length, data = self.layout.unpack(self._socket.recv(self.layout.size))
        except TimeoutError:
            return None
        return Frame(identifier, data[:length])

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()


@dataclass
class Car:
    """Frames of a car that turns steadily; counters go on from set to set."""

    precision: Precision = "single"
    counters: list[int] = field(default_factory=lambda: [0, 0])

    @functools.cached_property
    def codec(self) -> Codec:
        return Codec(CONFIG.can, self.precision)

    def frames(
        self, motion: VehicleMotion | None = None, conditions: VehicleConditions | None = None
    ) -> list[tuple[int, bytes]]:
        motion = motion or VehicleMotion(speed=15.0, front_angle=0.02, yaw_rate=0.1)
        conditions = conditions or VehicleConditions(rear_angle=0.0)
        result = []
        codes = ((MOTION, self.codec.encode(motion)), (CONDITIONS, self.codec.encode(conditions)))
        for index, (identifier, data) in enumerate(codes):
            result.append((identifier, protect(identifier, self.counters[index], data)))
            self.counters[index] = next_counter(self.counters[index])
        return result

    def command(self, frame: Frame | None) -> RearSteerCommand:
        """What an answer says."""
        assert frame is not None, "no answer"
        decoded = self.codec.decode(frame.id, frame.data)
        assert isinstance(decoded, RearSteerCommand)
        return decoded


@functools.cache
def made(variant: Variant) -> Folder:
    precision, prefix = variant
    inputs = BuildInputs("4ws2.npz", "0" * 64, "preset")
    return build(builds.paper_map(), CONFIG, BuildOptions("4ws2", prefix, precision), inputs)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    at = tmp_path_factory.mktemp("build") / "4ws2"
    write_folder(made(("single", "ars")), at)
    return at


@pytest.fixture
def wire(vcan: str) -> Iterator[Wire]:
    with Wire(vcan) as wire:
        yield wire


@pytest.fixture
def lock_step(folder: Path, vcan: str) -> Iterator[EcuProcess]:
    with EcuProcess(native.command(folder, vcan, lock_step=True, parent=os.getpid())) as ecu:
        yield ecu


@pytest.fixture
def real_time(folder: Path, vcan: str) -> Iterator[EcuProcess]:
    with EcuProcess(native.command(folder, vcan, parent=os.getpid())) as ecu:
        yield ecu


@contextmanager
def started(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    """A process whose words can be read; it is gone afterwards."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def send_set(wire: Wire, car: Car) -> None:
    for frame in car.frames():
        wire.send(*frame)


def drive(wire: Wire, car: Car, cycles: int) -> list[float]:
    """Sets at absolute deadlines; the time from each deadline to the first answer of its cycle, where there was one."""
    responses = []
    begun = time.monotonic()
    for cycle in range(cycles):
        send_set(wire, car)
        answers = []
        while (left := begun + (cycle + 1) * PERIOD - time.monotonic()) > 0.0:
            if wire.receive(left) is not None:
                answers.append(time.monotonic() - begun - cycle * PERIOD)
        responses += answers[:1]
    return responses


# --- lock-step -----------------------------------------------------------------------------------------------------


def foreign_frames(rng: np.random.Generator) -> list[tuple[int, bytes]]:
    """What an ECU must not take for the car: other nodes' frames, other kinds of frames, a command that another one sends."""
    data = rng.bytes(8)
    frames = [
        (int(rng.integers(0x100)), data),
        (0x7FF, b""),
        (MOTION | EXTENDED, data),
        (CONDITIONS | EXTENDED, data),
        (0x18FEF100 | EXTENDED, data),
        (MOTION | REMOTE, bytes(8)),
        (CONDITIONS | REMOTE, b""),
        (COMMAND, data),
        (COMMAND | EXTENDED, data),
    ]
    return [frames[index] for index in rng.permutation(len(frames))[:3]]


def random_set(rng: np.random.Generator, car: Car) -> list[tuple[int, bytes]]:
    """Both frames; at times a signal is missing, a bit has flipped, or a frame too many comes before: one of a wrong length, or
    the conditions of another set, which open none."""
    motion = VehicleMotion(rng.uniform(-2.0, 40.0), rng.uniform(-0.3, 0.3), rng.uniform(-0.8, 0.8))
    if rng.random() < 0.05:
        motion = VehicleMotion(motion.speed, motion.front_angle, float("nan"))
    conditions = VehicleConditions(rng.uniform(-0.05, 0.05), float(rng.choice([0.3, 0.9, np.nan])), bool(rng.random() < 0.1))
    frames = car.frames(motion, conditions)
    if rng.random() < 0.05:
        identifier, data = frames[0]
        frames[0] = (identifier, data[:3] + bytes((data[3] ^ 0x10,)) + data[4:])
    if rng.random() < 0.2:
        frames.insert(0, frames[1])
    if rng.random() < 0.1:
        frames.insert(0, (int(rng.choice([MOTION, CONDITIONS])), rng.bytes(int(rng.integers(8)))))
    return frames


@pytest.mark.parametrize("variant", [("single", "ars"), ("double", "rws_2")], ids=str)
def test_each_set_is_answered_once_with_the_bits_of_the_task(tmp_path: Path, vcan: str, wire: Wire, variant: Variant) -> None:
    write_folder(made(variant), tmp_path / "build")
    software, rng, car, sets = load(tmp_path / "build"), np.random.default_rng(1), Car(variant[0]), 500
    task, seen = software.task(), 0
    command = native.command(tmp_path / "build", vcan, lock_step=True, parent=os.getpid())
    with EcuProcess(command) as ecu:
        for number in range(sets):
            for identifier, data in random_set(rng, car):
                for frame in foreign_frames(rng):
                    wire.send(*frame)
                wire.send(identifier, data)
                task.on_can_frame(identifier, data)
            assert task.is_complete
            identifier, data = task.run()
            assert wire.receive() == Frame(identifier, data), number
            seen |= car.command(Frame(identifier, data)).diagnostics
        assert wire.receive(0.05) is None
        counts = native.counters(ecu.stop())
    assert (counts["cycles"], counts["sent"], counts["send_errors"], counts["late"]) == (sets, sets, 0, 0)
    assert {name: counts[name] for name in ("late_samples", "early_samples", "lost_samples")} == {
        "late_samples": task.counters()["late_cycles"],
        "early_samples": 0,
        "lost_samples": task.counters()["lost_samples"],
    }
    assert counts["lost_samples"] > 0  # the flipped bits
    assert seen & WRONG_LENGTH


def test_half_a_set_is_not_answered(wire: Wire, lock_step: EcuProcess) -> None:
    car = Car()
    for _ in range(3):
        motion, conditions = car.frames()
        wire.send(*motion)
        assert wire.receive(0.02) is None
        wire.send(*conditions)
        assert car.command(wire.receive()).status in GOOD
    assert lock_step.alive


# --- by the clock --------------------------------------------------------------------------------------------------


def test_before_the_first_frames_it_says_not_available(wire: Wire, real_time: EcuProcess) -> None:
    car = Car()
    commands = [car.command(wire.receive()) for _ in range(8)]
    assert all(np.isnan(command.rear_angle) and np.isnan(command.yaw_rate_reference) for command in commands)
    assert all(command.diagnostics & TASK_EARLY for command in commands)
    assert real_time.alive


def test_no_command_is_left_out_and_none_comes_too_much(wire: Wire, folder: Path, vcan: str) -> None:
    begun = time.monotonic()
    with EcuProcess(native.command(folder, vcan, parent=os.getpid())) as ecu:
        car = Car()
        answers: list[Frame] = []
        while len(answers) < 100:
            send_set(wire, car)
            frame = wire.receive()
            assert frame is not None
            answers.append(frame)
        counts = native.counters(ecu.stop())
    elapsed = time.monotonic() - begun
    answers += iter(lambda: wire.receive(0.0), None)
    assert {frame.id for frame in answers} == {COMMAND}
    assert [frame.data[1] & 0x0F for frame in answers] == [number % 15 for number in range(len(answers))]
    assert counts["cycles"] == counts["sent"] == len(answers)
    # One run at the start of each period, and one more where the phase was set.
    assert counts["cycles"] <= elapsed / PERIOD + 2


def test_the_phase_is_half_a_period_after_the_frames_and_set_again_after_silence(wire: Wire, real_time: EcuProcess) -> None:
    """Each time the car begins right after a run of the timer: as it stood, the answers would come a whole period later.

    What others send is no end of the silence. A first set that comes late, as on a busy machine, puts the phase off until the
    next silence: one phase in eight has to be right, where a timer that kept its own would have none.
    """
    car, medians = Car(), []
    for _ in range(8):
        for _ in range(6):  # silence for longer than four periods; what waits is old
            wire.send(MOTION | EXTENDED, bytes(8))
            wire.send(CONDITIONS | REMOTE, bytes(8))
            assert wire.receive() is not None
        while wire.receive(0.0) is not None:
            pass
        assert wire.receive() is not None
        medians.append(statistics.median(drive(wire, car, 25)))
        if 0.2 * PERIOD < medians[-1] < 0.8 * PERIOD:
            return
    pytest.fail(f"the answers came after {medians} s, half of {PERIOD} s is meant")


def test_silence_degrades_and_fails_safe_then_it_recovers(wire: Wire, real_time: EcuProcess) -> None:
    car = Car()
    assert wait_for_control(wire, car)
    commands = [car.command(wire.receive()) for _ in range(12)]
    statuses = [command.status for command in commands]
    while any(status in GOOD for status in statuses):  # the last set may still have been under way
        del statuses[0]
    tolerated = CONFIG.controller.fail_safe.degraded_samples_max
    assert statuses[:tolerated] == [Status.DEGRADED] * tolerated
    assert set(statuses[tolerated:]) == {Status.FAIL_SAFE}
    assert commands[-1].diagnostics & TIMEOUT
    assert commands[-1].diagnostics & TASK_EARLY
    assert wait_for_control(wire, car)
    assert real_time.alive


@contextmanager
def stopped(ecu: subprocess.Popen[str], wire: Wire, silence: float) -> Iterator[None]:
    """The ECU gets no processor until the block ends; from its beginning the bus was silent for so long (s)."""
    ecu.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, ecu.pid, os.WSTOPPED)
    while wire.receive(silence) is not None:
        pass
    yield
    ecu.send_signal(signal.SIGCONT)


def test_frames_that_came_before_a_late_run_are_in_its_answer(wire: Wire, folder: Path, vcan: str) -> None:
    """Bus and timer wake it at once: were the timer first, the first answer would know nothing of the frames.

    On a busy machine the pause may be too long for frames to be used: one of ten has to be short enough.
    """
    command = native.command(folder, vcan, parent=os.getpid())
    for _ in range(10):
        car = Car()
        with started(command) as ecu:
            assert car.command(wire.receive()).diagnostics & TASK_EARLY
            with stopped(ecu, wire, 1.5 * PERIOD):
                send_set(wire, car)
            answer = car.command(wire.receive())
        if not np.isnan(answer.rear_angle) and answer.diagnostics == 0:
            return
    pytest.fail("no first answer knew of the frames")


def test_frames_that_waited_through_a_pause_are_not_steered_by(wire: Wire, folder: Path, vcan: str) -> None:
    """Thirty samples in sequence come while it has no processor: of the past when it wakes, which goes by newer ones only."""
    car, command = Car(), native.command(folder, vcan, parent=os.getpid())
    with started(command) as ecu:
        assert wait_for_control(wire, car)
        before = car.command(wire.receive())
        with stopped(ecu, wire, 20.0 * PERIOD):
            for _ in range(30):
                for frame in car.frames(VehicleMotion(speed=15.0, front_angle=-0.05, yaw_rate=-0.2)):
                    wire.send(*frame)
        answers = [car.command(wire.receive()) for _ in range(8)]
        ecu.terminate()
        _, said = ecu.communicate(timeout=PATIENCE)
    assert before.yaw_rate_reference > 0.0
    assert all(answer.yaw_rate_reference >= 0.0 for answer in answers)  # of none of the thirty, which turn right
    assert answers[-1].status == Status.FAIL_SAFE
    assert native.counters(said)["discarded"] == 60


def wait_for_control(wire: Wire, car: Car) -> bool:
    """Sets, one for each command that comes, until one of the commands is no longer that of a fail-safe."""
    limit = time.monotonic() + PATIENCE
    while time.monotonic() < limit:
        send_set(wire, car)
        frame = wire.receive(2.0 * PERIOD)
        if frame is not None and car.command(frame).status in GOOD and not np.isnan(car.command(frame).rear_angle):
            return True
    return False


def test_a_late_run_is_counted_and_not_made_up_for(wire: Wire, folder: Path, vcan: str) -> None:
    begun = time.monotonic()
    command = native.command(folder, vcan, parent=os.getpid())
    with started(command) as ecu:
        for _ in range(5):
            assert wire.receive() is not None
        ecu.send_signal(signal.SIGSTOP)
        while wire.receive(20.0 * PERIOD) is not None:
            pass
        ecu.send_signal(signal.SIGCONT)
        for _ in range(5):
            assert wire.receive() is not None
        ecu.terminate()
        _, said = ecu.communicate(timeout=PATIENCE)
    elapsed = time.monotonic() - begun
    counts = native.counters(said)
    assert counts["late"] >= 1
    assert counts["lateness_max_us"] >= 19 * PERIOD * 1e6
    assert counts["cycles"] <= elapsed / PERIOD - 18


# --- the bus fails -------------------------------------------------------------------------------------------------


def wait_for_runs(ecu: int, count: int) -> None:
    """Until a process has gone to sleep `count` times more: a run of the ECU each, or a look whether the bus is back."""

    def sleeps() -> int:
        (line,) = (line for line in Path(f"/proc/{ecu}/status").read_text().splitlines() if line.startswith("voluntary_ctxt"))
        return int(line.split()[1])

    wanted, limit = sleeps() + count, time.monotonic() + PATIENCE
    while sleeps() < wanted:
        assert time.monotonic() < limit, "it no longer runs"
        time.sleep(PERIOD / 2.0)


@dataclass
class Running:
    """An ECU process, for tests that look into it."""

    process: subprocess.Popen[str]
    lock_step: bool

    def stop(self) -> dict[str, int]:
        self.process.terminate()
        _, said = self.process.communicate(timeout=PATIENCE)
        assert self.process.returncode == 0
        return native.counters(said)


@pytest.fixture(params=[True, False], ids=["lock-step", "real-time"])
def running(request: pytest.FixtureRequest, folder: Path, vcan: str) -> Iterator[Running]:
    command = native.command(folder, vcan, lock_step=request.param, parent=os.getpid())
    with started(command) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield Running(process, request.param)


def remove_interface(name: str) -> None:
    """As `ip link delete`: linux/rtnetlink.h, RTM_DELLINK."""
    request = struct.pack("=IHHII BxHiII", 32, 17, 0x1 | 0x4, 1, 0, socket.AF_UNSPEC, 0, socket.if_nametoindex(name), 0, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
        kernel.send(request)
        (error,) = struct.unpack_from("=i", kernel.recv(4096), 16)
    assert error == 0, os.strerror(-error)


def test_it_goes_on_after_the_interface_was_down(vcan: str, running: Running) -> None:
    car = Car()
    with Wire(vcan) as wire:
        assert wait_for_control(wire, car)
    set_interface(vcan, up=False)
    wait_for_runs(running.process.pid, 10)
    set_interface(vcan, up=True)
    with Wire(vcan) as wire:
        assert wait_for_control(wire, car)
    counts = running.stop()
    assert (counts["send_errors"] > 0) == (not running.lock_step)  # in lock-step nothing was to be answered
    assert counts["cycles"] == counts["sent"] + counts["send_errors"]


def test_nothing_is_missed_once_the_interface_is_up_again(vcan: str, lock_step: EcuProcess) -> None:
    """Not even the first set: the socket is kept."""
    car = Car()
    for _ in range(3):
        with Wire(vcan) as wire:
            send_set(wire, car)
            assert car.command(wire.receive()).status in GOOD
        set_interface(vcan, up=False)
        set_interface(vcan, up=True)
    assert lock_step.alive


def test_it_goes_on_after_the_interface_was_removed(vcan: str, running: Running) -> None:
    car = Car()
    with Wire(vcan) as wire:
        assert wait_for_control(wire, car)
    remove_interface(vcan)
    try:
        wait_for_runs(running.process.pid, 10)
    finally:
        add_vcan(vcan)
    with Wire(vcan) as wire:
        assert wait_for_control(wire, car)
    counts = running.stop()
    assert (counts["send_errors"] > 0) == (not running.lock_step)


def test_an_interface_that_is_down_at_the_start_is_waited_for(folder: Path, vcan: str) -> None:
    set_interface(vcan, up=False)
    with EcuProcess(native.command(folder, vcan, lock_step=True, parent=os.getpid())) as ecu:
        set_interface(vcan, up=True)
        with Wire(vcan) as wire:
            assert wait_for_control(wire, Car())
        assert ecu.alive


def test_a_full_queue_costs_frames_and_nothing_else(tmp_path: Path, folder: Path, vcan: str, wire: Wire) -> None:
    """The kernel has no room for every second frame, as with a slow bus."""
    source, library = tmp_path / "full.c", tmp_path / "full.so"
    source.write_text(
        f"""
        #define _GNU_SOURCE
        #include <errno.h>
        #include <sys/syscall.h>
        #include <unistd.h>
        ssize_t write(int file, const void *data, size_t size)
        {{
            static unsigned int frames;
            if (size == {Wire.layout.size} && ++frames % 2u == 0u) {{ errno = {errno.ENOBUFS}; return -1; }}
            return syscall(SYS_write, file, data, size);
        }}
        """
    )
    subprocess.run([*compiler_command(), "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    command = ["env", f"LD_PRELOAD={library}", *native.command(folder, vcan, lock_step=True, parent=os.getpid())]
    car = Car()
    with EcuProcess(command) as ecu:
        for number in range(10):
            send_set(wire, car)
            if number % 2 == 0:
                assert car.command(wire.receive()).status in GOOD
        assert wire.receive(0.05) is None
        counts = native.counters(ecu.stop())
    assert (counts["cycles"], counts["sent"], counts["send_errors"]) == (10, 5, 5)


# --- start and end -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_its_counters(running: Running, number: signal.Signals) -> None:
    running.process.send_signal(number)
    output, said = running.process.communicate(timeout=PATIENCE)
    assert running.process.returncode == 0
    assert output == ""
    assert said.count("\n") == 1
    names = "cycles late late_samples early_samples lost_samples discarded sent send_errors lateness_mean_us lateness_max_us"
    assert list(native.counters(said)) == names.split()


def test_killed_and_started_again_it_begins_anew(wire: Wire, lock_step: EcuProcess) -> None:
    car = Car()
    for _ in range(3):
        send_set(wire, car)
        assert wire.receive() is not None
    lock_step.kill()
    assert not lock_step.alive
    send_set(wire, car)
    assert wire.receive(0.05) is None
    lock_step.start()
    lock_step.wait_until_ready()
    send_set(wire, car)
    frame = wire.receive()
    assert car.command(frame).status in GOOD
    assert frame is not None
    assert frame.data[1] & 0x0F == 0


def test_it_ends_with_its_parent(folder: Path, vcan: str) -> None:
    """A shell that is killed cannot tell its children: they must see for themselves."""
    ecu = shlex.join(native.command(folder, vcan, lock_step=True))
    script = f"{ecu} --parent $$ & wait"
    with started(["sh", "-c", script]) as shell:
        assert shell.stdout is not None
        assert shell.stdout.readline() == "ready\n"
        shell.kill()
        _, said = shell.communicate(timeout=PATIENCE)  # until the last one that holds the pipes has ended
    assert native.counters(said)["cycles"] == 0


@pytest.mark.parametrize(
    ("interface", "message"),
    [
        (
            "vcan77",
            "vcan77: no such CAN interface; make one: sudo ip link add dev vcan77 type vcan && sudo ip link set up vcan77",
        ),
        ("lo", "lo: not a CAN interface"),
    ],
)
def test_an_interface_that_cannot_be_used_is_named(folder: Path, interface: str, message: str) -> None:
    result = subprocess.run(native.command(folder, interface), capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (2, "", f"error: {message}\n")


def test_priority_is_taken_or_refused(folder: Path, vcan: str) -> None:
    command = [*native.command(folder, vcan, lock_step=True, parent=os.getpid()), "--priority", "7"]
    with started(command) as ecu:
        assert ecu.stdout is not None
        if ecu.stdout.readline() == "ready\n":
            assert os.sched_getscheduler(ecu.pid) == os.SCHED_FIFO
            assert os.sched_getparam(ecu.pid).sched_priority == 7
            assert "VmLck:\t       0 kB" not in Path(f"/proc/{ecu.pid}/status").read_text()
            ecu.terminate()
        _, said = ecu.communicate(timeout=PATIENCE)
    refused = (
        "error: --priority: Operation not permitted; run it as root, or with the capabilities cap_sys_nice and cap_ipc_lock\n"
    )
    assert said == refused or native.counters(said)["cycles"] == 0

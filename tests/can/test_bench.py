"""The bench on a real vcan0: the same bits as everywhere, nothing lost by the clock, and defined ends of what goes wrong."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import can
import numpy as np
import pytest

from codegen.config import preset
from codegen.emit.write import write_folder
from codegen.refmap import map as npz
from codegen.refmap.solve import solve_case
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Software, Status, load
from hil_sim import bench, manoeuvres
from hil_sim.bench import BenchResult, run_in_lock_step
from hil_sim.bus import Bus, BusAddress
from hil_sim.codec import Codec, RearSteerCommand
from hil_sim.ecu_process import EcuThread
from hil_sim.faults import Fault
from hil_sim.frames import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.runs import run, run_through_can
from hil_sim.scenarios import Scenario, find
from hil_sim.session import EcuKind, Setup, ecu_of, run_hil
from tests import builds
from tests.can.interfaces import set_interface

pytestmark = pytest.mark.vcan

GENERATED = Path(__file__).resolve().parents[2] / "generated"
KINDS: tuple[EcuKind, ...] = ("native", "cffi")
RATE_LIMIT_DEG_S = 30.0
"""Of the paper's actuator."""
SYNC_FRAMES_MAX = 2
"""Frames that prove the counter after a silence: the first, and sync_counter_init = 1 more."""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The builds of C1 (4WS-2 map) and C2 (FWS map), and of the recommended controller."""
    place, config = tmp_path_factory.mktemp("builds"), preset()
    made = {}
    for name, case in (("C1", "4ws-2"), ("C2", "fws")):
        made[name] = place / case
        write_folder(builds.render(solve_case(config, case), config), made[name])
    tracking = npz.load(GENERATED / "4ws2-tracking.npz")
    assert tracking.config is not None
    made["tracking"] = place / "tracking"
    write_folder(builds.render(tracking, tracking.config), made["tracking"])
    return made


@pytest.fixture(scope="module")
def software(folders: dict[str, Path]) -> Software:
    """C1, compiled."""
    return load(folders["C1"])


@pytest.fixture
def address(vcan: str) -> BusAddress:
    return BusAddress("socketcan", vcan)


def corner(duration: float, *faults: Fault) -> Scenario:
    """4 deg at the front wheels from the start, 65 km/h: the rear wheels steer, and the fail-safe holds."""
    scenario = find("step-steer")
    settings = replace(scenario.settings, speed_km_h=65.0, steering_wheel_angle_deg=4.0 * 90.0 / 6.75)
    return replace(
        scenario, duration=duration, steer_time=0.1, drive=manoeuvres.step(0.1), settings=settings, faults=tuple(faults)
    )


def column(result: BenchResult, name: str) -> np.ndarray:
    return result.record[:, RECORD_COLUMNS.index(name)]


class TestTheSameBits:
    def test_whatever_carries_the_frames_and_whoever_answers(
        self, address: BusAddress, folders: dict[str, Path], software: Software
    ) -> None:
        """The paper's run: in C, in process, over virtual, UDP multicast and vcan, with the cffi and the native ECU."""
        scenario, config = find("step-steer"), software.config
        records = {
            "in C": ClosedLoop(software, LoopOptions(through_can=True)).run(scenario.inputs(config)),
            "in process": run_through_can(software, scenario).record,
        }
        virtual = BusAddress("virtual", "test")
        with EcuThread(software, virtual, lock_step=True), Bus(virtual) as bus:
            records["virtual"] = run_in_lock_step(PlantNode(config, scenario), bus).record
        others = {f"vcan, {kind}": (address, kind) for kind in KINDS}
        others["UDP multicast, cffi"] = (BusAddress("udp_multicast", "239.74.163.2"), "cffi")
        for name, (where, kind) in others.items():
            ran = run_hil(Setup(config, scenario, where, lock_step=True), folders["C1"], kind)
            records[name] = ran.result.record
            assert ran.result.received == {"commands": 1500, "refused": 0, "cycles_without": 0, "lost": 0}, name
        wanted = records.pop("in C")
        assert wanted.shape == (1500, len(RECORD_COLUMNS))
        assert {name: np.array_equal(record, wanted) for name, record in records.items()} == dict.fromkeys(records, True)

    def test_another_kind_of_controller(self, address: BusAddress, folders: dict[str, Path]) -> None:
        """Bus, task and ECU know nothing of the kind."""
        scenario, built = find("sine-with-dwell"), load(folders["tracking"])
        wanted = run_through_can(built, scenario).record
        for kind in KINDS:
            result = run_hil(Setup(built.config, scenario, address, lock_step=True), folders["tracking"], kind).result
            assert np.array_equal(result.record, wanted), kind

    @pytest.mark.parametrize("name", ["C1", "C2"])
    def test_the_papers_figures_within_the_frames_steps(self, address: BusAddress, folders: dict[str, Path], name: str) -> None:
        scenario, built = find("step-steer"), load(folders[name])
        result = run_hil(Setup(built.config, scenario, address, lock_step=True), folders[name], "native").result
        assert np.array_equal(result.record, run_through_can(built, scenario).record)
        bare = run(built, scenario)
        for quantity, gain in (("yaw_rate_rad_s", 3.8), ("sideslip_rad", 1.0)):
            index = RECORD_COLUMNS.index(quantity)
            # Steps of 5e-5 rad in the command through the car's gain, and of 2e-4 rad/s in the yaw rate that it is made from.
            assert np.abs(result.record - bare)[:, index].max() < 2 * (gain * 5e-5 + 2e-4), quantity


class TestByTheClock:
    def test_a_minute_without_a_lost_frame(
        self, address: BusAddress, folders: dict[str, Path], software: Software, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """6,000 cycles. A busy machine may delay any of them; what must not be is a frame that did not arrive.

        The car's side: the counters of all commands that came are consecutive. The ECU's side: of all its commands none reports
        a gap, a wrong CRC or a repetition, and a wrong sequence only where its counter proves itself after a silence (SYNC).
        """
        arrived: list[tuple[int, int]] = []  # counter and diagnostics of each command
        codec = Codec(software.config.can)
        original = PlantNode.receive

        def receive(node: PlantNode, frame: Frame) -> bool:
            if original(node, frame):
                command = codec.decode(frame.id, frame.data)
                assert isinstance(command, RearSteerCommand)
                arrived.append((frame.data[1] & 0xF, command.diagnostics))
                return True
            return False

        monkeypatch.setattr(PlantNode, "receive", receive)
        scenario = replace(find("step-steer"), duration=60.0)
        ran = run_hil(Setup(software.config, scenario, address), folders["C1"], "native")
        result, counters = ran.result, counted(ran.ecu_counters)
        assert len(result.record) == 6000
        assert result.send_errors == counters["send_errors"] == 0
        assert result.received["lost"] == 0
        assert all((later - earlier) % 15 == 1 for (earlier, _), (later, _) in pairwise(arrived))
        silent = SYNC_FRAMES_MAX  # before the run the bus was silent
        for _, diagnostics in arrived:
            for missing, wrong_sequence in ((1 << 0, 1 << 3), (1 << 5, 1 << 8)):
                assert not diagnostics & (missing << 1 | missing << 2)
                assert not diagnostics & missing << 4 or counters["discarded"]
                assert not diagnostics & wrong_sequence or silent >= 0 or counters["discarded"]  # read, and too old to use
            silent = SYNC_FRAMES_MAX if diagnostics & (1 << 0 | 1 << 5) else silent - 1

    def test_the_run_is_the_one_of_lock_step_where_every_command_is_in_time(
        self, address: BusAddress, folders: dict[str, Path], software: Software
    ) -> None:
        result = run_hil(Setup(software.config, corner(2.0), address), folders["C1"], "native").result
        wanted = run_through_can(software, corner(2.0)).record
        answered = np.isfinite(result.response) & (result.diagnostics == 0)
        first = int(np.argmax(answered))  # from the first good sample on
        assert first < 9  # before the driver steers: the states of both runs are the same
        late = np.flatnonzero(~answered[first:])
        end = first + int(late[0]) if late.size else len(answered)
        assert end > first
        assert np.array_equal(result.record[first:end], wanted[first:end])


def in_one_of_three(drive: Callable[[], None]) -> None:
    """What is true of one of three runs in real time: a busy machine holds frames up now and then, a fault each time."""
    for _ in range(2):
        with contextlib.suppress(AssertionError):
            drive()
            return
    drive()


class TestWhatGoesWrong:
    """δr stays within bounds at every sample, the state is the defined one, and control comes back."""

    @staticmethod
    def check(result: BenchResult) -> None:
        rear = column(result, "rear_angle_rad")
        assert np.abs(column(result, "rear_angle_command_rad")).max() <= np.deg2rad(3.5) + 5e-5
        assert np.abs(np.diff(rear)).max() <= np.deg2rad(RATE_LIMIT_DEG_S) * 0.01 * (1 + 1e-9)

    @staticmethod
    def status(result: BenchResult) -> np.ndarray:
        return column(result, "status").astype(int)

    def controls_again(self, result: BenchResult) -> bool:
        """At the end, but for a sample that a busy machine delays."""
        return bool((self.status(result)[-50:] <= Status.LIMITED).any())

    @pytest.mark.parametrize("kind", KINDS)
    def test_the_ecu_is_killed_and_restarted(
        self, address: BusAddress, folders: dict[str, Path], software: Software, kind: EcuKind
    ) -> None:
        lost = Fault("ecu-restart", 1.0, 0.5)
        duration = 3.0 if kind == "native" else 30.0  # Python has to start again, in a guest on a busy machine
        result = run_hil(Setup(software.config, corner(duration, lost), address), folders["C1"], kind).result
        self.check(result)
        status, commands = self.status(result), column(result, "rear_angle_command_rad")
        assert status[140] == Status.FAIL_SAFE  # the actuator's, for nobody commands
        assert len(set(commands[102:150])) == 1  # held
        assert self.controls_again(result)
        assert np.isfinite(result.response[-50:]).any()

    def test_the_plant_is_killed_and_restarted(self, address: BusAddress, folders: dict[str, Path], software: Software) -> None:
        lost = Fault("plant-restart", 1.0, 0.3)
        result = run_hil(Setup(software.config, corner(3.0, lost), address), folders["C1"], "native").result
        self.check(result)
        diagnostics = result.diagnostics[130:160]
        assert (diagnostics & (1 << 3)).any()  # the ECU sees counters that begin anew
        assert self.controls_again(result)

    def test_the_interface_goes_down_and_up(self, address: BusAddress, folders: dict[str, Path], software: Software) -> None:
        def down_and_up(cycle: bench.Cycle) -> None:
            if cycle.number in (100, 140):
                set_interface(address.channel, up=cycle.number == 140)

        result = run_hil(Setup(software.config, corner(4.0), address), folders["C1"], "native", down_and_up).result
        self.check(result)
        assert result.send_errors >= 2 * 30  # two frames in each of forty cycles, give or take late ones
        status = self.status(result)
        assert status[130] == Status.FAIL_SAFE
        assert self.controls_again(result)

    def test_a_bus_full_of_strangers(self, address: BusAddress, folders: dict[str, Path], software: Software) -> None:
        full = Fault("foreign-traffic", 0.5, 1.0)

        def drive() -> None:
            result = run_hil(Setup(software.config, corner(2.0, full), address), folders["C1"], "native").result
            self.check(result)
            assert result.received["lost"] == 0
            assert not (result.diagnostics & (1 << 4 | 1 << 9 | 1 << 14)).any()  # none of ours was lost or spoilt
            assert self.controls_again(result)

        in_one_of_three(drive)

    def test_a_missing_interface_says_how_to_make_one(self, software: Software, folders: dict[str, Path], vcan: str) -> None:
        for kind in KINDS:
            with pytest.raises(bench.CodegenError, match="sudo ip link add dev nothere type vcan"):
                run_hil(Setup(software.config, corner(1.0), BusAddress("socketcan", "nothere")), folders["C1"], kind)


class TestAStrangerOnTheBus:
    """Other people's tools beside the bench."""

    @contextlib.contextmanager
    def running(self, address: BusAddress, folder: Path, software: Software) -> Iterator[list[list[bench.Cycle]]]:
        """A run in real time, in a thread, for as long as the block lasts; its result is there after it."""
        results: list[list[bench.Cycle]] = []
        setup, over = Setup(software.config, corner(60.0), address), threading.Event()

        class Over(Exception):
            pass

        def run_until_over() -> None:
            cycles: list[bench.Cycle] = []

            def observe(cycle: bench.Cycle) -> None:
                cycles.append(cycle)
                if over.is_set() and cycle.number >= 100:
                    raise Over

            with contextlib.suppress(Over):
                run_hil(setup, folder, "native", observe)
            results.append(cycles)

        thread = threading.Thread(target=run_until_over)
        thread.start()
        try:
            yield results
        finally:
            over.set()
            thread.join()

    @staticmethod
    def tool(name: str) -> str:
        found = shutil.which(name)
        if found is None:
            pytest.skip(f"{name} is not installed (Debian: can-utils)")
        return found

    def test_candump_sees_every_frame(self, address: BusAddress, folders: dict[str, Path], software: Software) -> None:
        command = [self.tool("candump"), "-L", "-n", "300", "-T", "50000", address.channel]
        with (
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as dump,
            self.running(address, folders["C1"], software),
        ):
            lines = dump.communicate()[0].splitlines()
        assert len(lines) == 300
        names = {line.split()[2].partition("#")[0] for line in lines}
        assert names == {"101", "102", "201"}

    def test_cansend_does_not_disturb(self, address: BusAddress, folders: dict[str, Path], software: Software) -> None:
        cansend = self.tool("cansend")

        def drive() -> None:
            with self.running(address, folders["C1"], software) as results:
                for text in ("123#DEADBEEF", "00000101#0011223344556677", "101#R", "102#01"):
                    for _ in range(20):
                        subprocess.run([cansend, address.channel, text], check=True)
            (cycles,) = results
            # No frame lost or spoilt but for the wrong length that was sent.
            spoilt = 1 << 1 | 1 << 4 | 1 << 6 | 1 << 9
            seen = [cycle.command.diagnostics for cycle in cycles if cycle.command is not None]
            assert seen
            assert not any(diagnostics & spoilt for diagnostics in seen)
            assert any(diagnostics & 1 << 14 for diagnostics in seen)  # the frame of one byte was noticed

        in_one_of_three(drive)

    def test_cansend_can_be_the_car(self, address: BusAddress, folders: dict[str, Path], software: Software) -> None:
        """A motion and a conditions frame by hand, protected: the ECU answers in lock-step."""
        cansend, node = self.tool("cansend"), PlantNode(software.config, corner(1.0))

        with (
            can.Bus(interface="socketcan", channel=address.channel) as listener,
            ecu_of(folders["C1"], address, "native", lock_step=True),
        ):
            for frame in node.outgoing(0):
                subprocess.run([cansend, address.channel, f"{frame.id:03X}#{frame.data.hex()}"], check=True)
            answers = [message for message in iter(lambda: listener.recv(1.0), None) if message.arbitration_id == 0x201]
        assert len(answers) == 1

    def test_cantools_monitor_shows_names_and_units(
        self, address: BusAddress, folders: dict[str, Path], software: Software
    ) -> None:
        command = [sys.executable, "-m", "cantools", "monitor", "-i", "socketcan", "-c", address.channel]
        command.append(str(folders["C1"] / "ars.dbc"))
        with self.running(address, folders["C1"], software):
            words = ("VehicleMotion", "VehicleConditions", "RearSteerCommand", "Speed: ", "m/s", "RearAngleCommand", "TRACKING")
            shown = on_a_terminal(command, lambda text: all(word in text for word in words))
        assert [word for word in words if word not in shown] == []


def counted(line: str) -> dict[str, int]:
    """An ECU's counters by name."""
    return {name: int(count) for name, _, count in (word.partition("=") for word in line.split())}


def on_a_terminal(command: list[str], enough: Callable[[str], bool]) -> str:
    """What a program draws on a terminal of 120 x 40, until it is enough or far too much time is over."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ.update(TERM="xterm", COLUMNS="120", LINES="40")
        os.execv(command[0], command)
    shown = ""
    deadline = time.monotonic() + 50.0
    with contextlib.suppress(OSError):
        while time.monotonic() < deadline and not enough(shown):
            if select.select([terminal], [], [], 0.2)[0]:
                shown += os.read(terminal, 65536).decode("utf-8", "replace")
    os.kill(pid, 9)
    os.waitpid(pid, 0)
    os.close(terminal)
    return shown


def test_the_plant_alone_and_the_ecu_alone_meet(vcan: str, folders: dict[str, Path]) -> None:
    """Two commands in two terminals."""
    bus = ["--bus", f"socketcan:{vcan}", "--lock-step"]
    codegen = [sys.executable, "-m", "codegen"]
    ecu = [*codegen, "ecu", "--build", str(folders["C1"]), *bus]
    with subprocess.Popen(ecu, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        plant = subprocess.run([*codegen, "plant", *bus, "--json"], capture_output=True, text=True, check=False)
        process.terminate()
        _, said = process.communicate()
    assert plant.returncode == 0, plant.stderr
    assert '"commands": 1500' in plant.stdout
    assert process.returncode == 0
    assert "cycles=1500 " in said

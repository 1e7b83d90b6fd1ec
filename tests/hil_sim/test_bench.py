"""The bench: the same bits on every bus, the actuator's own reactions, and errors where something is missing."""

from __future__ import annotations

import math
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from codegen.config import Config
from codegen.errors import CodegenError
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from hil_sim import bench, manoeuvres, session
from hil_sim.bench import BenchResult, run_in_lock_step, run_in_process, run_in_real_time
from hil_sim.bus import Bus, BusAddress
from hil_sim.ecu_node import EcuNode
from hil_sim.ecu_process import EcuThread
from hil_sim.faults import Fault
from hil_sim.frames import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.runs import run, run_through_can
from hil_sim.scenarios import Scenario, find
from hil_sim.sensors import SensorModel
from hil_sim.session import Setup, passive, run_hil


def short(duration: float = 2.0, **changes: object) -> Scenario:
    """The paper's step, early."""
    return replace(find("step-steer"), duration=duration, steer_time=0.2, drive=manoeuvres.step(0.2), **changes)


def multicast(third: int) -> BusAddress:
    """A group of this process: tests may run side by side."""
    return BusAddress("udp_multicast", f"239.74.{third}.{2 + os.getpid() % 250}")


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> BusAddress:
    """A virtual bus of this test alone."""
    return BusAddress("virtual", request.node.nodeid)


def column(result: BenchResult, name: str) -> np.ndarray:
    return result.record[:, RECORD_COLUMNS.index(name)]


@pytest.fixture(scope="module")
def wanted(software: Software) -> np.ndarray:
    """The run in C as a whole, through frames."""
    return ClosedLoop(software, LoopOptions(through_can=True)).run(short().inputs(software.config))


class TestTheSameBits:
    """Every column of every cycle."""

    def test_in_process_and_on_a_virtual_bus(self, software: Software, channel: BusAddress, wanted: np.ndarray) -> None:
        """Python's codec and protection on the car's side, the C on the other."""
        assert np.array_equal(run_through_can(software, short()).record, wanted)
        with EcuThread(software, channel, lock_step=True), Bus(channel) as bus:
            result = run_in_lock_step(PlantNode(software.config, short()), bus)
        assert np.array_equal(result.record, wanted)
        assert result.received == {"commands": 200, "refused": 0, "cycles_without": 0, "lost": 0}

    def test_udp_multicast_with_the_ecu_in_another_process(
        self, software: Software, build_folder: Path, wanted: np.ndarray
    ) -> None:
        ran = run_hil(Setup(software.config, short(0.5), multicast(163), lock_step=True), build_folder, "cffi")
        assert np.array_equal(ran.result.record, wanted[:50])
        assert "cycles=50 " in f"{ran.ecu_counters} "

    def test_the_passive_car(self, software: Software) -> None:
        assert np.array_equal(passive(software.config, short()), run(software, short(), controlled=False))

    def test_a_delayed_command(self, software: Software) -> None:
        plant = software.config.plant.model_copy(update={"command_delay_samples": 3})
        config = software.config.model_copy(update={"plant": plant})
        loop = ClosedLoop(software, LoopOptions(through_can=True, delay_samples=3))
        result = run_in_process(PlantNode(config, short()), software)
        assert np.array_equal(result.record, loop.run(short().inputs(config)))


class FakeClock:
    """Time that passes only where somebody waits."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def receive(self, timeout: float) -> None:
        self.now += max(timeout, 0.0)


class TestRealTime:
    """Runs by the clock. Machines that run tests are busy: no test here requires punctuality."""

    def test_every_cycle_is_counted_and_equals_that_in_lock_step(self, software: Software, channel: BusAddress) -> None:
        with EcuThread(software, channel, lock_step=False), Bus(channel) as bus:
            result = run_in_real_time(PlantNode(software.config, short(0.5)), bus)
        assert len(result.record) == 50
        assert (result.received["lost"], result.send_errors) == (0, 0)
        wanted = run_through_can(software, short(0.5)).record
        # Up to the first cycle without a command of its own, or with two.
        answered = np.isfinite(result.response) & (result.diagnostics == 0)
        same = len(answered) if answered.all() else int(np.argmin(answered))
        assert np.array_equal(result.record[:same], wanted[:same])

    def test_late_cycles_are_counted_and_not_made_up_for(
        self, software: Software, channel: BusAddress, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A clock that jumps by 35 ms in one cycle: three deadlines are gone, and the rest keeps distance and phase."""
        clock = FakeClock()
        monkeypatch.setattr(bench, "time", clock)
        sent: list[float] = []

        class Recorded(PlantNode):
            def outgoing(self, cycle: int) -> list[Frame]:
                sent.append(clock.now)
                if cycle == 20:
                    clock.now += 0.035
                return super().outgoing(cycle)

        with Bus(channel) as bus:
            bus.receive = clock.receive  # type: ignore[method-assign]
            result = run_in_real_time(Recorded(software.config, short(0.5)), bus)
        assert result.late_cycles == 1
        steps = np.diff(sent)
        assert steps[20] == pytest.approx(0.04)
        assert np.delete(steps, 20) == pytest.approx(0.01)  # never shorter

    def test_without_an_ecu_the_actuator_holds(
        self, software: Software, channel: BusAddress, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        clock = FakeClock()
        monkeypatch.setattr(bench, "time", clock)
        with Bus(channel) as bus:
            bus.receive = clock.receive  # type: ignore[method-assign]
            result = run_in_real_time(PlantNode(software.config, short(0.3)), bus)
        assert result.received == {"commands": 0, "refused": 0, "cycles_without": 30, "lost": 0}
        assert not column(result, "rear_angle_command_rad").any()
        assert column(result, "status").tolist() == [Status.DEGRADED] * 3 + [Status.FAIL_SAFE] * 27


class TestNodesOnABusyBus:
    """Foreign frames, 29-bit identifiers, remote and error frames, wrong lengths, and the echo of one's own frames."""

    def test_foreign_frames_change_nothing(self, software: Software, channel: BusAddress) -> None:
        frames = software.config.can
        ids = (frames.vehicle_motion.id, frames.vehicle_conditions.id, frames.rear_steer_command.id)
        messages = [
            *(can.Message(arbitration_id=number, is_extended_id=True, data=b"\xff" * 8) for number in ids),
            *(can.Message(arbitration_id=number, is_extended_id=False, is_remote_frame=True, dlc=8) for number in ids),
            can.Message(arbitration_id=0, is_extended_id=False, data=b""),
            can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"\x01\x02"),
            can.Message(is_error_frame=True, arbitration_id=ids[0]),
        ]
        with can.Bus(interface=channel.interface, channel=channel.channel) as stranger:

            class Noisy(PlantNode):
                def outgoing(self, cycle: int) -> list[Frame]:
                    for message in messages:
                        stranger.send(message)
                    return super().outgoing(cycle)

            with EcuThread(software, channel, lock_step=True), Bus(channel) as bus:
                result = run_in_lock_step(Noisy(software.config, short(0.5)), bus)
        assert np.array_equal(result.record, run_through_can(software, short(0.5)).record)

    def test_an_echo_counts_for_nothing(self, software: Software, channel: BusAddress) -> None:
        """The ECU's own command comes back to it, the car's frames to the car: as on interfaces that echo."""
        node = PlantNode(software.config, short())
        for frame in node.outgoing(0):
            assert not node.receive(frame)
        with Bus(channel) as bus:
            ecu = EcuNode(software, bus)
            identifier, data = ecu.task.run()
            assert not ecu._take(Frame(identifier, data))
            assert not ecu.task.is_complete


class TestErrors:
    def test_no_ecu_in_lock_step(self, software: Software, channel: BusAddress, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(bench, "ANSWER_TIMEOUT", 0.01)
        with Bus(channel) as bus, pytest.raises(CodegenError, match=r"no answer to the frames of 0\.00 s within 0\.01 s"):
            run_in_lock_step(PlantNode(software.config, short()), bus)

    def test_two_ecus_in_lock_step(self, software: Software, channel: BusAddress) -> None:
        with (
            EcuThread(software, channel, lock_step=True),
            EcuThread(software, channel, lock_step=True),
            Bus(channel) as bus,
            pytest.raises(CodegenError, match="another node sends 0x201 here"),
        ):
            run_in_lock_step(PlantNode(software.config, short()), bus)

    def test_faults_have_no_meaning_in_lock_step(self, software: Software, channel: BusAddress) -> None:
        faulty = short(faults=(Fault("drop", 0.5, 0.1),))
        with Bus(channel) as bus, pytest.raises(CodegenError, match="take --real-time"):
            run_in_lock_step(PlantNode(software.config, faulty), bus)

    @pytest.mark.parametrize(
        ("kind", "changes", "words"),
        [
            ("external", {"lock_step": True}, "an external ECU has a clock of its own"),
            ("external", {"scenario": short(faults=(Fault("ecu-restart", 0.1, 0.1),))}, "cannot be switched off from here"),
            ("native", {}, "the native ECU speaks SocketCAN on Linux, not virtual"),
        ],
    )
    def test_combinations_without_meaning(
        self, software: Software, channel: BusAddress, kind: session.EcuKind, changes: dict[str, Any], words: str
    ) -> None:
        with pytest.raises(CodegenError, match=words):
            run_hil(replace(Setup(software.config, short(), channel), **changes), Path("unused"), kind)

    @pytest.mark.parametrize(
        ("script", "words"),
        [
            ("print('ready', flush=True); print('error: out of luck', file=sys.stderr)", "ended during the run: error: out of"),
            ("print('error: out of luck', file=sys.stderr); sys.exit(2)", "did not start: out of luck"),
        ],
    )
    def test_an_ecu_process_that_ends(
        self, software: Software, monkeypatch: pytest.MonkeyPatch, script: str, words: str
    ) -> None:
        monkeypatch.setattr(session, "cffi_command", lambda *_, **__: [sys.executable, "-c", f"import sys; {script}"])
        with pytest.raises(CodegenError, match=words):
            run_hil(Setup(software.config, short(0.3), multicast(165)), Path("unused"), "cffi")


class TestActuator:
    """Reactions of the rear actuator and of the car's node while commands are missing."""

    @staticmethod
    def run(software: Software, **actuator: object) -> BenchResult:
        config: Config = software.config
        config = config.model_copy(update={"rear_actuator": config.rear_actuator.model_copy(update=actuator)})
        gone = short(2.5, faults=(Fault("ecu-restart", 1.0, 1.0),))
        return run_in_process(PlantNode(config, gone), software)

    def test_it_holds_and_control_resumes_without_a_jump(self, software: Software) -> None:
        result = self.run(software)
        commands = column(result, "rear_angle_command_rad")
        assert commands[99] != 0.0
        assert (commands[100:200] == commands[99]).all()
        status = column(result, "status")[99:105].tolist()
        assert status == [0, *[Status.DEGRADED] * 3, *[Status.FAIL_SAFE] * 2]
        # Kp times what the error may be after a second (a fifth of the reference at most), and one sample of the integral.
        assert abs(commands[200] - commands[199]) < 0.01 * 0.1 + 0.01 * 0.1 + 5e-5

    def test_it_returns_to_zero_where_configured(self, software: Software) -> None:
        result = self.run(software, on_command_loss="return", return_rate_deg_s=2.0)
        commands = column(result, "rear_angle_command_rad")
        assert (commands[100:103] == commands[99]).all()
        step = math.radians(2.0) * 0.01
        assert np.diff(np.abs(commands[102:110])) == pytest.approx(-step)  # the third lost sample is the last that is held
        assert abs(commands[199]) < step
        returned = np.flatnonzero(np.abs(commands[102:200]) < step)
        assert not commands[102 + returned[0] + 1 : 200].any()  # at zero, it stays there

    def test_a_restarted_node_counts_from_zero(self, software: Software) -> None:
        node = PlantNode(software.config, short(faults=(Fault("plant-restart", 0.3, 0.1),)))
        counters = []
        for cycle in range(43):
            counters.append([frame.data[1] & 0xF for frame in node.outgoing(cycle)])
            node.finish(cycle)
        assert counters[29] == [29 % 15] * 2
        assert counters[30:40] == [[]] * 10
        assert counters[40:43] == [[0, 0], [1, 1], [2, 2]]

    def test_an_ecu_without_an_angle_leaves_no_holes_in_the_recording(self, software: Software) -> None:
        """Restarted while the car's frames are missing, it sends "not available"; the recording has numbers throughout."""
        faults = (Fault("ecu-restart", 0.0, 0.1), Fault("drop", 0.0, 0.3))
        result = run_in_process(PlantNode(software.config, short(0.5, faults=faults)), software)
        assert np.isfinite(result.record).all()
        assert set(column(result, "status")[:20]) <= {Status.DEGRADED, Status.FAIL_SAFE}


class TestSensors:
    def test_the_seed_decides(self, software: Software) -> None:
        one, again, other = (run_through_can(software, short(0.5), sensors=True, seed=seed).record for seed in (3, 3, 4))
        assert np.array_equal(one, again)
        assert not np.array_equal(one, other)

    def test_noise_has_its_size_and_one_sensor_leaves_the_others_alone(self, software: Software) -> None:
        sensors = software.config.sensors
        yaw_rate = sensors.yaw_rate.model_copy(update={"noise_deg_s": 0.5, "resolution_deg_s": 0.0, "delay_samples": 0})
        one, other = SensorModel(sensors, 1), SensorModel(sensors.model_copy(update={"yaw_rate": yaw_rate}), 1)
        values = [(other.measure("yaw_rate", 0.3), other.measure("speed", 20.0)) for _ in range(4000)]
        noise = np.array(values)[:, 0] - 0.3
        # Standard error of a standard deviation: 1 / sqrt(2 n) of it, 1.1 %; four of them.
        assert np.std(noise) == pytest.approx(math.radians(0.5), rel=0.045)
        assert [one.measure("speed", 20.0) for _ in range(4000)] == [speed for _, speed in values]

    def test_delay_and_resolution(self, software: Software) -> None:
        changes = {"noise_deg_s": 0.0, "resolution_deg_s": 0.5, "delay_samples": 2}
        yaw_rate = software.config.sensors.yaw_rate.model_copy(update=changes)
        model = SensorModel(software.config.sensors.model_copy(update={"yaw_rate": yaw_rate}))
        measured = [math.degrees(model.measure("yaw_rate", math.radians(value))) for value in (1.1, 2.4, 3.3, 4.0)]
        assert measured == pytest.approx([1.0, 1.0, 1.0, 2.5])


class TestBus:
    def test_multicast_groups_are_kept_apart(self) -> None:
        """Linux would hand over the frames of each group that anybody has joined."""
        one, other = multicast(166), multicast(167)
        with Bus(one) as sender, Bus(one) as member, Bus(other) as stranger:
            assert sender.send(Frame(0x123, b"hello"))
            heard = member.receive(2.0)
            assert heard is not None
            assert heard.data == b"hello"
            assert stranger.receive(0.0) is None  # what the member has got would be here as well

    @pytest.mark.parametrize("interface", ["kvaser", "pcan"])
    def test_an_interface_without_a_driver_is_one_line(self, interface: str) -> None:
        with pytest.raises(CodegenError) as caught:
            Bus(BusAddress(interface, "PCAN_USBBUS1"))
        assert str(caught.value).startswith(f"{interface}:PCAN_USBBUS1: the bus cannot be opened: ")
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("vcan0", "'vcan0' is not INTERFACE:CHANNEL"),
            (":vcan0", "is not INTERFACE:CHANNEL"),
            ("socketcan:", "is not INTERFACE:CHANNEL"),
            ("sockecan:vcan0", "python-can has no interface 'sockecan'"),
            ("socketcan:-h", "'-h' cannot be a CAN interface"),
        ],
    )
    def test_a_bad_address(self, text: str, words: str) -> None:
        with pytest.raises(CodegenError, match=words):
            BusAddress.parse(text)
        assert BusAddress.parse("udp_multicast:ff15::6d63") == BusAddress("udp_multicast", "ff15::6d63")

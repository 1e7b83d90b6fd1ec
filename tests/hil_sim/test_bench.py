"""The bench: the same bits whatever carries the frames, and what it does where something is missing."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from codegen.config import Config
from codegen.errors import CodegenError
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from hil_sim import bench, session
from hil_sim.bench import BenchResult, run_in_lock_step, run_in_process, run_in_real_time
from hil_sim.bus import Bus, BusAddress
from hil_sim.ecu_node import EcuNode
from hil_sim.ecu_process import EcuThread
from hil_sim.faults import Fault
from hil_sim.frames import Frame
from hil_sim.metrics import step_metrics
from hil_sim.plant_node import PlantNode
from hil_sim.runs import run, run_through_can
from hil_sim.scenarios import Scenario, find
from hil_sim.sensors import SensorModel
from hil_sim.session import Setup, passive, run_hil

MULTICAST = BusAddress("udp_multicast", "239.74.163.2")


def short(duration: float = 2.0, **changes: object) -> Scenario:
    """The paper's step, early."""
    scenario = find("step-steer")
    from hil_sim import manoeuvres

    return replace(scenario, duration=duration, steer_time=0.2, drive=manoeuvres.step(0.2), **changes)


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> BusAddress:
    """A virtual bus of this test alone."""
    return BusAddress("virtual", request.node.nodeid)


def column(result: BenchResult, name: str) -> np.ndarray:
    return result.record[:, RECORD_COLUMNS.index(name)]


@pytest.fixture(scope="module")
def wanted(software: Software) -> np.ndarray:
    """The paper's run in C as a whole, through frames."""
    loop = ClosedLoop(software, LoopOptions(through_can=True))
    return loop.run(find("step-steer").inputs(software.config))


class TestTheSameBits:
    """The whole of the paper's run, cycle by cycle, every column."""

    def test_in_process(self, software: Software, wanted: np.ndarray) -> None:
        """Python's codec and protection on the car's side, the C on the other."""
        assert np.array_equal(run_through_can(software, find("step-steer")).record, wanted)

    def test_virtual(self, software: Software, channel: BusAddress, wanted: np.ndarray) -> None:
        with EcuThread(software, channel, lock_step=True), Bus(channel) as bus:
            result = run_in_lock_step(PlantNode(software.config, find("step-steer")), bus)
        assert np.array_equal(result.record, wanted)
        assert result.received == {"commands": 1500, "refused": 0, "cycles_without": 0, "lost": 0}

    def test_udp_multicast_with_the_ecu_in_another_process(
        self, software: Software, build_folder: Path, wanted: np.ndarray
    ) -> None:
        address = BusAddress("udp_multicast", f"239.74.163.{2 + os.getpid() % 250}")  # tests may run side by side
        setup = Setup(software.config, find("step-steer"), address, lock_step=True)
        ran = run_hil(setup, build_folder, "cffi")
        assert np.array_equal(ran.result.record, wanted)
        assert "cycles=1500 " in f"{ran.ecu_counters} "

    def test_without_frames_it_is_near_but_not_the_same(self, software: Software, wanted: np.ndarray) -> None:
        """What the frames' steps change: the figures of the run without them, within what the steps can do."""
        bare = run(software, find("step-steer"))
        assert not np.array_equal(bare, wanted)
        yaw_rate = RECORD_COLUMNS.index("yaw_rate_rad_s")
        # The command's step of 5e-5 rad, through a steady gain of at most 3.8 1/s (single-track model at this speed), twice:
        # from rounding the command and from rounding what it was computed from (yaw rate 2e-4 rad/s).
        assert np.abs(bare - wanted)[:, yaw_rate].max() < 2 * (3.8 * 5e-5 + 2e-4)

    def test_the_passive_car(self, software: Software) -> None:
        scenario = find("step-steer")
        assert np.array_equal(passive(software.config, scenario), run(software, scenario, controlled=False))

    @pytest.mark.parametrize("delay", [1, 3])
    def test_a_delayed_command(self, software: Software, delay: int) -> None:
        plant = software.config.plant.model_copy(update={"command_delay_samples": delay})
        config = software.config.model_copy(update={"plant": plant})
        loop = ClosedLoop(software, LoopOptions(through_can=True, delay_samples=delay))
        result = run_in_process(PlantNode(config, short()), software)
        assert np.array_equal(result.record, loop.run(short().inputs(config)))


class TestRealTime:
    """By the clock. Machines that run tests are busy: no test here asks for punctuality."""

    def test_every_cycle_is_there_and_counted(self, software: Software, channel: BusAddress) -> None:
        with EcuThread(software, channel, lock_step=False), Bus(channel) as bus:
            result = run_in_real_time(PlantNode(software.config, short(1.0)), bus)
        assert len(result.record) == 100
        assert result.received["lost"] == 0
        assert result.send_errors == 0

    def test_where_every_command_is_in_time_it_is_the_run_in_lock_step(self, software: Software, channel: BusAddress) -> None:
        with EcuThread(software, channel, lock_step=False), Bus(channel) as bus:
            result = run_in_real_time(PlantNode(software.config, short(1.0)), bus)
        wanted = run_through_can(software, short(1.0)).record
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


class TestNodesOnABusyBus:
    """Foreign frames, 29-bit identifiers, remote and error frames, wrong lengths, and the echo of what one sends."""

    @staticmethod
    def noise(config: Config) -> list[can.Message]:
        frames = config.can
        ids = (frames.vehicle_motion.id, frames.vehicle_conditions.id, frames.rear_steer_command.id)
        return [
            *(can.Message(arbitration_id=number, is_extended_id=True, data=b"\xff" * 8) for number in ids),
            *(can.Message(arbitration_id=number, is_extended_id=False, is_remote_frame=True, dlc=8) for number in ids),
            can.Message(arbitration_id=0, is_extended_id=False, data=b""),
            can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"\x01\x02"),
            can.Message(is_error_frame=True, arbitration_id=ids[0]),
        ]

    def test_they_change_nothing(self, software: Software, channel: BusAddress) -> None:
        messages = self.noise(software.config)
        with can.Bus(interface=channel.interface, channel=channel.channel) as stranger:

            class Noisy(PlantNode):
                def outgoing(self, cycle: int) -> list[Frame]:
                    for message in messages:
                        stranger.send(message)
                    return super().outgoing(cycle)

            with EcuThread(software, channel, lock_step=True), Bus(channel) as bus:
                result = run_in_lock_step(Noisy(software.config, short()), bus)
        assert np.array_equal(result.record, run_through_can(software, short()).record)

    def test_an_echo_is_not_taken_for_another_node(self, software: Software, channel: BusAddress) -> None:
        """The ECU's own command comes back to it, the car's frames to the car: as on interfaces that echo."""
        node = PlantNode(software.config, short())
        for frame in node.outgoing(0):
            assert not node.receive(frame)
        with Bus(channel) as bus:
            ecu = EcuNode(software, bus)
            identifier, data = ecu.task.run()
            assert not ecu._take(Frame(identifier, data))
            assert not ecu.task.is_complete


class TestWhatIsMissing:
    def test_no_ecu_in_lock_step(self, software: Software, channel: BusAddress, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(bench, "ANSWER_TIMEOUT", 0.01)
        with Bus(channel) as bus, pytest.raises(CodegenError, match=r"no answer to the frames of 0\.00 s within 0\.01 s"):
            run_in_lock_step(PlantNode(software.config, short()), bus)

    def test_no_ecu_in_real_time_the_actuator_holds(self, software: Software, channel: BusAddress) -> None:
        with Bus(channel) as bus:
            result = run_in_real_time(PlantNode(software.config, short(0.3)), bus)
        assert result.received == {"commands": 0, "refused": 0, "cycles_without": 30, "lost": 0}
        assert not column(result, "rear_angle_command_rad").any()
        status = column(result, "status")
        assert (status[:3] == Status.DEGRADED).all()  # the actuator's: it holds
        assert (status[3:] == Status.FAIL_SAFE).all()

    def test_an_ecu_that_knows_no_angle_yet_leaves_no_holes_in_the_recording(self, software: Software) -> None:
        """Restarted while the car's frames stay away: it sends "not available", and the recording has numbers throughout."""
        faults = (Fault("ecu-restart", 0.0, 0.1), Fault("drop", 0.0, 0.3))
        result = run_in_process(PlantNode(software.config, short(faults=faults)), software)
        assert np.isfinite(result.record).all()
        assert set(column(result, "status")[:20]) <= {Status.DEGRADED, Status.FAIL_SAFE}

    def test_faults_have_no_meaning_in_lock_step(self, software: Software, channel: BusAddress) -> None:
        faulty = short(faults=(Fault("drop", 0.5, 0.1),))
        with Bus(channel) as bus, pytest.raises(CodegenError, match="take --real-time"):
            run_in_lock_step(PlantNode(software.config, faulty), bus)

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda setup: replace(setup, lock_step=True), "an external ECU has a clock of its own"),
            (
                lambda setup: replace(setup, scenario=short(faults=(Fault("ecu-restart", 0.1, 0.1),))),
                "cannot be switched off from here",
            ),
        ],
    )
    def test_an_external_ecu_is_not_ours(
        self, software: Software, channel: BusAddress, change: Callable[[Setup], Setup], words: str
    ) -> None:
        with pytest.raises(CodegenError, match=words):
            run_hil(change(Setup(software.config, short(), channel)), Path("unused"), "external")

    def test_the_native_ecu_needs_socketcan(self, software: Software, channel: BusAddress) -> None:
        with pytest.raises(CodegenError, match="the native ECU speaks SocketCAN on Linux, not virtual"):
            run_hil(Setup(software.config, short(), channel), Path("unused"), "native")

    def test_an_ecu_that_ends_during_the_run_is_told(self, software: Software, build_folder: Path) -> None:
        """A process that says `ready` and dies: the run is no evidence."""
        address = BusAddress("udp_multicast", f"239.74.165.{2 + os.getpid() % 250}")
        script = "import sys; print('ready', flush=True); print('error: out of luck', file=sys.stderr)"
        setup = Setup(software.config, short(0.5), address)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(session, "cffi_command", lambda *_, **__: [sys.executable, "-c", script])
            with pytest.raises(CodegenError, match="the ECU ended during the run: error: out of luck") as caught:
                run_hil(setup, build_folder, "cffi")
        assert caught.value.exit_code == 1

    def test_an_ecu_process_that_does_not_start_says_why(self, software: Software, tmp_path: Path) -> None:
        setup = Setup(software.config, short(), MULTICAST)
        with pytest.raises(CodegenError, match=r"the ECU did not start: .*manifest\.json"):
            run_hil(setup, tmp_path, "cffi")

    def test_another_ecu_in_lock_step_is_told(self, software: Software, channel: BusAddress) -> None:
        """Two answer each sample: the run is nobody's."""
        with (
            EcuThread(software, channel, lock_step=True),
            EcuThread(software, channel, lock_step=True),
            Bus(channel) as bus,
            pytest.raises(CodegenError, match="another node sends 0x201 here"),
        ):
            run_in_lock_step(PlantNode(software.config, short()), bus)


class TestActuator:
    """What the rear actuator does by itself while commands stay away."""

    @staticmethod
    def loss(config: Config, **actuator: object) -> Config:
        return config.model_copy(update={"rear_actuator": config.rear_actuator.model_copy(update=actuator)})

    def run(self, software: Software, config: Config) -> np.ndarray:
        gone = short(3.0, faults=(Fault("ecu-restart", 1.0, 1.0),))
        return column(run_in_process(PlantNode(config, gone), software), "rear_angle_command_rad")

    def test_it_holds(self, software: Software) -> None:
        commands = self.run(software, software.config)
        assert commands[99] != 0.0
        assert (commands[100:200] == commands[99]).all()

    def test_it_returns_to_zero_where_configured(self, software: Software) -> None:
        config = self.loss(software.config, on_command_loss="return", return_rate_deg_s=2.0)
        commands = self.run(software, config)
        assert (commands[100:103] == commands[99]).all()
        step = math.radians(2.0) * 0.01
        assert np.diff(np.abs(commands[102:110])) == pytest.approx(-step)  # the third lost sample is the last that is held
        assert abs(commands[199]) < step
        returned = np.flatnonzero(np.abs(commands[102:200]) < step)
        assert not commands[102 + returned[0] + 1 : 200].any()  # at zero, it stays there

    def test_a_restarted_node_counts_from_zero(self, software: Software) -> None:
        node = PlantNode(software.config, short(faults=(Fault("plant-restart", 0.3, 0.1),)))
        counters = []
        for cycle in range(60):
            counters.append([frame.data[1] & 0xF for frame in node.outgoing(cycle)])
            node.finish(cycle)
        assert counters[29] == [29 % 15] * 2
        assert counters[30:40] == [[]] * 10
        assert counters[40:43] == [[0, 0], [1, 1], [2, 2]]

    def test_its_status_while_nothing_comes(self, software: Software) -> None:
        gone = short(3.0, faults=(Fault("ecu-restart", 1.0, 1.0),))
        status = column(run_in_process(PlantNode(software.config, gone), software), "status")
        assert [int(value) for value in status[99:105]] == [0, *[Status.DEGRADED] * 3, *[Status.FAIL_SAFE] * 2]

    def test_after_a_restart_control_goes_on_without_a_jump(self, software: Software) -> None:
        commands = self.run(software, software.config)
        # Kp times what the error may be after a second (a fifth of the reference at most), and one sample of the integral.
        assert abs(commands[200] - commands[199]) < 0.01 * 0.1 + 0.01 * 0.1 + 5e-5


class TestSensors:
    def test_the_same_seed_gives_the_same_run(self, software: Software) -> None:
        def run_with(seed: int) -> np.ndarray:
            return run_through_can(software, short(), sensors=True, seed=seed).record

        assert np.array_equal(run_with(3), run_with(3))
        assert not np.array_equal(run_with(3), run_with(4))

    def test_noise_has_its_size_and_one_sensor_leaves_the_others_alone(self, software: Software) -> None:
        sensors = software.config.sensors
        yaw_rate = sensors.yaw_rate.model_copy(update={"noise_deg_s": 0.5, "resolution_deg_s": 0.0, "delay_samples": 0})
        one, other = SensorModel(sensors, 1), SensorModel(sensors.model_copy(update={"yaw_rate": yaw_rate}), 1)
        values = [(model.measure("yaw_rate", 0.3), model.measure("speed", 20.0)) for model in (other,) for _ in range(4000)]
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
        number = os.getpid() % 250
        one, other = (BusAddress("udp_multicast", f"239.74.{third}.{2 + number}") for third in (166, 167))
        with Bus(one) as sender, Bus(one) as member, Bus(other) as stranger:
            assert sender.send(Frame(0x123, b"hello"))
            heard = member.receive(2.0)
            assert heard is not None
            assert heard.data == b"hello"
            assert stranger.receive(0.0) is None  # what the member has got would be here as well

    @pytest.mark.parametrize("interface", ["kvaser", "pcan", "vector", "socketcand", "ixxat", "slcan"])
    def test_what_has_no_driver_here_is_one_line(self, interface: str, caplog: pytest.LogCaptureFixture) -> None:
        with pytest.raises(CodegenError) as caught:
            Bus(BusAddress(interface, "0"))
        assert str(caught.value).startswith(f"{interface}:0: the bus cannot be opened: ")
        assert "\n" not in str(caught.value)

    def test_a_channel_is_no_option(self) -> None:
        with pytest.raises(CodegenError, match="'-h' cannot be a CAN interface"):
            BusAddress.parse("socketcan:-h")

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("vcan0", "'vcan0' is not INTERFACE:CHANNEL"),
            (":vcan0", "is not INTERFACE:CHANNEL"),
            ("socketcan:", "is not INTERFACE:CHANNEL"),
            ("sockecan:vcan0", "python-can has no interface 'sockecan'"),
        ],
    )
    def test_a_bad_address(self, text: str, words: str) -> None:
        with pytest.raises(CodegenError, match=words):
            BusAddress.parse(text)

    def test_a_channel_may_have_colons(self) -> None:
        assert BusAddress.parse("udp_multicast:ff15:7079:7468:6f6e:6465:6d6f:6d63:6173") == BusAddress(
            "udp_multicast", "ff15:7079:7468:6f6e:6465:6d6f:6d63:6173"
        )

    def test_an_interface_that_cannot_be_opened(self) -> None:
        with pytest.raises(CodegenError) as caught:
            Bus(BusAddress("pcan", "PCAN_USBBUS1"))
        assert "pcan:PCAN_USBBUS1" in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("held", "told"), [(1, True), (40, True), (60, False)])
def test_a_sample_held_now_and_then_leaves_the_car_controlled(software: Software, held: int, told: bool) -> None:
    """In the last second of a step, whose mean is the steady value: it is told while most of it is controlled."""
    scenario = short(3.0)
    record = run_through_can(software, scenario).record.copy()
    record[-held:, RECORD_COLUMNS.index("status")] = Status.DEGRADED
    assert (step_metrics(record, scenario.steer_time).yaw_rate_reference_deg_s is not None) == told

"""The bench: the same bits on every bus, the actuator's own reactions, and errors for missing nodes."""

import math
import os
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from codegen.errors import CodegenError
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Software, Status
from hil_sim import bench, manoeuvres, session
from hil_sim.bench import run, run_in_lock_step, run_in_process, run_in_real_time, run_through_can
from hil_sim.bus import Bus, BusAddress
from hil_sim.codec import Codec, Frame, RearSteerCommand
from hil_sim.e2e import protect
from hil_sim.ecu_process import EcuThread
from hil_sim.faults import Fault
from hil_sim.metrics import column
from hil_sim.plant_node import PlantNode, Received, SensorModel
from hil_sim.scenario_files import find
from hil_sim.scenarios import Clocks, Scenario
from hil_sim.session import Setup, passive, run_hil


def short(duration: float = 2.0, *faults: Fault) -> Scenario:
    """Return the paper's step, with an early start."""
    return replace(find("step-steer"), duration=duration, steer_time=0.2, drive=manoeuvres.step(0.2), faults=faults)


def multicast(third: int) -> BusAddress:
    """Return a group of this process, so that tests can run in parallel."""
    return BusAddress("udp_multicast", f"239.74.{third}.{2 + os.getpid() % 250}")


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> BusAddress:
    """Return a virtual bus for this test only."""
    return BusAddress("virtual", request.node.nodeid)


@pytest.fixture(scope="module")
def wanted(software: Software) -> np.ndarray:
    """Return the record of the whole run in C, through frames."""
    return ClosedLoop(software, LoopOptions(through_can=True)).run(short().inputs(software.config))


def test_in_process_and_on_a_virtual_bus(software: Software, channel: BusAddress, wanted: np.ndarray) -> None:
    """Python's codec and protection on the car's side talk to the C; foreign frames change nothing.

    Those have 29-bit identifiers, are remote or error frames, or have wrong lengths.
    """
    assert np.array_equal(run_through_can(software, short()).record, wanted)
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
            result = run_in_lock_step(Noisy(software.config, short()), bus)
    assert np.array_equal(result.record, wanted)
    # Two cycles until the car's messages are valid.
    assert result.received == {"commands": 200, "refused": 0, "cycles_without": 2, "lost": 0}


def test_the_passive_car_and_a_delayed_command(software: Software) -> None:
    assert np.array_equal(passive(software.config, short()), run(software, short(), controlled=False))
    config = software.config.replace({"plant": {"command_delay_samples": 3}})
    loop = ClosedLoop(software, LoopOptions(through_can=True, delay_samples=3))
    result = run_in_process(PlantNode(config, short()), software)
    assert np.array_equal(result.record, loop.run(short().inputs(config)))


def test_every_cycle_is_counted_and_equals_lock_step(software: Software, channel: BusAddress, wanted: np.ndarray) -> None:
    with EcuThread(software, channel, lock_step=False), Bus(channel) as bus:
        result = run_in_real_time(PlantNode(software.config, short(0.5)), bus)
    assert len(result.record) == 50
    assert (result.received["lost"], result.send_errors) == (0, 0)
    # Until the first cycle without exactly one command.
    answered = np.isfinite(result.response) & (result.diagnostics == 0)
    same = len(answered) if answered.all() else int(np.argmin(answered))
    assert np.array_equal(result.record[:same], wanted[:same])


def test_late_cycles_are_counted_and_without_an_ecu_the_actuator_holds(
    software: Software, channel: BusAddress, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock jumps by 35 ms in one cycle: three deadlines are lost, the others keep period and phase."""
    sent: list[float] = []

    class Clock:
        """Clock that advances only when someone waits."""

        now = 100.0

        def monotonic(self) -> float:
            return self.now

        def sleep(self, seconds: float) -> None:
            self.now += seconds

    class Recorded(PlantNode):
        def outgoing(self, cycle: int) -> list[Frame]:
            sent.append(clock.now)
            if cycle == 20:
                clock.now += 0.035
            return super().outgoing(cycle)

    clock = Clock()
    monkeypatch.setattr(bench, "time", clock)
    with Bus(channel) as bus:
        monkeypatch.setattr(bus, "receive", lambda timeout: clock.sleep(max(timeout, 0.0)))
        fast = replace(short(0.5), clocks=Clocks(drift_ppm=1e4))
        result = run_in_real_time(Recorded(software.config, fast), bus)
    assert result.late_cycles == 1
    steps, period = np.diff(sent), 0.01 / 1.01
    assert steps[20] == pytest.approx(0.03 + period)
    assert np.delete(steps, 20) == pytest.approx(period)  # never shorter
    assert result.received == {"commands": 0, "refused": 0, "cycles_without": 50, "lost": 0}
    assert not column(result.record, "rear_angle_command_rad").any()
    assert column(result.record, "status").tolist() == [Status.DEGRADED] * 3 + [Status.FAIL_SAFE] * 47


def test_two_ecus_in_lock_step(software: Software, channel: BusAddress) -> None:
    with (
        EcuThread(software, channel, lock_step=True),
        EcuThread(software, channel, lock_step=True),
        Bus(channel) as bus,
        pytest.raises(CodegenError, match="another node sends 0x201 here"),
    ):
        run_in_lock_step(PlantNode(software.config, short()), bus)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("print('ready', flush=True); print('error: out of luck', file=sys.stderr)", "ended during the run: error: out of"),
        ("print('error: out of luck', file=sys.stderr); sys.exit(2)", "did not start: out of luck"),
    ],
)
def test_an_ecu_process_that_ends(software: Software, monkeypatch: pytest.MonkeyPatch, script: str, words: str) -> None:
    monkeypatch.setattr(session, "cffi_command", lambda *_, **__: [sys.executable, "-c", f"import sys; {script}"])
    with pytest.raises(CodegenError, match=words):
        run_hil(Setup(software.config, short(0.3), multicast(165)), Path("unused"), "cffi")


def test_it_returns_to_zero_where_configured(software: Software) -> None:
    """`fault_catalogue` covers holding and recovery."""
    config = software.config.replace({"rear_actuator": {"on_command_loss": "return", "return_rate_deg_s": 2.0}})
    result = run_in_process(PlantNode(config, short(2.5, Fault("ecu-restart", 1.0, 1.0))), software)
    commands, step = column(result.record, "rear_angle_command_rad"), math.radians(2.0) * 0.01
    assert (commands[100:103] == commands[99]).all() and commands[99] != 0.0
    assert np.diff(np.abs(commands[102:110])) == pytest.approx(-step)  # the third lost sample is the last one held
    returned = np.flatnonzero(np.abs(commands[102:200]) < step)
    assert not commands[102 + returned[0] + 1 : 200].any()  # it stays at zero


def test_a_restarted_node_counts_from_zero(software: Software) -> None:
    node, counters = PlantNode(software.config, short(2.0, Fault("plant-restart", 0.33, 0.1))), []
    command, angle = software.config.can.rear_steer_command, Codec(software.config.can).encode(RearSteerCommand(0.0, 0.0))
    for cycle in range(45):
        counters.append([frame.data[1] & 0xF for frame in node.outgoing(cycle)])
        node.receive(Frame(command.id, protect(command.e2e_data_id, (cycle + 7 * (cycle > 40)) % 15, angle)))
        node.finish(cycle)
    assert counters[32:] == [[2, 2], *[[]] * 10, [0, 0], [1, 1]]
    assert node.received == Received(commands=35, refused=0, cycles_without=10, lost=0)  # its receiver restarts too


def frames_of_each_task(clocks: Clocks, cycles: int, seed: int = 0) -> list[int]:
    """Return how many frames of a message each start of the task finds."""
    found, waiting = [], 0
    for starts in clocks.task_starts(cycles, 0.01, seed):
        waiting += 1
        for _ in starts:
            found.append(waiting)
            waiting = 0
    return found


def test_two_clocks_give_0_1_or_2_frames_and_lose_none(software: Software, wanted: np.ndarray) -> None:
    # A car that is 1 % fast gains a cycle in a second; the clocks tick together in the middle of the run.
    assert Counter(frames_of_each_task(Clocks(drift_ppm=1e4), 200)) == {1: 198, 2: 1}
    assert Counter(frames_of_each_task(Clocks(drift_ppm=-1e4), 200))[0] == 2
    # Only jitter decides the order, so a quarter of the cycles has none: 500 +- 4 standard deviations of 19.
    counts = Counter(frames_of_each_task(Clocks(jitter_ms=0.7), 2000))
    assert set(counts) == {0, 1, 2} and abs(counts[0] - 500) < 77 and abs(counts[0] - counts[2]) <= 1

    uneven = replace(short(), clocks=Clocks(100.0, 0.7))
    one, again, other = (run_through_can(software, uneven, seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(one.record, again.record) and not np.array_equal(one.record, other.record)
    assert (one.received["lost"], one.received["refused"]) == (0, 0)
    # A command acts when it arrives: at the end of a cycle that is one sample of delay.
    node = PlantNode(software.config, short())
    node.task_starts = [(0.01,)] * node.cycles
    late = ClosedLoop(software, LoopOptions(through_can=True, delay_samples=1)).run(short().inputs(software.config))
    found = run_in_process(node, software).record
    assert np.array_equal(column(found, "yaw_rate_rad_s"), column(late, "yaw_rate_rad_s"))
    assert not np.array_equal(found, wanted)


def test_two_clocks_are_rejected_where_they_have_no_meaning(software: Software, channel: BusAddress) -> None:
    uneven = replace(short(), clocks=Clocks(jitter_ms=0.7))
    with pytest.raises(CodegenError, match="two clocks"):
        run(software, uneven)
    with Bus(channel) as bus, pytest.raises(CodegenError, match="one clock"):
        run_in_lock_step(PlantNode(software.config, uneven), bus)
    with pytest.raises(CodegenError, match="half of the period"):
        PlantNode(software.config, replace(short(), clocks=Clocks(jitter_ms=5.0)))


def test_sensor_noise_delay_and_resolution(software: Software) -> None:
    """The seed determines the run; noise has its amplitude; sensors are independent; delay and resolution act."""

    def sensors(**changes: float) -> SensorModel:
        return SensorModel(software.config.replace({"sensors": {"yaw_rate": changes}}).sensors, 1)

    one, again, other = (run_through_can(software, short(0.5), sensors=True, seed=seed).record for seed in (3, 3, 4))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    plain, noisy = sensors(), sensors(noise_deg_s=0.5, resolution_deg_s=0.0, delay_samples=0)
    yaw_rate, speed = zip(*((noisy.measure("yaw_rate", 0.3), noisy.measure("speed", 20.0)) for _ in range(4000)), strict=True)
    # Standard error of a standard deviation: 1 / sqrt(2 n) of it, 1.1 %; four of them.
    assert np.std(np.array(yaw_rate) - 0.3) == pytest.approx(math.radians(0.5), rel=0.045)
    assert [plain.measure("speed", 20.0) for _ in range(4000)] == list(speed)
    late = sensors(noise_deg_s=0.0, resolution_deg_s=0.5, delay_samples=2)
    measured = [math.degrees(late.measure("yaw_rate", math.radians(value))) for value in (1.1, 2.4, 3.3, 4.0)]
    assert measured == pytest.approx([1.0, 1.0, 1.0, 2.5])


def test_multicast_groups_are_kept_apart() -> None:
    """Linux would otherwise deliver the frames of every joined group."""
    one, other = multicast(166), multicast(167)
    with Bus(one) as sender, Bus(one) as member, Bus(other) as stranger:
        assert sender.send(Frame(0x123, b"hello"))
        heard = member.receive(2.0)
        assert heard is not None and heard.data == b"hello"
        assert stranger.receive(0.0) is None  # the member's frame would arrive here too


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (":vcan0", "is not INTERFACE:CHANNEL"),
        ("socketcan:", "is not INTERFACE:CHANNEL"),
        ("sockecan:vcan0", "python-can has no interface 'sockecan'"),
        ("socketcan:-h", "'-h' cannot be a CAN interface"),
        ("pcan:PCAN_USBBUS1", r"^pcan:PCAN_USBBUS1: the bus cannot be opened: .+$"),
    ],
)
def test_a_bad_address_or_an_interface_without_a_driver(text: str, words: str) -> None:
    with pytest.raises(CodegenError, match=words):
        Bus(BusAddress.parse(text))
    assert BusAddress.parse("udp_multicast:ff15::6d63") == BusAddress("udp_multicast", "ff15::6d63")

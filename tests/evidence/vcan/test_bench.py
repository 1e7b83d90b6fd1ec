"""The bench on a real vcan0: the same bits as in one process, no frame lost in real time, defined behaviour under faults."""

from dataclasses import replace
from itertools import pairwise

import can
import numpy as np
import pytest

from codegen.sil.software import Software, Status, load
from hil_sim import ecu_process, manoeuvres
from hil_sim.bench import BenchResult, run_through_can
from hil_sim.bus import BusAddress
from hil_sim.codec import Codec, Frame
from hil_sim.faults import Fault
from hil_sim.metrics import column
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from hil_sim.scenarios import Scenario
from hil_sim.session import EcuKind, Setup, run_hil
from tests import builds, frame_kinds
from tests.evidence.vcan.conftest import FOLDER

RATE_LIMIT_DEG_S = 30.0
"""Rate limit of the paper's actuator."""
SYNC_FRAMES_MAX = 2
"""Frames that validate the counter after a silence: the first, and sync_counter_init = 1 more."""
TIMING_CAUSES = 1 << 8 | 1 << 9
"""Bits of the diagnostics: timeout, task late."""
FAULTS = (
    Fault("drop", 0.3, 0.05, "VehicleMotion"),
    Fault("corrupt", 0.5, 0.03),
    Fault("freeze-counter", 0.7, 0.1, "VehicleConditions"),
    Fault("delay", 0.9, 0.1, "VehicleMotion", cycles=2),
    Fault("duplicate", 1.2, 0.05),
    Fault("not-a-number", 1.4, 0.05, "VehicleMotion", "yaw_rate"),
)
STEP = replace(find("step-steer"), duration=2.0, steer_time=1.0, drive=manoeuvres.step(1.0))
kinds = pytest.mark.parametrize("kind", ["native", pytest.param("cffi", marks=pytest.mark.long)])


@pytest.fixture
def address(vcan: str) -> BusAddress:
    return BusAddress("socketcan", vcan)


def corner(duration: float, *faults: Fault) -> Scenario:
    """Return a scenario with 4 deg at the front wheels from the start, 65 km/h: the rear wheels steer."""
    scenario = find("step-steer")
    settings = replace(scenario.settings, speed_km_h=65.0, steering_wheel_angle_deg=4.0 * 90.0 / 6.75)
    drive = manoeuvres.step(0.1)
    return replace(scenario, duration=duration, steer_time=0.1, drive=drive, settings=settings, faults=faults)


@pytest.mark.parametrize(
    ("build", "scenario", "kind"),
    [
        ("4ws2-paper", STEP, "native"),
        pytest.param("4ws2-paper", STEP, "cffi", marks=pytest.mark.long),
        pytest.param("4ws2", find("sine-with-dwell"), "native", marks=pytest.mark.long),
    ],
)
def test_lock_step_gives_the_same_bits_as_one_process(
    address: BusAddress, build: str, scenario: Scenario, kind: EcuKind
) -> None:
    folder = FOLDER.with_name(build)
    built = load(folder)
    wanted = run_through_can(built, scenario).record
    result = run_hil(Setup(built.config, scenario, address, lock_step=True), folder, kind).result
    assert result.received == {"commands": len(wanted), "refused": 0, "cycles_without": 2, "lost": 0}  # until valid
    assert np.array_equal(result.record, wanted)


@kinds
@pytest.mark.parametrize("name", ["29 bits", "FD, 24 bytes, profile 11C, 29 bits", "FD, 64 bytes, profile 5"])
def test_other_frames_give_the_same_bits(address: BusAddress, name: str, kind: EcuKind) -> None:
    """29-bit identifiers, and frames of CAN FD with bit-rate switching."""
    build, scenario = frame_kinds.folder(name), replace(find("step-steer"), duration=1.0)
    wanted = run_through_can(builds.paper().software, scenario).record
    result = run_hil(Setup(frame_kinds.built(name).software.config, scenario, address, lock_step=True), build, kind).result
    assert result.received["commands"] == len(wanted)
    assert np.array_equal(result.record, wanted)


@pytest.mark.long
def test_a_minute_without_a_lost_frame(address: BusAddress, software: Software, monkeypatch: pytest.MonkeyPatch) -> None:
    """6,000 cycles. A busy machine may delay any of them, but every frame must arrive.

    For the car, the counters of all commands are consecutive. For the ECU, no command reports a gap, a wrong CRC or a
    repetition, and a wrong sequence only where its counter is validated after a silence (SYNC).
    """
    arrived: list[tuple[int, int]] = []  # counter and diagnostics of each command
    codec, original = Codec(software.config.can), PlantNode.receive

    def receive(node: PlantNode, frame: Frame) -> bool:
        if own := original(node, frame):
            arrived.append((frame.data[1] & 0xF, codec.decode(frame.id, frame.data).diagnostics))
        return own

    monkeypatch.setattr(PlantNode, "receive", receive)
    ran = run_hil(Setup(software.config, replace(find("step-steer"), duration=60.0), address), FOLDER, "native")
    result, counters = ran.result, ecu_process.counters(ran.ecu_counters)
    assert len(result.record) == 6000
    assert result.send_errors == counters["send_errors"] == result.received["lost"] == 0
    assert all((later - earlier) % 15 == 1 for (earlier, _), (later, _) in pairwise(arrived))
    silent = SYNC_FRAMES_MAX  # the bus was silent before the run
    for _, diagnostics in arrived:
        for missing, wrong_sequence in ((1 << 0, 1 << 3), (1 << 5, 1 << 8)):
            assert not diagnostics & (missing << 1 | missing << 2)
            assert not diagnostics & missing << 4 or counters["discarded"]
            assert not diagnostics & wrong_sequence or silent >= 0 or counters["discarded"]  # received, but too old to use
        silent = SYNC_FRAMES_MAX if diagnostics & (1 << 0 | 1 << 5) else silent - 1


def drive(scenario: Scenario, address: BusAddress, software: Software, kind: EcuKind = "native") -> BenchResult:
    """Run in real time; check that δr stays within bounds at every sample, and that the ECU has control at the end."""
    result = run_hil(Setup(software.config, scenario, address), FOLDER, kind).result
    rear, commands = (column(result.record, name) for name in ("rear_angle_rad", "rear_angle_command_rad"))
    assert np.abs(commands).max() <= np.deg2rad(3.5) + 5e-5
    assert np.abs(np.diff(rear)).max() <= np.deg2rad(RATE_LIMIT_DEG_S) * 0.01 * (1 + 1e-9)
    # A busy machine may delay a sample.
    assert (column(result.record, "status")[-50:] <= Status.LIMITED).any()
    return result


@kinds
def test_the_ecu_is_killed_and_restarted(address: BusAddress, software: Software, kind: EcuKind) -> None:
    duration = 3.0 if kind == "native" else 30.0  # Python has to restart, in a guest on a busy machine
    result = drive(corner(duration, Fault("ecu-restart", 1.0, 0.5)), address, software, kind)
    assert column(result.record, "status")[140] == Status.FAIL_SAFE  # of the actuator, which receives no command
    assert len(set(column(result.record, "rear_angle_command_rad")[102:150])) == 1  # held
    assert np.isfinite(result.response[-50:]).any()


@kinds
def test_faults_of_end_to_end_protection(address: BusAddress, software: Software, kind: EcuKind) -> None:
    """The ECU reports every cause that it reports in one process with the same faults in the frames."""
    scenario = corner(2.5, *FAULTS)
    causes = int(np.bitwise_or.reduce(run_through_can(software, scenario).diagnostics)) & ~TIMING_CAUSES
    # All causes of motion and conditions except missing conditions; unavailable, speed replaced, intermittent.
    assert causes == 0x8F7, f"{causes:#x}"
    seen = int(np.bitwise_or.reduce(drive(scenario, address, software, kind).diagnostics))
    assert seen & causes == causes, f"{seen:#x}"


@pytest.mark.long
def test_the_plant_is_killed_and_restarted(address: BusAddress, software: Software) -> None:
    result = drive(corner(3.0, Fault("plant-restart", 1.0, 0.3)), address, software)
    assert (result.diagnostics[130:160] & (1 << 2)).any()  # the counters restart


@pytest.mark.long
def test_foreign_frames_on_the_bus(address: BusAddress, software: Software) -> None:
    """The bus is full of other nodes' frames, and a listener receives every frame.

    One of three runs must be free of faults: a busy machine delays frames occasionally.
    """
    cars = [{"can_id": identifier, "can_mask": 0x7FF, "extended": False} for identifier in (0x101, 0x102)]
    for _ in range(3):
        with can.Bus(interface="socketcan", channel=address.channel, can_filters=cars) as stranger:
            result = drive(corner(2.0, Fault("foreign-traffic", 0.5, 1.0)), address, software)
            heard = [message.arbitration_id for message in iter(lambda: stranger.recv(0.0), None)]
        assert heard.count(0x101) == heard.count(0x102) == 200
        assert result.received["lost"] == 0
        if not (result.diagnostics & (1 << 4 | 1 << 9 | 1 << 14)).any():
            return
    pytest.fail("own frames were lost or damaged in each of three runs")

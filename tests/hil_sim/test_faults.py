"""Faults on the bus: the injector's effect on frames and values, and the defined outcome of every fault."""

import math
import typing
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from codegen.configuration.can import Can
from codegen.errors import CodegenError
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from hil_sim.bench import BenchResult, run_through_can
from hil_sim.codec import Frame
from hil_sim.e2e import protect
from hil_sim.fault_catalogue import catalogue, judge, scenario
from hil_sim.faults import FRAME_BITS_MAX, Fault, FaultKind, Injector
from hil_sim.metrics import column
from tests import builds, frame_kinds

CAN = Can()
MOTION, CONDITIONS, COMMAND = CAN.vehicle_motion, CAN.vehicle_conditions, CAN.rear_steer_command
PERIOD = 0.01
CASES = {case.name: case for case in catalogue(CAN, PERIOD)}
VALUES = {"speed": 10.0, "front_angle": 0.1, "yaw_rate": 0.2}


def injector(*faults: Fault) -> Injector:
    return Injector(faults, CAN, PERIOD, seed=1)


def fault(kind: FaultKind, start: int = 2, count: int = 3, **more: object) -> Fault:
    """Return a fault from cycle `start` on, for `count` cycles."""
    return Fault(kind, start * PERIOD, count * PERIOD, **more)


def frames(cycle: int) -> list[Frame]:
    """Return the car's frames of a cycle, with the number of the cycle in the last byte."""
    data = bytes([0] * 7 + [cycle])
    return [Frame(message.id, protect(message.e2e_data_id, cycle % 15, data)) for message in (MOTION, CONDITIONS)]


def numbers(faulty: Injector, message: int = MOTION.id) -> list[list[int]]:
    """Return the cycle numbers of the frames of one message, by the cycle in which they were sent."""
    sent = [faulty.outgoing(cycle, frames(cycle)) for cycle in range(8)]
    return [[frame.data[7] for frame in group if frame.id == message] for group in sent]


LOST = [[0], [1], [], [], [], [5], [6], [7]]


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ([], [[cycle] for cycle in range(8)]),
        ([fault("drop")], LOST),
        ([fault("bus-down")], LOST),
        # In the order in which they are due, older first.
        ([fault("delay", cycles=4)], [[0], [1], [], [], [], [5], [2, 6], [3, 7]]),
        ([fault("duplicate")], [[0], [1], [2, 2], [3, 3], [4, 4], [5], [6], [7]]),
        # A frame follows its successor; none is lost if the fault ends between them.
        ([fault("reorder")], [[0], [1], [], [3, 2], [], [5, 4], [6], [7]]),
        ([fault("reorder", count=4)], [[0], [1], [], [3, 2], [], [5, 4], [6], [7]]),
        ([fault("burst")], [[0], [1], [], [2, 3], [], [4, 5], [6], [7]]),
        # A dropped frame does not reappear in another order.
        ([fault("drop"), fault("reorder", 0, 10)], [[], [1, 0], [], [], [], [], [6, 5], []]),
        # A bus that is down discards delayed frames.
        ([fault("bus-down"), fault("delay", 0, 2, cycles=3)], [[], [], *LOST[2:]]),
    ],
)
def test_order_of_frames(faults: list[Fault], expected: list[list[int]]) -> None:
    assert numbers(injector(*faults)) == expected


def test_only_the_named_message_is_affected() -> None:
    assert numbers(injector(fault("drop", message=MOTION.name)), CONDITIONS.id) == [[cycle] for cycle in range(8)]
    command = Frame(COMMAND.id, bytes(8))
    for faulty, cycle, arrives in (
        (fault("drop"), 2, True),
        (fault("drop", message=COMMAND.name), 2, False),
        (fault("bus-down"), 3, False),
        (fault("bus-down"), 5, True),
    ):
        assert injector(faulty).incoming(cycle, [command]) == [command] * arrives
    assert injector(fault("drop", message=COMMAND.name)).outgoing(2, frames(2)) == frames(2)


def test_corrupt_flips_one_bit_and_a_frozen_counter_repeats() -> None:
    for frame, right in zip(injector(fault("corrupt")).outgoing(2, frames(2)), frames(2), strict=True):
        assert (int.from_bytes(frame.data) ^ int.from_bytes(right.data)).bit_count() == 1
    faulty = injector(fault("freeze-counter", 15))
    sent = [faulty.outgoing(cycle, frames(cycle))[0].data for cycle in range(19)]
    assert [data[1] & 0xF for data in sent[14:]] == [14] * 4 + [3]
    assert all(data == protect(MOTION.e2e_data_id, data[1] & 0xF, data) for data in sent)


def test_values() -> None:
    stuck = injector(fault("stuck-value", message=MOTION.name, signal="yaw_rate"))
    seen = [stuck.signals(cycle, MOTION.name, {**VALUES, "yaw_rate": 0.1 * cycle})["yaw_rate"] for cycle in range(7)]
    assert seen == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.2, 0.5, 0.6])
    infinite = fault("infinity", signal="speed")
    for faulty, cycle, speed in (
        (fault("not-a-number", signal="speed"), 2, math.nan),
        (infinite, 4, math.inf),
        (infinite, 5, 10.0),
        (fault("infinity", message=CONDITIONS.name), 2, 10.0),
    ):
        assert injector(faulty).signals(cycle, MOTION.name, VALUES) == pytest.approx({**VALUES, "speed": speed}, nan_ok=True)


def test_foreign_traffic_exactly_fills_the_bus() -> None:
    group = injector(fault("foreign-traffic")).outgoing(2, frames(2))
    own = {MOTION.id, CONDITIONS.id, COMMAND.id}
    assert [frame for frame in group if frame.id in own and not frame.extended] == frames(2)
    room = PERIOD * CAN.bitrate_kbit_s * 1e3 / FRAME_BITS_MAX
    assert room - 1 < len(group) + 1 <= room  # plus one: the command
    assert any(frame.extended for frame in group)
    assert any(frame.remote for frame in group)
    assert {frame.id < MOTION.id for frame in group if not frame.extended} == {True, False}
    assert injector(fault("bus-down"), fault("foreign-traffic")).outgoing(3, frames(3)) == []


@pytest.mark.parametrize(
    ("kind", "more", "words"),
    [
        ("drop", {"message": "VehicleMoton"}, "did you mean 'VehicleMotion'"),
        ("stuck-value", {"message": "VehicleConditions", "signal": "speed"}, "names the unknown signal 'speed'"),
        ("bus-down", {"message": "VehicleMotion"}, "takes no message"),
        ("not-a-number", {"message": "RearSteerCommand", "signal": "rear_angle"}, "is the controller's"),
        ("delay", {}, "delay of 0 cycles"),
    ],
)
def test_a_fault_that_cannot_be_injected(kind: FaultKind, more: dict[str, str], words: str) -> None:
    with pytest.raises(CodegenError, match=words):
        injector(fault(kind, **more))


@pytest.mark.parametrize("name", CASES)
def test_each_fault_ends_as_defined(software: Software, name: str) -> None:
    result = run_through_can(software, scenario(CASES[name]))
    assert judge(CASES[name], result, software.config).violations == ()
    assert np.isfinite(column(result.record, "rear_angle_command_rad")).all()


@pytest.mark.parametrize(
    "name", ["drop-3", "drop-4", "corrupt-3", "freeze-3", "freeze-50", "reorder", "burst", "delay-2", "ecu"]
)
def test_faults_end_as_defined_with_a_constant_window_of_the_counter(name: str) -> None:
    """Profile 5, in frames of 64 bytes. Its receiver does not synchronise the counter."""
    other = frame_kinds.built("FD, 64 bytes, profile 5").software
    cases = {case.name: case for case in catalogue(other.config.can, PERIOD)}
    assert judge(cases[name], run_through_can(other, scenario(cases[name])), other.config).violations == ()


def test_every_kind_is_covered_and_messages_are_those_of_the_configuration() -> None:
    assert {fault.kind for case in CASES.values() for fault in case.faults} == set(typing.get_args(FaultKind))
    motion = CAN.vehicle_motion.model_copy(update={"name": "Drive", "id": 0x55})
    can = CAN.model_copy(update={"vehicle_motion": motion})
    named = {fault.message for case in catalogue(can, PERIOD) for fault in case.faults}
    assert "Drive" in named and "VehicleMotion" not in named


@pytest.fixture(scope="module")
def loss(software: Software) -> BenchResult:
    return run_through_can(software, scenario(CASES["drop-50"]))


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("rear_angle_command_rad", lambda values: 3.0 * values, ["beyond 3.5 deg"]),
        ("rear_angle_rad", lambda values: 20.0 * values, ["faster than 30 deg/s"]),
        # Like a recovery that starts from another angle.
        ("rear_angle_command_rad", lambda values: np.where(np.arange(len(values)) == 200, -0.02, values), ["deg at once"]),
        (
            "status",
            lambda values: np.minimum(values, Status.DEGRADED),
            ["reached DEGRADED, defined is FAIL_SAFE", "fail-safe later than 0.05 s"],
        ),
        ("status", lambda values: np.where(np.arange(len(values)) > 60, 4.0, values), ["no recovery"]),
    ],
)
def test_a_violation_is_found(
    loss: BenchResult, name: str, change: Callable[[np.ndarray], np.ndarray], words: list[str]
) -> None:
    record = loss.record.copy()
    index = RECORD_COLUMNS.index(name)
    record[:, index] = change(record[:, index])
    found = "; ".join(judge(CASES["drop-50"], replace(loss, record=record), builds.CONFIG).violations)
    assert all(word in found for word in words)

"""Faults on the bus: the injector's effect on frames and values, and the defined end of every fault."""

from __future__ import annotations

import math
import typing
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from codegen.can_sections import Can
from codegen.config import Config
from codegen.errors import CodegenError
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from hil_sim import fault_catalogue
from hil_sim.bench import BenchResult
from hil_sim.e2e import E2eStatus, Receiver, protect
from hil_sim.fault_catalogue import catalogue, judge, run_all, scenario
from hil_sim.faults import FRAME_BITS_MAX, Fault, FaultKind, Injector
from hil_sim.frames import Frame
from hil_sim.runs import run_through_can
from tests import builds

CAN = Can()
MOTION, CONDITIONS, COMMAND = CAN.vehicle_motion, CAN.vehicle_conditions, CAN.rear_steer_command
PERIOD = 0.01
CASES = catalogue(CAN, PERIOD)


def injector(kind: FaultKind, start: int = 2, count: int = 3, **more: object) -> Injector:
    """One fault from cycle `start` on, for `count` cycles."""
    fault = Fault(kind, start * PERIOD, count * PERIOD, **more)  # type: ignore[arg-type]
    return Injector([fault], CAN, PERIOD, seed=1)


def frames(cycle: int) -> list[Frame]:
    """Frames of the car in a cycle: the number of the cycle is in the last byte."""
    data = bytes([0] * 7 + [cycle])
    return [Frame(message.id, protect(message.e2e_data_id, cycle % 15, data)) for message in (MOTION, CONDITIONS)]


def sent(faulty: Injector, cycles: int = 12) -> list[list[Frame]]:
    return [faulty.outgoing(cycle, frames(cycle)) for cycle in range(cycles)]


def numbers(faulty: Injector, message: int = MOTION.id, cycles: int = 8) -> list[list[int]]:
    """Cycle numbers of the frames of one message, by the cycle in which they were sent."""
    return [[frame.data[7] for frame in cycle if frame.id == message] for cycle in sent(faulty, cycles)]


class TestInjector:
    def test_without_a_fault_nothing_changes(self) -> None:
        plain = Injector([], CAN, PERIOD)
        for cycle in range(3):
            assert plain.outgoing(cycle, frames(cycle)) == frames(cycle)
            assert plain.signals(cycle, MOTION.name, {"speed": 1.0}) == {"speed": 1.0}

    @pytest.mark.parametrize(
        ("faulty", "expected"),
        [
            (injector("drop"), [[0], [1], [], [], [], [5], [6], [7]]),
            # In the order in which they fall due, the older first.
            (injector("delay", cycles=4), [[0], [1], [], [], [], [5], [2, 6], [3, 7]]),
            (injector("duplicate"), [[0], [1], [2, 2], [3, 3], [4, 4], [5], [6], [7]]),
            # A frame comes after its successor; none is lost when the fault ends in between.
            (injector("reorder"), [[0], [1], [], [3, 2], [], [5, 4], [6], [7]]),
            (injector("reorder", count=4), [[0], [1], [], [3, 2], [], [5, 4], [6], [7]]),
            # A dropped frame does not come back in another order.
            (
                Injector([Fault("drop", 0.02, 0.03), Fault("reorder", 0.0, 0.1)], CAN, PERIOD),
                [[], [1, 0], [], [], [], [], [6, 5], []],
            ),
            (injector("bus-down"), [[0], [1], [], [], [], [5], [6], [7]]),
            # A bus that is down carries no strangers and keeps no delayed frame.
            (
                Injector([Fault("bus-down", 0.02, 0.03), Fault("delay", 0.0, 0.02, cycles=3)], CAN, PERIOD),
                [[], [], [], [], [], [5], [6], [7]],
            ),
        ],
    )
    def test_order_of_frames(self, faulty: Injector, expected: list[list[int]]) -> None:
        assert numbers(faulty) == expected

    def test_only_the_named_message_is_affected(self) -> None:
        assert numbers(injector("drop", message=MOTION.name), CONDITIONS.id) == [[cycle] for cycle in range(8)]
        command = Frame(COMMAND.id, bytes(8))
        assert injector("drop").incoming(2, [command]) == [command]
        assert injector("drop", message=COMMAND.name).incoming(2, [command]) == []
        assert injector("drop", message=COMMAND.name).outgoing(2, frames(2)) == frames(2)
        assert injector("bus-down").incoming(3, [command]) == []
        assert injector("bus-down").incoming(5, [command]) == [command]

    def test_delayed_frames_that_are_equal_are_all_sent(self) -> None:
        """Counters come round after 15 cycles, so frames with unchanging data are equal; each is due in its own cycle."""
        faulty = injector("delay", start=0, count=40, cycles=20)
        counts = []
        for cycle in range(60):
            frame = Frame(MOTION.id, protect(MOTION.e2e_data_id, cycle % 15, bytes(8)))
            counts.append(len(faulty.outgoing(cycle, [frame])))
        assert counts == [0] * 20 + [1] * 20 + [2] * 20

    def test_corrupt_flips_one_bit_of_each(self) -> None:
        for cycle, group in enumerate(sent(injector("corrupt"))):
            for frame, right in zip(group, frames(cycle), strict=True):
                flipped = int.from_bytes(frame.data) ^ int.from_bytes(right.data)
                assert flipped.bit_count() == (1 if cycle in (2, 3, 4) else 0)

    def test_a_frozen_counter_is_that_of_the_frame_before_under_a_right_crc(self) -> None:
        receiver = Receiver(CAN.e2e)
        checks = [receiver.check(MOTION.e2e_data_id, group[0].data) for group in sent(injector("freeze-counter"))]
        assert checks[:6] == [E2eStatus.INITIAL, E2eStatus.OK, *[E2eStatus.REPEATED] * 3, E2eStatus.OK_SOME_LOST]
        across_the_wrap = [group[0].data[1] & 0xF for group in sent(injector("freeze-counter", start=15), 20)]
        assert across_the_wrap[15:18] == [14] * 3

    def test_values(self) -> None:
        values = {"speed": 10.0, "front_angle": 0.1, "yaw_rate": 0.2}
        stuck = injector("stuck-value", message=MOTION.name, signal="yaw_rate")
        seen = [stuck.signals(cycle, MOTION.name, {**values, "yaw_rate": 0.1 * cycle})["yaw_rate"] for cycle in range(7)]
        assert seen == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.2, 0.5, 0.6])
        assert math.isnan(injector("not-a-number", signal="speed").signals(2, MOTION.name, values)["speed"])
        assert injector("infinity", signal="speed").signals(4, MOTION.name, values) == {**values, "speed": math.inf}
        assert injector("infinity", signal="speed").signals(5, MOTION.name, values) == values
        assert injector("infinity", message=CONDITIONS.name).signals(2, MOTION.name, values) == values

    def test_foreign_traffic_fills_the_bus_and_no_more(self) -> None:
        group = sent(injector("foreign-traffic"))[2]
        own = {MOTION.id, CONDITIONS.id, COMMAND.id}
        assert [frame for frame in group if frame.id in own and not frame.extended] == frames(2)
        room = PERIOD * CAN.bitrate_kbit_s * 1e3 / FRAME_BITS_MAX
        assert room - 1 < len(group) + 1 <= room  # one more is the command
        assert any(frame.extended for frame in group)
        assert any(frame.remote for frame in group)
        assert {frame.id < MOTION.id for frame in group if not frame.extended} == {True, False}
        down = [Fault("bus-down", 0.02, 0.03), Fault("foreign-traffic", 0.0, 1.0)]
        assert Injector(down, CAN, PERIOD).outgoing(3, frames(3)) == []

    @pytest.mark.parametrize(
        ("fault", "words"),
        [
            (Fault("drop", 0.0, 1.0, message="VehicleMoton"), "did you mean 'VehicleMotion'"),
            (Fault("stuck-value", 0.0, 1.0, message="VehicleMotion", signal="yawrate"), "did you mean 'yaw_rate'"),
            (Fault("stuck-value", 0.0, 1.0, message="VehicleConditions", signal="speed"), "names the signal 'speed'"),
            (Fault("bus-down", 0.0, 1.0, message="VehicleMotion"), "takes no message"),
            (Fault("drop", 0.0, 1.0, message="VehicleMotion", signal="speed"), "takes no signal"),
            (Fault("not-a-number", 0.0, 1.0, message="RearSteerCommand", signal="rear_angle"), "is the controller's"),
            (Fault("delay", 0.0, 1.0), "delay of 0 cycles"),
        ],
    )
    def test_a_fault_that_cannot_be_injected(self, fault: Fault, words: str) -> None:
        with pytest.raises(CodegenError, match=words):
            Injector([fault], CAN, PERIOD)


class TestCatalogue:
    """The generated task, in process: the same in every run."""

    @pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
    def test_each_fault_ends_as_defined(self, software: Software, case: fault_catalogue.FaultCase) -> None:
        result = run_through_can(software, scenario(case))
        assert judge(case, result, software.config).violations == ()
        commands = result.record[:, RECORD_COLUMNS.index("rear_angle_command_rad")]
        assert np.isfinite(commands).all()

    def test_every_kind_is_covered(self) -> None:
        assert {fault.kind for case in CASES for fault in case.faults} == set(typing.get_args(FaultKind))
        assert len({case.name for case in CASES}) == len(CASES)

    @pytest.mark.parametrize("seed", range(2))
    def test_many_faults_at_once(self, software: Software, seed: int) -> None:
        """Random faults on top of each other: the rear angle stays within bounds and rate, and control comes back."""
        draw = np.random.default_rng(seed)
        kinds = [kind for kind in typing.get_args(FaultKind) if kind != "foreign-traffic"]
        faults = tuple(
            Fault(
                draw.choice(kinds),
                float(draw.uniform(0.3, 1.5)),
                float(draw.uniform(0.01, 0.4)),
                cycles=int(draw.integers(1, 8)),
            )
            for _ in range(8)
        )
        result = run_through_can(software, replace(scenario(CASES[0]), faults=faults), seed=seed)
        rear = result.record[:, RECORD_COLUMNS.index("rear_angle_rad")]
        assert np.abs(rear).max() <= software.config.rear_actuator.angle_max + COMMAND.rear_angle.factor
        assert np.abs(np.diff(rear)).max() <= math.radians(software.config.rear_actuator.rate_max_deg_s) * PERIOD * (1 + 1e-9)
        assert result.record[-1, RECORD_COLUMNS.index("status")] <= Status.LIMITED

    def test_messages_are_those_of_the_configuration(self) -> None:
        motion = CAN.vehicle_motion.model_copy(update={"name": "Drive", "id": 0x55})
        config = Config(can=CAN.model_copy(update={"vehicle_motion": motion}))
        named = {fault.message for case in catalogue(config.can, PERIOD) for fault in case.faults}
        assert "Drive" in named
        assert "VehicleMotion" not in named


LOSS = next(case for case in CASES if case.name == "drop-50")


@pytest.fixture(scope="module")
def loss(software: Software) -> BenchResult:
    return run_through_can(software, scenario(LOSS))


class TestJudge:
    """Results that violate the definition, one way each."""

    @pytest.mark.parametrize(
        ("column", "change", "words"),
        [
            ("rear_angle_command_rad", lambda values: 1.01 * values, ["beyond 3.5 deg"]),
            ("rear_angle_rad", lambda values: 4.0 * values, ["faster than 30 deg/s"]),
            # As at a recovery that starts from another angle.
            ("rear_angle_command_rad", lambda values: np.where(np.arange(len(values)) == 101, 0.02, values), ["deg at once"]),
            (
                "status",
                lambda values: np.minimum(values, Status.DEGRADED),
                ["reached DEGRADED, defined is FAIL_SAFE", "fail-safe later than 0.05 s"],
            ),
            ("status", lambda values: np.where(np.arange(len(values)) > 60, 4.0, values), ["no recovery"]),
        ],
    )
    def test_a_violation_is_found(
        self, loss: BenchResult, column: str, change: Callable[[np.ndarray], np.ndarray], words: list[str]
    ) -> None:
        record = loss.record.copy()
        index = RECORD_COLUMNS.index(column)
        record[:, index] = change(record[:, index])
        found = "; ".join(judge(LOSS, replace(loss, record=record), builds.CONFIG).violations)
        assert all(word in found for word in words)

    def test_a_controller_that_holds_for_too_long(self, software: Software, monkeypatch: pytest.MonkeyPatch) -> None:
        """Six lost samples are tolerated where three are defined: in the C's own parameters."""
        tolerant = replace(software)
        original = software.parameters
        object.__setattr__(tolerant, "parameters", lambda **changes: original(degraded_samples_max=6, **changes))
        names = ("drop-3", "drop-4", "corrupt-50")
        chosen = tuple(case for case in CASES if case.name in names)
        assert len(chosen) == len(names)
        monkeypatch.setattr(fault_catalogue, "catalogue", lambda *_: chosen)
        steps: list[tuple[int, int]] = []
        outcomes = run_all(software.config, lambda run: run_through_can(tolerant, run), lambda *step: steps.append(step))
        assert [outcome.case.name for outcome in outcomes if outcome.violations] == ["drop-4", "corrupt-50"]
        assert steps == [(1, 3), (2, 3), (3, 3)]

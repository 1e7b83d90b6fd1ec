"""Faults on the bus: what the injector does to frames and values, and that every fault ends in its defined state."""

from __future__ import annotations

import math
import typing
from dataclasses import replace

import numpy as np
import pytest

from codegen.can_sections import Can
from codegen.config import Config
from codegen.errors import CodegenError
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from hil_sim import fault_catalogue
from hil_sim.e2e import E2eStatus, Receiver, protect
from hil_sim.fault_catalogue import catalogue, judge, run_all, scenario
from hil_sim.faults import FRAME_BITS_MAX, Fault, FaultKind, Injector
from hil_sim.frames import Frame
from hil_sim.runs import run_through_can

CAN = Can()
MOTION, CONDITIONS, COMMAND = CAN.vehicle_motion, CAN.vehicle_conditions, CAN.rear_steer_command
PERIOD = 0.01


def injector(kind: FaultKind, start: int = 2, count: int = 3, **more: object) -> Injector:
    """One fault from cycle `start` on, for `count` cycles."""
    fault = Fault(kind, start * PERIOD, count * PERIOD, **more)  # type: ignore[arg-type]
    return Injector([fault], CAN, PERIOD, seed=1)


def frames(cycle: int) -> list[Frame]:
    """What the car sends in a cycle: the number of the cycle is in the last byte."""
    made = []
    for message in (MOTION, CONDITIONS):
        made.append(Frame(message.id, protect(message.e2e_data_id, cycle % 15, bytes([0] * 7 + [cycle]))))
    return made


def sent(kind: FaultKind, cycles: int = 12, **more: object) -> list[list[Frame]]:
    faulty = injector(kind, **more)
    return [faulty.outgoing(cycle, frames(cycle)) for cycle in range(cycles)]


def numbers(cycles: list[list[Frame]], message: int = MOTION.id) -> list[list[int]]:
    """Cycle numbers of the frames of one message, by the cycle in which they were sent."""
    return [[frame.data[7] for frame in cycle if frame.id == message] for cycle in cycles]


class TestInjector:
    def test_without_a_fault_nothing_changes(self) -> None:
        plain = Injector([], CAN, PERIOD)
        for cycle in range(20):
            assert plain.outgoing(cycle, frames(cycle)) == frames(cycle)
            assert plain.signals(cycle, MOTION.name, {"speed": 1.0}) == {"speed": 1.0}

    def test_drop(self) -> None:
        assert numbers(sent("drop"), MOTION.id) == [[0], [1], [], [], [], [5], [6], [7], [8], [9], [10], [11]]
        assert numbers(sent("drop", message=MOTION.name), CONDITIONS.id) == [[cycle] for cycle in range(12)]

    def test_delay(self) -> None:
        """In the order in which they fall due, the older first."""
        faulty = Injector([Fault("delay", 0.02, 0.03, cycles=4)], CAN, PERIOD)
        late = numbers([faulty.outgoing(cycle, frames(cycle)) for cycle in range(12)])
        assert late == [[0], [1], [], [], [], [5], [2, 6], [3, 7], [4, 8], [9], [10], [11]]

    def test_delayed_frames_that_are_equal_are_all_sent(self) -> None:
        """Counters come round after 15 cycles, so frames with unchanging data are equal; each is due in its own cycle."""
        faulty = injector("delay", start=0, count=40, cycles=20)
        counts = []
        for cycle in range(60):
            frame = Frame(MOTION.id, protect(MOTION.e2e_data_id, cycle % 15, bytes(8)))
            counts.append(len(faulty.outgoing(cycle, [frame])))
        assert counts == [0] * 20 + [1] * 20 + [2] * 20

    def test_what_is_dropped_does_not_come_back_in_another_order(self) -> None:
        faulty = Injector([Fault("drop", 0.02, 0.03), Fault("reorder", 0.0, 0.1)], CAN, PERIOD)
        assert numbers([faulty.outgoing(cycle, frames(cycle)) for cycle in range(8)]) == [
            [],
            [1, 0],
            [],
            [],
            [],
            [],
            [6, 5],
            [],
        ]

    def test_duplicate(self) -> None:
        assert numbers(sent("duplicate"))[1:6] == [[1], [2, 2], [3, 3], [4, 4], [5]]

    def test_reorder(self) -> None:
        """A frame comes after its successor; none is lost when the fault ends in between."""
        assert numbers(sent("reorder", count=4))[1:8] == [[1], [], [3, 2], [], [5, 4], [6], [7]]
        assert numbers(sent("reorder", count=3))[1:8] == [[1], [], [3, 2], [], [5, 4], [6], [7]]

    def test_corrupt_flips_one_bit_of_each(self) -> None:
        for cycle, group in enumerate(sent("corrupt")):
            for frame, right in zip(group, frames(cycle), strict=True):
                flipped = int.from_bytes(frame.data) ^ int.from_bytes(right.data)
                assert flipped.bit_count() == (1 if cycle in (2, 3, 4) else 0)

    def test_a_frozen_counter_is_that_of_the_frame_before_under_a_right_crc(self) -> None:
        receiver = Receiver(CAN.e2e)
        checks = [receiver.check(MOTION.e2e_data_id, group[0].data) for group in sent("freeze-counter")]
        assert checks[:6] == [E2eStatus.INITIAL, E2eStatus.OK, *[E2eStatus.REPEATED] * 3, E2eStatus.OK_SOME_LOST]

    @pytest.mark.parametrize("start", range(14, 17))
    def test_a_counter_freezes_across_its_wrap(self, start: int) -> None:
        faulty = injector("freeze-counter", start=start)
        counters = [faulty.outgoing(cycle, frames(cycle))[0].data[1] & 0xF for cycle in range(20)]
        assert counters[start : start + 3] == [(start - 1) % 15] * 3

    def test_nothing_gets_through_a_bus_that_is_down(self) -> None:
        faulty = injector("bus-down")
        assert [bool(faulty.outgoing(cycle, frames(cycle))) for cycle in range(7)] == [
            True,
            True,
            False,
            False,
            False,
            True,
            True,
        ]
        assert faulty.incoming(3, [Frame(COMMAND.id, bytes(8))]) == []
        assert faulty.incoming(5, [Frame(COMMAND.id, bytes(8))]) != []

    def test_a_bus_that_is_down_carries_no_strangers_and_keeps_no_delayed_frame(self) -> None:
        down = Fault("bus-down", 0.02, 0.03)
        assert Injector([down, Fault("foreign-traffic", 0.0, 1.0)], CAN, PERIOD).outgoing(3, frames(3)) == []
        late = Injector([down, Fault("delay", 0.0, 0.02, cycles=3)], CAN, PERIOD)
        assert numbers([late.outgoing(cycle, frames(cycle)) for cycle in range(7)]) == [[], [], [], [], [], [5], [6]]

    def test_commands_are_touched_only_where_named(self) -> None:
        command = Frame(COMMAND.id, bytes(8))
        assert injector("drop").incoming(2, [command]) == [command]
        assert injector("drop", message=COMMAND.name).incoming(2, [command]) == []
        assert injector("drop", message=COMMAND.name).outgoing(2, frames(2)) == frames(2)

    def test_values(self) -> None:
        values = {"speed": 10.0, "front_angle": 0.1, "yaw_rate": 0.2}
        stuck = injector("stuck-value", message=MOTION.name, signal="yaw_rate")
        seen = [stuck.signals(cycle, MOTION.name, {**values, "yaw_rate": 0.1 * cycle})["yaw_rate"] for cycle in range(7)]
        assert seen == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.2, 0.5, 0.6])
        assert math.isnan(injector("not-a-number", signal="speed").signals(2, MOTION.name, values)["speed"])
        assert injector("infinity", signal="speed").signals(4, MOTION.name, values) == {**values, "speed": math.inf}
        assert injector("infinity", signal="speed").signals(5, MOTION.name, values) == values
        assert injector("infinity", message=CONDITIONS.name).signals(2, MOTION.name, values) == values

    def test_strangers_fill_the_bus_and_no_more(self) -> None:
        group = sent("foreign-traffic")[2]
        own = {MOTION.id, CONDITIONS.id, COMMAND.id}
        ours = [frame for frame in group if frame.id in own and not frame.extended]
        assert ours == frames(2)
        room = PERIOD * CAN.bitrate_kbit_s * 1e3 / FRAME_BITS_MAX
        assert room - 1 < len(group) + 1 <= room  # one more is the command
        assert any(frame.extended for frame in group)
        assert any(frame.remote for frame in group)
        assert {frame.id < MOTION.id for frame in group if not frame.extended} == {True, False}

    @pytest.mark.parametrize(
        ("fault", "words"),
        [
            (Fault("drop", 0.0, 1.0, message="VehicleMoton"), "did you mean 'VehicleMotion'?"),
            (Fault("stuck-value", 0.0, 1.0, message="VehicleMotion", signal="yawrate"), "did you mean 'yaw_rate'?"),
            (Fault("stuck-value", 0.0, 1.0, message="VehicleConditions", signal="speed"), "names the signal 'speed'"),
        ],
    )
    def test_names_that_there_are_not(self, fault: Fault, words: str) -> None:
        with pytest.raises(CodegenError, match="a fault names the") as caught:
            Injector([fault], CAN, PERIOD)
        assert words in str(caught.value)

    @pytest.mark.parametrize(
        ("fault", "words"),
        [
            (Fault("bus-down", 0.0, 1.0, message="VehicleMotion"), "takes no message"),
            (Fault("foreign-traffic", 0.0, 1.0, message="VehicleMotion"), "takes no message"),
            (Fault("drop", 0.0, 1.0, message="VehicleMotion", signal="speed"), "takes no signal"),
            (Fault("not-a-number", 0.0, 1.0, message="RearSteerCommand", signal="rear_angle"), "is the controller's"),
            (Fault("delay", 0.0, 1.0), "delay of 0 cycles"),
        ],
    )
    def test_what_a_kind_does_not_take(self, fault: Fault, words: str) -> None:
        with pytest.raises(CodegenError, match=words):
            Injector([fault], CAN, PERIOD)


class TestEveryFaultEndsAsDefined:
    """The generated task, in process: the same in every run."""

    CASES = catalogue(CAN, PERIOD)

    @pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
    def test_it(self, software: Software, case: fault_catalogue.FaultCase) -> None:
        outcome = judge(case, run_through_can(software, scenario(case)), software.config)
        assert outcome.violations == ()

    def test_every_kind_is_tried(self) -> None:
        kinds = {fault.kind for case in self.CASES for fault in case.faults}
        assert kinds == set(typing.get_args(FaultKind))
        assert len({case.name for case in self.CASES}) == len(self.CASES)

    def test_the_command_stays_finite_and_within_bounds_in_every_sample(self, software: Software) -> None:
        limit = software.config.rear_actuator.angle_max + COMMAND.rear_angle.factor
        for case in self.CASES:
            record = run_through_can(software, scenario(case)).record
            commands = record[:, RECORD_COLUMNS.index("rear_angle_command_rad")]
            assert np.isfinite(commands).all(), case.name
            assert np.abs(commands).max() <= limit, case.name

    @pytest.mark.parametrize("seed", range(8))
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
        result = run_through_can(software, replace(scenario(self.CASES[0]), faults=faults), seed=seed)
        rear = result.record[:, RECORD_COLUMNS.index("rear_angle_rad")]
        assert np.abs(rear).max() <= software.config.rear_actuator.angle_max + COMMAND.rear_angle.factor
        assert np.abs(np.diff(rear)).max() <= math.radians(software.config.rear_actuator.rate_max_deg_s) * PERIOD * (1 + 1e-9)
        assert result.record[-1, RECORD_COLUMNS.index("status")] <= Status.LIMITED


class TestTheJudgeCanFail:
    """Results that are not as defined, one way each."""

    @pytest.fixture
    def case(self) -> fault_catalogue.FaultCase:
        return next(case for case in catalogue(CAN, PERIOD) if case.name == "drop-50")

    def violations(self, software: Software, case: fault_catalogue.FaultCase, column: str, change: typing.Any) -> str:
        result = run_through_can(software, scenario(case))
        record = result.record.copy()
        index = RECORD_COLUMNS.index(column)
        record[:, index] = change(record[:, index])
        return "; ".join(judge(case, replace(result, record=record), software.config).violations)

    def test_an_angle_beyond_its_limit(self, software: Software, case: fault_catalogue.FaultCase) -> None:
        assert "beyond 3.5 deg" in self.violations(software, case, "rear_angle_command_rad", lambda values: 1.01 * values)

    def test_a_rate_beyond_its_limit(self, software: Software, case: fault_catalogue.FaultCase) -> None:
        assert "faster than 30 deg/s" in self.violations(software, case, "rear_angle_rad", lambda values: values * 4.0)

    def test_a_command_that_jumps(self, software: Software, case: fault_catalogue.FaultCase) -> None:
        """As at a recovery that starts from another angle."""
        said = self.violations(
            software, case, "rear_angle_command_rad", lambda values: np.where(np.arange(len(values)) == 101, 0.02, values)
        )
        assert "deg at once" in said

    def test_a_fail_safe_that_never_comes(self, software: Software, case: fault_catalogue.FaultCase) -> None:
        said = self.violations(software, case, "status", lambda values: np.minimum(values, Status.DEGRADED))
        assert "reached DEGRADED, defined is FAIL_SAFE" in said
        assert "fail-safe later than 0.05 s" in said

    def test_no_recovery(self, software: Software, case: fault_catalogue.FaultCase) -> None:
        values = self.violations(software, case, "status", lambda values: np.where(np.arange(len(values)) > 60, 4.0, values))
        assert "no recovery" in values

    def test_a_controller_that_holds_for_too_long(self, software: Software) -> None:
        """Six lost samples are tolerated where three are defined: in the C's own parameters."""
        tolerant = replace(software)
        original = software.parameters
        object.__setattr__(tolerant, "parameters", lambda **changes: original(degraded_samples_max=6, **changes))
        names = [
            outcome.case.name
            for outcome in run_all(software.config, lambda run: run_through_can(tolerant, run))
            if outcome.violations
        ]
        assert {"drop-4", "drop-50", "corrupt-50"} <= set(names)


def test_a_configuration_of_other_names_is_followed() -> None:
    motion = CAN.vehicle_motion.model_copy(update={"name": "Drive", "id": 0x55})
    config = Config(can=CAN.model_copy(update={"vehicle_motion": motion}))
    named = {fault.message for case in catalogue(config.can, PERIOD) for fault in case.faults}
    assert "Drive" in named
    assert "VehicleMotion" not in named

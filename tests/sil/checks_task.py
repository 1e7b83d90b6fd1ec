"""What the generated cyclic task promises, beside what `answers_task` compares: a gap is held, and control starts from an angle
that is known. Each check takes a build of any kind and raises AssertionError if the build fails it."""

import math
from typing import Any

from codegen.emit.can_view import DIAGNOSTICS
from codegen.sil.software import Status
from hil_sim.codec import Codec, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.e2e import next_counter, protect
from tests.builds import Built

BIT = {cause.name: 1 << cause.bit for cause in DIAGNOSTICS}
RUNNING = (Status.TRACKING, Status.LIMITED)
START_TOLERANCE = 0.01 + 5e-5
"""Largest distance of a first command from the achieved angle: one sample of the integral, one step of the frame; rad."""


class Car:
    """The other side of the bus: it sends frames to a new task and reads the answers, as the bench does."""

    def __init__(self, built: Built, **parameters: Any) -> None:
        software = built.software
        self.task, self.can = software.task(software.parameters(**parameters)), software.config.can
        self.codec, self.counter = Codec(self.can, software.precision), 0

    def cycle(self, rear_angle: float = 0.0, lost: str = "") -> RearSteerCommand:
        """Send both messages, or one, or none; run the task once and decode its frame."""
        sent = {"motion": (self.can.vehicle_motion, VehicleMotion(15.0, 0.03, 0.05)),
                "conditions": (self.can.vehicle_conditions, VehicleConditions(rear_angle, math.nan, False))}  # fmt: skip
        for name, (message, signals) in sent.items():
            if lost not in (name, "both"):
                data = protect(message.e2e_data_id, self.counter, self.codec.encode(signals))
                self.task.on_can_frame(message.id, data)
        self.counter = next_counter(self.counter)
        command = self.codec.decode(*self.task.run())
        assert isinstance(command, RearSteerCommand)
        return command


def check_task_gap(built: Built) -> None:
    """A short gap is held, one sample more is the fail-safe with TIMEOUT; each cause has its bit. After a long one the counter
    proves itself, then the recovery counts."""
    parameters = built.software.parameters()
    held, needed = parameters.degraded_samples_max, parameters.recovery_samples
    causes = {"motion": {"MOTION_MISSING"}, "conditions": {"CONDITIONS_MISSING"},
              "both": {"MOTION_MISSING", "CONDITIONS_MISSING", "TASK_EARLY"}}  # fmt: skip
    for lost in causes:
        car = Car(built)
        before = [car.cycle() for _ in range(30)][-1]
        assert before.status in RUNNING
        for sample in range(1, 9):
            command, is_held = car.cycle(lost=lost), sample <= held
            assert command.status == (Status.DEGRADED if is_held else Status.FAIL_SAFE)
            assert not is_held or command.rear_angle == before.rear_angle
            names = {name for name, mask in BIT.items() if command.diagnostics & mask}
            assert names == causes[lost] | (set() if is_held else {"TIMEOUT"})
    statuses = [Status(car.cycle().status) for _ in range(needed + 6)]
    # One frame, and one more (max_no_new_or_repeated_data, sync_counter_init), then the good samples are counted; the last of
    # them ends the fail-safe.
    assert set(statuses[: needed + 1]) == {Status.FAIL_SAFE}
    assert statuses[needed + 1] in RUNNING


def check_task_start(built: Built) -> None:
    """Before the first good sample no angle is sent; control starts from the achieved angle, never from an impossible one, and
    without one from zero after as many samples in a row as a recovery takes."""
    for achieved in (-0.06, -0.02, 0.0, 0.035):
        car = Car(built)
        assert all(math.isnan(car.cycle(lost="both").rear_angle) for _ in range(7))
        assert abs(car.cycle(achieved).rear_angle - achieved) <= START_TOLERANCE
    for needed in (1, 3, 12):
        car = Car(built, recovery_samples=needed)
        for impossible in (0.3, -0.3, math.inf):
            assert all(math.isnan(car.cycle(math.nan).rear_angle) for _ in range(needed))
            assert math.isnan(car.cycle(impossible).rear_angle), "the count starts again"
        assert all(math.isnan(car.cycle(math.nan).rear_angle) for _ in range(needed))
        assert abs(car.cycle(math.nan).rear_angle) <= START_TOLERANCE

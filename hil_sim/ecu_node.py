"""The generated task as an ECU on any bus: the same C that goes into the car, called through cffi.

In real time a timer with absolute deadlines runs the task, half a period after the car's frames; in lock-step each complete set
of them does. Foreign frames, identifiers of another length, remote and error frames, and its own frames are ignored.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from codegen.sil.software import Software, Task
from hil_sim.bus import Bus
from hil_sim.codec import Frame, frame_of, is_configured

SILENCE_PERIODS = 4
"""Periods without a frame of the car after which the timer synchronises with the next complete set."""

SLIP_WEIGHT, SLIPPING_MAX = 10, 25
"""Weight of a run with no or two sets of frames, against one in phase; and the sum above which the phase is synchronised again.
The car's frames then arrive together with the timer."""

POLL = 0.05
"""Interval in s at which the node checks whether to stop, if there is no timer."""


@dataclass
class EcuCounters:
    """Counters of an ECU; late: runs of the timer that came a period or more after their deadline; discarded: frames that
    waited for too long."""

    cycles: int = 0
    late: int = 0
    discarded: int = 0
    send_errors: int = 0


class EcuNode:
    """One task on one bus."""

    def __init__(self, software: Software, bus: Bus) -> None:
        can = software.config.can
        self._can = can
        self._ids = (can.vehicle_motion.id, can.vehicle_conditions.id)
        self._period = software.config.controller.sampling_time_s
        self._tolerated = software.config.controller.fail_safe.degraded_samples_max + 1
        self._bus = bus
        self.task: Task = software.task()
        self.counters = EcuCounters()

    def run(self, lock_step: bool, stopped: Callable[[], bool]) -> None:
        """Serve until `stopped` returns true."""
        if lock_step:
            self._run_in_lock_step(stopped)
        else:
            self._run_in_real_time(stopped)

    def _run_in_lock_step(self, stopped: Callable[[], bool]) -> None:
        while not stopped():
            self._take(self._bus.receive(POLL))
            if self.task.is_complete:
                self._answer()

    def _run_in_real_time(self, stopped: Callable[[], bool]) -> None:
        now = time.monotonic()
        deadline, heard, in_phase = now + self._period, now, False
        slips, slipping = 0, 0
        while not stopped():
            frame = self._bus.receive(deadline - time.monotonic())
            now = time.monotonic()
            if now - deadline > self._tolerated * self._period:
                self._discard(frame)  # waiting frames are outdated, although consecutive
            elif self._take(frame):
                in_phase = in_phase and now - heard < SILENCE_PERIODS * self._period
                heard = now
                if not in_phase and self.task.is_complete:
                    deadline, in_phase = now + 0.5 * self._period, True
            if now < deadline or stopped():
                continue
            self._answer()
            deadline += self._period
            if now >= deadline:  # late by a period or more: continue in the same phase, without a burst to catch up
                self.counters.late += 1
                deadline += (math.floor((now - deadline) / self._period) + 1) * self._period
            found, slips = slips, self.task.state.late_cycles + self.task.state.early_cycles
            slipping = slipping + SLIP_WEIGHT if slips != found else max(slipping - 1, 0)
            if slipping > SLIPPING_MAX:
                in_phase, slipping = False, 0

    def _discard(self, frame: Frame | None) -> None:
        """Discard a frame and all that wait after it."""
        while frame is not None:
            self.counters.discarded += 1
            frame = self._bus.receive(0.0)

    def _take(self, frame: Frame | None) -> bool:
        """Pass a frame to the task. Return whether it was one of the car's."""
        if frame is None or not is_configured(self._can, frame) or frame.id not in self._ids:
            return False
        self.task.on_can_frame(frame.id, frame.data)
        return True

    def _answer(self) -> None:
        identifier, data = self.task.run()
        self.counters.cycles += 1
        if not self._bus.send(frame_of(self._can, identifier, data)):
            self.counters.send_errors += 1

"""Python interface of the generated cyclic task: frames in, one frame out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

COUNTERS = ("cycles", "late_cycles", "early_cycles", "lost_samples")
"""Public counters of a task."""


class Task:
    """One `<prefix>_task_t` with its functions. Instances are independent; do not share one between threads."""

    def __init__(self, ffi: Any, state: Any, parameters: Any, function: Callable[[str], Any], period_name: str) -> None:
        self.state = state
        self._parameters = parameters  # the C keeps a pointer to them
        self._on_can_frame, self._is_complete = function("task_on_can_frame"), function("task_is_complete")
        self._run = function(period_name)
        self._data = ffi.new("uint8_t[8]")
        self._buffer = ffi.buffer(self._data)
        function("task_init")(state, parameters)

    def on_can_frame(self, identifier: int, data: bytes) -> None:
        """Receive a classical data frame with an 11-bit identifier."""
        self._on_can_frame(self.state, identifier, data, len(data))

    @property
    def is_complete(self) -> bool:
        """Whether both messages of the car arrived since the last run."""
        return bool(self._is_complete(self.state))

    def run(self) -> tuple[int, bytes]:
        """Run one sample and return identifier and data of the frame to send."""
        return self._run(self.state, self._data), bytes(self._buffer)

    def counters(self) -> dict[str, int]:
        """Return the value of each counter in COUNTERS."""
        return {name: getattr(self.state, name) for name in COUNTERS}

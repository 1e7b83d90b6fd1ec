"""The Python face of the generated cyclic task: frames in, one frame out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

COUNTERS = ("cycles", "late_cycles", "early_cycles", "lost_samples")
"""Counters of a task, for its caller to read."""


class Task:
    """One `<prefix>_task_t` with its functions. Not shared between threads; any number may run side by side."""

    def __init__(self, ffi: Any, state: Any, parameters: Any, function: Callable[[str], Any], period_name: str) -> None:
        self.state = state
        self._parameters = parameters  # the C keeps a pointer to them
        self._on_can_frame, self._is_complete = function("task_on_can_frame"), function("task_is_complete")
        self._run = function(period_name)
        self._data = ffi.new("uint8_t[8]")
        self._buffer = ffi.buffer(self._data)
        function("task_init")(state, parameters)

    def on_can_frame(self, identifier: int, data: bytes) -> None:
        """A classical data frame with an 11-bit identifier came from the bus."""
        self._on_can_frame(self.state, identifier, data, len(data))

    @property
    def is_complete(self) -> bool:
        """Whether both messages of the car came since the last run."""
        return bool(self._is_complete(self.state))

    def run(self) -> tuple[int, bytes]:
        """One sample: identifier and data of the frame to send."""
        return self._run(self.state, self._data), bytes(self._buffer)

    def counters(self) -> dict[str, int]:
        """Name to count, see COUNTERS."""
        return {name: getattr(self.state, name) for name in COUNTERS}

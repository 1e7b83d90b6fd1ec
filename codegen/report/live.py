"""Live view of a bench run on a terminal: values, a short history, and errors.

`LiveView.update` only stores the sample. A thread of rich draws ten times a second, and releases the interpreter within half a
millisecond. By default Python lets a thread keep it for 5 ms, half a cycle of the controller.
"""

from __future__ import annotations

import sys
from collections import deque
from types import TracebackType
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from codegen.report.live_rows import History, LiveSample, LiveStyle, draw

__all__ = ["LiveSample", "LiveView"]

REDRAWS_PER_SECOND = 10
SWITCH_INTERVAL = 0.0005
"""Longest time in s that the drawing thread may keep others waiting."""


class LiveView:
    """The view; a context manager. Prints nothing if the console is quiet or not a terminal.

    After a run without an error the view disappears; after an error or Ctrl-C the last picture stays.
    """

    def __init__(self, title: str, bus: str, ecu: str, clock: str, console: Console | None = None) -> None:
        """
        Args:
            title: title of the scenario.
            bus, ecu, clock: "socketcan:vcan0", "native", "real time".
            console: None for standard error.
        """
        # FORCE_COLOR only affects colour; redrawing needs a terminal.
        self._console = Console(stderr=True, force_terminal=sys.stderr.isatty()) if console is None else console
        self._title, self._footer = title, f"{bus} · ECU {ecu} · {clock}"
        self._samples: deque[LiveSample] = deque()
        self._history = History()
        self._live: Live | None = None
        self._switch_interval = 0.0

    def update(self, sample: LiveSample) -> None:
        """Store a sample, from any thread. Another thread draws it."""
        if self._live is not None:
            self._samples.append(sample)

    def __enter__(self) -> Self:
        if self._console.is_terminal and not self._console.is_dumb_terminal and not self._console.quiet:
            self._live = Live(
                console=self._console, get_renderable=self.picture, refresh_per_second=REDRAWS_PER_SECOND, transient=True
            )
            self._switch_interval = sys.getswitchinterval()
            sys.setswitchinterval(min(SWITCH_INTERVAL, self._switch_interval))
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._live is not None:
            self._live.transient = kind is None
            self._live.stop()
            self._live = None
            sys.setswitchinterval(self._switch_interval)

    def picture(self) -> Panel:
        """Return the content of the screen for the size of the console."""
        while self._samples:
            self._history.add(self._samples.popleft())
        width, height = self._console.size
        options = LiveStyle(max(1, width - 4), height - 3, self._console.options.ascii_only, self._console.no_color)
        return Panel(
            Group(*draw(self._history, options)),
            title=Text(self._title),
            title_align="left",
            subtitle=Text(options.plain(self._footer)),
            subtitle_align="right",
        )

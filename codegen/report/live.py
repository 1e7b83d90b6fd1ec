"""Live view of a bench run on a terminal: progress, values and errors.

`LiveView.update` only stores the sample. A thread of rich draws ten times a second, and releases the interpreter within half a
millisecond. By default Python lets a thread keep it for 5 ms, half a cycle of the controller.
"""

from __future__ import annotations

import math
import sys
from collections import Counter, deque
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from codegen.errors import printable
from codegen.sil.software import Status
from hil_sim.codec import causes

MEASURED, COMMANDED = "cyan", "magenta"
STATUS_STYLES = {
    Status.TRACKING: "green",
    Status.LIMITED: "yellow",
    Status.STANDBY: "default",
    Status.DEGRADED: "bold bright_yellow",
    Status.FAIL_SAFE: "bold red",
}

LABELS, NUMBERS = 13, 8  # columns
FEWEST_COLUMNS = 12  # of the bar
RECENT = 1.0  # s


@dataclass(frozen=True)
class LiveSample:
    """A cycle of the bench, in SI units; NaN where not available.

    Attributes:
        time: of the run (s); simulated time in lock-step.
        duration: of the run (s); infinite or 0 where it has no end.
        yaw_rate, yaw_rate_reference: rad/s.
        sideslip: rad.
        rear_angle_command, rear_angle: rad, commanded and achieved.
        status: code of `Status`.
        diagnostics: bits of hil_sim.codec.
        cycle_time: duration of the last cycle (s).
        lost_frames, late_cycles: since the start.
    """

    time: float
    duration: float
    yaw_rate: float
    yaw_rate_reference: float
    sideslip: float
    rear_angle_command: float
    rear_angle: float
    status: int
    diagnostics: int
    cycle_time: float
    lost_frames: int
    late_cycles: int


@dataclass(frozen=True)
class LiveStyle:
    """Width of the terminal, and what it can display."""

    columns: int
    ascii_only: bool = False

    def plain(self, text: str) -> str:
        """Return the text, in ASCII if the terminal supports nothing else."""
        if not self.ascii_only:
            return text
        return text.translate({0x00B7: "|", 0x2501: "#", 0x2500: "-", 0x00D7: "x"}).encode("ascii", "replace").decode("ascii")


@dataclass
class History:
    """The run so far in a bounded amount of memory; `rear_rate` is in deg/s."""

    last: LiveSample | None = None
    cycles: int = 0
    rear_rate: float = math.nan
    cycle_times: deque[tuple[float, float]] = field(default_factory=deque)
    seen: Counter[str] = field(default_factory=Counter)
    seen_at: dict[str, float] = field(default_factory=dict)

    def add(self, sample: LiveSample) -> None:
        """Add a sample."""
        for cause in causes(sample.diagnostics):
            self.seen[cause] += 1
            self.seen_at[cause] = sample.time
        self.cycle_times.append((sample.time, sample.cycle_time))
        while self.cycle_times[0][0] <= sample.time - RECENT:
            self.cycle_times.popleft()
        if self.last is not None and sample.time > self.last.time:
            self.rear_rate = math.degrees(sample.rear_angle - self.last.rear_angle) / (sample.time - self.last.time)
        self.last = sample
        self.cycles += 1


def draw(history: History, options: LiveStyle) -> list[Text]:
    """Return the rows of the view, none wider than `options`."""
    rows = [Text("waiting for the first cycle")] if history.last is None else _draw(history, history.last, options)
    for row in rows:
        row.truncate(options.columns, overflow="crop" if options.ascii_only else "ellipsis")
    return rows


def _draw(history: History, last: LiveSample, options: LiveStyle) -> list[Text]:
    values = (
        ("Yaw rate", math.degrees(last.yaw_rate), "deg/s", MEASURED),
        ("reference", math.degrees(last.yaw_rate_reference), "deg/s", COMMANDED),
        ("Sideslip", math.degrees(last.sideslip), "deg", MEASURED),
        ("Rear angle", math.degrees(last.rear_angle), "deg", MEASURED),
        ("command", math.degrees(last.rear_angle_command), "deg", COMMANDED),
        ("rate", history.rear_rate, "deg/s", "default"),
    )
    rows = [_progress(history, last, options)]
    for label, value, unit, style in values:
        rows.append(Text.assemble((label.ljust(LABELS), style), _number(value).rjust(NUMBERS), f" {unit}"))
    rows.append(Text.assemble("Status".ljust(LABELS), _status(last.status)))
    return rows + _counters(history, last, options) + _diagnostics(history, last, options)


def _number(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "n/a"


def _progress(history: History, last: LiveSample, options: LiveStyle) -> Text:
    """Return the progress, with a bar if the run has an end."""
    bounded = 0.0 < last.duration < math.inf
    share = min(1.0, max(0.0, last.time / last.duration)) if bounded else 0.0
    told = f"{last.time:.2f} s of {last.duration:.2f} s  {math.floor(100 * share):3d} %" if bounded else f"{last.time:.2f} s"
    told += f"  cycle {history.cycles}"
    room = options.columns - len(told) - 2
    if not bounded or room < FEWEST_COLUMNS:
        return Text(told)
    done = round(share * room)
    row = Text(options.plain("━" * done), "green")
    row.append(("-" if options.ascii_only else "─") * (room - done), "dim")
    return row.append(f"  {told}", "default")


def _status(code: int) -> tuple[str, str]:
    """Return name and style of a status, known or not."""
    return (Status(code).name, STATUS_STYLES[Status(code)]) if code in set(Status) else (f"unknown ({code})", "bold red")


def _counters(history: History, last: LiveSample, options: LiveStyle) -> list[Text]:
    times = [1000.0 * value for _, value in history.cycle_times]
    least, mean, most = min(times), sum(times) / len(times), max(times)
    told = f"{least:8.2f} min · {mean:.2f} mean · {most:.2f} max ms"
    if LABELS + len(told) > options.columns:
        told = f"{least:.2f} / {mean:.2f} / {most:.2f} ms"
    counters = Text("Lost frames".ljust(LABELS))
    counters.append(f"{last.lost_frames:8d}", "bold red" if last.lost_frames else "default")
    counters.append("      late cycles ")
    counters.append(f"{last.late_cycles}", "bold yellow" if last.late_cycles else "default")
    return [Text("Cycle time".ljust(LABELS) + options.plain(told)), counters]


def _diagnostics(history: History, last: LiveSample, options: LiveStyle) -> list[Text]:
    """Return the causes of the last half second in one row, and earlier ones with their number of cycles in two rows."""
    now = [cause for cause, at in history.seen_at.items() if at > last.time - 0.5 * RECENT]
    before = [f"{cause} ×{history.seen[cause]}" for cause in history.seen if cause not in now]
    first: list[str] = []
    second = list(before)
    while second and LABELS + len(" · ".join([*first, second[0]])) <= options.columns:
        first.append(second.pop(0))
    rows = []
    for label, found, style in (("Diagnostics", now, "bold red"), ("  earlier", first, "dim"), ("", second, "dim")):
        row = Text(label.ljust(LABELS), no_wrap=True)
        rows.append(row.append(options.plain(" · ".join(found) or ("none" if label else "")), style if found else "dim"))
    return rows


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
        self._title, self._footer = printable(title), f"{bus} · ECU {ecu} · {clock}"
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
        options = LiveStyle(max(1, self._console.width - 4), self._console.options.ascii_only)
        return Panel(
            Group(*draw(self._history, options)),
            title=Text(self._title),
            title_align="left",
            subtitle=Text(options.plain(self._footer)),
            subtitle_align="right",
        )

"""Live view of a bench run on a terminal: values, a short history, and errors.

`LiveView.update` only stores the sample. A thread of rich draws ten times a second, and releases the interpreter within half a
millisecond. By default Python lets a thread keep it for 5 ms, half a cycle of the controller.
"""

from __future__ import annotations

import math
import sys
from collections import Counter, deque
from collections.abc import Sequence
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

BINS = 200
DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of U+2800 by row and column of a character (Unicode, block Braille Patterns)."""

STEPS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)

LONGEST = 30.0
"""Largest time range of a chart, in s; a longer run scrolls."""


@dataclass(frozen=True)
class Window:
    """Time range of a chart: `start` to `start + length` in s, in bins."""

    start: float
    length: float

    @staticmethod
    def of(time: float, duration: float) -> Window:
        """Return the whole range of a short run, or the last 30 s of a longer or endless one."""
        length = duration if 0.0 < duration <= LONGEST else LONGEST
        width = length / BINS
        return Window(max(0.0, (math.floor(time / width) + 1) * width - length), length)


@dataclass
class Trace:
    """A signal over time: bin number -> (least, greatest); NaN leaves a gap."""

    bins: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, time: float, value: float, width: float) -> None:
        """Add a value; `width` is that of a bin, in s. Bins that no chart shows any more are dropped."""
        if not math.isfinite(value):
            return
        number = math.floor(time / width)
        low, high = self.bins.get(number, (value, value))
        self.bins[number] = (min(low, value), max(high, value))
        if len(self.bins) > 2 * BINS:
            for old in sorted(self.bins)[:BINS]:
                del self.bins[old]

    def shown(self, window: Window) -> dict[int, tuple[float, float]]:
        """Return the bins inside a window."""
        first = round(window.start / window.length * BINS)
        return {number - first: pair for number, pair in self.bins.items() if 0 <= number - first < BINS}


def scale(traces: Sequence[Trace], window: Window, least: float) -> float:
    """Return the top of an axis from -top to top that holds all shown values: a step times a power of ten, `least` or more."""
    extremes = [abs(value) for trace in traces for pair in trace.shown(window).values() for value in pair]
    needed = max([least, *extremes])
    power = 10.0 ** math.floor(math.log10(needed))
    return next(step * power for step in STEPS if needed <= step * power * (1 + 1e-9))


def columns_of(number: int, columns: int) -> range:
    """Return the columns that a bin occupies, at least one, on a chart with more or fewer columns than bins."""
    first = number * columns // BINS
    return range(first, max(first + 1, (number + 1) * columns // BINS))


@dataclass(frozen=True)
class Line:
    """A trace and its style; `dotted` omits every other dot, for terminals without colour."""

    trace: Trace
    style: str
    dotted: bool = False


def chart(lines: Sequence[Line], window: Window, top: float, size: tuple[int, int], ascii_only: bool = False) -> list[Text]:
    """Return the rows of a chart, from the top.

    Args:
        lines: lines to draw; the last is on top.
        window: time range of the chart.
        top: the axis reaches from -top to top.
        size: columns and rows, in characters.
        ascii_only: stars instead of braille.
    """
    columns, rows = size
    cells: list[list[tuple[int, str]]] = [[(0, "")] * columns for _ in range(rows)]
    for line in lines:
        for column, first, last in _spans(line, window, top, (2 * columns, 4 * rows)):
            if line.dotted and column % 2:
                continue
            for row in range(first, last + 1):
                bits, _ = cells[row // 4][column // 2]
                cells[row // 4][column // 2] = (bits | DOTS[row % 4][column % 2], line.style)
    zero = _row(0.0, top, 4 * rows) // 4
    return [_row_of_text(row, number == zero, ascii_only) for number, row in enumerate(cells)]


def _spans(line: Line, window: Window, top: float, dots: tuple[int, int]) -> list[tuple[int, int, int]]:
    """Return (column, first row, last row) in dots, joined with the neighbour so that steep lines have no gaps."""
    columns, rows = dots
    found: dict[int, tuple[int, int]] = {}
    for number, (low, high) in line.trace.shown(window).items():
        upper, lower = _row(high, top, rows), _row(low, top, rows)
        for column in columns_of(number, columns):
            first, last = found.get(column, (upper, lower))
            found[column] = (min(first, upper), max(last, lower))
    joined = []
    for column, (first, last) in sorted(found.items()):
        before = found.get(column - 1)
        if before is not None:
            first, last = min(first, before[1] + 1), max(last, before[0] - 1)
        joined.append((column, first, last))
    return joined


def _row(value: float, top: float, rows: int) -> int:
    return min(rows - 1, max(0, round((top - value) / (2.0 * top) * (rows - 1))))


def _row_of_text(cells: list[tuple[int, str]], zero: bool, ascii_only: bool) -> Text:
    text = Text(no_wrap=True)
    for bits, style in cells:
        if bits:
            text.append("*" if ascii_only else chr(0x2800 + bits), style)
        else:
            text.append(("-" if ascii_only else "┈") if zero else " ", "dim")
    return text


MEASURED, ASKED = "cyan", "magenta"
STATUSES = {
    Status.TRACKING: ("─", "green"),
    Status.LIMITED: ("L", "yellow"),
    Status.STANDBY: ("s", "default"),
    Status.DEGRADED: ("D", "bold bright_yellow"),
    Status.FAIL_SAFE: ("F", "bold red"),
}
"""Mark of each status on the time axis, and its style."""

LABELS, NUMBERS, UNITS, SCALES = 13, 8, 6, 7  # columns
FEWEST_COLUMNS = 12  # of a chart
FIXED_ROWS = 8
CHART_HEIGHTS = ((9, 7, 9), (7, 7, 7), (7, 5, 7), (5, 5, 5), (5, 3, 5), (3, 3, 3))
"""Odd heights of the three charts, so that zero is in the middle of a row; the first that fit are taken."""
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
    """Space on the terminal, and what it can display."""

    columns: int
    rows: int
    ascii_only: bool = False
    no_colour: bool = False

    def plain(self, text: str) -> str:
        """Return the text, in ASCII if the terminal supports nothing else."""
        if not self.ascii_only:
            return text
        return text.translate({0x00B7: "|", 0x2501: "#", 0x2500: "-", 0x00D7: "x"}).encode("ascii", "replace").decode("ascii")


TRACES = ("yaw_rate", "yaw_rate_reference", "sideslip", "rear_angle_command", "rear_angle")


@dataclass
class History:
    """The run so far in a bounded amount of memory: angles in deg, rates in deg/s."""

    last: LiveSample | None = None
    cycles: int = 0
    rear_rate: float = math.nan
    traces: dict[str, Trace] = field(default_factory=lambda: {name: Trace() for name in TRACES})
    statuses: Trace = field(default_factory=Trace)
    cycle_times: deque[tuple[float, float]] = field(default_factory=deque)
    seen: Counter[str] = field(default_factory=Counter)
    seen_at: dict[str, float] = field(default_factory=dict)

    def add(self, sample: LiveSample) -> None:
        """Add a sample."""
        width = Window.of(sample.time, sample.duration).length / BINS
        for name, trace in self.traces.items():
            trace.add(sample.time, math.degrees(getattr(sample, name)), width)
        self.statuses.add(sample.time, sample.status, width)
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
    """Return the rows of the view, none wider than `options`; charts only if there is room for them."""
    rows = [Text("waiting for the first cycle")] if history.last is None else _draw(history, history.last, options)
    for row in rows:
        row.truncate(options.columns, overflow="crop" if options.ascii_only else "ellipsis")
    return rows


def _draw(history: History, last: LiveSample, options: LiveStyle) -> list[Text]:
    window = Window.of(last.time, last.duration)
    columns = options.columns - LABELS - NUMBERS - UNITS - SCALES
    fitting = (heights for heights in CHART_HEIGHTS if sum(heights) <= options.rows - FIXED_ROWS)
    heights = next(fitting, None) if columns >= FEWEST_COLUMNS else None
    rows = [_progress(history, last, options)]
    for number, block in enumerate(_blocks(history, last, options)):
        size = None if heights is None else (columns, heights[number])
        rows += _draw_block(block, window, size, options)
    rows += _status_rows(history, last, window, 0 if heights is None else columns, options)
    return rows + _counters(history, last, options) + _diagnostics(history, last, options)


@dataclass(frozen=True)
class _Block:
    """Rows of numbers next to a chart: (label, value, unit, style); `least` is the smallest range of the axis."""

    entries: Sequence[tuple[str, float, str, str]]
    lines: Sequence[Line]
    least: float


def _blocks(history: History, last: LiveSample, options: LiveStyle) -> tuple[_Block, ...]:
    def asked(name: str) -> Line:
        return Line(history.traces[name], ASKED, dotted=options.no_colour)

    def measured(name: str) -> Line:
        return Line(history.traces[name], MEASURED)

    dots = " .." if options.no_colour else ""
    yaw_rate, reference = math.degrees(last.yaw_rate), math.degrees(last.yaw_rate_reference)
    rear_angle, command = math.degrees(last.rear_angle), math.degrees(last.rear_angle_command)
    return (
        _Block(
            (("Yaw rate", yaw_rate, "deg/s", MEASURED), (f"reference{dots}", reference, "deg/s", ASKED)),
            (asked("yaw_rate_reference"), measured("yaw_rate")),
            5.0,
        ),
        _Block((("Sideslip", math.degrees(last.sideslip), "deg", MEASURED),), (measured("sideslip"),), 1.0),
        _Block(
            (
                ("Rear angle", rear_angle, "deg", MEASURED),
                (f"command{dots}", command, "deg", ASKED),
                ("rate", history.rear_rate, "deg/s", ""),
            ),
            (asked("rear_angle_command"), measured("rear_angle")),
            1.0,
        ),
    )


def _draw_block(block: _Block, window: Window, size: tuple[int, int] | None, options: LiveStyle) -> list[Text]:
    height = len(block.entries) if size is None else size[1]
    top = scale([line.trace for line in block.lines], window, block.least)
    drawn = chart(block.lines, window, top, size, options.ascii_only) if size is not None else []
    rows = []
    for number in range(height):
        row = Text(no_wrap=True)
        if number < len(block.entries):
            label, value, unit, style = block.entries[number]
            row.append(label.ljust(LABELS), style)
            row.append(_number(value).rjust(NUMBERS) + f" {unit}".ljust(UNITS))
        if drawn:
            row.pad_right(LABELS + NUMBERS + UNITS - row.cell_len)
            shown = {0: f"{top:g}", height - 1: f"-{top:g}"}.get(number, "")
            row.append(shown.rjust(SCALES - 1) + " ", "dim")
            row.append_text(drawn[number])
        rows.append(row)
    return rows


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


def _status_rows(history: History, last: LiveSample, window: Window, columns: int, options: LiveStyle) -> list[Text]:
    """Yield the status by name with the worst status of each bin, then the time axis."""
    name, _, style = _status(last.status)
    row = Text.assemble("Status".ljust(LABELS), (name, style))
    if not columns:
        return [row]
    row.pad_right(LABELS + NUMBERS + UNITS + SCALES - row.cell_len)
    worst: dict[int, int] = {}
    for number, (_, status) in history.statuses.shown(window).items():
        for column in columns_of(number, columns):
            worst[column] = max(worst.get(column, 0), int(status))
    for column in range(columns):
        if column in worst:
            _, mark, style = _status(worst[column])
            row.append(options.plain(mark), style)
        else:
            row.append(" ")
    axis = Text(" " * (LABELS + NUMBERS + UNITS + SCALES))
    start, end = f"{window.start:g} s", f"{window.start + window.length:g} s"
    return [row, axis.append(start.ljust(columns - len(end)) + end, "dim")]


def _status(code: int) -> tuple[str, str, str]:
    """Return name, mark and style of a status, known or not."""
    return (Status(code).name, *STATUSES[Status(code)]) if code in set(Status) else (f"unknown ({code})", "?", "bold red")


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
        width, height = self._console.size
        options = LiveStyle(max(1, width - 4), height - 3, self._console.options.ascii_only, self._console.no_color)
        return Panel(
            Group(*draw(self._history, options)),
            title=Text(self._title),
            title_align="left",
            subtitle=Text(options.plain(self._footer)),
            subtitle_align="right",
        )

"""Timing of the frames in a log of the bus."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Can
from codegen.errors import CodegenError, one_line
from codegen.files import reason_of, require_regular
from codegen.report.html.blocks import Block, Chart, Gallery, Table, Text, axis, layout, numbers
from codegen.report.style import BLUE, GREEN, ORANGE, VERMILION

COLOURS = (BLUE, ORANGE, VERMILION)
BINS = 120
TOOLS = 'pip install "ars-codegen[tools]"'
HISTOGRAM_SPAN_MIN_MS = 0.1
"""Minimum span of a histogram, in ms."""
TEXT_LOGS = (".asc", ".log")
LOG_BYTES_MAX = 2**30
LINE_BYTES_MAX = 2**20
TIME_MAX_S = 1e11
"""Largest time stamp of a frame; Unix time stays below for 3,000 years."""
ASC_FRAME = re.compile(r"\s*(\S+)\s+(?:\d+\s+[0-9a-f]+x?|CANFD\s+\d+)\s+(?:Rx|Tx)\s", re.IGNORECASE)
"""Beginning of a frame in an ASC: time, channel, identifier and direction; of CAN FD, the channel and the direction."""
REMEDY = "give a log that `codegen hil --log` or another tool wrote"
ANSWER = "Command after the motion frame"


@dataclass(frozen=True)
class BusTimes:
    """Periods and response times of the frames in a log, in ms.

    Attributes:
        name: name of the log.
        periods: name of a message -> time from each of its frames to the next.
        answers: time from each motion frame to the next command.
        cycle: nominal period.
    """

    name: str
    periods: dict[str, FloatArray]
    answers: FloatArray
    cycle: float

    @property
    def is_simulated(self) -> bool:
        """Whether every period is the configured one to a microsecond, which no real clock achieves; False without any."""
        return bool(self.periods) and all(bool(np.all(np.abs(values - self.cycle) < 1e-3)) for values in self.periods.values())


def read_log(path: Path, can: Can, name: str) -> BusTimes:
    """Read a log with python-can.

    Args:
        path: `.blf`, `.asc`, `.log` or `.mf4`.
        can: messages of the build, found by their ids.
        name: name in the report.

    Raises:
        CodegenError: it cannot be read, or contains no frame of the build.
    """
    messages = (can.vehicle_motion, can.vehicle_conditions, can.rear_steer_command)
    sent: dict[int, list[float]] = {message.id: [] for message in messages}
    received: dict[int, list[float]] = {message.id: [] for message in messages}
    require_regular(path, LOG_BYTES_MAX, "give a shorter log")
    if path.suffix.lower() in TEXT_LOGS:
        _check_text(path)
    try:
        from can import LogReader

        with LogReader(path) as reader:
            whole = getattr(reader, "file_size", 0)  # from the header of a BLF
            for frame in reader:
                if frame.arbitration_id in sent and not frame.is_extended_id and not frame.is_error_frame:
                    (received if frame.is_rx else sent)[frame.arbitration_id].append(frame.timestamp)
    except ImportError as error:
        raise CodegenError(f"the package that reads it is missing ({one_line(error)})", where=path, remedy=TOOLS) from None
    except Exception as error:  # readers may raise anything for a damaged file
        raise CodegenError(f"not a readable log of a CAN bus ({one_line(error)})", where=path, remedy=REMEDY) from None
    if path.stat().st_size < whole:
        what = f"it ends early: {path.stat().st_size} of {whole} bytes"
        raise CodegenError(what, where=path, remedy="copy it again, or let the tool that writes it close it")
    # On some buses, such as udp_multicast, a node also receives its own frames; the time of sending counts.
    times = {key: sent[key] or received[key] for key in sent}
    if not any(times.values()):
        known = ", ".join(f"0x{message.id:x}" for message in messages)
        raise CodegenError(f"no frame with an id of the build ({known})", where=path, remedy="name its build with --build")
    if not all(abs(stamp) <= TIME_MAX_S for of_message in times.values() for stamp in of_message):  # NaN neither
        raise CodegenError("a frame has an invalid time", where=path, remedy=REMEDY)
    stamps = {message.name: np.sort(np.array(times[message.id])) for message in messages}
    motion, command = stamps[can.vehicle_motion.name], stamps[can.rear_steer_command.name]
    cycle = float(can.vehicle_motion.cycle_time_ms or 10.0)
    # In simulated time the answer has the time of its sample.
    following = np.searchsorted(command, motion, side="left")
    # A motion frame that is answered only after the next one has no answer of its own.
    ends = np.append(motion[1:], np.inf)
    answered = following < command.size
    delay = command[following[answered]] - motion[answered]
    own = command[following[answered]] < ends[answered]
    periods = {key: 1e3 * np.diff(values) for key, values in stamps.items() if values.size > 1}
    return BusTimes(name, periods, 1e3 * delay[own], cycle)


def _check_text(path: Path) -> None:
    """Check the lines of a text log: their lengths, as the reader holds each in memory, and the times of an ASC.

    python-can skips a frame with an invalid time. Raises CodegenError.
    """
    is_asc = path.suffix.lower() == ".asc"
    try:
        with path.open("rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(LINE_BYTES_MAX + 1), b""), start=1):
                if len(line) > LINE_BYTES_MAX:
                    raise CodegenError("not a log of a CAN bus: a line is over 1 MiB", where=path, remedy="give another log")
                frame = ASC_FRAME.match(line.decode("utf-8", "replace")) if is_asc else None
                if frame is not None and _is_invalid_time(frame[1]):
                    what = f"a frame has an invalid time, {one_line(frame[1], 40)}"
                    raise CodegenError(what, where=f"{path}, line {number}", remedy=REMEDY)
    except OSError as error:
        raise CodegenError(f"cannot be read ({reason_of(error)})", where=path, remedy="check its permissions") from None


def _is_invalid_time(word: str) -> bool:
    """Return whether the word is a number, but not one that an ASC has as time; other words begin comments."""
    if re.fullmatch(r"-?\d+\.\d+", word):
        return False
    try:
        float(word)
    except ValueError:
        return False
    return True


def bus_blocks(logs: Sequence[BusTimes]) -> Iterator[Block]:
    """Yield histograms and a table for each log."""
    for number, log in enumerate(logs, start=1):
        yield Text(f"{log.name}: period of the frames (nominal {log.cycle:g} ms), and time from a sample to its command.")
        if log.is_simulated:
            yield Text("These times are simulated. They do not measure the timing of the ECU.", "notice")
        yield Gallery(list(_histograms(log, number)))
        rows = [_row(f"{name}, period", values) for name, values in log.periods.items()]
        if log.answers.size:
            rows.append(_row(ANSWER, log.answers))
        yield Table(f"{log.name}: times in ms", ("", "number", "median", "99 %", "least", "largest"), rows)


def _row(what: str, values: FloatArray) -> tuple[str, ...]:
    shares = (np.median(values), np.percentile(values, 99.0), values.min(), values.max())
    return what, f"{values.size:,}", *(f"{float(value):.3f}" for value in shares)


def _histograms(log: BusTimes, number: int) -> Iterator[Chart]:
    if log.periods:
        edges = _edges(np.concatenate(list(log.periods.values())))  # the same for all, so that they can be compared
        for k, ((name, values), colour) in enumerate(zip(log.periods.items(), COLOURS, strict=False), start=1):
            yield _histogram(values, edges, f"Period of {name} (ms)", colour, f"can-{number}-{k}")
    if log.answers.size:
        yield _histogram(log.answers, _edges(log.answers), f"{ANSWER} (ms)", GREEN, f"can-{number}-answer")


def _edges(values: FloatArray) -> FloatArray:
    low, high = float(values.min()), float(values.max())
    if high - low < HISTOGRAM_SPAN_MIN_MS:  # centre times that are all equal
        low, high = (low + high - HISTOGRAM_SPAN_MIN_MS) / 2.0, (low + high + HISTOGRAM_SPAN_MIN_MS) / 2.0
    return np.linspace(low, high, BINS + 1)


def _histogram(values: FloatArray, edges: FloatArray, title: str, colour: str, name: str) -> Chart:
    counts, _ = np.histogram(values, edges)
    bars = {
        "type": "bar",
        "x": numbers((edges[:-1] + edges[1:]) / 2.0),
        "y": counts.tolist(),
        "width": float(edges[1] - edges[0]),
        "marker": {"color": colour, "line": {"width": 0}},
        "hovertemplate": "%{y} frames around %{x:.3f} ms<extra></extra>",
    }
    look = layout(
        bargap=0.0,
        showlegend=False,
        xaxis=axis(title, range=[float(edges[0]), float(edges[-1])], zeroline=False),
        yaxis=axis("Frames", type="log", dtick=1, range=[-0.3, float(np.log10(max(int(counts.max()), 2))) + 0.2]),
    )
    told = f"{title}: median {np.median(values):.3f}, largest {values.max():.3f}."
    return Chart(name, {"data": [bars], "layout": look}, told, f"Histogram. {told}", 300)

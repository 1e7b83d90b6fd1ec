"""The live view of a run: what it says, in every size of terminal, and that it leaves the bench alone."""

from __future__ import annotations

import io
import math
import re
import sys
import threading
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from codegen.emit.can_view import DIAGNOSTICS as IN_THE_C
from codegen.report.live import LiveSample, LiveView
from codegen.report.live_chart import BINS, Line, Trace, Window, chart, scale
from codegen.report.live_rows import TRACES, History, Look, draw
from codegen.sil.software import Status
from hil_sim.diagnostics import DIAGNOSTICS, causes

CALM = LiveSample(0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0, Status.TRACKING, 0, 0.01, 0, 0)


def a_run(cycles: int, **changes: object) -> History:
    """Cycles of 10 ms."""
    history = History()
    for cycle in range(cycles):
        history.add(replace(CALM, time=cycle * 0.01, **changes))  # type: ignore[arg-type]
    return history


def row_of(history: History, label: str, look: Look | None = None) -> str:
    rows = [row.plain for row in draw(history, look or Look(76, 21))]
    return next(row for row in rows if row.strip().startswith(label))


def console_of(width: int = 80, height: int = 24, **options: object) -> Console:
    settings: dict[str, object] = {"force_terminal": True, "color_system": "truecolor", "legacy_windows": False, "_environ": {}}
    return Console(file=io.StringIO(), width=width, height=height, **(settings | options))  # type: ignore[arg-type]


def printed(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_the_bits_are_those_of_the_generated_c() -> None:
    assert {bit: name for bit, (name, _) in DIAGNOSTICS.items()} == {cause.bit: cause.name for cause in IN_THE_C}
    assert len({words for _, words in DIAGNOSTICS.values()}) == 16


def test_causes_in_words() -> None:
    assert causes(0) == ()
    assert causes(1 << 1 | 1 << 15 | 1 << 20) == ("motion CRC wrong", "timeout", "bit 20")
    assert len(causes(0xFFFF)) == 16


def test_numbers_are_in_degrees() -> None:
    sample = replace(CALM, yaw_rate=0.2, yaw_rate_reference=0.25, sideslip=-0.03, rear_angle_command=0.05, rear_angle=0.04)
    history = History()
    history.add(replace(sample, rear_angle=0.039))
    history.add(replace(sample, time=0.01))
    expected = {"Yaw rate": "11.46 deg/s", "reference": "14.32 deg/s", "Sideslip": "-1.72 deg", "command": "2.86 deg"}
    # 0.001 rad in 10 ms
    for label, number in (expected | {"Rear angle": "2.29 deg", "rate": "5.73 deg/s"}).items():
        assert f" {number} " in f"{row_of(history, label)} "


def test_what_is_not_available_is_said_and_leaves_a_gap() -> None:
    history = a_run(100, yaw_rate_reference=math.nan, rear_angle_command=math.inf)
    assert "n/a" in row_of(history, "reference")
    assert "n/a" in row_of(history, "command")
    assert history.traces["yaw_rate_reference"].bins == {}
    assert "n/a" not in row_of(history, "Yaw rate")


def test_progress_and_cycle() -> None:
    row = row_of(a_run(251), "━")
    assert "2.50 s of 10.00 s   25 %  cycle 251" in row
    bar = row.split("  2.50")[0]
    assert bar.count("━") / len(bar) == pytest.approx(0.25, abs=0.5 / len(bar))  # rounded to a character
    endless = History()
    endless.add(replace(CALM, duration=math.inf, time=72.0))
    assert draw(endless, Look(76, 21))[0].plain == "72.00 s  cycle 1"


def test_before_the_first_cycle() -> None:
    assert [row.plain for row in draw(History(), Look(76, 21))] == ["waiting for the first cycle"]


def test_cycle_times_are_those_of_the_last_second() -> None:
    history = History()
    for cycle in range(301):
        slow = {100: 0.5, 250: 0.0149}.get(cycle, 0.010)
        history.add(replace(CALM, time=cycle * 0.01, cycle_time=0.0097 if cycle == 300 else slow))
    assert " 9.70 min · 10.05 mean · 14.90 max ms" in row_of(history, "Cycle time")
    assert len(history.cycle_times) == 100


def test_losses_are_counted_and_stand_out() -> None:
    history = a_run(5, lost_frames=7, late_cycles=3)
    row = next(row for row in draw(history, Look(76, 21)) if row.plain.startswith("Lost frames"))
    assert re.search(r"Lost frames +7 +late cycles 3$", row.plain)
    assert {"bold red", "bold yellow"} <= {str(span.style) for span in row.spans}
    calm = next(row for row in draw(a_run(5), Look(76, 21)) if row.plain.startswith("Lost frames"))
    assert not {"bold red", "bold yellow"} & {str(span.style) for span in calm.spans}


@pytest.mark.parametrize("status", list(Status))
def test_status_by_name(status: Status) -> None:
    assert status.name in row_of(a_run(3, status=status), "Status")


def test_colours_tell_states_apart() -> None:
    rows = [next(row for row in draw(a_run(3, status=one), Look(76, 21)) if row.plain.startswith("Status")) for one in Status]
    assert len({str(row.spans[0].style) for row in rows}) == len(Status)


def test_a_status_that_is_none() -> None:
    assert "unknown (9)" in row_of(a_run(3, status=9), "Status")


def test_one_degraded_cycle_shows_in_the_history() -> None:
    history = History()
    for cycle in range(1000):
        status = {300: Status.DEGRADED, 600: Status.FAIL_SAFE, 601: Status.STANDBY}.get(cycle, Status.TRACKING)
        history.add(replace(CALM, time=cycle * 0.01, status=status))
    marks = row_of(history, "Status")[34:]
    assert len(marks) == 42
    assert set(marks) == {"─", "D", "F"}
    assert (marks.index("D"), marks.index("F")) == (12, 25)  # 3 s and 6 s of 10 s


def test_a_cause_of_one_cycle_is_told_and_kept() -> None:
    history = a_run(10)
    history.add(replace(CALM, time=0.10, diagnostics=1 << 1))
    history.add(replace(CALM, time=0.11))
    assert "motion CRC wrong" in row_of(history, "Diagnostics")
    assert "none" in row_of(history, "earlier")
    history.add(replace(CALM, time=2.0, diagnostics=1 << 15))
    assert row_of(history, "Diagnostics").split("  ")[-1] == "timeout"
    assert "motion CRC wrong ×1" in row_of(history, "earlier")


def test_many_causes_go_on_a_second_row() -> None:
    history = History()
    history.add(replace(CALM, diagnostics=0x1F))
    history.add(replace(CALM, time=5.0))
    rows = [row.plain for row in draw(history, Look(76, 21))][-2:]
    assert "motion missing ×1" in rows[0]
    assert "motion lost in between ×1" in rows[1]


@pytest.mark.parametrize(
    ("needed", "top"), [(0.0, 1.0), (1.0, 1.0), (1.01, 1.5), (1.9, 2.0), (2.3, 3.0), (14.0, 15.0), (70.0, 70.0), (71.0, 100.0)]
)
def test_scales(needed: float, top: float) -> None:
    trace = Trace()
    trace.add(1.0, -needed, 0.05)
    assert scale([trace], Window.of(2.0, 10.0), 1.0) == pytest.approx(top, rel=1e-12)


def test_a_window_holds_a_short_run_and_moves_with_a_long_one() -> None:
    assert Window.of(3.0, 10.0) == Window(0.0, 10.0)
    assert Window.of(10.0, 10.0).start == pytest.approx(0.05)  # the sample at the end has a bin of its own
    for duration in (60.0, math.inf, 0.0):
        assert Window.of(20.0, duration) == Window(0.0, 30.0)
        moved = Window.of(45.0, duration)
        assert moved.length == 30.0
        assert moved.start + moved.length == pytest.approx(45.15)  # up to the end of the bin


def sampled(signal: Callable[[float], float]) -> Trace:
    trace = Trace()
    for cycle in range(1000):
        trace.add(cycle * 0.01, signal(cycle * 0.01), 10.0 / BINS)
    return trace


def cells(trace: Trace, columns: int = 20, rows: int = 5, ascii_only: bool = False) -> list[str]:
    return [row.plain for row in chart([Line(trace, "cyan")], Window.of(5.0, 10.0), 1.0, (columns, rows), ascii_only)]


def test_a_chart_has_zero_in_the_middle_and_the_extremes_at_its_edges() -> None:
    assert cells(Trace()) == [" " * 20, " " * 20, "┈" * 20, " " * 20, " " * 20]
    assert cells(sampled(lambda time: 1.0))[0] == chr(0x2809) * 20  # the upper two dots
    assert cells(sampled(lambda time: -1.0))[4] == chr(0x28C0) * 20  # the lower two
    assert {*cells(sampled(lambda time: 0.0))[2]} <= {chr(0x2812), chr(0x2824)}  # the two in the middle
    assert cells(sampled(lambda time: -99.0))[4] == chr(0x28C0) * 20
    assert cells(sampled(lambda time: 99.0))[0] == chr(0x2809) * 20  # beyond the axis: at its edge


def test_a_chart_runs_from_left_to_right_without_holes() -> None:
    rows = cells(sampled(lambda time: 0.2 * time - 1.0))
    assert rows[4].startswith(rows[4].strip(" "))
    assert rows[0].endswith(rows[0].strip(" "))
    step = cells(sampled(lambda time: -1.0 if time < 5.0 else 1.0))
    assert all(any(0x2800 < ord(one) <= 0x28FF for one in row) for row in step)
    assert step[4][:9] == chr(0x28C0) * 9
    assert step[0][11:] == chr(0x2809) * 9


def test_a_peak_of_one_cycle_is_drawn() -> None:
    rows = cells(sampled(lambda time: 1.0 if abs(time - 7.02) < 0.005 else 0.0))
    assert rows[0][14] != " "
    assert rows[0].count(" ") == 19


def test_bins_wider_than_dots_leave_no_holes() -> None:
    assert cells(sampled(lambda time: 1.0), columns=300)[0].strip() == chr(0x2809) * 300


def test_what_was_asked_for_can_be_told_without_colour() -> None:
    trace = sampled(lambda time: 1.0)
    assert chart([Line(trace, "", dotted=True)], Window.of(5.0, 10.0), 1.0, (20, 5))[0].plain == chr(0x2801) * 20
    assert ".." in row_of(a_run(3), "reference", Look(76, 21, no_colour=True))


@pytest.mark.parametrize(
    ("signal", "first", "style"),
    [
        ("yaw_rate", 1, "cyan"),
        ("yaw_rate_reference", 1, "magenta"),
        ("sideslip", 6, "cyan"),
        ("rear_angle", 9, "cyan"),
        ("rear_angle_command", 9, "magenta"),
    ],
)
def test_each_signal_is_drawn_where_its_number_stands(signal: str, first: int, style: str) -> None:
    """0.1 rad, 5.73 deg: near the top of an axis to 7 deg, on the first of its rows, in the colour of its label."""
    history = a_run(500, **{signal: 0.1})
    top, *_, bottom = draw(history, Look(76, 21))[first : first + (3 if signal == "sideslip" else 5)]
    assert top.plain[27:34].strip() == "7"
    assert bottom.plain[27:34].strip() == "-7"
    assert re.fullmatch("[\u2801-\u28ff]{21} *", top.plain[34:])  # half of the run
    assert style in {str(span.style) for span in top.spans if span.start == 34}
    without_colour = draw(history, Look(76, 21, no_colour=True))[first].plain[34:55]
    assert (chr(0x2802) in without_colour or chr(0x2804) in without_colour) == (style == "magenta")  # every other dot


def test_a_long_run_does_not_grow() -> None:
    trace = Trace()
    for cycle in range(200_000):
        trace.add(cycle * 0.01, 1.0, 30.0 / BINS)
    assert len(trace.bins) <= 2 * BINS
    assert len(trace.shown(Window.of(1999.99, math.inf))) == BINS


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
@pytest.mark.parametrize("size", [(80, 24), (132, 50), (200, 100), (60, 17), (40, 14), (20, 10)])
def test_it_fits(size: tuple[int, int], encoding: str) -> None:
    width, height = size
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(
        file=stream,
        width=width,
        height=height,
        force_terminal=True,
        legacy_windows=False,
        _environ={},
        color_system="truecolor",
    )
    view = LiveView("a scenario with a rather long name", "socketcan:vcan0", "native", "real time", console=console)
    view._samples.extend(
        replace(CALM, time=0.01 * cycle, diagnostics=0xFFFF, yaw_rate=9.99, status=cycle % 6) for cycle in range(900)
    )
    console.print(view.picture())  # what the encoding lacks would raise
    stream.seek(0)
    lines = re.sub(r"\x1b\[[0-9;]*m", "", stream.read()).splitlines()
    assert {len(line) for line in lines} == {width}
    assert len(lines) <= max(height - 1, 16)  # numbers alone take 15 rows
    if size == (80, 24):
        assert len(lines) == 23
    assert any("Yaw rate" in line for line in lines)
    if width >= 60:
        drawn = any("***" in line if encoding == "ascii" else re.search("[\u2801-\u28ff]{3}", line) for line in lines)
        assert drawn == (height >= 20)


def test_ascii_where_there_is_no_more() -> None:
    history = a_run(500, diagnostics=0xFFFF, yaw_rate=0.1)
    text = "\n".join(row.plain for row in draw(history, Look(76, 21, ascii_only=True)))
    assert text.isascii()
    assert "****" in text
    assert "motion missing" in text


def test_no_color() -> None:
    console = console_of(_environ={"NO_COLOR": "1"})
    view = LiveView("step", "virtual", "cffi", "lock-step", console=console)
    view._samples.extend(replace(CALM, time=0.01 * cycle, lost_frames=3, status=4) for cycle in range(9))
    console.print(view.picture())
    codes = {code for group in re.findall(r"\x1b\[([0-9;]*)m", printed(console)) for code in group.split(";")}
    assert codes <= {"", "0", "1", "2"}  # bold and dim
    assert "reference .." in printed(console)


@pytest.mark.parametrize("options", [{"force_terminal": False}, {"quiet": True}, {"_environ": {"TERM": "dumb"}}])
def test_nothing_is_printed_where_nobody_looks(options: dict[str, object]) -> None:
    console = console_of(**options)
    with LiveView("step", "virtual", "cffi", "lock-step", console=console) as view:
        view.update(CALM)
        assert not view._samples  # nothing would ever take them
    assert printed(console) == ""


def test_update_only_stores(monkeypatch: pytest.MonkeyPatch) -> None:
    """All drawing while the run goes on is another thread's."""
    drawn = []
    real = LiveView.picture
    monkeypatch.setattr(LiveView, "picture", lambda view: (drawn.append(threading.current_thread()), real(view))[1])
    console = console_of()
    with LiveView("step", "virtual", "cffi", "lock-step", console=console) as view:
        started = len(drawn)
        for cycle in range(3000):
            view.update(replace(CALM, time=0.01 * cycle))
        here = [one for one in drawn[started:] if one is threading.main_thread()]
    assert here == []
    assert view._history.cycles == 3000  # none is left at the end
    assert "cycle 3000" in printed(console)


def test_the_interpreter_is_shared_finely_while_it_draws() -> None:
    sys.setswitchinterval(0.004)
    view = LiveView("step", "virtual", "cffi", "real time", console=console_of())
    view.__enter__()
    assert sys.getswitchinterval() < 0.001
    view.__exit__(KeyboardInterrupt, None, None)
    assert sys.getswitchinterval() == pytest.approx(0.004)
    sys.setswitchinterval(0.005)  # Python's own


def test_a_good_end_clears_the_screen_and_a_bad_one_leaves_the_picture() -> None:
    def ending(error: type[BaseException] | None) -> str:
        console = console_of()
        view = LiveView("step", "virtual", "cffi", "lock-step", console=console)
        view.__enter__()
        view.update(CALM)
        view.__exit__(error, None, None)
        return printed(console)[-60:]

    erase = "\x1b[2K"
    assert erase in ending(None)
    assert erase not in ending(KeyboardInterrupt)
    assert "virtual" in ending(KeyboardInterrupt)


numbers = st.floats(-1e3, 1e3) | st.just(math.nan) | st.just(math.inf)


@given(
    st.lists(
        st.builds(
            LiveSample,
            time=st.floats(0.0, 200.0),
            duration=st.just(60.0),
            **dict.fromkeys(TRACES, numbers),
            status=st.integers(0, 15),
            diagnostics=st.integers(0, 0xFFFF),
            cycle_time=st.floats(0.0, 10.0),
            lost_frames=st.integers(0, 10**6),
            late_cycles=st.integers(0, 10**6),
        ),
        max_size=8,
    ),
    st.integers(1, 150),
    st.integers(1, 60),
)
def test_no_run_breaks_it(samples: list[LiveSample], columns: int, rows: int) -> None:
    history = History()
    for sample in sorted(samples, key=lambda one: one.time):
        history.add(sample)
    for ascii_only in (False, True):
        drawn = draw(history, Look(columns, rows, ascii_only))
        assert all(row.cell_len <= columns for row in drawn)
        assert not samples or len(drawn) <= max(rows, 13)

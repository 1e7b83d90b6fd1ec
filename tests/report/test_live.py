"""The live view of a run: its numbers at every terminal width, and no load on the bench's thread."""

import io
import math
import re
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from codegen.emit.can_view import DIAGNOSTIC_CAUSES as IN_THE_C
from codegen.report.live import History, LiveSample, LiveStyle, LiveView, draw
from codegen.sil.software import Status
from hil_sim.codec import DIAGNOSTICS, causes

QUIET_SAMPLE = LiveSample(0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0, Status.TRACKING, 0, 0.01, 0, 0)
LOOK = LiveStyle(76)


def history_of(cycles: int, **changes: Any) -> History:
    """Return cycles of 10 ms; a callable value is a function of the cycle."""
    history = History()
    for cycle in range(cycles):
        values = {name: value(cycle) if callable(value) else value for name, value in changes.items()}
        history.add(replace(QUIET_SAMPLE, time=cycle * 0.01, **values))
    return history


def row_of(history: History, label: str) -> Any:
    return next(row for row in draw(history, LOOK) if row.plain.strip().startswith(label))


def console_of(**options: Any) -> Console:
    settings = {"force_terminal": True, "color_system": "truecolor", "legacy_windows": False, "_environ": {}}
    return Console(file=io.TextIOWrapper(io.BytesIO(), encoding="utf-8"), width=80, height=24, **(settings | options))


def printed(console: Console) -> str:
    console.file.seek(0)
    return console.file.read()


def test_diagnostic_bits_are_those_of_the_generated_c() -> None:
    assert {bit: name for bit, (name, _) in DIAGNOSTICS.items()} == {cause.bit: cause.name for cause in IN_THE_C}
    assert len({words for _, words in DIAGNOSTICS.values()}) == len(DIAGNOSTICS)
    assert causes(1 << 1 | 1 << 9 | 1 << 20) == ("motion damaged", "yaw rate replaced", "bit 20")


def test_numbers_are_in_degrees_and_missing_ones_are_named() -> None:
    sample = replace(
        QUIET_SAMPLE, yaw_rate=0.2, yaw_rate_reference=0.25, sideslip=-0.03, rear_angle_command=0.05, rear_angle=0.04
    )
    history = History()
    history.add(replace(sample, rear_angle=0.039))
    history.add(replace(sample, time=0.01))
    expected = {"Yaw rate": "11.46 deg/s", "reference": "14.32 deg/s", "Sideslip": "-1.72 deg", "command": "2.86 deg"}
    # 0.001 rad in 10 ms
    for label, number in (expected | {"Rear angle": "2.29 deg", "rate": "5.73 deg/s"}).items():
        assert f" {number} " in f"{row_of(history, label).plain} "
    history = history_of(100, yaw_rate_reference=math.nan)
    assert "n/a" in row_of(history, "reference").plain and "n/a" not in row_of(history, "Yaw rate").plain


def test_progress_cycle_times_and_losses() -> None:
    row = row_of(history_of(251), "━").plain
    assert "2.50 s of 10.00 s   25 %  cycle 251" in row
    slow = {100: 0.5, 250: 0.0149, 300: 0.0097}
    history = history_of(301, cycle_time=lambda cycle: slow.get(cycle, 0.010))
    assert " 9.70 min · 10.05 mean · 14.90 max ms" in row_of(history, "Cycle time").plain  # over the last second
    lost = row_of(history_of(5, lost_frames=7, late_cycles=3), "Lost frames")
    assert re.search(r"Lost frames +7 +late cycles 3$", lost.plain)


def test_a_cause_of_one_cycle_is_shown_and_retained() -> None:
    history = history_of(11, diagnostics=lambda cycle: (cycle == 10) << 1)
    history.add(replace(QUIET_SAMPLE, time=0.11))
    assert "motion damaged" in row_of(history, "Diagnostics").plain
    assert "none" in row_of(history, "earlier").plain
    history.add(replace(QUIET_SAMPLE, time=2.0, diagnostics=1 << 9))
    assert row_of(history, "Diagnostics").plain.split("  ")[-1] == "yaw rate replaced"
    assert "motion damaged ×1" in row_of(history, "earlier").plain


def test_update_only_stores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another thread draws during the run."""
    drawn = []
    real = LiveView.picture
    monkeypatch.setattr(LiveView, "picture", lambda view: (drawn.append(threading.current_thread()), real(view))[1])
    console = console_of()
    with LiveView("step", "virtual", "cffi", "lock-step", console=console) as view:
        started = len(drawn)
        for cycle in range(3000):
            view.update(replace(QUIET_SAMPLE, time=0.01 * cycle))
        assert threading.main_thread() not in drawn[started:]
    assert view._history.cycles == 3000  # none is lost at the end
    assert "cycle 3000" in printed(console)


@pytest.mark.parametrize("error", [None, KeyboardInterrupt])
def test_the_end_restores_the_interpreter_and_keeps_the_view_of_a_failure(error: type[BaseException] | None) -> None:
    console, before = console_of(), sys.getswitchinterval()
    with suppress(KeyboardInterrupt), LiveView("step", "virtual", "cffi", "lock-step", console=console) as view:
        assert sys.getswitchinterval() < 0.001
        view.update(QUIET_SAMPLE)
        if error is not None:
            raise error
    assert sys.getswitchinterval() == pytest.approx(before)
    ending = printed(console)[-60:]
    assert ("\x1b[2K" in ending, "virtual" in ending) == (error is None, error is not None)


numbers = st.floats(-1e3, 1e3) | st.just(math.nan) | st.just(math.inf)
angles = dict.fromkeys(("yaw_rate", "yaw_rate_reference", "sideslip", "rear_angle_command", "rear_angle"), numbers)
counts = {"status": st.integers(0, 15), "diagnostics": st.integers(0, 0xFFFF), "cycle_time": st.floats(0.0, 10.0)}
counts |= {"duration": st.just(60.0), **dict.fromkeys(("lost_frames", "late_cycles"), st.integers(0, 10**6))}
samples = st.builds(LiveSample, time=st.floats(0.0, 200.0), **angles, **counts)


@settings(max_examples=50)
@given(st.lists(samples, max_size=8), st.integers(1, 150), st.booleans())
def test_any_run_fits_any_width(run: list[LiveSample], columns: int, ascii_only: bool) -> None:
    history = History()
    for sample in sorted(run, key=lambda one: one.time):
        history.add(sample)
    drawn = draw(history, LiveStyle(columns, ascii_only))
    assert all(row.cell_len <= columns for row in drawn)
    assert len(drawn) == (13 if run else 1)
    assert not ascii_only or all(row.plain.isascii() for row in drawn)

"""Timing of the machine's clock and scheduler."""

from __future__ import annotations

import os
import statistics
import time

from codegen.doctor.finding import Finding, State

PERIOD = 0.001
"""s; the plant's step."""
WAITS = 50
LATENESS_MAX_FRACTION = 0.5
"""Fraction of the period by which a wait may end late; beyond it the bench counts late cycles in real time."""
PRIORITY = 1


def punctuality() -> Finding:
    """Measure the median and worst delay of waits of a millisecond in an idle process."""
    name, serves = "timer", "hil and plant by the clock"
    late = []
    for _ in range(WAITS):
        start = time.monotonic()
        time.sleep(PERIOD)
        late.append(time.monotonic() - start - PERIOD)
    middle, worst = statistics.median(late), max(late)
    what = f"waits of 1 ms end {1e3 * middle:.2f} ms late, at worst {1e3 * worst:.1f} ms"
    if middle > LATENESS_MAX_FRACTION * PERIOD:
        return Finding(name, State.BAD, what, serves, "take --lock-step, or a machine with less to do")
    return Finding(name, State.GOOD, what, serves)


def real_time() -> Finding:
    """Whether a process of this user may be scheduled in real time: tried, and undone."""
    name, serves = "SCHED_FIFO", "the native ECU's --priority, for exact timing beside other load"
    if not hasattr(os, "SCHED_FIFO"):
        return Finding(name, State.MISSING, "this system has none", serves)
    before, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        remedy = "add `USER - rtprio 50` to /etc/security/limits.conf and log in again"
        return Finding(name, State.MISSING, "not permitted", serves, remedy)
    os.sched_setscheduler(0, before, parameter)
    return Finding(name, State.GOOD, "permitted", serves)

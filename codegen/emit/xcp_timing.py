"""The period of the task in the units of ASAM MCD-1 XCP, for the XCP slave of the native ECU."""

from __future__ import annotations

from dataclasses import dataclass

from codegen.configuration import Config

UNITS = ("1 ns", "10 ns", "100 ns", "1 us", "10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s")
"""Units of time by their code: ten to the power of the code, in ns."""
MILLISECOND, TEN_MICROSECONDS = 6, 4

CYCLE_MAX = 255
"""Largest period of an event, in one byte."""
TIMESTAMP_SIZE = 2
"""Bytes of a timestamp."""


@dataclass(frozen=True)
class XcpTiming:
    """Times of the slave.

    Attributes:
        timestamp_ticks: units that the clock of the timestamps advances with each run of the task.
        timestamp_unit: code of that unit.
        event_cycle: period of the task in the event's unit; 0 where no unit fits it.
        event_unit: code of that unit.
    """

    timestamp_ticks: int
    timestamp_unit: int
    event_cycle: int
    event_unit: int

    @property
    def timestamp_mode(self) -> int:
        """Size and unit, as GET_DAQ_RESOLUTION_INFO reports them."""
        return self.timestamp_unit << 4 | TIMESTAMP_SIZE

    @property
    def timestamp_text(self) -> str:
        """The unit of the timestamps."""
        return UNITS[self.timestamp_unit]

    @property
    def event_text(self) -> str:
        """The unit of the event's period."""
        if not self.event_cycle:
            return "0, because no whole number of any unit fits a byte"
        return f"in units of {UNITS[self.event_unit]}"


def xcp_timing(config: Config) -> XcpTiming:
    """Return the times for the configured sampling time (1 to 100 ms)."""
    period = round(config.controller.sampling_time_s * 1e9)
    # The longest unit lets two bytes reach furthest. A period that is no whole number of 10 us is rounded to the nearest.
    unit = next((code for code in range(MILLISECOND, TEN_MICROSECONDS, -1) if period % 10**code == 0), TEN_MICROSECONDS)
    cycle_unit = next((code for code in range(MILLISECOND, -1, -1) if period % 10**code == 0), 0)
    cycle = period // 10**cycle_unit
    fits = cycle <= CYCLE_MAX
    return XcpTiming(
        timestamp_ticks=round(period / 10**unit),
        timestamp_unit=unit,
        event_cycle=cycle if fits else 0,
        event_unit=cycle_unit if fits else MILLISECOND,
    )

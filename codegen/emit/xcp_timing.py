"""The period of the task in the units of ASAM MCD-1 XCP, for the XCP slave of the native ECU."""

from __future__ import annotations

from dataclasses import dataclass

from codegen.configuration import Config

UNITS = ("1 ns", "10 ns", "100 ns", "1 us", "10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s")
"""Units of time by code: 10^code ns."""
MILLISECOND, TEN_MICROSECONDS = 6, 4

CYCLE_MAX = 255
"""Largest period of an event, in one byte."""
TIMESTAMP_SIZE = 2
"""Bytes of a timestamp."""


@dataclass(frozen=True)
class XcpTiming:
    """Timing of the XCP slave, in units of the standard.

    Attributes:
        timestamp_ticks: increment of the timestamp clock per run of the task, in timestamp units.
        timestamp_unit: code of the timestamp unit, see UNITS.
        event_cycle: period of the task in event units; 0 if it is not a whole number up to CYCLE_MAX of any unit.
        event_unit: code of the event unit.
    """

    timestamp_ticks: int
    timestamp_unit: int
    event_cycle: int
    event_unit: int

    @property
    def timestamp_mode(self) -> int:
        """Timestamp mode of GET_DAQ_RESOLUTION_INFO: size and unit."""
        return self.timestamp_unit << 4 | TIMESTAMP_SIZE

    @property
    def timestamp_text(self) -> str:
        """Unit of the timestamps, as text."""
        return UNITS[self.timestamp_unit]

    @property
    def event_text(self) -> str:
        """Unit of the event's period, as text."""
        if not self.event_cycle:
            return "0, because no whole number of any unit fits a byte"
        return f"in units of {UNITS[self.event_unit]}"


def xcp_timing(config: Config) -> XcpTiming:
    """Return the times for the configured sampling time (1 to 100 ms)."""
    period = round(config.controller.sampling_time_s * 1e9)
    # The longest unit gives two bytes the largest range. A period that is not a multiple of 10 us is rounded.
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

"""View model of the XCP slave of the native ECU: its identifiers, and the task's period in the units of ASAM MCD-1 XCP."""

from __future__ import annotations

from dataclasses import dataclass

from codegen.configuration import Config

UNITS = ("1 ns", "10 ns", "100 ns", "1 us", "10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s")
"""Of times, by their code: ten to the power of the code in ns."""
MILLISECOND, TEN_MICROSECONDS = 6, 4

CYCLE_MAX = 255
"""Of an event, in one byte."""
TIMESTAMP_SIZE = 2
"""Bytes."""


@dataclass(frozen=True)
class XcpView:
    """What the XCP slave is configured with.

    Attributes:
        timestamp_ticks: units that the clock of the timestamps advances with each run of the task.
        timestamp_mode: size and unit, as GET_DAQ_RESOLUTION_INFO reports them.
        event_cycle: period of the task in the event's unit; 0 where no unit fits it.
    """

    receive_id: str
    transmit_id: str
    timestamp_ticks: int
    timestamp_mode: str
    timestamp_text: str
    event_cycle: int
    event_unit: int
    event_text: str


def xcp_view(config: Config) -> XcpView:
    """The view of the configured identifiers and sampling time (1 to 100 ms)."""
    period = round(config.controller.sampling_time_s * 1e9)
    # The longest unit lets two bytes reach furthest; a period that is no whole number of 10 us is told to the nearest.
    unit = next((code for code in range(MILLISECOND, TEN_MICROSECONDS, -1) if period % 10**code == 0), TEN_MICROSECONDS)
    cycle_unit = next((code for code in range(MILLISECOND, -1, -1) if period % 10**code == 0), 0)
    cycle = period // 10**cycle_unit
    fits = cycle <= CYCLE_MAX
    return XcpView(
        receive_id=f"0x{config.can.xcp_receive_id:03X}",
        transmit_id=f"0x{config.can.xcp_transmit_id:03X}",
        timestamp_ticks=round(period / 10**unit),
        timestamp_mode=f"0x{unit << 4 | TIMESTAMP_SIZE:02X}u",
        timestamp_text=UNITS[unit],
        event_cycle=cycle if fits else 0,
        event_unit=cycle_unit if fits else MILLISECOND,
        event_text=f"in units of {UNITS[cycle_unit]}" if fits else "0, because no whole number of any unit fits a byte",
    )

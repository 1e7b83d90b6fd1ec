"""View model of XCP: the timing of the native ECU's slave, and the slave that the A2L describes (`IF_DATA XCP`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from codegen.configuration import Config, Xcp
from codegen.configuration.xcp import IDENTIFICATION_BYTES, OPTIONAL_COMMANDS, TimestampUnit

UNITS: tuple[str, ...] = get_args(TimestampUnit)
"""Units of time by code: 10^code ns."""
MILLISECOND, TEN_MICROSECONDS = 6, 4

CYCLE_MAX = 255
"""Largest period of an event, in one byte."""
TIMESTAMP_SIZE = 2
"""Bytes of a timestamp of the native ECU."""

ENTRY_BYTES_MAX = 255
"""Largest size of a measurement in a packet, in one byte."""


@dataclass(frozen=True)
class XcpTiming:
    """Timing of the native ECU's slave, in units of the standard.

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


@dataclass(frozen=True)
class XcpView:
    """The slave that the A2L describes: `[xcp]`, completed by the timing of the task.

    Attributes:
        options: the table `[xcp]`.
        timing: see `XcpTiming`.
        task: name of the task's function.
        bitrate: bit/s.
    """

    options: Xcp
    timing: XcpTiming
    task: str
    bitrate: int
    commands: tuple[tuple[str, int], ...] = tuple(OPTIONAL_COMMANDS.items())

    @property
    def data_bitrate(self) -> int | None:
        """Bit rate of the data phase of CAN FD in bit/s; None: classical CAN."""
        return None if self.options.data_bitrate_kbit_s is None else round(self.options.data_bitrate_kbit_s * 1e3)

    @property
    def ids(self) -> tuple[int, int]:
        """Identifiers of commands and answers; bit 31 marks one of 29 bits."""
        return self.options.bus_id(self.options.receive_id), self.options.bus_id(self.options.transmit_id)

    @property
    def frames_text(self) -> str:
        """Kind of the frames, in words."""
        bits = 29 if self.options.extended_ids else 11
        return f"{'CAN FD' if self.options.is_fd else 'classical CAN'} with {bits}-bit identifiers"

    @property
    def has_measuring(self) -> bool:
        """Whether the slave sends lists of measurements."""
        return self.options.has("WRITE_DAQ")

    @property
    def has_pages(self) -> bool:
        """Whether the calibration has a working page and a reference page."""
        return self.options.has("SET_CAL_PAGE")

    @property
    def entry_bytes_max(self) -> int:
        """Largest size of a measurement in a packet, in bytes."""
        return min(self.options.max_dto - IDENTIFICATION_BYTES[self.options.identification], ENTRY_BYTES_MAX)

    @property
    def identification(self) -> str:
        """Identification field, as the A2L spells it."""
        return self.options.identification.replace("-", "_").upper()

    @property
    def event_name(self) -> str:
        """Name of the event after each run of the task."""
        return self.options.event_name or self.task

    @property
    def event_short_name(self) -> str:
        """Short name of the event, at most eight characters."""
        return self.event_name.removeprefix("task_")[:8]

    @property
    def timestamp_size(self) -> str:
        """Size of a timestamp, as the A2L spells it."""
        return {1: "SIZE_BYTE", 2: "SIZE_WORD", 4: "SIZE_DWORD"}[self.options.timestamp_bytes]

    @property
    def timestamp_unit(self) -> str:
        """Unit of a timestamp, as the A2L spells it."""
        unit = self.options.timestamp_unit or UNITS[self.timing.timestamp_unit]
        return f"UNIT_{unit.replace(' ', '').upper()}"


def xcp_view(config: Config, task: str) -> XcpView:
    """Return the view of `[xcp]` for a task with this name."""
    bitrate = config.xcp.bitrate_kbit_s or config.can.bitrate_kbit_s
    return XcpView(config.xcp, xcp_timing(config), task, round(bitrate * 1e3))

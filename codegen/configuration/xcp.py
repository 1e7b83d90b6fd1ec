"""The table `[xcp]` of `ars.toml`: the XCP slave that the A2L describes, and the frames of the native ECU's slave.

Names and codes of commands are those of ASAM MCD-1 XCP, protocol layer 1.1.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from codegen.configuration.section import Meaning, Range, Section
from codegen.errors import suggestion


def _codes(table: str) -> dict[str, int]:
    return {name: int(code, 16) for name, _, code in (entry.partition("=") for entry in table.split())}


MANDATORY_COMMANDS = _codes("CONNECT=FF DISCONNECT=FE GET_STATUS=FD SYNCH=FC")
"""Codes of the commands that every slave has. An A2L does not list them."""

NATIVE_COMMANDS = _codes("""
    GET_COMM_MODE_INFO=FB GET_ID=FA SET_MTA=F6 UPLOAD=F5 SHORT_UPLOAD=F4 BUILD_CHECKSUM=F3 DOWNLOAD=F0
    SET_CAL_PAGE=EB GET_CAL_PAGE=EA GET_PAG_PROCESSOR_INFO=E9 GET_SEGMENT_INFO=E8 GET_PAGE_INFO=E7 COPY_CAL_PAGE=E4
    SET_DAQ_PTR=E2 WRITE_DAQ=E1 SET_DAQ_LIST_MODE=E0 GET_DAQ_LIST_MODE=DF START_STOP_DAQ_LIST=DE START_STOP_SYNCH=DD
    GET_DAQ_CLOCK=DC GET_DAQ_PROCESSOR_INFO=DA GET_DAQ_RESOLUTION_INFO=D9 GET_DAQ_EVENT_INFO=D7
    FREE_DAQ=D6 ALLOC_DAQ=D5 ALLOC_ODT=D4 ALLOC_ODT_ENTRY=D3
""")
"""Codes of the optional commands of the native ECU's slave, `templates/linux/ars_xcp.c`; a test sends it every code."""

_OTHER_COMMANDS = _codes("""
    SET_REQUEST=F9 GET_SEED=F8 UNLOCK=F7 TRANSPORT_LAYER_CMD=F2 USER_CMD=F1
    DOWNLOAD_NEXT=EF DOWNLOAD_MAX=EE SHORT_DOWNLOAD=ED MODIFY_BITS=EC SET_SEGMENT_MODE=E6 GET_SEGMENT_MODE=E5
    CLEAR_DAQ_LIST=E3 READ_DAQ=DB GET_DAQ_LIST_INFO=D8
    PROGRAM_START=D2 PROGRAM_CLEAR=D1 PROGRAM=D0 PROGRAM_RESET=CF GET_PGM_PROCESSOR_INFO=CE GET_SECTOR_INFO=CD
    PROGRAM_PREPARE=CC PROGRAM_FORMAT=CB PROGRAM_NEXT=CA PROGRAM_MAX=C9 PROGRAM_VERIFY=C8 WRITE_DAQ_MULTIPLE=C7
""")
OPTIONAL_COMMANDS = dict(sorted((NATIVE_COMMANDS | _OTHER_COMMANDS).items(), key=lambda entry: -entry[1]))
"""Codes of all optional commands, in the order of the standard."""

REQUIRED_BY = {
    "UPLOAD": ("SET_MTA",),
    "DOWNLOAD": ("SET_MTA",),
    "SET_CAL_PAGE": ("GET_CAL_PAGE",),
    "GET_SEED": ("UNLOCK",),
    "WRITE_DAQ": (
        *("SET_DAQ_PTR", "SET_DAQ_LIST_MODE", "START_STOP_DAQ_LIST", "START_STOP_SYNCH"),
        *("FREE_DAQ", "ALLOC_DAQ", "ALLOC_ODT", "ALLOC_ODT_ENTRY"),
    ),
}
"""Commands that another one is useless without. Lists of measurements are dynamic, so they need those that allocate."""

CLASSICAL_BYTES = 8
"""Largest frame of classical CAN, in bytes."""

IDENTIFICATION_BYTES = {"absolute": 1, "relative-byte": 2, "relative-word": 3, "relative-word-aligned": 4}
"""Bytes at the head of a measurement packet by its type of identification field."""

Identification = Literal["absolute", "relative-byte", "relative-word", "relative-word-aligned"]
TimestampUnit = Literal["1 ns", "10 ns", "100 ns", "1 us", "10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s"]


def _check_command(name: str) -> str:
    if name in MANDATORY_COMMANDS:
        raise ValueError(f"every slave has {name}; remove it from the list")
    if name not in OPTIONAL_COMMANDS:
        near = suggestion(name[:40], OPTIONAL_COMMANDS) or "; use the names of ASAM MCD-1 XCP, such as SET_MTA"
        raise ValueError(f"{name[:40]!r} is no command of XCP{near}")
    return name


def _check_text(text: str) -> str:
    if not re.match(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,99}\Z", text, re.ASCII):
        raise ValueError(f"{text[:40]!r} does not fit an A2L; use 1 to 100 ASCII letters, digits, ' ', '.', '_' or '-'")
    return text


Text = Annotated[str, AfterValidator(_check_text)]
Identifier = Annotated[int, Field(ge=0, le=0x1FFF_FFFF)]


class Xcp(Section):
    """XCP on CAN. The native ECU follows the identifiers, the kind of frames and the sizes of packets.

    The other keys only change the A2L. The defaults describe the slave of the native ECU. For an ECU with its own slave, change
    the keys in which that one differs.
    """

    receive_id: Annotated[Identifier, Meaning("identifier of the master's commands (CAN_ID_MASTER of the A2L)")] = 0x6A0
    transmit_id: Annotated[Identifier, Meaning("identifier of answers and measurements (CAN_ID_SLAVE)")] = 0x6A1
    extended_ids: Annotated[bool, Meaning("whether both have 29 bits")] = False
    bitrate_kbit_s: Annotated[
        Annotated[float, Range(10.0, 1000.0, "kbit/s")] | None, Meaning("bit rate, by default that of `[can]`")
    ] = None
    data_bitrate_kbit_s: Annotated[
        Annotated[float, Range(10.0, 20000.0, "kbit/s")] | None,
        Meaning("bit rate of the data phase of CAN FD; not given: classical CAN"),
    ] = None
    frame_bytes_max: Annotated[
        Literal[8, 12, 16, 20, 24, 32, 48, 64], Meaning("bytes of the largest frame (MAX_DLC); above 8 with CAN FD")
    ] = 8
    frames_are_full: Annotated[bool, Meaning("whether the master must pad its frames to the largest length")] = False
    max_cto: Annotated[int, Field(ge=8, le=64), Meaning("bytes of the largest command or answer")] = 8
    max_dto: Annotated[int, Field(ge=8, le=64), Meaning("bytes of the largest measurement packet")] = 8
    timeout_ms: Annotated[int, Field(ge=1, le=65535), Meaning("time in ms in which the slave answers (T1 to T7)")] = 1000
    seed_and_key_function: Annotated[
        Text | None, Meaning("file of the function that computes the key, for a slave with GET_SEED and UNLOCK")
    ] = None
    commands: Annotated[
        list[Annotated[str, AfterValidator(_check_command)]],
        Meaning("optional commands that the slave has, by their names in ASAM MCD-1 XCP; a calibration tool uses no others"),
    ] = list(NATIVE_COMMANDS)  # noqa: RUF012 - pydantic copies it
    event_channel: Annotated[int, Field(ge=0, le=65535), Meaning("number of the event after each run of the task")] = 0
    event_name: Annotated[Text | None, Meaning("its name, by default that of the task's function")] = None
    daq_lists_max: Annotated[int, Field(ge=1, le=255), Meaning("largest number of measurement lists")] = 8
    identification: Annotated[Identification, Meaning("identification field of measurement packets")] = "absolute"
    has_prescaler: Annotated[bool, Meaning("whether a list can be sent in every n-th event only")] = True
    timestamp_bytes: Annotated[Literal[0, 1, 2, 4], Meaning("size of a timestamp; 0: the slave has none")] = 2
    timestamp_unit: Annotated[
        TimestampUnit | None, Meaning("unit of the timestamp; by default the longest one up to 1 ms that counts runs exactly")
    ] = None

    @property
    def is_fd(self) -> bool:
        """Whether packets are sent in frames of CAN FD."""
        return self.data_bitrate_kbit_s is not None

    def bus_id(self, identifier: int) -> int:
        """Return an identifier as in A2L and SocketCAN: bit 31 marks one of 29 bits."""
        return identifier | 0x8000_0000 if self.extended_ids else identifier

    def has(self, *commands: str) -> bool:
        """Return whether the slave has all of these optional commands."""
        return all(name in self.commands for name in commands)

    @model_validator(mode="after")
    def _ids(self) -> Self:
        if self.receive_id == self.transmit_id:
            raise ValueError(f"receive_id and transmit_id are the same, 0x{self.receive_id:X}; change one")
        for key, identifier in (("receive_id", self.receive_id), ("transmit_id", self.transmit_id)):
            if identifier > 0x7FF and not self.extended_ids:
                raise ValueError(f"{key} is 0x{identifier:X}, beyond 11 bits; set extended_ids = true, or use at most 0x7FF")
        return self

    @model_validator(mode="after")
    def _frames(self) -> Self:
        if not self.is_fd and self.frame_bytes_max > CLASSICAL_BYTES:
            raise ValueError(f"frame_bytes_max is {self.frame_bytes_max} without CAN FD; give data_bitrate_kbit_s, or 8 bytes")
        for key, size in (("max_cto", self.max_cto), ("max_dto", self.max_dto)):
            if size > self.frame_bytes_max:
                most = self.frame_bytes_max
                raise ValueError(f"{key} is {size}, more than frame_bytes_max, {most}; lower it, or enlarge frame_bytes_max")
        return self

    @model_validator(mode="after")
    def _commands_are_complete(self) -> Self:
        if twice := next((name for name in self.commands if self.commands.count(name) > 1), None):
            raise ValueError(f"commands has {twice} twice; remove one")
        for command in self.commands:
            if missing := next((name for name in REQUIRED_BY.get(command, ()) if name not in self.commands), None):
                raise ValueError(f"commands has {command}, but not {missing}; add it, or remove both")
        if self.seed_and_key_function is not None and not self.has("GET_SEED"):
            raise ValueError("seed_and_key_function without the command GET_SEED; add GET_SEED and UNLOCK to commands")
        return self

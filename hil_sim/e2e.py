"""End-to-end protection of frames: AUTOSAR E2E profile 1, variant 1A, both sides, and the state of a message (E2E_SMCheck).

After AUTOSAR FO R20-11, E2E Protocol Specification (PRS_E2EProtocol, document 849), section 6.3. A frame of eight bytes holds
a CRC-8 in byte 0 and a counter, 0 to 14, in the low nibble of byte 1. The data id, known to both sides and never sent, goes
into the CRC before the data, so that a frame under a wrong identifier does not pass.
"""

from __future__ import annotations

import enum
from collections import deque

from codegen.configuration.can import FRAME_BYTES, E2e

POLYNOMIAL = 0x1D
"""CRC-8 SAE J1850. Profile 1 takes 0x00 for start value and final XOR (PRS_E2E_00083), unlike the bare CRC, which has 0xFF."""

LARGEST_COUNTER = 14
"""15 is skipped (PRS_E2E_00075)."""


class E2eStatus(enum.IntEnum):
    """Result of the check of a cycle; values of E2E_P01CheckStatusType and of the C enum `<prefix>_e2e_status_t`."""

    OK = 0
    NO_NEW_DATA = 1
    WRONG_CRC = 2
    SYNC = 3
    INITIAL = 4
    REPEATED = 5
    OK_SOME_LOST = 6
    WRONG_SEQUENCE = 7


def _crc_of_byte(value: int) -> int:
    for _ in range(8):
        value = (value << 1) ^ POLYNOMIAL if value & 0x80 else value << 1
    return value & 0xFF


_TABLE = bytes(_crc_of_byte(value) for value in range(256))


def crc(data_id: int, data: bytes) -> int:
    """Return the CRC of a frame, over the data id (16 bits, low byte first) and all bytes of `data` except the first, which
    holds the CRC."""
    result = 0
    for byte in (data_id & 0xFF, data_id >> 8 & 0xFF, *data[1:]):
        result = _TABLE[result ^ byte]
    return result


def protect(data_id: int, counter: int, data: bytes) -> bytes:
    """Return `data` (8 bytes) with counter and CRC (PRS_E2E_00195). The high nibble of byte 1 is unchanged.

    Raises:
        ValueError: not eight bytes, or a counter outside 0 to 14.
    """
    if len(data) != FRAME_BYTES:
        raise ValueError(f"{len(data)} bytes; a protected frame has {FRAME_BYTES}")
    if not 0 <= counter <= LARGEST_COUNTER:
        raise ValueError(f"counter {counter} is not within 0 to {LARGEST_COUNTER}")
    body = bytes((0, data[1] & 0xF0 | counter)) + data[2:]
    return bytes((crc(data_id, body),)) + body[1:]


def next_counter(counter: int) -> int:
    """Return the counter of the next frame; 0 follows 14."""
    return (counter + 1) % (LARGEST_COUNTER + 1)


class Receiver:
    """State of the reception of one message: function E2E_P01Check (PRS_E2E_00196 and the figures of 6.3.4).

    Called in every cycle: `check` for each frame that came, in their order, or `no_new_data` where none came.
    """

    def __init__(self, settings: E2e) -> None:
        self._settings = settings
        self._last_valid_counter = 0
        self._max_delta_counter = 0
        self._wait_for_first_data = True
        self._sync_counter = 0
        self._no_new_or_repeated = 0

    def no_new_data(self) -> E2eStatus:
        """Check a cycle with a frame of eight bytes."""
        self._tolerate_one_more()
        self._count_no_new_or_repeated()
        return E2eStatus.NO_NEW_DATA

    def check(self, data_id: int, data: bytes) -> E2eStatus:
        """Check a cycle with a frame of eight bytes.

        A counter of 15 counts as a wrong CRC. The specification treats it as a wrong input (E2E_E_INPUTERR_WRONG), tested
        before the CRC. The state machine maps that to E2E_P_ERROR (SWS_E2E_00384), as it does WRONG_CRC (SWS_E2E_00383). A
        frame of another length is a wrong input too.
        """
        self._tolerate_one_more()
        if len(data) != FRAME_BYTES:
            return E2eStatus.WRONG_CRC
        received = data[1] & 0x0F
        if received > LARGEST_COUNTER or crc(data_id, data) != data[0]:
            return E2eStatus.WRONG_CRC
        if self._wait_for_first_data:
            self._wait_for_first_data = False
            self._accept(received)
            return E2eStatus.INITIAL
        return self._check_sequence(received)

    def _check_sequence(self, received: int) -> E2eStatus:
        delta = (received - self._last_valid_counter) % (LARGEST_COUNTER + 1)
        if delta == 0:
            self._count_no_new_or_repeated()
            return E2eStatus.REPEATED
        if delta > self._max_delta_counter:
            self._no_new_or_repeated = 0
            self._sync_counter = self._settings.sync_counter_init
            if self._sync_counter > 0:  # without synchronisation the tolerance grows until the counter is within it
                self._accept(received)
            return E2eStatus.WRONG_SEQUENCE
        self._accept(received)
        silent_too_long = self._no_new_or_repeated > self._settings.max_no_new_or_repeated_data
        self._no_new_or_repeated = 0
        if silent_too_long:
            self._sync_counter = self._settings.sync_counter_init
            return E2eStatus.SYNC
        if self._sync_counter > 0:
            self._sync_counter -= 1
            return E2eStatus.SYNC
        return E2eStatus.OK if delta == 1 else E2eStatus.OK_SOME_LOST

    def _accept(self, counter: int) -> None:
        self._max_delta_counter = self._settings.max_delta_counter_init
        self._last_valid_counter = counter

    def _tolerate_one_more(self) -> None:
        # At every call, so that the cycle of a good frame counts too: with an initial value of 1, one lost frame is tolerated.
        self._max_delta_counter = min(self._max_delta_counter + 1, LARGEST_COUNTER)

    def _count_no_new_or_repeated(self) -> None:
        self._no_new_or_repeated = min(self._no_new_or_repeated + 1, LARGEST_COUNTER)


class E2eState(enum.IntEnum):
    """State of a message; values of the C enum `<prefix>_e2e_state_t`."""

    NO_DATA = 0
    INIT = 1
    VALID = 2
    INVALID = 3


class Supervision:
    """E2E state machine of one message: E2E_SMCheck of PRS_E2EProtocol (SWS_E2E_00345, SWS_E2E_00466), once for each cycle.

    Attributes:
        state: after the last cycle. Only in VALID may data be used.
    """

    def __init__(self, settings: E2e) -> None:
        self._settings = settings
        self._good: deque[bool] = deque(maxlen=settings.window_size)
        self._damaged: deque[bool] = deque(maxlen=settings.window_size)
        self.state = E2eState.NO_DATA

    def step(self, is_good: bool, is_damaged: bool) -> E2eState:
        """Close a cycle and return the state.

        Args:
            is_good: a frame came whose data may be used.
            is_damaged: a frame came with a wrong CRC or length.
        """
        if self.state is E2eState.NO_DATA:
            if is_good:
                self.state = E2eState.INIT
            return self.state
        self._good.append(is_good)
        self._damaged.append(is_damaged)
        name = self.state.name.lower()
        has_enough = sum(self._good) >= getattr(self._settings, f"min_ok_state_{name}")
        if sum(self._damaged) > getattr(self._settings, f"max_error_state_{name}"):
            self.state = E2eState.INVALID
        elif has_enough:
            self.state = E2eState.VALID
        elif self.state is E2eState.VALID:
            self.state = E2eState.INVALID
        return self.state

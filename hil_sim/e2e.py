"""AUTOSAR E2E protection of frames in Python, from the same table as the generated C but by other means.

After AUTOSAR FO R20-11, E2E Protocol Specification (PRS_E2EProtocol, document 849). A frame starts with a CRC and a counter.
The data id, known to both sides, goes into the CRC, so that a frame under a wrong identifier does not pass.
"""

from __future__ import annotations

import enum
from collections import deque
from functools import lru_cache

from codegen.configuration.can import FRAME_BYTES, E2e
from codegen.configuration.e2e_profiles import DEFAULT_PROFILE, Crc, DataId, Profile

LARGEST_COUNTER = DEFAULT_PROFILE.counter_max
"""15 is skipped in profile 1 (PRS_E2E_00075)."""


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


@lru_cache
def _table(kind: Crc) -> tuple[int, ...]:
    """Return the remainder of each byte."""
    mask = (1 << kind.width) - 1

    def remainder(value: int) -> int:
        value <<= kind.width - 8
        for _ in range(8):
            value = (value << 1) ^ kind.polynomial if value >> (kind.width - 1) & 1 else value << 1
        return value & mask

    return tuple(remainder(value) for value in range(256))


def _data_id_bytes(profile: Profile, data_id: DataId, counter: int) -> tuple[int, ...]:
    """Return the bytes of the data id in the CRC."""
    if isinstance(data_id, bytes):
        return (data_id[counter],)
    low, high = data_id & 0xFF, data_id >> 8 & 0xFF
    return {"both": (low, high), "alternating": ((low, high)[counter & 1],), "nibble": (low, 0)}[profile.data_id_mode]


def crc(data_id: DataId, data: bytes, profile: Profile = DEFAULT_PROFILE) -> int:
    """Return the CRC of a frame, over the data id and all bytes of `data` except the first ones, which hold the CRC."""
    kind, table = profile.crc, _table(profile.crc)
    number, contents = _data_id_bytes(profile, data_id, received_counter(data, profile)), data[profile.crc_bytes :]
    result, shift, mask = kind.start, kind.width - 8, (1 << kind.width) - 1
    for byte in (*number, *contents) if profile.has_data_id_first else (*contents, *number):
        result = (result << 8 & mask) ^ table[result >> shift ^ byte]
    return result ^ kind.final_xor


def received_counter(data: bytes, profile: Profile = DEFAULT_PROFILE) -> int:
    """Return the counter of a frame."""
    return data[profile.counter_byte] & ((1 << profile.counter_length) - 1)


def protect(data_id: DataId, counter: int, data: bytes, profile: Profile = DEFAULT_PROFILE) -> bytes:
    """Return `data` with CRC, counter (PRS_E2E_00195) and, in the variants C, the nibble of the data id.

    Other bits are unchanged.

    Raises:
        ValueError: a frame without room for both, or a counter out of range.
    """
    if not profile.counter_byte < len(data) <= profile.data_bytes_max:
        raise ValueError(
            f"{len(data)} bytes; a frame of E2E {profile.title} has {profile.counter_byte + 1} to {profile.data_bytes_max}"
        )
    if not 0 <= counter <= profile.counter_max:
        raise ValueError(f"counter {counter} is not within 0 to {profile.counter_max}")
    body = bytearray(data)
    kept = 0xFF << profile.counter_length & 0xFF
    body[profile.counter_byte] = body[profile.counter_byte] & kept | counter
    if profile.nibble_bits and isinstance(data_id, int):
        body[1] = data_id >> 4 & 0xF0 | counter
    body[: profile.crc_bytes] = crc(data_id, bytes(body), profile).to_bytes(profile.crc_bytes, "little")
    return bytes(body)


def next_counter(counter: int, profile: Profile = DEFAULT_PROFILE) -> int:
    """Return the counter of the next frame; 0 follows the largest one."""
    return (counter + 1) % profile.counter_count


class Receiver:
    """State of the reception of one message: function E2E_P01Check (PRS_E2E_00196 and the figures of 6.3.4), or that of another
    profile.

    Called in every cycle: `check` for each frame that came, in their order, or `no_new_data` where none came.

    In profiles 5 and 11 the window of the counter is constant. The first intact frame is INITIAL for them too. The
    specification compares it with the counter before 0, so that most are WRONG_SEQUENCE. Its state machine goes from NO_DATA
    to INIT with either result.
    """

    def __init__(self, settings: E2e, frame_bytes: int = FRAME_BYTES) -> None:
        self._settings, self._profile, self.frame_bytes = settings, settings.definition, frame_bytes
        self._last_valid_counter = 0
        self._max_delta_counter = 0
        self._wait_for_first_data = True
        self._sync_counter = 0
        self._no_new_or_repeated = 0

    def no_new_data(self) -> E2eStatus:
        """Check a cycle without a frame."""
        self._tolerate_one_more()
        self._count_no_new_or_repeated()
        return E2eStatus.NO_NEW_DATA

    def check(self, data_id: DataId, data: bytes) -> E2eStatus:
        """Check a cycle with a frame.

        A counter of 15 counts as a wrong CRC. The specification treats it as a wrong input (E2E_E_INPUTERR_WRONG), tested
        before the CRC. The state machine maps that to E2E_P_ERROR (SWS_E2E_00384), as it does WRONG_CRC (SWS_E2E_00383). A
        frame of another length is a wrong input too.
        """
        self._tolerate_one_more()
        profile = self._profile
        if len(data) != self.frame_bytes:
            return E2eStatus.WRONG_CRC
        received = received_counter(data, profile)
        if received > profile.counter_max or crc(data_id, data, profile) != int.from_bytes(data[: profile.crc_bytes], "little"):
            return E2eStatus.WRONG_CRC
        if profile.nibble_bits and isinstance(data_id, int) and data[1] >> 4 != data_id >> 8:
            return E2eStatus.WRONG_CRC
        if self._wait_for_first_data:
            self._wait_for_first_data = False
            self._accept(received)
            return E2eStatus.INITIAL
        return self._check_sequence(received)

    def _check_sequence(self, received: int) -> E2eStatus:
        delta = (received - self._last_valid_counter) % self._profile.counter_count
        if not self._profile.has_synchronisation:
            self._last_valid_counter = received
            if delta == 0:
                return E2eStatus.REPEATED
            if delta > self._settings.max_delta_counter:
                return E2eStatus.WRONG_SEQUENCE
            return E2eStatus.OK if delta == 1 else E2eStatus.OK_SOME_LOST
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
        if self._profile.has_synchronisation:
            self._max_delta_counter = min(self._max_delta_counter + 1, self._profile.counter_max)

    def _count_no_new_or_repeated(self) -> None:
        if self._profile.has_synchronisation:
            self._no_new_or_repeated = min(self._no_new_or_repeated + 1, self._profile.counter_max)


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

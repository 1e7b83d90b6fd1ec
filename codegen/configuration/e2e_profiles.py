"""Table of the AUTOSAR E2E profiles: CRC, counter, data id and layout of the header.

After AUTOSAR FO R20-11, E2E Protocol Specification (PRS_E2EProtocol, document 849), chapter 6. The generated C with its
contracts, the DBC, the ARXML and the bench derive the protection from this table.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

ProfileName = Literal["1A", "1B", "1C", "2", "5", "11A", "11C"]
DataIdMode = Literal["both", "alternating", "nibble", "list"]
"""Part of the data id in the CRC: both bytes; the low byte with an even counter, else the high byte; the low byte and a zero,
while the frame carries the low four bits of the high byte; the byte that the counter selects from a list of 16."""

DataId = int | bytes
"""Data id of a message: 16 bits, or the list of 16 bytes of profile 2."""

DATA_ID_COUNT = 16
"""Data ids in the list of profile 2, one for each counter."""


@dataclass(frozen=True)
class Crc:
    """A CRC that processes the most significant bit first.

    Attributes:
        name: name in the AUTOSAR specification of the CRC library, in words.
        width: number of bits.
        polynomial, start, final_xor: parameters as in that specification.
    """

    name: str
    width: int
    polynomial: int
    start: int
    final_xor: int

    @property
    def polynomial_text(self) -> str:
        """The polynomial in hexadecimal digits."""
        return f"0x{self.polynomial:0{self.width // 4}X}"

    def shifted(self, byte: int) -> int:
        """Return the remainder of a byte followed by `width` zero bits: an entry of the table of 256."""
        remainder, top = byte << (self.width - 8), 1 << (self.width - 1)
        for _ in range(8):
            remainder = (remainder << 1) ^ (self.polynomial if remainder & top else 0)
            remainder &= 2 * top - 1
        return remainder

    def of(self, data: Iterable[int]) -> int:
        """Return the CRC of bytes."""
        result, mask = self.start, (1 << self.width) - 1
        for byte in data:
            result = (result << 8 & mask) ^ self.shifted(result >> (self.width - 8) ^ byte)
        return result ^ self.final_xor


SAE_J1850 = Crc("CRC-8", 8, 0x1D, 0x00, 0x00)
"""Profiles 1 and 11 take 0x00 for start value and final XOR (PRS_E2E_00083), unlike the bare CRC, which has 0xFF."""
H2F = Crc("CRC-8H2F", 8, 0x2F, 0xFF, 0xFF)
CCITT = Crc("CRC-16", 16, 0x1021, 0xFFFF, 0x0000)


@dataclass(frozen=True)
class Profile:
    """An E2E profile with its variant. All of them have the CRC at the start of the frame.

    Attributes:
        name: value of the key `profile`.
        category: name of the profile in AUTOSAR models.
        crc: the CRC.
        counter_start, counter_length: bits of the counter in the frame.
        counter_max: largest counter; 0 follows it.
        data_id_mode: part of the data id in the CRC.
        has_data_id_first: the data id precedes the data in the CRC.
        data_bytes_max: largest protected frame that an AUTOSAR configuration may have.
        has_synchronisation: the receiver synchronises the counter after a gap, and its window grows in each cycle without a new
            frame. Otherwise the window is constant.
    """

    name: ProfileName
    category: str
    crc: Crc
    counter_start: int
    counter_length: int
    counter_max: int
    data_id_mode: DataIdMode
    has_data_id_first: bool
    data_bytes_max: int
    has_synchronisation: bool

    @property
    def number(self) -> str:
        """Number of the profile, without its variant."""
        return self.name.rstrip("ABC")

    @property
    def has_variants(self) -> bool:
        """Whether a configuration places CRC and counter and selects the part of the data id. Otherwise they are fixed."""
        return self.name != self.number

    @property
    def title(self) -> str:
        """Name in comments."""
        variant = f", variant {self.name}" if self.has_variants else ""
        return f"profile {self.number}{variant}"

    @property
    def crc_bytes(self) -> int:
        """Bytes of the CRC, from byte 0 on."""
        return self.crc.width // 8

    @property
    def crc_bits(self) -> frozenset[int]:
        """Bits of the CRC in the frame."""
        return frozenset(range(self.crc.width))

    @property
    def counter_byte(self) -> int:
        """Byte of the counter. A counter of four bits is in its low nibble."""
        return self.counter_start // 8

    @property
    def counter_bits(self) -> frozenset[int]:
        """Bits of the counter in the frame."""
        return frozenset(range(self.counter_start, self.counter_start + self.counter_length))

    @property
    def nibble_bits(self) -> frozenset[int]:
        """Bits of the data id in the frame; empty if the frame carries none."""
        return frozenset(range(12, 16)) if self.data_id_mode == "nibble" else frozenset()

    @property
    def header_bits(self) -> frozenset[int]:
        """Bits of CRC, counter and data id in the frame."""
        return self.crc_bits | self.counter_bits | self.nibble_bits

    @property
    def counter_count(self) -> int:
        """Number of different counters."""
        return self.counter_max + 1

    @property
    def has_invalid_counter(self) -> bool:
        """Whether the bits of the counter can carry a value above its largest one."""
        return self.counter_max < (1 << self.counter_length) - 1

    def data_id_bytes(self, data_id: DataId, counter: int) -> tuple[int, ...]:
        """Return the bytes of the data id in the CRC of a frame with a counter."""
        if isinstance(data_id, bytes):
            return (data_id[counter],)
        low, high = data_id & 0xFF, data_id >> 8
        return {"both": (low, high), "alternating": ((low, high)[counter % 2],), "nibble": (low, 0)}[self.data_id_mode]

    def crc_of(self, data_id: DataId, data: bytes) -> int:
        """Return the CRC of a frame, over its data id and all bytes of `data` except the first ones, which hold the CRC."""
        number, contents = self.data_id_bytes(data_id, data[self.counter_byte] & self.counter_mask), data[self.crc_bytes :]
        return self.crc.of((*number, *contents) if self.has_data_id_first else (*contents, *number))

    @property
    def counter_mask(self) -> int:
        """Bits of the counter in its byte."""
        return (1 << self.counter_length) - 1

    def nibble(self, data_id: DataId) -> int:
        """Return the bits of the data id that a frame carries; 0 if it carries none."""
        return data_id >> 8 if self.nibble_bits and isinstance(data_id, int) else 0

    @property
    def data_id_max(self) -> int:
        """Largest data id. With a nibble, the frame carries 12 bits of it in all."""
        return 0x0FFF if self.data_id_mode == "nibble" else 0xFFFF


def _profile_1(name: ProfileName, mode: DataIdMode) -> Profile:
    return Profile(name, "PROFILE_01", SAE_J1850, 8, 4, 14, mode, True, 30, True)


def _profile_11(name: ProfileName, mode: DataIdMode) -> Profile:
    return Profile(name, "PROFILE_11", SAE_J1850, 8, 4, 14, mode, True, 30, False)


PROFILES: dict[ProfileName, Profile] = {
    each.name: each
    for each in (
        _profile_1("1A", "both"),
        _profile_1("1B", "alternating"),
        _profile_1("1C", "nibble"),
        Profile("2", "PROFILE_02", H2F, 8, 4, 15, "list", False, 32, True),
        Profile("5", "PROFILE_05", CCITT, 16, 8, 255, "both", False, 4096, False),
        _profile_11("11A", "both"),
        _profile_11("11C", "nibble"),
    )
}
"""All profiles by the value of the key `profile`."""

DEFAULT_PROFILE = PROFILES["1A"]


@functools.lru_cache
def shared_counters(profile: Profile, one: DataId, other: DataId) -> tuple[int, ...]:
    """Return the counters whose frames under one data id pass the check of a receiver with the other one.

    A CRC is linear, so the contents of frames of equal length do not matter: the check cannot distinguish two data ids if the
    CRC of their own bytes is equal. With both bytes in a CRC of eight bits, each data id has 255 others of that kind.
    """
    if profile.nibble(one) != profile.nibble(other):
        return ()

    def crc(data_id: DataId, counter: int) -> int:
        return profile.crc.of(profile.data_id_bytes(data_id, counter))

    return tuple(counter for counter in range(profile.counter_count) if crc(one, counter) == crc(other, counter))

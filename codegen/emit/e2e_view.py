"""View model of the E2E protection: expressions and phrases of the generated C, from the table of profiles."""

from __future__ import annotations

from dataclasses import dataclass

from codegen.configuration.e2e_profiles import DEFAULT_PROFILE, Profile
from codegen.emit.text import lines_of

EXAMPLE_ID = 0x0123
"""Data id of the self-test's frames."""

_COVERED = {
    "both": "the data id",
    "alternating": "the low byte of the data id with an even counter, else its high byte,",
    "nibble": "the low byte of the data id, a zero",
    "list": "the data id of the counter",
}
"""Part of the data id in the CRC, in words."""


@dataclass(frozen=True)
class E2eView:
    """A profile in the words and expressions of the templates.

    Attributes:
        profile: entry in the table of profiles.
        frame_bytes: bytes of a frame.
        lists: data ids of each message in profile 2, else empty.
        settings: phrase with the parameters of the receiver.
    """

    profile: Profile
    frame_bytes: int
    lists: tuple[bytes, ...]
    settings: str

    @property
    def crc_type(self) -> str:
        """C type of the CRC."""
        return f"uint{self.profile.crc.width}_t"

    @property
    def crc_table(self) -> tuple[str, ...]:
        """Lines of the table of the CRC."""
        digits = self.profile.crc.width // 4
        return lines_of([f"0x{self.profile.crc.shifted(byte):0{digits}X}u" for byte in range(256)])

    @property
    def data_id_lists(self) -> tuple[str, ...]:
        """Elements of the list of data ids of each message."""
        return tuple(", ".join(f"0x{each:02X}u" for each in each_list) for each_list in self.lists)

    @property
    def covered_bytes(self) -> range:
        """Bytes of the frame in the CRC."""
        return range(self.profile.crc_bytes, self.frame_bytes)

    def step(self, byte: str) -> str:
        """Return the C expression that continues `crc` with a byte."""
        if self.profile.crc.width == 8:
            return f"crc_table[crc ^ {byte}]"
        return f"((crc << 8u) & 0xFF00u) ^ crc_table[(crc >> 8u) ^ {byte}]"

    @property
    def crc_head(self) -> tuple[str, ...]:
        """Statements before the bytes of the frame."""
        low, high = "data_id & 0xFFu", "((uint32_t)data_id >> 8u)"
        match self.profile.data_id_mode if self.profile.has_data_id_first else "":
            case "both":
                return (f"uint32_t crc = crc_table[{low}];", "", f"crc = {self.step(high)};")
            case "alternating":
                return (f"uint32_t crc = crc_table[((data[1] & 1u) == 0u) ? ({low}) : {high}];", "")
            case "nibble":
                return (f"uint32_t crc = crc_table[{low}];", "", "crc = crc_table[crc];")
        return (f"uint32_t crc = 0x{self.profile.crc.start:X}u;", "")

    @property
    def crc_tail(self) -> tuple[str, ...]:
        """Statements after the bytes of the frame."""
        crc, found = self.profile.crc, []
        if self.lists:
            found.append(
                f"crc = {self.step(f'data_ids[(data_id < {len(self.lists)}u) ? data_id : 0u][{self.received_counter}]')};"
            )
        elif not self.profile.has_data_id_first:
            found += [f"crc = {self.step(byte)};" for byte in ("(data_id & 0xFFu)", "((uint32_t)data_id >> 8u)")]
        result = f"(crc ^ 0x{crc.final_xor:X}u)" if crc.final_xor else "crc"
        return (*found, f"return ({self.crc_type}){result};")

    @property
    def received_counter(self) -> str:
        """C expression of the counter in a frame."""
        byte = f"data[{self.profile.counter_byte}]"
        return byte if self.profile.counter_length == 8 else f"{byte} & 0x0Fu"

    @property
    def received_crc(self) -> str:
        """C expression of the CRC in a frame."""
        return "data[0]" if self.profile.crc_bytes == 1 else "(((uint32_t)data[1] << 8u) | data[0])"

    def is_damaged(self, function: str) -> str:
        """Return the C condition that a frame is damaged; `function` computes the CRC."""
        wrong = f"{function}(data_id, data) != {self.received_crc}"
        found = ["counter > counter_max"] if self.profile.has_invalid_counter else []
        found += [wrong, "((uint32_t)data[1] >> 4u) != ((uint32_t)data_id >> 8u)"] if self.profile.nibble_bits else [wrong]
        return " || ".join(f"({each})" for each in found) if len(found) > 1 else wrong

    @property
    def length_text(self) -> str:
        """Number of bytes of a frame, in words."""
        return "eight" if self.frame_bytes == 8 else str(self.frame_bytes)

    @property
    def crc_place(self) -> str:
        """Place of the CRC, in words."""
        return "byte 0" if self.profile.crc_bytes == 1 else "bytes 0 and 1"

    @property
    def counter_place(self) -> str:
        """Place of the counter, in words."""
        byte = f"byte {self.profile.counter_byte}"
        return byte if self.profile.counter_length == 8 else f"the low nibble of {byte}"

    @property
    def start_text(self) -> str:
        """Start value of the CRC."""
        return f"0x{self.profile.crc.start:X}" if self.profile.crc.start else "0"

    def covered(self, data_id: str = "") -> str:
        """Return what the CRC covers, in words; `data_id` replaces the words for the data id."""
        number = data_id or _COVERED[self.profile.data_id_mode]
        covered = f"bytes {self.covered_bytes.start} to {self.covered_bytes.stop - 1}"
        return f"{number} and {covered}" if self.profile.has_data_id_first else f"{covered} and {number}"

    @property
    def protect_text(self) -> str:
        """Fields that protection writes, in words."""
        counter = f"counter ({self.counter_place.removeprefix('the ')})"
        if self.profile.nibble_bits:
            return f"CRC ({self.crc_place}), {counter} and data id nibble (high nibble of byte 1)"
        return f"CRC ({self.crc_place}) and {counter}"

    @property
    def lines(self) -> tuple[str, ...]:
        """Description of the protection at the head of the header."""
        profile, number = self.profile, self.profile.category.removeprefix("PROFILE_")
        nibble = ", the low four bits of the high byte of the data id in its high nibble" if profile.nibble_bits else ""
        layout = (
            f"A frame has {self.length_text} bytes: the CRC in {self.crc_place}, the counter (0 to {profile.counter_max}) in "
            f"{self.counter_place}{nibble}, and signals in the rest."
        )
        data_id = "the data id, low byte first," if profile.data_id_mode == "both" and profile.has_data_id_first else ""
        section = ", section 6.3" if profile.category == DEFAULT_PROFILE.category else ""
        covered = f"covers {self.covered(data_id)}. Specification: AUTOSAR FO R20-11, PRS_E2EProtocol{section}"
        functions = f"(E2E_P{number}Protect and E2E_P{number}Check), with {self.settings}."
        first = (f"{layout} The CRC",) if len(layout) < 125 else (layout, "The CRC")
        more = ("data_id is the number of the message, from 0: its list of data ids.",) if self.lists else ()
        return (*first, covered, functions, *more)

    @property
    def examples(self) -> tuple[str, ...]:
        """CRC of two frames of the self-test, zero but for the counter, which is 0 and 1."""
        digits = self.profile.crc.width // 4
        return tuple(f"0x{self._crc_of(self._example(counter, 0)):0{digits}X}u" for counter in (0, 1))

    @property
    def example_id(self) -> str:
        """Data id of the self-test's frames: 0x123, or the first list of data ids."""
        return "0u" if self.lists else f"0x{EXAMPLE_ID:X}u"

    @property
    def crc_sum(self) -> int:
        """Sum of the weighted CRC of frames with the counter 1 and any last byte."""
        return sum((value + 1) * self._crc_of(self._example(1, value)) for value in range(256))

    def _example(self, counter: int, last: int) -> bytes:
        data = bytearray(self.frame_bytes)
        data[-1] = last
        data[self.profile.counter_byte] = counter
        return bytes(data)

    def _crc_of(self, data: bytes) -> int:
        return self.profile.crc_of(self.lists[0] if self.lists else EXAMPLE_ID, data)

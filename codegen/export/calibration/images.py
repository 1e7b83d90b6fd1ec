"""Calibration values in program images: ELF, Motorola S-record and Intel HEX."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from codegen.emit.objects import CalibrationObject, Layout, Values
from codegen.emit.text import comment_text
from codegen.errors import BuildError, CodegenError
from codegen.export.a2l import fill
from codegen.export.elf import ELF_BYTES_MAX, Elf
from codegen.files import read_file, refuse_empty, refuse_utf16
from codegen.limits import Limits
from codegen.requirements import missing

ELF_MAGIC = b"\x7fELF"
IMAGE_REMEDY = "give a linked program as ELF, S-record or Intel HEX"
_RECORD_BYTES = 32
PIECES_MAX, RECORDS_AT_A_TIME = 1000, 1000
"""Largest number of separate pieces of an image. Linked programs have some ten."""
_IHEX_BASES = ("02", "04")
"""Types of the records of Intel HEX that set the base of the addresses in the lines that follow."""
_SREC_BITS = {b"S1": 16, b"S2": 24, b"S3": 32}

A2L_BYTES_MAX = 16 * 2**20
_ADDRESS = re.compile(
    r"/begin (?:AXIS_PTS|CHARACTERISTIC) (?P<name>\S+) \"[^\"]*\"\s+(?:(?:VALUE|CURVE|MAP)\s+)?"
    r"(?P<address>0x[0-9A-Fa-f]{1,8})\s"
)
_EPK = re.compile(r'ADDR_EPK (0x[0-9A-Fa-f]{1,8})\s+EPK "([^"]*)"')
_BYTE_ORDER = re.compile(r"BYTE_ORDER (MSB_FIRST|MSB_LAST)")
"""What a user's A2L must have: the addresses. Everything else about the objects comes from the manifest."""

Format = Literal["ELF", "S-record", "Intel HEX"]


@dataclass(frozen=True, eq=False)
class Image:
    """A program image that contains a build.

    Attributes:
        path: its file.
        format: its format.
        layout: the calibration objects with their addresses in the image.
    """

    path: Path
    format: Format
    layout: Layout
    _content: Any

    @classmethod
    def load(cls, path: Path, addresses: Path | None, build: Path, layout: Layout) -> Image:
        """Read an image.

        Args:
            addresses: for S-record and Intel HEX, the ELF of the same program, or its A2L; None for an ELF.
            build: folder of the build. layout: its objects.

        Raises:
            CodegenError: it is damaged, or does not contain this build.
        """
        content = read_file(path, ELF_BYTES_MAX, IMAGE_REMEDY, BuildError)
        if content.startswith(ELF_MAGIC):
            if addresses is not None:
                raise CodegenError("has no effect on an ELF, which has its own", where="`addresses=`", remedy="leave it out")
            elf = Elf(str(path), content)
            return cls(path, "ELF", fill(build, elf).layout, elf)
        records = _records(content, path)
        if addresses is None:
            raise CodegenError(
                "the image has no names", where=path, remedy="give its ELF, or the A2L of codegen a2l, with `addresses=`"
            )
        image = cls(
            path, "S-record" if content[:1] == b"S" else "Intel HEX", _placed(addresses, build, layout), (content, records)
        )
        image._check_build(addresses)
        return image

    def _check_build(self, addresses: Path) -> None:
        """Check that the image has the identity of the build at its address."""
        wanted = self.layout.build_id
        found = self._bytes(self.layout.epk_address, len(wanted))
        if found != wanted.encode():
            text = comment_text(found.decode("ascii", "replace")) if found is not None else "nothing"
            raise BuildError(
                f"the build {wanted} is not at the address of its EPK, 0x{self.layout.epk_address:08X}, but {text}",
                where=self.path,
                remedy=f"give the image of the program of {addresses.name}",
            )

    def read(self) -> Values:
        """Return the values in the image. Raises BuildError: it does not contain one of them."""
        values: Values = {}
        for each in self.layout.objects.values():
            data = self._bytes(each.address, each.bytes)
            if data is None:
                what = f"has no initial bytes for {each.name} at 0x{each.address:08X}"
                raise BuildError(what, where=self.path, remedy="give the image of the whole program")
            stored = np.frombuffer(data, dtype=self._stored(each)).reshape(each.shape)
            values[each.name] = each.physical_values(stored.astype(each.stored))
        return values

    def patched(self, values: Values) -> bytes:
        """Return the image with other values; the rest of its content stays. `read` must have found all of them."""
        parts = {
            each.address: each.raw(values[each.name]).astype(self._stored(each)).tobytes()
            for each in self.layout.objects.values()
        }
        if isinstance(self._content, Elf):
            return self._content.replaced(parts)
        content, records = self._content
        for address, data in parts.items():
            records[address : address + len(data)] = data
        with _undamaged(self.path):
            if self.format == "Intel HEX":
                text: str = records.as_ihex(_RECORD_BYTES, 32)
            else:
                bits = next((bits for kind, bits in _SREC_BITS.items() if kind in content), 32)
                text = records.as_srec(_RECORD_BYTES, bits)
        return text.replace("\n", "\r\n" if b"\r\n" in content else "\n").encode("ascii")

    def _stored(self, each: CalibrationObject) -> np.dtype[Any]:
        return each.stored.newbyteorder(self.layout.byte_order)  # type: ignore[arg-type]

    def _bytes(self, address: int, size: int) -> bytes | None:
        if isinstance(self._content, Elf):
            return self._content.bytes_at(address, size)
        _, records = self._content
        for segment in records.segments:
            start = address - segment.address
            if start >= 0 and start + size <= len(segment.data):
                return bytes(segment.data[start : start + size])
        return None


def _placed(addresses: Path, build: Path, layout: Layout) -> Layout:
    """Return the layout with the addresses at which a programmer writes, of an ELF or an A2L."""
    content = read_file(addresses, ELF_BYTES_MAX, "give the ELF of the image, or its A2L", BuildError)
    refuse_empty(len(content), addresses, BuildError)
    if not content.startswith(ELF_MAGIC):
        return layout_of_a2l(addresses, layout)
    elf = Elf(str(addresses), content)
    found = fill(build, elf).layout
    addresses_in_image = {name: elf.load_address(each.address, each.bytes) for name, each in found.objects.items()}
    return found.at(addresses_in_image, elf.load_address(found.epk_address, len(found.build_id)), found.byte_order)


def layout_of_a2l(path: Path, build: Layout) -> Layout:
    """Return the layout with the addresses in an A2L. Raises BuildError: `codegen a2l` did not make it of this build."""
    remedy = "make it with codegen a2l"
    content = read_file(path, A2L_BYTES_MAX, remedy, BuildError)
    refuse_utf16(content, path, BuildError)
    text = content.decode("ascii", "replace")
    addresses = {each["name"]: int(each["address"], 16) for each in _ADDRESS.finditer(text)}
    epk, order = _EPK.search(text), _BYTE_ORDER.search(text)
    if epk is None or order is None or addresses.keys() != build.objects.keys():
        raise BuildError("not an A2L as this version writes it", where=path, remedy="build again with this version")
    if epk[2] != build.build_id:
        raise BuildError(f"it is of another build than {build.build_id}", where=path, remedy=remedy)
    epk_address = int(epk[1], 16)
    if not (epk_address and all(addresses.values())):
        raise BuildError("it has no addresses", where=path, remedy=remedy)
    return build.at(addresses, epk_address, ">" if order[1] == "MSB_FIRST" else "<")


def _records(content: bytes, path: Path) -> Any:
    """Return the `bincopy.BinFile` of an S-record or Intel HEX file. Raises CodegenError."""
    refuse_empty(len(content), path, BuildError)
    refuse_utf16(content, path, BuildError)
    if content[:1] not in (b"S", b":"):
        raise BuildError("neither ELF, S-record nor Intel HEX", where=path, remedy=IMAGE_REMEDY)
    try:
        bincopy = importlib.import_module("bincopy")
    except ImportError:
        raise missing("bincopy", "reads S-records and Intel HEX", "codegen calibrate") from None
    records = bincopy.BinFile()
    with Limits.of(len(content)).enforced(path, BuildError), _undamaged(path):
        lines = content.decode("ascii").splitlines(keepends=True)
        _add_records(records.add_ihex if content[:1] == b":" else records.add_srec, records, lines)
    return records


def _add_records(add: Callable[[str], None], records: Any, lines: Sequence[str]) -> None:
    """Add records some at a time, because bincopy takes for ever for many pieces. Raises ValueError: there are too many."""
    bases: dict[str, str] = {}
    for start in range(0, len(lines), RECORDS_AT_A_TIME):
        some = lines[start : start + RECORDS_AT_A_TIME]
        add("".join([*bases.values(), *some]))
        bases |= {type_: line for line in some if (type_ := line.strip()[7:9]) in _IHEX_BASES and line.lstrip()[:1] == ":"}
        if len(records.segments) > PIECES_MAX:
            raise ValueError(f"more than {PIECES_MAX} separate pieces")


@contextmanager
def _undamaged(path: Path) -> Iterator[None]:
    """Convert the exceptions of bincopy for a damaged file, its own and those of binascii and int, to BuildError."""
    try:
        yield
    except Exception as error:
        raise BuildError(f"damaged ({error})", where=path, remedy="write the image again") from None

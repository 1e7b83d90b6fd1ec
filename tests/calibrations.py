"""A2L and images of a build at invented addresses, without a compiler."""

import itertools
import re
import tempfile
from pathlib import Path
from typing import Any

import bincopy

from codegen.emit.objects import Values
from codegen.export.calibration.build import BuildCalibration
from codegen.export.calibration.images import layout_of_a2l

FIRST, SPACING = 0x0801_0000, 0x2_0000


def addressed(a2l: bytes, byte_order: str = "MSB_LAST") -> bytes:
    """Return the A2L of a build with an address for each object, as `codegen a2l` fills them in."""
    numbers = itertools.count(FIRST, SPACING)
    text = re.sub(rb"\b0x00000000\b", lambda _: b"0x%08X" % next(numbers), a2l)
    return text.replace(b"BYTE_ORDER MSB_LAST", f"BYTE_ORDER {byte_order}".encode())


def records_of(a2l: bytes, build: BuildCalibration, values: Values | None = None) -> Any:
    """Return an image with the identity of the build and its values of the build, or others, at the addresses of an A2L."""
    with tempfile.NamedTemporaryFile(suffix=".a2l") as file:
        file.write(a2l)
        file.flush()
        layout = layout_of_a2l(Path(file.name), build.layout)
    records = bincopy.BinFile()
    records.header = "ecu"
    records.execution_start_address = FIRST
    records.add_binary(layout.build_id.encode() + b"\0", layout.epk_address)
    for each in layout.objects.values():
        stored = each.raw((values or build.values)[each.name])
        records.add_binary(stored.astype(stored.dtype.newbyteorder(layout.byte_order)).tobytes(), each.address)
    return records

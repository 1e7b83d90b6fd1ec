"""A2L and images of a build at invented addresses, without a compiler."""

import itertools
import re
from typing import Any

import bincopy

from codegen.export.calibration.layout import Layout, Values, read_layout

FIRST, SPACING = 0x0801_0000, 0x2_0000


def addressed(a2l: bytes, byte_order: str = "MSB_LAST") -> bytes:
    """Return the A2L of a build with an address for each object, as `codegen a2l` fills them in."""
    numbers = itertools.count(FIRST, SPACING)
    text = re.sub(rb"\b0x00000000\b", lambda _: b"0x%08X" % next(numbers), a2l)
    return text.replace(b"BYTE_ORDER MSB_LAST", f"BYTE_ORDER {byte_order}".encode())


def records_of(a2l: bytes, values: Values, prefix: str = "ars") -> Any:
    """Return an image with the identity of the build and its values at the addresses of an A2L."""
    layout: Layout = read_layout(a2l, prefix, "A2L")
    records = bincopy.BinFile()
    records.header = "ecu"
    records.execution_start_address = FIRST
    records.add_binary(layout.build_id.encode() + b"\0", layout.epk_address)
    for each in layout.objects.values():
        stored = each.raw(values[each.name])
        records.add_binary(stored.astype(stored.dtype.newbyteorder(layout.byte_order)).tobytes(), each.address)
    return records

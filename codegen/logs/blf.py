"""Frames of a BLF, Vector's binary log.

This module walks the headers of the objects, counts the frames, and reads CAN messages. It hands python-can the other objects
that it can read, in containers of whole objects. python-can alone ignores objects outside of containers, objects whose header
it does not know, and an object that the end of the file cuts.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from codegen.errors import CodegenError
from codegen.logs.frames import REMEDY, Collector, Kind

FILE_HEADER = struct.Struct("<4sL")
FILE_HEADER_BYTES = 144
OBJECT_HEADER = struct.Struct("<4sHHLL")
"""Signature, size of the header, version of the header, size and type of the object."""
CONTAINER_HEADER = struct.Struct("<H6xL4x")
"""Compression, size of the content."""
CONTAINER, NOT_COMPRESSED, DEFLATE = 10, 0, 2
CONTAINER_BYTES_MAX = 2**26
"""Largest unpacked container. Tools write 128 KiB."""
UNPACKED_FACTOR, UNPACKED_BYTES_MIN = 16, 2**25
"""Largest size of all unpacked containers as a multiple of the file's, and what every file may have. Tools reach 4; the packing
can reach 1000."""
PACKED_OBJECT_BYTES, OBJECTS_MIN = 5, 100_000
"""Fewest bytes of the file for each object: packed frames have 8 or more. What every file may have."""
OBJECT_BYTES_MAX = 2**26
"""Largest object. Those with frames have some 100 bytes."""
HEADER_VERSIONS = (1, 2)
PADDING_MAX = 8
BATCH_OBJECTS = 1000
READ = (1, 86, 73, 100, 101)
"""Types of objects that python-can reads: CAN messages, error frames, messages of CAN FD. Numbers: Vector's binlog API."""
MESSAGES = (1, 86)
"""Types of CAN messages among them, whose content is the same."""
MESSAGE = struct.Struct("<16xL4xQHBBL8s")
"""Behind the first header: unit of the stamp, stamp, channel, flags, length, identifier, data."""
SENT, REMOTE, IDENTIFIER, EXTENDED = 0x01, 0x80, 0x1FFFFFFF, 0x80000000
UNREAD_FRAMES = {2: "an error frame of the old kind", 3: "an overload frame", 104: "an error frame of CAN FD"}
OTHER_NAMES = {
    4: "statistics of CAN",
    5: "application trigger",
    6: "environment variable",
    31: "status of a CAN controller",
    65: "event comment",
    96: "global marker",
    72: "application text",
    115: "end of a packet",
}


def read(path: Path) -> tuple[Collector, str]:
    """Read a BLF. Returns the frames and the meaning of the stamps.

    Raises:
        CodegenError: damaged, or cut short.
        Exception: whatever python-can raises for a damaged object.
    """
    from can import BLFReader, Message

    into = Collector("BLF")
    with path.open("rb") as file:
        head = file.read(FILE_HEADER.size)
        if len(head) < FILE_HEADER.size or head[:4] != b"LOGG":
            raise CodegenError("not a readable log of a CAN bus: a BLF begins with LOGG", where=path, remedy=REMEDY)
        head += file.read(max(FILE_HEADER.unpack(head)[1], FILE_HEADER_BYTES) - len(head))
        with BLFReader(io.BytesIO(head)) as reader:
            size, start = reader.file_size, reader.start_timestamp
        if path.stat().st_size < size:
            what = f"it ends early: {path.stat().st_size} of {size} bytes"
            raise CodegenError(what, where=path, remedy="copy it again, or let the tool that writes it close it")
        for objects in _batches(file, path, into):
            are_messages = [_is_message(each) for each in objects]
            others = [each for each, is_message in zip(objects, are_messages, strict=True) if not is_message]
            messages: list[Message] = []
            if others:
                with BLFReader(io.BytesIO(head + _container(b"".join(others)))) as reader:
                    messages = list(reader)
            if len(messages) != len(others):
                what = f"damaged: {len(messages)} of {len(others)} frames can be read"
                raise CodegenError(what, where=f"{path}, before frame {into.in_file}", remedy=REMEDY)
            following = iter(messages)
            for each, is_message in zip(objects, are_messages, strict=True):
                if is_message:
                    _add_message(each, start, into, path)
                    continue
                message = next(following)
                into.add(message, message.timestamp, str(int(str(message.channel)) + 1), str(path))
    return into, "Unix time" if start else "time from the start of the log"


def _is_message(content: bytes) -> bool:
    """Return whether an object is a CAN message with a header of version 1: nearly every frame of a log is."""
    return content[6] == 1 and content[7] == 0 and content[12] in MESSAGES and len(content) >= MESSAGE.size


def _add_message(content: bytes, start: float, into: Collector, path: Path) -> None:
    """Take over a CAN message. With python-can the whole log takes 2.2 times as long."""
    unit, stamp, channel, flags, length, identifier, data = MESSAGE.unpack_from(content)
    time = stamp / (100_000 if unit == 1 else 1_000_000_000) + start
    is_remote = bool(flags & REMOTE)
    row = (
        identifier & IDENTIFIER,
        bool(identifier & EXTENDED),
        False,
        bool(flags & SENT),
        Kind.REMOTE if is_remote else Kind.DATA,
    )
    into.add_row(time, row, str(channel), b"" if is_remote else data[:length], str(path))


def _container(objects: bytes) -> bytes:
    """Return objects in a container that is not compressed."""
    size = OBJECT_HEADER.size + CONTAINER_HEADER.size + len(objects)
    head = OBJECT_HEADER.pack(b"LOBJ", OBJECT_HEADER.size, 1, size, CONTAINER)
    return head + CONTAINER_HEADER.pack(NOT_COMPRESSED, len(objects)) + objects


def _batches(file: BinaryIO, path: Path, into: Collector) -> Iterator[list[bytes]]:
    """Yield the objects that python-can reads, some at a time. Counts all frames."""
    tail, number = b"", 0
    objects_max = max(path.stat().st_size // PACKED_OBJECT_BYTES, OBJECTS_MIN)
    whole: list[bytes] = []
    for chunk in _chunks(file, path):
        data, position = tail + chunk, 0
        while True:
            start = data.find(b"LOBJ", position, position + PADDING_MAX + 4)
            if start < 0 and len(data) - position >= PADDING_MAX + 4:
                raise CodegenError("no object where one should begin", where=f"{path}, object {number}", remedy=REMEDY)
            if start < 0 or start + OBJECT_HEADER.size > len(data):
                break
            _, _, version, size, kind = OBJECT_HEADER.unpack_from(data, start)
            if not OBJECT_HEADER.size <= size <= OBJECT_BYTES_MAX:
                raise CodegenError(f"an object has the size {size}", where=f"{path}, object {number}", remedy=REMEDY)
            if start + size > len(data):
                break  # it continues in the next container
            if _is_readable(kind, version, into, number):
                whole.append(data[start : start + size] + bytes(-size % 4))
            position = start + size
            number += 1
            if number > objects_max:
                raise CodegenError("it holds far more objects than a log of its size", where=path, remedy=REMEDY)
        tail = data[position:]
        if len(whole) >= BATCH_OBJECTS:
            yield whole
            whole = []
    if whole:
        yield whole
    if tail.strip(b"\0"):
        raise CodegenError("it ends inside an object", where=f"{path}, object {number}", remedy="copy it again")


def _is_readable(kind: int, version: int, into: Collector, number: int) -> bool:
    """Count an object, and return whether python-can reads it."""
    if kind not in READ and kind not in UNREAD_FRAMES:
        into.others[OTHER_NAMES.get(kind, f"object of type {kind}")] += 1
        return False
    into.in_file += 1
    if kind in UNREAD_FRAMES:
        into.skip(f"{UNREAD_FRAMES[kind]} (type {kind})", f"object {number}")
    elif version not in HEADER_VERSIONS:
        into.skip(f"object header of version {version}, which is not known", f"object {number}")
    else:
        return True
    return False


def _chunks(file: BinaryIO, path: Path) -> Iterator[bytes]:
    """Yield the unpacked contents of containers, and each object outside of a container."""
    left = max(UNPACKED_FACTOR * path.stat().st_size, UNPACKED_BYTES_MIN)
    while head := file.read(OBJECT_HEADER.size):
        if not head.strip(b"\0"):
            continue  # padding at the end
        if len(head) < OBJECT_HEADER.size:
            yield head
            return
        signature, _, _, size, kind = OBJECT_HEADER.unpack(head)
        if signature != b"LOBJ" or size < OBJECT_HEADER.size:
            what = f"an object has the size {size}" if signature == b"LOBJ" else "no object where one should begin"
            raise CodegenError(what, where=f"{path}, byte {file.tell() - len(head)}", remedy=REMEDY)
        content = file.read(size - OBJECT_HEADER.size)
        if len(content) < size - OBJECT_HEADER.size:
            yield head + content
            return
        file.read(size % 4)  # as tools pad containers
        chunk = _unpacked(content, path) if kind == CONTAINER else head + content
        left -= len(chunk)
        if left < 0:
            raise CodegenError("its containers hold far more than a log of its size", where=path, remedy=REMEDY)
        yield chunk


def _unpacked(content: bytes, path: Path) -> bytes:
    method, size = CONTAINER_HEADER.unpack_from(content)
    packed = content[CONTAINER_HEADER.size :]
    if method == NOT_COMPRESSED:
        return packed
    if method != DEFLATE:
        raise CodegenError(f"a container is packed with method {method}, not known", where=path, remedy=REMEDY)
    if size > CONTAINER_BYTES_MAX:
        raise CodegenError(f"a container of {size} bytes", where=path, remedy=REMEDY)
    unpacker = zlib.decompressobj()
    data = unpacker.decompress(packed, CONTAINER_BYTES_MAX)
    if unpacker.unconsumed_tail:
        raise CodegenError(f"a container of more than {CONTAINER_BYTES_MAX} bytes", where=path, remedy=REMEDY)
    return data

"""Frames of logs of a bus."""

from pathlib import Path

import can
import pytest

from codegen.errors import CodegenError
from codegen.importing.bus_log import frames


def test_an_object_of_no_size_is_refused(tmp_path: Path) -> None:
    """python-can would read it for ever."""
    path = tmp_path / "bus.blf"
    with can.BLFWriter(path, compression_level=0) as log:
        log.on_message_received(can.Message(timestamp=1.0, arbitration_id=0x101, data=bytes(8)))
    assert [frame.arbitration_id for frame in frames(path)] == [0x101]
    data = bytearray(path.read_bytes())
    start = data.rindex(b"LOBJ")  # the frame, inside the container
    data[start + 8 : start + 12] = bytes(4)  # its size, behind signature, header size and header version
    path.write_bytes(data)
    with pytest.raises(CodegenError, match="an object has the size 0"):
        list(frames(path))

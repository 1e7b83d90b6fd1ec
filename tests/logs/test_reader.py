"""Frames of logs of a bus."""

from pathlib import Path

import can
import pytest

from codegen.errors import CodegenError
from codegen.logs.reader import read_frames


@pytest.mark.parametrize("name", ["bus.asc", "bus.log"])
def test_a_text_log_that_ends_inside_a_line_is_refused(name: str, tmp_path: Path) -> None:
    """python-can reads a frame with fewer bytes, or none."""
    path = tmp_path / name
    with can.Logger(path) as log:
        for time in (1.0, 2.0):
            log(can.Message(timestamp=time, arbitration_id=0x101, data=bytes(8)))
    whole = path.read_bytes()
    path.write_bytes(whole.removesuffix(b"TriggerBlock\n"))  # cut where no frame is
    assert read_frames(path)[1].read == 2
    lines = whole.removesuffix(b"End TriggerBlock\n").splitlines(keepends=True)
    for cut in range(1, len(lines[-1]) - 1):
        path.write_bytes(b"".join(lines)[:-cut])
        with pytest.raises(CodegenError, match=f"line {len(lines)}: it ends inside a line; copy it again"):
            read_frames(path)


def test_an_object_of_no_size_is_refused(tmp_path: Path) -> None:
    """python-can would read it for ever."""
    path = tmp_path / "bus.blf"
    with can.BLFWriter(path, compression_level=0) as log:
        log.on_message_received(can.Message(timestamp=1.0, arbitration_id=0x101, data=bytes(8)))
    assert read_frames(path)[0].identifier.tolist() == [0x101]
    data = bytearray(path.read_bytes())
    start = data.rindex(b"LOBJ")  # the frame, inside the container
    data[start + 8 : start + 12] = bytes(4)  # its size, behind signature, header size and header version
    path.write_bytes(data)
    with pytest.raises(CodegenError, match="an object has the size 0"):
        read_frames(path)

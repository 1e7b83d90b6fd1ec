"""Files are written together or not at all."""

from pathlib import Path

import pytest

from codegen.errors import CodegenError
from codegen.files import write_together


@pytest.mark.parametrize("bad", ["no/b", "folder"])
@pytest.mark.parametrize("is_last", [True, False])
def test_a_file_that_cannot_be_written_keeps_the_others(bad: str, is_last: bool, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "good").write_bytes(b"before")
    files = {tmp_path / "good": b"after", tmp_path / bad: b"new"}
    with pytest.raises(CodegenError, match="cannot be written") as caught:
        write_together(files if is_last else dict(reversed(files.items())))
    assert caught.value.where == str(tmp_path / bad)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "folder", tmp_path / "good"]
    assert (tmp_path / "good").read_bytes() == b"before"
    write_together({tmp_path / "good": b"after", tmp_path / "other": b"new"})
    assert [(tmp_path / name).read_bytes() for name in ("good", "other")] == [b"after", b"new"]

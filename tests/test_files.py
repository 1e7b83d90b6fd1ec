"""Files are written together or not at all, and of two programs that replace the same content only one succeeds."""

import fcntl
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from codegen import files
from codegen.errors import CodegenError
from codegen.files import ChangedError, distinct_names, read_text, write_atomically, write_together


def test_text_is_utf_8_or_windows_1252() -> None:
    for encoding in ("utf-8", "utf-8-sig", "cp1252"):
        assert files.decoded("5 € … ü\n".encode(encoding)) == "5 € … ü\n"
    assert files.decoded(b"\x81") == "\ufffd"  # no character of Windows-1252


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_text_in_utf_16_is_named(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "ars.toml").write_text("[vehicle]\n", encoding=encoding)
    with pytest.raises(CodegenError, match="it is in UTF-16; save it as UTF-8"):
        read_text(tmp_path / "ars.toml", 1000, "")


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["a/x.csv", "a/y.csv"], ["x", "y"]),
        (["a/x.csv", "b/x.log"], ["x.csv", "x.log"]),
        (["a/x.csv", "b/x.csv", "b/y.csv"], ["a/x.csv", "b/x.csv", "b/y.csv"]),
        (["/c/a/d/x.csv", "/c/b/d/x.csv"], ["a/d/x.csv", "b/d/x.csv"]),
        (["x.csv", "a/x.csv"], ["x.csv", "a/x.csv"]),
        (["x.csv", "x.csv"], ["x.csv", "x.csv"]),
        ([], []),
    ],
)
def test_names_distinguish_files(paths: list[str], names: list[str]) -> None:
    assert distinct_names([Path(path) for path in paths]) == names


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


@pytest.mark.parametrize("before", [b"before", None])
def test_of_two_writers_that_replace_the_same_content_one_succeeds(before: bytes | None, tmp_path: Path) -> None:
    writers, races = 2, 40
    barrier = threading.Barrier(writers)

    def write(number: int) -> bool:
        barrier.wait()
        try:
            write_atomically(path, b"by %d" % number, replaces=before)
        except ChangedError:
            return False
        return True

    with ThreadPoolExecutor(writers) as pool:
        for race in range(races):
            path = tmp_path / f"{race}.toml"
            if before is not None:
                path.write_bytes(before)
            succeeded = list(pool.map(write, range(writers)))
            assert sorted(succeeded) == [False, True]
            assert path.read_bytes() == b"by %d" % succeeded.index(True)
    assert len([*tmp_path.iterdir()]) == races


@pytest.mark.parametrize(
    ("there", "expected"), [(b"other", b"before"), (b"before and more", b"before"), (None, b""), (b"", None)]
)
def test_a_file_that_another_program_wrote_is_kept(there: bytes | None, expected: bytes | None, tmp_path: Path) -> None:
    path, other = tmp_path / "ars.toml", tmp_path / "other"
    if there is not None:
        path.write_bytes(there)
    with pytest.raises(ChangedError, match=rf"^{path}: another program wrote it in the meantime; nothing was written"):
        write_together({other: b"new", path: b"after"}, {path: expected})
    assert [*tmp_path.iterdir()] == ([] if there is None else [path])
    assert there is None or path.read_bytes() == there


def test_a_lock_that_is_never_released_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "LOCK_TIMEOUT_S", 0.0)
    path = tmp_path / "ars.toml"
    path.write_bytes(b"before")
    with path.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(CodegenError, match="another program holds its lock"):
            write_atomically(path, b"after")
        assert path.read_bytes() == b"before"
    write_atomically(path, b"after")
    assert [*tmp_path.iterdir()] == [path] and path.read_bytes() == b"after"

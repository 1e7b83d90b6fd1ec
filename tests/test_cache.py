"""The cache: a folder that others could change is not used, and a file with other content or of another user is not found."""

import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen import cache
from codegen.cache import cache_folder
from codegen.errors import BuildError

NAME, CONTENT = "_library_0123456789abcdef", b"\x7fELF\x00some code"
OTHER_USER = 12345


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the configured cache folder, not created yet, with a temporary folder of the test for its replacement."""
    (tmp_path / "tmp").mkdir(mode=0o700)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    monkeypatch.setenv("ARS_CACHE", str(tmp_path / "own" / "cache"))
    cache._report.cache_clear()
    cache._folder_of_this_process.cache_clear()
    return tmp_path / "own" / "cache"


def is_temporary(found: Path, folder: Path) -> bool:
    return found.parent == folder.parents[1] / "tmp" and stat.S_IMODE(found.stat().st_mode) == 0o700


def test_the_users_own_folder_is_used_without_a_line(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cache_folder() == folder
    assert capfd.readouterr() == ("", "")


def open_to_all(folder: Path) -> None:
    folder.chmod(0o777)


def open_to_the_group(folder: Path) -> None:
    folder.chmod(0o770)


def replaceable(folder: Path) -> None:
    folder.parent.chmod(0o777)


def link_to_an_open_folder(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere")).chmod(0o777)
    folder.symlink_to("elsewhere")


@pytest.mark.parametrize("plant", [open_to_all, open_to_the_group, replaceable, link_to_an_open_folder])
def test_a_folder_that_others_can_change_is_replaced_with_one_line(
    folder: Path, plant: Callable[[Path], None], capfd: pytest.CaptureFixture[str]
) -> None:
    folder.mkdir(parents=True)
    plant(folder)
    assert is_temporary(cache_folder(), folder)
    assert cache_folder() == cache_folder()
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("warning: other users can ") and "ARS_CACHE" in lines[0]


def test_a_sticky_parent_is_safe_because_only_the_owner_can_replace_the_folder(folder: Path) -> None:
    folder.mkdir(parents=True)
    folder.parent.chmod(0o1777)
    assert cache_folder() == folder


def test_a_folder_of_another_user_is_replaced_with_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder.mkdir(parents=True)
    monkeypatch.setattr(os, "getuid", lambda: OTHER_USER)
    assert is_temporary(cache_folder(), folder)
    assert capfd.readouterr().err.startswith(
        f"warning: the cache folder {folder} belongs to another user; compiled files go to "
    )


def test_a_file_is_found_by_name_and_content(folder: Path) -> None:
    place = cache_folder()
    kept = cache.keep(place, NAME, CONTENT, ".so", executable=True)
    assert cache.find(place, NAME, ".so") == kept == cache.Entry(kept.path, CONTENT)
    assert [*folder.iterdir()] == [kept.path]
    assert stat.S_IMODE(kept.path.stat().st_mode) == 0o700
    assert cache.find(place, f"{NAME}0", ".so") is None
    assert cache.find(place, NAME, ".h") is None


def test_no_flipped_bit_and_no_other_length_is_accepted(folder: Path) -> None:
    kept = cache.keep(cache_folder(), NAME, CONTENT)
    for place in range(len(CONTENT)):
        for bit in range(8):
            changed = bytearray(CONTENT)
            changed[place] ^= 1 << bit
            kept.path.write_bytes(changed)
            assert cache.find(folder, NAME) is None, (place, bit)
    for other in (b"", CONTENT[:-1], CONTENT + b"\0"):
        kept.path.write_bytes(other)
        assert cache.find(folder, NAME) is None
    kept.path.write_bytes(CONTENT)
    assert cache.find(folder, NAME) == kept


def test_a_file_renamed_to_another_key_is_not_accepted(folder: Path) -> None:
    kept, other = cache.keep(cache_folder(), NAME, CONTENT), NAME.replace("0", "1")
    kept.path.rename(folder / kept.path.name.replace(NAME, other))
    assert cache.find(folder, other) is None


def linked(path: Path) -> None:
    path.symlink_to(path.rename(path.with_name("elsewhere")))


def piped(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def writable(path: Path) -> None:
    path.chmod(0o666)


@pytest.mark.parametrize("plant", [linked, piped, writable])
def test_a_planted_file_is_not_accepted(folder: Path, plant: Callable[[Path], None]) -> None:
    kept = cache.keep(cache_folder(), NAME, CONTENT)
    plant(kept.path)
    assert cache.find(folder, NAME) is None


def test_a_file_of_another_user_is_not_accepted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache.keep(cache_folder(), NAME, CONTENT)
    monkeypatch.setattr(os, "getuid", lambda: OTHER_USER)
    assert cache.find(folder, NAME) is None


def test_a_folder_that_cannot_be_written_is_reported(folder: Path) -> None:
    with pytest.raises(
        BuildError, match=r"gone.*: cannot be written \(No such file or directory\); free space there, or set ARS_CACHE$"
    ):
        cache.keep(folder / "gone", NAME, CONTENT)


# --- a temporary folder in it ---------------------------------------------------------------------------------------------


def test_the_folder_of_a_compiler_goes_although_the_compiler_still_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    remove, late = shutil.rmtree, iter(["1.o", "2.o", "3.o"])

    def removing(path: Path, *, ignore_errors: bool) -> None:
        remove(path, ignore_errors=ignore_errors)
        for name in late:
            path.mkdir()
            (path / name).touch()
            break

    monkeypatch.setattr("shutil.rmtree", removing)
    with pytest.raises(SystemExit, match="143"), cache.scratch(tmp_path):
        raise SystemExit(143)
    assert not any(tmp_path.iterdir())

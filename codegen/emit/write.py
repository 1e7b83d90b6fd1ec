"""Write a generated folder as one step.

A new folder is written next to the old one and swapped in whole. A full disk, an interrupt or a kill leaves the old one or
the new one, never a mixture. Only files that a folder's own manifest names are ever removed.

Imports `errors`, `files` and, of this package, `folder`, whose public names are offered here as well.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from codegen.emit.folder import (
    BESIDE,
    MANIFEST,
    Folder,
    as_build_error,
    differences,
    entries,
    folders_of,
    owned_paths,
    read_manifest,
    render_manifest,
    strays,
    verify_hashes,
)
from codegen.errors import BuildError
from codegen.files import sync_folder

__all__ = [
    "BESIDE",
    "MANIFEST",
    "Folder",
    "check_target",
    "differences",
    "read_manifest",
    "render_manifest",
    "verify_hashes",
    "write_folder",
]


def write_folder(folder: Folder, target: Path) -> bool:
    """Make `target` hold exactly `folder`; return whether anything had to change.

    Nothing is touched if every byte is there already. Otherwise the folder is replaced as a whole, and the
    `BESIDE` files of the old build go with it. A link to a folder is followed. Builds into one parent folder take turns.

    Raises:
        BuildError: the target is a file or holds something that is not ours, or cannot be written; then, as after any
            other exception up to the swap, what stood before still stands.
    """
    place = Path(os.path.realpath(target))
    with as_build_error(target, "written"), _parents(place.parent), _turn(place.parent):
        _restore(place)
        _refuse_foreign(place, target)
        _refuse_other_kind(folder, place, target)
        for leftover in list(_leftovers(place)):
            _discard(leftover)
        if not differences(folder, place):
            return False
        _replace(place, folder.content(), target)
        return True


def check_target(target: Path) -> None:
    """Refuse before any work what `write_folder` would refuse after it: a file, or a folder that holds something else.

    Raises:
        BuildError: with what stands there.
    """
    _refuse_foreign(Path(os.path.realpath(target)), target)


def _refuse_foreign(place: Path, target: Path) -> None:
    remedy = "nothing was changed; choose another folder with -o, or move that away"
    if not place.name or (os.path.lexists(place) and not place.is_dir()):
        raise BuildError("not a folder that a build can be written to", where=target, remedy=remedy)
    if place.is_dir() and (stray := next(strays(entries(place), owned_paths(place)), None)) is not None:
        raise BuildError(f"holds {stray!r}, which no manifest of codegen names", where=target, remedy=remedy)


def _refuse_other_kind(folder: Folder, place: Path, target: Path) -> None:
    """Refuse to replace a firmware project by a build, or a build by a firmware project."""
    if owned_paths(place) and read_manifest(place).get("what") != folder.manifest.get("what"):
        raise BuildError(
            "another kind of generated folder stands there",
            where=target,
            remedy="nothing was changed; choose another folder with -o",
        )


def _replace(place: Path, content: Mapping[str, bytes], target: Path) -> None:
    new, aside = _temporary(place)
    os.mkdir(new)  # outside `try`: what stands there already is not for this build to discard
    try:
        _fill(new, content)
        if place.is_dir():
            shutil.copymode(place, new)
        old = _swap(new, place, aside)
        try:
            if old is not None:  # what was put there since the first look must not vanish with the old build
                _refuse_foreign(old, target)
            sync_folder(place.parent)
        except BaseException:
            if old is None:
                os.rename(place, new)
            else:
                _swap(old, place, aside if old == new else new)
            raise
    finally:
        # By now the temporary folder is either the unfinished new one or the old one.
        _discard(new)
        if os.path.lexists(place):
            _discard(aside)


def _fill(folder: Path, content: Mapping[str, bytes]) -> None:
    for path, data in content.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        _write_file(folder / path, data)
    for path in sorted(folders_of(content)):
        sync_folder(folder / path)
    sync_folder(folder)


def _write_file(path: Path, content: bytes) -> None:
    with path.open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _swap(new: Path, place: Path, aside: Path) -> Path | None:
    """Put `new` in `place`; return where the old folder is now, None where there was none."""
    if not os.path.lexists(place):
        os.rename(new, place)
        return None
    with suppress(OSError):
        _exchange(new, place)
        return new
    try:
        os.rename(place, aside)
        os.rename(new, place)
    except BaseException:
        if os.path.lexists(aside) and not os.path.lexists(place):
            os.rename(aside, place)
        raise
    return aside


def _exchange(one: Path, other: Path) -> None:
    """Exchange two folders in one step (Linux: renameat2). Raises OSError where system or file system cannot."""
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if sys.platform == "linux" else None
    if renameat2 is None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    at_working_folder, exchange = -100, 2  # AT_FDCWD of fcntl.h, RENAME_EXCHANGE of linux/fs.h
    if renameat2(at_working_folder, os.fsencode(one), at_working_folder, os.fsencode(other), exchange) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


@contextmanager
def _parents(folder: Path) -> Iterator[None]:
    """Make `folder` and what is missing above it; take that away again where the build fails."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):
                os.rmdir(path)
        raise


@contextmanager
def _turn(parent: Path) -> Iterator[None]:
    """Wait for other builds into `parent`. The lock ends with the process, whatever ends it, and leaves no file."""
    descriptor = os.open(parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with suppress(OSError):  # a file system without locks: the swap alone still keeps folders whole
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _temporary(place: Path) -> tuple[Path, Path]:
    """Paths for the new folder, and for the old one if the two cannot be exchanged."""
    name = f".{place.name}.codegen-tmp-{os.getpid()}"
    return place.with_name(name), place.with_name(f"{name}-old")


def _leftovers(place: Path) -> Iterator[Path]:
    """Temporary folders of builds into `place` whose process is gone."""
    pattern = re.compile(re.escape(f".{place.name}.codegen-tmp-") + r"([1-9][0-9]*)(-old)?\Z")
    with os.scandir(place.parent) as listing:
        siblings = sorted(listing, key=lambda sibling: sibling.name)
    for entry in siblings:
        match = pattern.match(entry.name)
        if match and entry.is_dir(follow_symlinks=False) and not _is_alive(int(match[1])):
            yield place.parent / entry.name


def _is_alive(pid: int) -> bool:
    if pid == os.getpid():
        # Builds take turns, so this one is not ours but that of a namesake: process numbers repeat, in containers often.
        return False
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # it lives and is another user's
        pass
    return True


def _restore(place: Path) -> None:
    """Put back a folder that a killed build had moved aside (only where the file system cannot exchange two folders)."""
    if not os.path.lexists(place):
        for leftover in _leftovers(place):
            if leftover.name.endswith("-old") and owned_paths(leftover):
                os.rename(leftover, place)
                return


def _discard(folder: Path) -> None:
    """Remove the files that the manifest of `folder` names, and the folders that this leaves empty.

    Files that cannot be removed stay for the next build, with the manifest. A finished build does not fail because of them.
    """
    if folder.is_symlink():
        return
    ours = owned_paths(folder)
    folders = folders_of(ours)
    with suppress(OSError):
        for path, kind in list(entries(folder)):
            if kind == "file" and path in ours and path != MANIFEST:
                os.unlink(folder / path)
            elif kind == "folder" and path in folders:
                with suppress(OSError):
                    os.rmdir(folder / path)
        # Alone, it goes even if it is cut short: a build that ended while it wrote its manifest has written nothing else.
        if os.listdir(folder) == [MANIFEST]:
            os.unlink(folder / MANIFEST)
        os.rmdir(folder)

"""Write a generated folder as one step.

A new folder is written next to the old one, and then the two are swapped. After a full disk, an interrupt or a kill, either the
old or the new folder is complete, never a mixture. Only files that a folder's own manifest names are ever removed.

This module imports only `errors`, `files` and, from this package, `folder`.
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
    MANIFEST,
    Folder,
    as_build_error,
    differences,
    entries,
    folders_of,
    foreign_paths,
    owned_paths,
    read_manifest,
)
from codegen.errors import BuildError
from codegen.files import sync_folder


def write_folder(folder: Folder, target: Path) -> bool:
    """Replace the content of `target` with `folder`. Return whether anything changed.

    If every byte is the same already, nothing is touched. Otherwise the folder is replaced as a whole, and the
    `VERIFICATION_FILES` of the old build are removed. A link to a folder is followed. Concurrent builds into one parent folder
    wait for each other.

    Raises:
        BuildError: the target is a file, contains files that codegen did not write, or cannot be written. After this and any
            other exception before the swap, the previous content is unchanged.
    """
    place = Path(os.path.realpath(target))
    with as_build_error(target, "written"), _parents(place.parent), _folder_lock(place.parent):
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
    """Reject a target that `write_folder` would reject, before any work: a file, or a folder with other content.

    Raises:
        BuildError: the target is rejected; the message names the content.
    """
    _refuse_foreign(Path(os.path.realpath(target)), target)


def _refuse_foreign(place: Path, target: Path) -> None:
    remedy = "nothing was changed; choose another folder, or move it away"
    if not place.name or (os.path.lexists(place) and not place.is_dir()):
        raise BuildError("not a folder that a build can be written to", where=target, remedy=remedy)
    if place.is_dir() and (stray := next(foreign_paths(entries(place), owned_paths(place)), None)) is not None:
        raise BuildError(f"contains {stray!r}, which no manifest of codegen names", where=target, remedy=remedy)


def _refuse_other_kind(folder: Folder, place: Path, target: Path) -> None:
    """Reject the replacement of a firmware project by a build, or of a build by a firmware project."""
    if owned_paths(place) and read_manifest(place).get("what") != folder.manifest.get("what"):
        raise BuildError(
            "the folder contains another kind of generated project",
            where=target,
            remedy="nothing was changed; choose another folder",
        )


def _replace(place: Path, content: Mapping[str, bytes], target: Path) -> None:
    new, aside = _temporary(place)
    os.mkdir(new)  # outside `try`: if the folder exists, this build must not discard it
    try:
        _fill(new, content)
        if place.is_dir():
            shutil.copymode(place, new)
        old = _swap(new, place, aside)
        try:
            if old is not None:  # files added since the first check must not be deleted with the old build
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
    """Move `new` to `place`. Return the new path of the old folder, None if there was none."""
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
    """Exchange two folders in one step (Linux: renameat2). Raises OSError if system or file system do not support it."""
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if sys.platform == "linux" else None
    if renameat2 is None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    at_working_folder, exchange = -100, 2  # AT_FDCWD of fcntl.h, RENAME_EXCHANGE of linux/fs.h
    if renameat2(at_working_folder, os.fsencode(one), at_working_folder, os.fsencode(other), exchange) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


@contextmanager
def _parents(folder: Path) -> Iterator[None]:
    """Create `folder` and its missing parents. Remove them again if the build fails."""
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
def _folder_lock(parent: Path) -> Iterator[None]:
    """Lock `parent` against other builds, and wait for them. The lock ends with the process in any case and leaves no file."""
    descriptor = os.open(parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with suppress(OSError):  # a file system without locks: the swap alone still keeps folders whole
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _temporary(place: Path) -> tuple[Path, Path]:
    """Return paths for the new folder, and for the old one if the two cannot be exchanged."""
    name = f".{place.name}.codegen-tmp-{os.getpid()}"
    return place.with_name(name), place.with_name(f"{name}-old")


def _leftovers(place: Path) -> Iterator[Path]:
    """Yield temporary folders of builds into `place` whose process has ended."""
    pattern = re.compile(re.escape(f".{place.name}.codegen-tmp-") + r"([1-9][0-9]*)(-old)?\Z")
    with os.scandir(place.parent) as listing:
        siblings = sorted(listing, key=lambda sibling: sibling.name)
    for entry in siblings:
        match = pattern.match(entry.name)
        if match and entry.is_dir(follow_symlinks=False) and not _is_alive(int(match[1])):
            yield place.parent / entry.name


def _is_alive(pid: int) -> bool:
    if pid == os.getpid():
        # This build has not created its folder yet, so an earlier process with the same number left this one. Numbers repeat,
        # often in containers.
        return False
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # the process is alive and belongs to another user
        pass
    return True


def _restore(place: Path) -> None:
    """Restore a folder that a killed build had moved aside (only if the file system cannot exchange two folders)."""
    if not os.path.lexists(place):
        for leftover in _leftovers(place):
            if leftover.name.endswith("-old") and owned_paths(leftover):
                os.rename(leftover, place)
                return


def _discard(folder: Path) -> None:
    """Remove the files that the manifest of `folder` names, and the folders that are empty then.

    Files that cannot be removed remain for the next build, with the manifest. They do not make a finished build fail.
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
        # A lone manifest is removed even if it is incomplete: a build that was killed while it wrote its manifest, its first
        # file, has written nothing else.
        if os.listdir(folder) == [MANIFEST]:
            os.unlink(folder / MANIFEST)
        os.rmdir(folder)

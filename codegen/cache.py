"""The cache: a folder that only the user can write, and files in it that are bound to their name and their content."""

from __future__ import annotations

import contextlib
import functools
import glob
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from codegen.errors import BuildError, CodegenError, one_line
from codegen.files import write_atomically

WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
SEAL_DIGITS = 32
"""Hexadecimal digits of the SHA-256 in the name of a file."""
REMOVALS_MAX = 1000
"""Largest number of attempts to remove a temporary folder: a fraction of a second."""


@dataclass(frozen=True)
class CacheFolder:
    """A cache folder, and the reason why it replaces the configured one; "" if it is the configured one."""

    path: Path
    reason: str = ""


@dataclass(frozen=True)
class Entry:
    """A file in the cache, and its content when it was checked."""

    path: Path
    content: bytes


def cache_folder() -> Path:
    """Return the cache folder, creating it if necessary. Its content can be deleted at any time.

    See `choose_folder`. A line on standard error, once per process, reports a replacement.
    """
    chosen = choose_folder()
    if chosen.reason:
        _report(f"warning: {chosen.reason}; compiled files go to {chosen.path}; set ARS_CACHE to a folder of your own")
    return chosen.path


def choose_folder() -> CacheFolder:
    """Return the cache folder, creating it if necessary.

    The folder is `$ARS_CACHE`, else `$XDG_CACHE_HOME/ars-codegen`, else `~/.cache/ars-codegen`. Code is loaded from it, so it
    must belong to the user, and nobody else may write into it or replace it. Otherwise, or if it is not writable, a temporary
    folder that is private to the user replaces it.

    Raises:
        BuildError: no folder is writable.
    """
    try:
        folder = _configured()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = folder.resolve()
        fault = _who_else_writes(folder)
        if not fault:
            with tempfile.TemporaryFile(dir=folder):
                return CacheFolder(folder)
    except (OSError, RuntimeError) as error:  # RuntimeError: no home folder, or a link to itself
        fault = f"the cache folder cannot be written ({getattr(error, 'strerror', None) or error})"
    return CacheFolder(_temporary_folder(), fault)


def _configured() -> Path:
    named = os.environ.get("ARS_CACHE")
    shared = os.environ.get("XDG_CACHE_HOME", "")
    if named:
        return Path(named).absolute()
    if Path(shared).is_absolute():  # the XDG specification requires relative paths to be ignored
        return Path(shared, "ars-codegen")
    return Path.home() / ".cache" / "ars-codegen"


def _who_else_writes(folder: Path) -> str:
    """Return why another user could change what is loaded from a folder; "" if nobody can. Its path must have no links."""
    user, status = os.getuid(), folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != user:
        return f"the cache folder {folder} belongs to another user"
    if status.st_mode & WRITABLE_BY_OTHERS:
        return f"other users can write into the cache folder {folder}"
    for parent in folder.parents:
        status = parent.lstat()
        # In a folder with the sticky bit, as /tmp, only the owner of an entry can replace it.
        is_open = status.st_mode & WRITABLE_BY_OTHERS and not status.st_mode & stat.S_ISVTX
        if status.st_uid not in (0, user) or is_open:
            return f"other users can replace the cache folder {folder}, because they can write into {parent}"
    return ""


@functools.cache
def _report(line: str) -> None:
    print(one_line(line, limit=1000), file=sys.stderr)


def _temporary_folder() -> Path:
    try:
        folder = Path(tempfile.gettempdir()).resolve() / f"ars-codegen-{os.getuid()}"
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        return _folder_of_this_process() if _who_else_writes(folder) else folder
    except OSError as error:
        raise BuildError(
            f"no cache folder is writable: {error.strerror}", remedy="set ARS_CACHE to a writable folder"
        ) from error


@functools.cache
def _folder_of_this_process() -> Path:
    return Path(tempfile.mkdtemp(prefix="ars-codegen-"))


@contextlib.contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder in the cache folder, in which a compiler works.

    A signal may end this process while its compilers, which get it too, still write for a moment. So the folder is removed
    until nothing comes back.
    """
    path = Path(tempfile.mkdtemp(prefix="build-", dir=folder))
    try:
        yield path
    finally:
        for _ in range(REMOVALS_MAX):
            shutil.rmtree(path, ignore_errors=True)
            if not path.exists():
                break
            os.sched_yield()


# --- files in the cache --------------------------------------------------------------------------------------------------


def find(folder: Path, name: str, suffix: str = "") -> Entry | None:
    """Return the file that `keep` stored under a name; None if it is missing, damaged, or not the user's own.

    Args:
        folder: a cache folder.
        name: name with a digest of everything that determines the content.
        suffix: end of the file name.
    """
    for path in sorted(folder.glob(f"{glob.escape(name)}-*{suffix}")):
        content = _own_content(path)
        if content is not None and path.name == _file_name(name, content, suffix):
            return Entry(path, content)
    return None


def keep(folder: Path, name: str, content: bytes, suffix: str = "", *, executable: bool = False) -> Entry:
    """Store a file under a name in one step: other processes see all of it or nothing. Arguments are those of `find`.

    The name of the file contains a digest of the name and the content, so a file with one changed bit, or one that was
    renamed, is not found.

    Raises:
        BuildError: it cannot be written.
    """
    path = folder / _file_name(name, content, suffix)
    try:
        write_atomically(path, content, mode=0o700 if executable else 0o600)
    except CodegenError as error:
        raise BuildError(error.what, where=error.where, remedy="free space there, or set ARS_CACHE") from None
    return Entry(path, content)


def _file_name(name: str, content: bytes, suffix: str) -> str:
    seal = hashlib.sha256(name.encode() + b"\0" + content).hexdigest()[:SEAL_DIGITS]
    return f"{name}-{seal}{suffix}"


def _own_content(path: Path) -> bytes | None:
    """Return the content of a regular file of the user that nobody else can write; None for any other."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)  # a pipe would block
        with os.fdopen(handle, "rb") as file:
            status = os.fstat(handle)
            is_own = status.st_uid == os.getuid() and not status.st_mode & WRITABLE_BY_OTHERS
            return file.read() if stat.S_ISREG(status.st_mode) and is_own else None
    except OSError:
        return None

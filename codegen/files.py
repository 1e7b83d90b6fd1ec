"""Read regular files up to a size limit, and write files completely or not at all."""

from __future__ import annotations

import codecs
import contextlib
import errno
import fcntl
import os
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import EllipsisType

from codegen.errors import CodegenError
from codegen.interrupts import deferred

LOCK_TIMEOUT_S = 10.0
"""Time to wait for the lock of a file. Other commands hold it for milliseconds."""
LOCK_RETRY_S = 0.01


def read_file(path: Path, limit: int, remedy: str, kind: type[CodegenError] = CodegenError, *, smaller: str = "") -> bytes:
    """Return all bytes of a regular file. Links are followed.

    Args:
        limit: largest size in bytes; larger files are rejected.
        remedy: remedy in the error message.
        kind: class of the error.
        smaller: remedy if the file is too large; by default `remedy`.

    Raises:
        CodegenError: of class `kind`, if the file is unreadable, too large or not regular. Reading a pipe would block, and
            reading a device might never end.
    """
    size = require_regular(path, limit, remedy, kind, smaller=smaller)
    try:
        with path.open("rb") as file:
            return file.read(size)  # not `limit`, which would allocate that much memory
    except OSError as error:
        raise kind(f"cannot be read ({reason_of(error)})", where=path, remedy=remedy) from None


def require_regular(path: Path, limit: int, remedy: str, kind: type[CodegenError] = CodegenError, *, smaller: str = "") -> int:
    """Return the size in bytes of a regular file that another library reads. Arguments and errors are those of `read_file`."""
    try:
        status = path.stat()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise kind(f"cannot be read ({reason_of(error)})", where=path, remedy=remedy) from None
    if not stat.S_ISREG(status.st_mode):
        raise kind("not a file", where=path, remedy=remedy)
    if status.st_size > limit:
        raise kind(f"over {size_text(limit)}", where=path, remedy=smaller or remedy)
    return status.st_size


def resolved(path: Path, kind: type[CodegenError] = CodegenError) -> Path:
    """Return an absolute path with all links followed. Raises CodegenError, of class `kind`, for a link to itself."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        raise kind("it is a link to itself", where=path, remedy="remove the link, or name another path") from None


def read_text(path: Path, limit: int, remedy: str, kind: type[CodegenError] = CodegenError, *, smaller: str = "") -> str:
    """Return the UTF-8 text of a regular file without its byte order mark. See `read_file`; other text is an error too."""
    data = read_file(path, limit, remedy, kind, smaller=smaller)
    refuse_utf16(data, path, kind)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise kind("not UTF-8 text", where=f"{path}, byte {error.start}", remedy="save it as UTF-8") from None


def refuse_utf16(data: bytes, where: object, kind: type[CodegenError] = CodegenError) -> None:
    """Raise CodegenError, of class `kind`, for text in UTF-16: with its mark, or with every second byte zero."""
    head = data[:64]
    is_wide = len(head) > 1 and any(not any(head[start::2]) and all(head[1 - start :: 2]) for start in (0, 1))
    if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) or is_wide:
        raise kind("it is in UTF-16", where=where, remedy="save it as UTF-8")


def refuse_empty(size: int, where: object, kind: type[CodegenError] = CodegenError) -> None:
    """Raise CodegenError, of class `kind`, for a file of no bytes."""
    if not size:
        raise kind("empty", where=where, remedy="save or copy it again")


def distinct_names(paths: Sequence[Path]) -> list[str]:
    """Return a name for each path: its stem, its name, or its name with as many folders as distinguish all paths."""
    depth = max((len(path.parts) for path in paths), default=0)
    tails = ([str(Path(*path.parts[-count:])) for path in paths] for count in range(1, depth + 1))
    for names in ([path.stem for path in paths], *tails):
        if len(set(names)) == len(names):
            break
    return names


def decoded(data: bytes) -> str:
    """Return the text of a file from elsewhere: UTF-8 with or without its mark, else Windows-1252, as older tools write it."""
    try:
        return data.removeprefix(codecs.BOM_UTF8).decode()  # "utf-8-sig" takes eight times as long for a line of a log
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def size_text(limit: int) -> str:
    """Return a size in bytes as whole MiB, or as whole KiB below one MiB."""
    return f"{limit >> 20} MiB" if limit >= 1 << 20 else f"{limit >> 10} KiB"


def reason_of(error: Exception) -> str:
    """Return the reason of an error as text."""
    return getattr(error, "strerror", None) or str(error)


class ChangedError(CodegenError):
    """A file that was to be replaced is no longer the one that was read."""


def write_atomically(
    path: Path, content: bytes, *, replaces: bytes | EllipsisType | None = ..., mode: int | None = None
) -> None:
    """Write one file completely or not at all. See `write_together`.

    Args:
        replaces: content that the file must still have; None: it must not exist; ...: any.
        mode: permissions of the file; None: those of any new file.

    Raises:
        ChangedError: another program wrote the file in the meantime. Nothing is written.
    """
    write_together({path: content}, {} if isinstance(replaces, EllipsisType) else {path: replaces}, mode)


def write_together(
    files: Mapping[Path, bytes], replaces: Mapping[Path, bytes | None] | None = None, mode: int | None = None
) -> None:
    """Write a temporary file beside each path, then rename them all. If one cannot be written, all previous files remain. Links
    are followed. A rename that fails leaves those before it done; then the content of all is on the same disk already.

    The files are locked from the comparison with `replaces` to the rename, so of two programs that replace the same content one
    succeeds.

    Args:
        replaces: path -> content that the file must still have, None: it must not exist. Other paths may have any.
        mode: permissions of the files; None: those of any new file.

    Raises:
        CodegenError: a folder is missing, a path is a folder or a device, the disk is full, or similar.
        ChangedError: see `replaces`.
    """
    expected = replaces or {}
    # A signal between creating a temporary file and entering `try` would leave it there.
    with deferred(), contextlib.ExitStack() as stack:
        written = [(path, *stack.enter_context(_written_beside(path, content, mode))) for path, content in files.items()]
        for path, _, target in sorted(written, key=lambda each: each[2]):  # in one order, so that no two wait for each other
            stack.enter_context(_locked(path, target))
        for path, _, target in written:
            if path in expected:
                _require_unchanged(path, target, expected[path])
        for path, temporary, target in written:
            with _told(path):
                if path in expected and expected[path] is None:
                    _rename_to_new(path, temporary, target)
                else:
                    temporary.replace(target)


@contextlib.contextmanager
def _locked(path: Path, target: Path) -> Iterator[None]:
    """Hold the lock of a file, if it exists and its file system has locks. The lock leaves no file."""
    handle = _handle_of_lock(path, target)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _handle_of_lock(path: Path, target: Path) -> int | None:
    end = time.monotonic() + LOCK_TIMEOUT_S
    while True:
        try:
            handle = os.open(target, os.O_RDONLY | os.O_NONBLOCK)
        except OSError:  # new, or unreadable
            return None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(handle), target.stat()):
                return handle
        except FileNotFoundError:
            pass  # removed since
        except BlockingIOError:
            if time.monotonic() > end:
                os.close(handle)
                raise CodegenError(
                    "another program holds its lock", where=path, remedy="end that program, or name another file"
                ) from None
            time.sleep(LOCK_RETRY_S)
        except OSError:  # a file system without locks
            return handle
        os.close(handle)  # of a file that was replaced since


def _require_unchanged(path: Path, target: Path, expected: bytes | None) -> None:
    try:
        with target.open("rb") as file:
            found: bytes | None = file.read(len(expected or b"") + 1)
    except OSError:
        found = None
    if found != expected:
        raise _changed(path)


def _rename_to_new(path: Path, temporary: Path, target: Path) -> None:
    """Rename a file to a name that must not exist. Raises ChangedError."""
    try:
        os.link(temporary, target)
    except FileExistsError:
        raise _changed(path) from None
    except OSError:  # a file system without links
        temporary.replace(target)


def _changed(path: Path) -> ChangedError:
    return ChangedError(
        "another program wrote it in the meantime",
        where=path,
        remedy="nothing was written; repeat the command with its new content",
    )


@contextlib.contextmanager
def _written_beside(path: Path, content: bytes, mode: int | None) -> Iterator[tuple[Path, Path]]:
    """Yield a temporary file with the content, and the target of `path`. The temporary file is removed at the end."""
    with _told(path):
        target = path.resolve()
        if target.exists() and not target.is_file():
            raise OSError(0, "it exists and is not a file")
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".tmp")
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            if mode is None:  # mkstemp makes a file that only its user can read
                umask = os.umask(0)
                os.umask(umask)
                mode = 0o666 & ~umask
            temporary.chmod(mode)
            yield temporary, target
        finally:
            temporary.unlink(missing_ok=True)


def replace_durably(temporary: Path, path: Path) -> None:
    """Rename a finished temporary file to `path` in the same folder. A loss of power after the return does not damage it.

    Raises:
        OSError: it cannot be synchronised or renamed.
    """
    with temporary.open("rb") as file:
        os.fsync(file.fileno())
    os.replace(temporary, path)
    sync_folder(path.parent)


def sync_folder(path: Path) -> None:
    """Synchronise the entries of a folder to the disk. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some file systems sync only files
            raise
    finally:
        os.close(descriptor)


def make_folder(path: Path) -> None:
    """Create a folder and its missing parents. Raises CodegenError."""
    with _told(path):
        path.mkdir(parents=True, exist_ok=True)


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, RuntimeError) as error:  # a NUL in the name; a link to itself
        raise CodegenError(
            f"cannot be written ({reason_of(error)})",
            where=path,
            remedy="check that the folder exists, is writable and has space",
        ) from None

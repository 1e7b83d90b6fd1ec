"""The door for files: read regular ones up to a size, write whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from codegen.errors import CodegenError
from codegen.interrupts import deferred


def read_file(path: Path, limit: int, remedy: str, kind: type[CodegenError] = CodegenError) -> bytes:
    """All bytes of a regular file; a link is followed.

    Args:
        limit: bytes; what is larger is not read.
        remedy: what to do where it cannot be read.
        kind: of the error.

    Raises:
        CodegenError: of that kind: unreadable, too large, or no regular file: a pipe would be waited for, a device read on.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise kind("not a file", where=path, remedy=remedy)
        if status.st_size > limit:
            raise kind(f"over {limit >> 20} MiB", where=path, remedy=remedy)
        with path.open("rb") as file:
            return file.read(status.st_size)  # not `limit`: so much memory would be taken
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise kind(f"cannot be read ({reason_of(error)})", where=path, remedy=remedy) from None


def read_text(path: Path, limit: int, remedy: str, kind: type[CodegenError] = CodegenError) -> str:
    """The UTF-8 text of a regular file, without the mark at its start. See `read_file`; raises the same, and for other text."""
    try:
        return read_file(path, limit, remedy, kind).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise kind("not UTF-8 text", where=f"{path}, byte {error.start}", remedy="save it as UTF-8") from None


def reason_of(error: Exception) -> str:
    """Why, in words."""
    return getattr(error, "strerror", None) or str(error)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a temporary file beside `path`, then put it in place; on any failure what stood before still stands. A link is
    followed.

    Raises:
        CodegenError: the folder is missing, `path` is a folder or a device, the disk is full, and the like.
    """
    with deferred(), _told(path):  # a signal between the making of the temporary file and what removes it would leave it there
        path = path.resolve()  # through a link, to what it names
        if path.exists() and not path.is_file():
            raise OSError(0, "there is something that is not a file")
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            # mkstemp is private to the user; a result is as public as the umask lets any new file be.
            umask = os.umask(0)
            os.umask(umask)
            temporary.chmod(0o666 & ~umask)
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def replace_durably(temporary: Path, path: Path) -> None:
    """Put a finished temporary file in the place of `path`, in the same folder: on return a loss of power loses nothing of it.

    Raises:
        OSError: it cannot be synchronised or renamed.
    """
    with temporary.open("rb") as file:
        os.fsync(file.fileno())
    os.replace(temporary, path)
    sync_folder(path.parent)


def sync_folder(path: Path) -> None:
    """Bring the names in a folder to the disk. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some file systems sync only files
            raise
    finally:
        os.close(descriptor)


def make_folder(path: Path) -> None:
    """Make a folder and its parents where they are missing. Raises CodegenError."""
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

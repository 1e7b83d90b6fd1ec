"""Files written whole or not at all.

Layer 1: imports only `errors` and `interrupts`.
"""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from codegen.errors import CodegenError
from codegen.interrupts import deferred


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
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise CodegenError(
            f"cannot be written ({reason})", where=path, remedy="check that the folder exists, is writable and has space"
        ) from None

"""Location of the cache of compiled libraries and templates."""

from __future__ import annotations

import contextlib
import functools
import os
import stat
import tempfile
from pathlib import Path

from codegen.errors import BuildError


def cache_folder() -> Path:
    """Return the cache folder, creating it if necessary. Its content can be deleted at any time.

    The folder is `$ARS_CACHE`, else `$XDG_CACHE_HOME/ars-codegen`, else `~/.cache/ars-codegen`. If it is not writable, a
    temporary folder that is private to the user replaces it.
    """
    named = os.environ.get("ARS_CACHE")
    shared = os.environ.get("XDG_CACHE_HOME", "")
    try:
        if named:
            folder = Path(named).absolute()
        elif Path(shared).is_absolute():  # the XDG specification requires relative paths to be ignored
            folder = Path(shared, "ars-codegen")
        else:
            folder = Path.home() / ".cache" / "ars-codegen"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # RuntimeError: no home folder
        return _temporary_folder()


def _temporary_folder() -> Path:
    try:
        folder = Path(tempfile.gettempdir(), f"ars-codegen-{os.getuid()}")
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        # Code is loaded from here, so a folder that another user could write to is rejected.
        status = folder.lstat()
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077:
            return folder
        return _folder_of_this_process()
    except OSError as error:
        raise BuildError(
            f"no cache folder is writable: {error.strerror}", remedy="set ARS_CACHE to a writable folder"
        ) from error


@functools.cache
def _folder_of_this_process() -> Path:
    return Path(tempfile.mkdtemp(prefix="ars-codegen-"))

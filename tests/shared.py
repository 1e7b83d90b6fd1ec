"""Results that several tests need, made once per run and shared by all its workers.

The store is a temporary folder of the run. An entry is named by the SHA-256 of its key, so two tests that describe the same
work share it and a different input never gets a stale result.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import functools
import hashlib
import os
import pickle
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from codegen.emit.folder import Folder
from codegen.emit.text import Precision

VARIABLE = "ARS_TESTS_SHARED"
"""Environment variable with the folder of the run; workers inherit it from the process that starts them."""


IS_CI = os.environ.get("CI", "").lower() not in ("", "0", "false")
"""Whether this is a run in CI, where a test that cannot run is a failure."""
PREFIX = "ars-tests-run-"
YOUNG_S = 60.0
"""Minimum age of folders to remove: a younger run may not have locked its folder yet."""


def begin() -> None:
    """Create the folder of the run, and remove those of killed runs."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > YOUNG_S:
                lock = os.open(path, os.O_RDONLY)
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails while the process lives
                    shutil.rmtree(path)
                finally:
                    os.close(lock)
    os.environ[VARIABLE] = tempfile.mkdtemp(prefix=PREFIX)
    fcntl.flock(os.open(os.environ[VARIABLE], os.O_RDONLY), fcntl.LOCK_EX)  # until the process ends


def folder() -> Path:
    """Return the folder of the run. The first process that calls this, which starts the others, creates and removes it."""
    if VARIABLE not in os.environ:
        begin()
        atexit.register(shutil.rmtree, os.environ[VARIABLE], ignore_errors=True)  # a run may begin another one in the meantime
    return Path(os.environ[VARIABLE])


@contextlib.contextmanager
def locked(key: str) -> Iterator[Path]:
    """Hold the lock of a key across all processes, and yield a path for its entry (a file or a folder)."""
    path = folder() / hashlib.sha256(f"{__file__} {key}".encode()).hexdigest()  # a copy of the checkout has its own
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield path


def once(key: str, make: Callable[[], Any]) -> Any:
    """Return the result of `make`, computed by the first worker that needs it. It must be picklable."""
    with locked(key) as path:
        if not path.exists():
            path.write_bytes(pickle.dumps(make()))
        return pickle.loads(path.read_bytes())


@functools.cache
def build_folder(kind: str = "pi", precision: Precision = "single") -> Path:
    """Return a build of `tests.builds.of_kind` on disk, as written by `codegen build`. Tests must not write to it."""
    from tests import builds

    return written(f"build folder {kind} {precision}", lambda: builds.of_kind(kind, precision).folder)


def written(key: str, make: Callable[[], Folder]) -> Path:
    """Return a build on disk, as written by `codegen build` once per run. Tests must not write to it."""
    from codegen.emit.write import write_folder

    with locked(key) as path:
        place = path / "4ws2"
        if not place.exists():
            write_folder(make(), place)
        return place

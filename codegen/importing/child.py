"""Calls in a process of its own, for libraries that crash or request any amount of memory on a damaged file.

The result returns as a pickle. An attacker who could forge it through a file could already run code in the child, with the
same rights.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import math
import os
import pickle
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from codegen.errors import one_line
from codegen.limits import Limits, limit_memory
from codegen.requirements import missing

PROGRAM = (sys.executable, "-P", "-m", __name__)
"""-P: neither the user's folder nor this one comes before the libraries."""
WALL_FACTOR = 3.0
"""Time limit by the clock, as a multiple of the processor time: the machine may be busy."""


RESULT_SHARE = 4
"""Part of the memory that a result may have: both processes hold several copies of it."""


def result_bytes(limits: Limits) -> int:
    """Return the largest size of a result."""
    return limits.memory_bytes // RESULT_SHARE


class ChildError(Exception):
    """The call ended without a result: the process crashed or took too long."""


def call(module: str, function: str, *arguments: Any, limits: Limits | None = None) -> Any:
    """Call a function of a module, which only the child imports, and return its result.

    Args:
        arguments: of types that can be pickled.
        limits: time and memory after the import of the module; None: those of a small file.

    Raises:
        ChildError: the process crashed or took too long, or could not be started.
        MemoryError: it needs more memory.
        Exception: whatever the import of the module or the function raises, ImportError included.
    """
    limits = limits or Limits()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry)}
    request = pickle.dumps((module, function, arguments, limits))
    too_long = f"reading it takes more than {limits.seconds:g} s, the limit for its size"
    try:
        ended = subprocess.run(
            PROGRAM, input=request, capture_output=True, timeout=WALL_FACTOR * limits.seconds, check=False, env=environment
        )
    except subprocess.TimeoutExpired as error:
        raise ChildError(f"reading it does not end within {error.timeout:g} s by the clock") from None
    except OSError as error:
        raise ChildError(f"it cannot be read in a process of its own: {error.strerror}") from None
    if ended.returncode == -signal.SIGXCPU:
        raise ChildError(too_long)
    if ended.returncode:
        raise ChildError(f"its reader crashed, exit code {ended.returncode}")
    result, failure = pickle.loads(ended.stdout)
    if failure is not None:
        raise failure
    return result


PACKAGES = {"mf4": "asammdf", "parquet": "pyarrow"}
"""Module of `codegen.importing` -> the package that it needs."""


def read(path: Path, module: str, function: str, *arguments: Any, limits: Limits) -> Any:
    """Call a function of a module of PACKAGES for a file.

    Raises:
        CodegenError: the package is not installed.
        Exception: see `call`.
    """
    try:
        return call(f"codegen.importing.{module}", function, path, *arguments, limits=limits)
    except ImportError:
        raise missing(PACKAGES[module], f"reads {path.suffix.lower()}", path) from None


def _bound_process(limits: Limits) -> None:
    """Disable core files, and limit the processor time and the memory of this process."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + limits.seconds), most))
    limit_memory(limits.memory_bytes)


def _main() -> None:
    """Make the call that standard input describes and write its result or its error to standard output."""
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # libraries may print
    module, function, arguments, limits = pickle.load(sys.stdin.buffer)
    try:
        called = getattr(importlib.import_module(module), function)
        _bound_process(limits)
        content = pickle.dumps((called(*arguments), None))
    except ImportError as error:
        content = pickle.dumps((None, ImportError(one_line(error))))
    except MemoryError:
        text = f"reading it takes more than {limits.memory_bytes / 1e9:.1f} GB of memory, the limit for its size"
        content = pickle.dumps((None, MemoryError(text)))
    except Exception as error:  # some cannot be pickled, or not restored
        content = pickle.dumps((None, ValueError(one_line(error) or type(error).__name__)))
    output.write(content)


if __name__ == "__main__":
    _main()


LIBRARIES = ("can", "cantools", "asammdf")


@contextlib.contextmanager
def collected() -> Iterator[list[str]]:
    """Yield a list that gets each warning of the libraries in the block, once."""
    found: list[str] = []

    def keep(text: object) -> None:
        line = one_line(text)
        if line and line not in found:
            found.append(line)

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            keep(record.getMessage())

    handler = Handler(logging.WARNING)
    loggers = [logging.getLogger(name) for name in LIBRARIES]
    propagated, disabled = [logger.propagate for logger in loggers], logging.root.manager.disable
    logging.disable(logging.NOTSET)  # the command line disables all logging
    for logger in loggers:
        logger.addHandler(handler)
        logger.propagate = False
    try:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always", UserWarning)
            yield found
        for each in raised:
            if issubclass(each.category, UserWarning):
                keep(each.message)
    finally:
        logging.disable(disabled)
        for logger, is_propagated in zip(loggers, propagated, strict=True):
            logger.removeHandler(handler)
            logger.propagate = is_propagated

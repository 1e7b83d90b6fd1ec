"""Calls in a process of its own, for libraries that crash or request any amount of memory on a damaged file.

The result returns as a pickle. Whoever could forge it through a file would already run code in the child, with the same rights.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

from codegen.errors import one_line

PROGRAM = (sys.executable, "-P", "-m", __name__)
"""-P: neither the user's folder nor this one comes before the libraries."""
SPARE_BYTES = 2**30
"""Default memory limit of a call, in addition to Python and the libraries."""
SECONDS = 60.0
"""Default time limit of a call."""
LOG: dict[str, Any] = {"seconds": 600.0, "spare_bytes": 2**34}
"""Limits for a log of up to 2 GiB."""


class ChildError(Exception):
    """The call ended without a result: the process crashed or took too long."""


def call(module: str, function: str, *arguments: Any, seconds: float = SECONDS, spare_bytes: int = SPARE_BYTES) -> Any:
    """Call a function of a module, which only the child imports, and return its result.

    Args:
        arguments: of types that can be pickled.
        spare_bytes: memory limit, where Linux reports the size of the process.

    Raises:
        ChildError: the process crashed or took too long, or could not be started.
        Exception: whatever the import of the module or the function raises, ImportError and MemoryError included.
    """
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(entry for entry in sys.path if entry)}
    request = pickle.dumps((module, function, arguments, spare_bytes))
    try:
        ended = subprocess.run(PROGRAM, input=request, capture_output=True, timeout=seconds, check=False, env=environment)
    except subprocess.TimeoutExpired:
        raise ChildError(f"no answer within {seconds:g} s") from None
    except OSError as error:
        raise ChildError(f"it cannot be read in a process of its own: {error.strerror}") from None
    if ended.returncode:
        raise ChildError(f"its reader crashed, exit code {ended.returncode}")
    result, failure = pickle.loads(ended.stdout)
    if failure is not None:
        raise failure
    return result


def _bound_process(spare_bytes: int) -> None:
    """Disable core files and, where Linux reports the size of this process, limit its memory to `spare_bytes` more."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + spare_bytes, most))


def _main() -> None:
    """Make the call that standard input describes and write its result or its error to standard output."""
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # libraries may print
    module, function, arguments, spare_bytes = pickle.load(sys.stdin.buffer)
    result: tuple[Any, Exception | None]
    try:
        called = getattr(importlib.import_module(module), function)
        _bound_process(spare_bytes)
        result = called(*arguments), None
    except (ImportError, MemoryError) as error:
        result = None, type(error)(one_line(error))
    except Exception as error:  # some cannot be pickled, or not restored
        result = None, ValueError(one_line(error) or type(error).__name__)
    output.write(pickle.dumps(result))


if __name__ == "__main__":
    _main()

"""Run another program to its end, without input, and capture its output as text."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path


def run_program(
    command: Sequence[str],
    folder: Path | None = None,
    *,
    timeout: float | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run `command` in `folder` for at most `timeout` seconds, with messages in English.

    Args:
        command: Program and arguments.
        folder: Working directory; None is the current one.
        timeout: Limit, in s; None waits for ever.
        environment: All variables of the program; None is those of this process.

    Returns:
        Exit code and output. Bytes that are not UTF-8 are replaced.

    Raises:
        OSError: the program cannot be started.
        subprocess.TimeoutExpired: it did not end in time.
    """
    return subprocess.run(
        command,
        cwd=folder,
        env={**(os.environ if environment is None else environment), "LC_ALL": "C"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=timeout,
    )

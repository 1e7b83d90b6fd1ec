"""Whether C comes to run in Python here: the cache of compiled files, and a small module made of C."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from codegen.cache import cache_folder
from codegen.doctor.finding import Finding, State
from codegen.errors import BuildError, one_line

HEADER = "int sum(int one, int other);\n"
SOURCE = '#include "tiny.h"\n\nint sum(int one, int other)\n{\n    return one + other;\n}\n'

_TRIAL = """
import sys
from codegen.errors import BuildError
from codegen.sil.compile import compile_library
try:
    made = compile_library("doctor", {"include/tiny.h": sys.argv[1], "src/tiny.c": sys.argv[2]}, ["include/tiny.h"])
except BuildError as error:
    sys.exit(str(error))
if made.lib.sum(19, 23) != 42:
    sys.exit("it computes 19 + 23 wrong")
print(made.mode)
"""

HOW = {
    "api": "compiled against Python's headers",
    "abi": "compiled as a plain library, for Python's headers are not installed",
}


def cache() -> Finding:
    """Check the folder of compiled files and whether it is writable."""
    serves = "compiled C is kept, and a second run starts at once"
    try:
        folder = cache_folder()
    except BuildError as error:
        return Finding("cache", State.BAD, error.what, serves, error.remedy, needed=True)
    if folder.is_relative_to(tempfile.gettempdir()) and not os.environ.get("ARS_CACHE", "").startswith(str(folder)):
        what = f"{folder}, for no folder of the user can be written"
        return Finding("cache", State.GOOD, what, serves, "set ARS_CACHE to a folder that stays", needed=True)
    return Finding("cache", State.GOOD, str(folder), serves, needed=True)


def module() -> Finding:
    """Compile a small module and call it, in a process and a folder of its own: nothing of it comes from the cache."""
    name, serves = "C in Python", "codegen sil, and all that runs the generated C"
    try:
        with tempfile.TemporaryDirectory(prefix="ars-doctor-") as folder:
            root = str(Path(__file__).resolve().parents[2])
            path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
            answer = subprocess.run(
                [sys.executable, "-c", _TRIAL, HEADER, SOURCE],
                env={**os.environ, "ARS_CACHE": folder, "PYTHONPATH": path},
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
            )
    except OSError as error:
        return Finding(name, State.BAD, f"it could not be tried: {one_line(error)}", serves, "free space", needed=True)
    if answer.returncode == 0:
        return Finding(name, State.GOOD, HOW[answer.stdout.strip()], serves, needed=True)
    what = (answer.stderr.strip().splitlines() or [f"it ended with exit code {answer.returncode}"])[-1]
    return Finding(name, State.BAD, one_line(what), serves, "check the compiler with a small program of your own", needed=True)

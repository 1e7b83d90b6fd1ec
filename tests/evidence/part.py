"""What every part of the campaign takes, and what it gives.

A part is a module of this package with `run(folders, effort) -> Outcome`: one row of the table for all the builds, by default
the committed ones. It writes nothing into the folders, and raises `codegen.verify.packages.MissingTool` where what it needs is
not there: that part counts as not run.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from pathlib import Path

from codegen.verify.check import Effort, Outcome

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "generated" / "4ws2", ROOT / "generated" / "4ws2-tracking")

# Name on the command line to module: in the order in which they are run.
MODULES = {
    "coverage": "coverage.coverage",
    "mcdc": "coverage.mcdc",
    "mutation": "mutation.mutation",
    "planted": "faults.planted",
    "libfuzzer": "libfuzzer.libfuzzer",
    "exhaustive": "exhaustive.exhaustive",
    "frama-c": "frama_c.frama_c",
}

OPTIONAL = frozenset({"frama-c"})
"""Parts whose tool few have: where it is missing they are not run, and that is no failure."""

Run = Callable[[Sequence[Path], Effort], Outcome]


def part(name: str) -> Run:
    """The function that runs a part, by its name on the command line."""
    run: Run = importlib.import_module(f"tests.evidence.{MODULES[name]}").run
    return run

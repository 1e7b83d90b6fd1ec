"""`python -m tests.evidence [PART…] [--quick]`: run the parts, print a table, write build/campaign.json; exit 1 if one fails.

Without names all parts are run. A part whose tool is missing is not run, and that counts as a failure unless it is allowed, or
the part is optional.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from codegen.errors import CodegenError
from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.part import FOLDERS, MODULES, OPTIONAL, ROOT, Run, part

RESULT = ROOT / "build" / "campaign.json"
FINDINGS_SHOWN = 20
"""Of each part; the file holds all."""


def main(arguments: Sequence[str] | None = None, result: Path = RESULT, part_of: Callable[[str], Run] = part) -> int:
    """Run what is asked for. Returns the exit code: 1 where a part fails or could not be run."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.evidence", description="What is shown of the C beyond codegen verify."
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(MODULES)}; by default all")
    parser.add_argument("--quick", action="store_true", help="less of it")
    parser.add_argument("--allow-missing", action="store_true", help="a part whose tool is missing does not count as a failure")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.parts if name not in MODULES]
    if unknown:
        parser.error(f"there is no part {unknown[0]!r}; known: {', '.join(MODULES)}")
    outcomes: dict[str, Outcome] = {}
    for name in options.parts or MODULES:
        print(f"... {name}", file=sys.stderr, flush=True)
        outcomes[name] = run_part(part_of(name), Effort(options.quick))
    write(result, outcomes, options.quick)
    Console(width=max(100, min(160, Console().width))).print(table(outcomes))
    for name, outcome in outcomes.items():
        _tell_findings(name, outcome, result)
    allowed = outcomes.keys() if options.allow_missing else OPTIONAL
    return 1 if any(_is_bad(outcome.verdict, name in allowed) for name, outcome in outcomes.items()) else 0


def _is_bad(verdict: Verdict, may_be_missing: bool) -> bool:
    return verdict is Verdict.FAILED or (verdict is Verdict.NOT_RUN and not may_be_missing)


def run_part(run: Run, effort: Effort, folders: Sequence[Path] = FOLDERS) -> Outcome:
    """One part; a missing tool and a build that cannot be tested are outcomes too."""
    try:
        return run(folders, effort)
    except MissingTool as error:
        return Outcome("", "", Verdict.NOT_RUN, (str(error),))
    except CodegenError as error:
        return Outcome("", "", Verdict.FAILED, (str(error),))


def table(outcomes: Mapping[str, Outcome]) -> Table:
    """Part, what it shows, figure, verdict."""
    shown = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    shown.add_column("Part", no_wrap=True)
    shown.add_column("Shows")
    shown.add_column("Figure")
    shown.add_column("Verdict", no_wrap=True)
    for name, outcome in outcomes.items():
        shown.add_row(name, outcome.shows, outcome.figure, str(outcome.verdict))
    return shown


def _tell_findings(name: str, outcome: Outcome, result: Path) -> None:
    for finding in outcome.findings[:FINDINGS_SHOWN]:
        print(f"{name}: {finding}")
    if len(outcome.findings) > FINDINGS_SHOWN:
        print(f"{name}: and {len(outcome.findings) - FINDINGS_SHOWN} more, in {result}")


def write(path: Path, outcomes: Mapping[str, Outcome], quick: bool) -> None:
    """The outcomes as JSON; those of parts that were not asked for stay as they were."""
    path.parent.mkdir(parents=True, exist_ok=True)
    known: dict[str, object] = {}
    if path.is_file():
        known = json.loads(path.read_text(encoding="utf-8")).get("parts", {})
    known |= {name: {**asdict(outcome), "quick": quick} for name, outcome in outcomes.items()}
    ordered = {name: known[name] for name in MODULES if name in known}
    path.write_text(json.dumps({"parts": ordered}, indent=1, default=dict) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())

"""`python -m tests.evidence [PART…] [--quick] [--changed] [--check]`: run parts of the evidence and record their results.

Without names all parts run. An interrupted part resumes. Exit code 1: a part fails, a required tool is missing, or with --check
a record is out of date. 2: bad input. 130: Ctrl-C.
"""

import argparse
import faulthandler
import importlib
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from codegen.errors import CodegenError, suggestion
from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence import pytest_part
from tests.evidence.parts import FOLDERS, PARTS, RECORDS, ROOT, Part, Run
from tests.evidence.progress import Progress
from tests.evidence.record import FORMS, Form, Record

SCRATCH = ROOT / "build" / "evidence"
"""Finished steps of the parts, until their code changes."""
STEPS = (".passed", ".jsonl")
"""Suffixes of the files of finished steps."""
FINDINGS_SHOWN = 20
"""Largest number of findings printed for a part; the record holds all."""


def main(arguments: Sequence[str] | None = None, parts: Sequence[Part] = PARTS, records: Path = RECORDS) -> int:
    """Run the command. Returns the exit code."""
    options = _options(arguments, [part.name for part in parts])
    chosen = [part for part in parts if not options.parts or part.name in options.parts]
    if options.check:
        return _check(chosen, records)
    if options.changed:
        changed = [part for part in parts if not Record.read(part, records).is_current("full")]
        chosen = [part for part in parts if part in changed or part.name in options.parts]
    for part in chosen:
        Record.read(part, records)  # report an invalid record before the run
    rows: list[tuple[Part, Outcome, float]] = []
    missing = {part.name: part.missing_tools() for part in chosen}
    for line in (f"{name}: not run: {tool}" for name, tools in missing.items() for tool in tools):
        print(line, flush=True)
    for part in chosen:
        if missing[part.name]:
            continue
        print(f"... {part.name}", file=sys.stderr, flush=True)
        hashes = part.hashes()
        rows.append((part, *run_part(part, Effort(options.quick))))
        outcome = rows[-1][1]
        form: Form = "quick" if options.quick else "full"
        if outcome.verdict is not Verdict.NOT_RUN:
            Record.read(part, records).keep(form, outcome, hashes, rows[-1][2], records)
    for part, outcome, seconds in rows:
        begin = f"{part.name}: not run" if outcome.verdict is Verdict.NOT_RUN else part.name
        if outcome.verdict is not Verdict.NOT_RUN:
            print(f"{part.name}: {outcome.verdict}: {outcome.figure} ({seconds:.0f} s)")
        for finding in outcome.findings[:FINDINGS_SHOWN]:
            print(f"{begin}: {finding}")
        if len(outcome.findings) > FINDINGS_SHOWN:
            print(f"{part.name}: and {len(outcome.findings) - FINDINGS_SHOWN} more, in its record")
    return 1 if any(missing.values()) or any(outcome.verdict is not Verdict.PASSED for _, outcome, _ in rows) else 0


class _Parser(argparse.ArgumentParser):
    """A parser that reports bad input in one line, without its usage."""

    def error(self, message: str) -> NoReturn:
        raise CodegenError(message, remedy="see python -m tests.evidence --help")


def _options(arguments: Sequence[str] | None, known: Sequence[str]) -> argparse.Namespace:
    parser = _Parser(prog="python -m tests.evidence", description="The evidence that a release needs.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(known)}; all by default")
    parser.add_argument("--quick", action="store_true", help="the quick form of each part")
    parser.add_argument("--changed", action="store_true", help="the named parts, and those whose subject or code changed")
    parser.add_argument("--check", action="store_true", help="run nothing; report which records are out of date")
    options = parser.parse_args(arguments)
    for name in options.parts:
        if name not in known:
            remedy = f"the parts are {', '.join(known)}{suggestion(name, known)}"
            raise CodegenError(f"there is no part {name!r}", remedy=remedy)
    return options


def _check(parts: Sequence[Part], records: Path) -> int:
    """Report outdated records, and records without a part; return 1 if there are any."""
    wrong, match_count = [], 0
    for part in parts:
        try:
            record = Record.read(part, records)
        except CodegenError as error:
            wrong.append(str(error))
            continue
        if record.matches:
            match_count += 1
        else:
            causes = "; ".join(f"{form} run: {record.fault(form)}" for form in FORMS)
            wrong.append(f"{part.name}: {causes}; run: make evidence PART={part.name} QUICK=1")
    known = {part.name for part in PARTS} | {part.name for part in parts}
    wrong += [f"{path}: there is no such part; delete it" for path in sorted(records.glob("*.json")) if path.stem not in known]
    print("\n".join(wrong) or f"{match_count} records match what is there")
    return 1 if wrong else 0


def run_part(part: Part, effort: Effort) -> tuple[Outcome, float]:
    """Run one part; return its outcome and its duration in s, including interrupted runs.

    A missing tool and a build that cannot be tested are outcomes too.
    """
    state = "-".join(digest[:16] for digest in part.hashes().values())
    scratch = SCRATCH / f"{part.name}-{'quick' if effort.quick else 'full'}-{state}"
    begun = time.time() - _seconds_before(scratch)
    try:
        if not part.module:
            outcome = pytest_part.run(part, effort, scratch.with_suffix(".passed"))
        else:
            run: Run = importlib.import_module(part.module).run
            outcome = run(FOLDERS, effort, Progress(scratch.with_suffix(".jsonl")))
    except MissingTool as error:
        outcome = Outcome(part.shows, "", Verdict.NOT_RUN, (str(error),))
    except CodegenError as error:
        return Outcome(part.shows, "", Verdict.FAILED, (str(error),)), time.time() - begun
    if outcome.verdict is not Verdict.NOT_RUN:  # finished: the next run starts over
        for suffix in (*STEPS, ".clock"):
            scratch.with_suffix(suffix).unlink(missing_ok=True)
    return outcome, time.time() - begun


def _seconds_before(scratch: Path) -> float:
    """Return the duration of earlier runs up to their last finished steps, in s, and store it with the time now."""
    clock, seconds = scratch.with_suffix(".clock"), 0.0
    finished = [path.stat().st_mtime for path in map(scratch.with_suffix, STEPS) if path.is_file()]
    if finished and clock.is_file():
        seconds, begun = json.loads(clock.read_text(encoding="ascii"))
        seconds += max(0.0, max(finished) - begun)
    clock.parent.mkdir(parents=True, exist_ok=True)
    clock.write_text(json.dumps([seconds, time.time()]), encoding="ascii")
    return seconds


if __name__ == "__main__":
    faulthandler.enable()  # print the stack if a part crashes the process
    try:
        sys.exit(main())
    except CodegenError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("interrupted; run the same command to resume", file=sys.stderr)
        sys.exit(130)

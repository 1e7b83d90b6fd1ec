"""`python -m tests.evidence [PART…] [--quick] [--files DIR]`: run parts of the evidence.

Without names all parts run. A full run leaves a record, and resumes if it was interrupted. A quick run leaves none; it fails
also for a part whose recorded full run failed on the current files. Exit code 1: a part fails, or a required tool is missing.
2: bad input. 130: Ctrl-C.
"""

import argparse
import faulthandler
import importlib
import json
import multiprocessing
import os
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from codegen.errors import CodegenError
from codegen.files import write_atomically
from codegen.verify.outcomes import Effort, Outcome, Verdict
from codegen.verify.tools import MissingTool
from tests import shared
from tests.evidence import pytest_part, record
from tests.evidence.parts import FOLDERS, PARTS, RECORDS, ROOT, Part, hash_of
from tests.evidence.progress import Progress
from tests.evidence.record import Record

SCRATCH = ROOT / "build" / "evidence"
"""Finished steps of parts; those of full runs stay until code changes."""
CODE = ("ars_codegen/*", "codegen/**/*", "hil_sim/**/*", "scripts/**/*", "templates/**/*", "tests/**/*")
QUICK_PROCESS_COUNT = 2
"""Parts whose quick forms run at the same time. On two processors three are slower: they share caches."""
NEEDS_FILES = "it needs public files, which are not in the repository: make evidence PART={} FILES=DIR; see docs/evidence.md"
FINDINGS_SHOWN = 20
"""Largest number of findings printed for a part; a record holds all."""


def main(arguments: Sequence[str] | None = None, parts: Sequence[Part] = PARTS, records: Path = RECORDS) -> int:
    """Run the command. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.evidence", description="The evidence that a release needs.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(part.name for part in parts)}; all by default")
    parser.add_argument("--quick", action="store_true", help="the quick form of each part, without a record")
    parser.add_argument("--files", type=Path, metavar="DIR", help="folder of the files that the part public is about")
    options = parser.parse_args(arguments)
    if unknown := set(options.parts) - {part.name for part in parts}:
        parser.error(f"there is no part {', '.join(sorted(unknown))}; see --help")
    if options.files is not None and not options.files.is_dir():
        parser.error(f"{options.files} is not a folder")
    chosen = [part for part in parts if not options.parts or part.name in options.parts]
    lacking = [part for part in chosen if part.needs_files and options.files is None]
    unmet = [f"{part.name}: not run: {NEEDS_FILES.format(part.name)}" for part in lacking]
    if unmet and options.parts:
        parser.error("; ".join(unmet))
    chosen = [part for part in chosen if part not in lacking]
    states = {part.name: record.state(part, record.read(part, records)) for part in chosen}  # reports an invalid record
    faults = [f"{part.name}: not run: {tool}" for part in chosen for tool in part.missing_tools()]
    if not options.quick:
        faults += unmet
    else:
        print("".join(f"{line}\n" for line in unmet), end="")  # no fault: a machine of CI may have no such files
        faults += [f"{name}: its recorded full run failed, and nothing has changed since; run it again"
                   for name, state in states.items() if state == "failed"]  # fmt: skip
    print("".join(f"{fault}\n" for fault in faults), end="", flush=True)
    is_good, begun, cpu_seconds = not faults, time.monotonic(), 0.0
    complete = [part for part in chosen if not part.missing_tools()]
    for run, seconds, used in _runs(complete, Effort(options.quick), options.files):
        is_good, cpu_seconds = is_good and run["verdict"] == Verdict.PASSED, cpu_seconds + used
        if run["verdict"] != Verdict.NOT_RUN and not options.quick:
            write_atomically(records / f"{run['part']}.json", f"{json.dumps(run, indent=1)}\n".encode())
        lines = [f"{run['verdict']}: {run['figure']} ({seconds:.0f} s, CPU {used:.0f} s)", *run["findings"][:FINDINGS_SHOWN]]
        print("".join(f"{run['part']}: {line}\n" for line in lines), end="", flush=True)
    print(f"in all {time.monotonic() - begun:.0f} s, CPU {cpu_seconds:.0f} s")
    return 0 if is_good else 1


def _runs(parts: Sequence[Part], effort: Effort, files: Path | None) -> Iterator[tuple[Record, float, float]]:
    """Run parts in processes that end with this one, and yield the results of each when it ends."""
    shared.folder()  # all parts use the same results
    fork, count = multiprocessing.get_context("fork"), QUICK_PROCESS_COUNT if effort.quick else 1
    with ProcessPoolExecutor(count, fork, pytest_part.end_with_parent) as pool:
        running = [pool.submit(run_part, part, effort, files) for part in parts]
        try:
            yield from (done.result() for done in as_completed(running))
        finally:
            pool.shutdown(cancel_futures=True)


def run_part(part: Part, effort: Effort, files: Path | None = None) -> tuple[Record, float, float]:
    """Run one part; return its record, its duration and its CPU time in s.

    `files` is the folder for a part that needs files.
    A missing tool, a build that cannot be tested and a crash are outcomes too.
    """
    scratch = SCRATCH / f"{part.name}-{'quick' if effort.quick else hash_of((*part.patterns, *CODE))[:16]}"
    if effort.quick:
        scratch.unlink(missing_ok=True)
    is_resumed, digest, begun, used = scratch.is_file(), part.hash(), time.monotonic(), sum(os.times()[:4])
    print(f"... {part.name}{' resumes' if is_resumed else ''}", file=sys.stderr, flush=True)
    try:
        if part.module:
            folders = (files,) if part.needs_files else FOLDERS
            outcome = importlib.import_module(f"tests.evidence.{part.module}").run(folders, effort, Progress(scratch))
        else:
            outcome = pytest_part.run(part, effort, scratch)
    except Exception as error:
        if not isinstance(error, CodegenError):  # a crash of this part; the others run
            traceback.print_exc()
        is_failed = isinstance(error, CodegenError) and not isinstance(error, MissingTool)
        outcome = Outcome("", "no figure", Verdict.FAILED if is_failed else Verdict.NOT_RUN, (str(error) or repr(error),))
    if outcome.verdict is not Verdict.NOT_RUN:  # finished: the next run starts over
        scratch.unlink(missing_ok=True)
    seconds = time.monotonic() - begun
    return record.of(part, digest, outcome, None if is_resumed else seconds), seconds, sum(os.times()[:4]) - used


if __name__ == "__main__":
    faulthandler.enable()  # print the stack if a part crashes the process
    try:
        sys.exit(main())
    except CodegenError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("interrupted; run the same command to resume a full run", file=sys.stderr)
        sys.exit(130)

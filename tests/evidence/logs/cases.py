"""Part `logs`: 10,000 damaged or wrong files for `codegen identify`, each through the whole command.

A file is a log, a database or a names.toml. It is damaged at random, or has the content of another kind. The command either
reads it, or prints one line that names a file, with exit code 2. In both cases no file changes, but for those that a finished
command writes. One case in FULL_EVERY identifies the car, into a file that exists already.
"""

from __future__ import annotations

import functools
import json
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from codegen import cli, configuration
from codegen.configuration import preset_text
from codegen.verify.outcomes import Effort, Outcome, Verdict
from tests.evidence.progress import Progress
from tests.identify import made
from tests.loader_cases import HANG_S, HangError, damaged

SHOWS = "codegen identify reads damaged and wrong logs or rejects them in one line, and no file is lost"
COUNTS = {"toml": 1_500, "dbc": 1_500, "blf": 1_500, "csv": 2_000, "parquet": 2_000, "log": 750, "asc": 650, "mf4": 100}
"""Kind of file -> cases of a full run."""
QUICK_SHARE = 0.02
BLOCK_SIZE = 50
WRONG_SHARE = 0.15
"""Fraction of the files that have the content of another kind."""
FULL_EVERY = 10
DURATION_S = 4.0
NAMES = b'time_unit = "s"\nwithout = ["sideslip"]\n[vx]\nsignal = ["speed_km_h"]\nunit = "km/h"\nsign = 1\noffset = 0.1\n'
OTHERS = (b"", b"\x00" * 300, b"\x89PNG\r\n\x1a\n" + bytes(range(256)), b"PK\x03\x04" + b"\xff" * 200, b"<html></html>\n")
Block = tuple[str, int, int]
"""Kind, seed and number of its cases."""


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the cases on all processors."""
    del folders
    counts = {kind: max(1, round(QUICK_SHARE * count)) if effort.quick else count for kind, count in COUNTS.items()}
    blocks: list[Block] = [
        (kind, seed, min(BLOCK_SIZE, count - seed * BLOCK_SIZE))
        for kind, count in counts.items()
        for seed in range(-(-count // BLOCK_SIZE))
    ]
    waiting = [block for block in blocks if progress.done.get(_key(block)) is None]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for block, result in zip(waiting, pool.map(_block, waiting), strict=True):
            progress.keep(_key(block), result)
    results = {block: progress.done.get(_key(block)) for block in blocks}
    findings = [fault for result in results.values() for fault in result["faults"]]
    figures = {
        kind: {
            name: sum(result[name] for block, result in results.items() if block[0] == kind)
            for name in ("read", "rejected", "identified")
        }
        for kind in COUNTS
    }
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    return Outcome(SHOWS, f"{sum(counts.values()):,} files of {len(counts)} kinds", verdict, tuple(findings), figures)


def _key(block: Block) -> str:
    return "{}, seed {}, {} cases".format(*block)


@functools.cache
def seeds() -> Mapping[str, bytes]:
    """Return the content of a good file of each kind."""
    found = {"dbc": made.DBC.encode("ascii"), "toml": NAMES}
    frames = made.frames(duration=DURATION_S)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in ("asc", "log", "blf"):
            found[kind] = made.write_bus(folder / f"drive.{kind}", frames).read_bytes()
        made.write_mf4(folder / "drive.mf4")
        found["mf4"] = (folder / "drive.mf4").read_bytes()
        table = made.table()
        table = table.head(round(DURATION_S / 0.01))
        found["csv"] = table.to_csv(index=False).encode()
        table.to_parquet(folder / "drive.parquet")
        found["parquet"] = (folder / "drive.parquet").read_bytes()
    return found


@dataclass(frozen=True)
class Answer:
    """Exit code and output of a command; exit code -1 for an exception, whose text is `err`."""

    code: int
    out: str
    err: str


def command(*arguments: str) -> Answer:
    """Run `codegen identify` in this process, with all that it prints, by libraries too."""

    def main() -> int:
        try:
            cli.main()
        except SystemExit as stopped:
            return stopped.code if isinstance(stopped.code, int) else -1
        return 0

    before, sys.argv = sys.argv, ["codegen", "identify", *arguments]
    try:
        with _captured() as read:
            code = _within(HANG_S, main)
        return Answer(code, *read())
    except (Exception, HangError) as error:
        return Answer(-1, "", f"{type(error).__name__}: {error}")
    finally:
        sys.argv = before


def _within(seconds: int, call: Callable[[], int]) -> int:
    def hung(_signal: int, _frame: object) -> None:
        raise HangError(f"no answer after {seconds} s")

    before = signal.signal(signal.SIGALRM, hung)
    signal.alarm(seconds)
    try:
        return call()
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _captured() -> Iterator[Callable[[], tuple[str, str]]]:
    """Redirect both outputs of the process into files; the yielded function returns their contents."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        texts: list[str] = []
        try:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            yield lambda: (texts[0], texts[1])
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for number, saved in enumerate(kept, start=1):
                os.dup2(saved, number)
                os.close(saved)
            for file in (out, err):
                file.seek(0)
                texts.append(file.read().decode("utf-8", "replace"))


def contents(folder: Path) -> dict[str, bytes]:
    """Return the content of every file of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def prepare(kind: str, data: bytes, folder: Path) -> list[str]:
    """Write the files of one case; return the options that name them."""
    for path in folder.iterdir():
        path.unlink()
    good = {"car.dbc": seeds()["dbc"], "ars.toml": preset_text("recommended").encode(), "out.toml": b"kept\n"}
    for name, content in good.items():
        (folder / name).write_bytes(content)
    log = "csv" if kind == "toml" else "log" if kind == "dbc" else kind
    (folder / f"drive.{log}").write_bytes(seeds()[log])
    options = ["--log", str(folder / f"drive.{log}")]
    if log in ("blf", "asc", "log", "mf4"):
        options += ["--dbc", str(folder / "car.dbc")]
    if kind == "toml":
        options += ["--signals", str(folder / "names.toml")]
    broken = {"toml": "names.toml", "dbc": "car.dbc"}.get(kind, f"drive.{kind}")
    (folder / broken).write_bytes(data)
    return options


def fault_of(kind: str, data: bytes, folder: Path, is_full: bool) -> tuple[str, str]:
    """Return the fault in the response to one file, or "", and what happened: "read", "rejected" or "identified"."""
    options = prepare(kind, data, folder)
    before = contents(folder)
    wanted = ("--config", str(folder / "ars.toml"), "-o", str(folder / "out.toml")) if is_full else ("--check",)
    answer = command(*options, *wanted, "--json")
    after = contents(folder)
    if answer.code == 0:
        written = after.pop("out.toml"), before.pop("out.toml")
        if after != before or (not is_full and written[0] != written[1]):
            return "a file changed", "read"
        try:
            json.loads(answer.out)
            if is_full:
                configuration.load(folder / "out.toml")
        except Exception as error:
            return f"what it wrote cannot be read: {type(error).__name__}: {str(error)[:200]}", "read"
        return "" if is_full or not answer.err else f"output beside the result: {answer.err[:200]!r}", (
            "identified" if is_full else "read"
        )
    line = answer.err.removesuffix("\n")
    if answer.code != 2:
        return f"exit code {answer.code}: {answer.err[:300]!r}", "rejected"
    if answer.out or not line.startswith("error: ") or not line.isprintable():
        return f"not one line: {(answer.out + answer.err)[:300]!r}", "rejected"
    if not any(name in line for name in before):
        return f"no file is named: {line[:300]!r}", "rejected"
    return "" if after == before else "a file changed", "rejected"


def _block(block: Block) -> dict[str, object]:
    """Return the faults of one block of cases, and the number of outcomes of each sort."""
    kind, seed, count = block
    generator, found = np.random.default_rng([seed, sum(kind.encode())]), seeds()
    faults: list[str] = []
    happened = {"read": 0, "rejected": 0, "identified": 0}
    with tempfile.TemporaryDirectory() as name:
        for case in range(count):
            data = damaged(found[kind], generator)
            if generator.random() < WRONG_SHARE:
                wrong = [*OTHERS, *(content for other, content in found.items() if other != kind)]
                data = wrong[int(generator.integers(len(wrong)))]
            fault, outcome = fault_of(kind, data, Path(name), case % FULL_EVERY == FULL_EVERY - 1)
            happened[outcome] += 1
            if fault:
                faults.append(f"{kind}, seed {seed}, case {case}: {fault}")
    return {"faults": faults, **happened}

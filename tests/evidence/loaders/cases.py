"""Part `loaders`: 100,000 randomly damaged files for all loaders."""

import functools
import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from codegen.verify.check import Effort, Outcome, Verdict
from tests.evidence.progress import Progress
from tests.loader_cases import Loader, damaged, fault_of, loaders

CASES, QUICK_CASES = 100_000, 2_500
Block = tuple[str, int, int]
"""Loader, seed and number of its cases."""
BLOCK_SIZE = 200
"""Cases per seed."""
SHOWS = "damaged files are read, or rejected in one line with the location"


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the cases on all processors."""
    del folders
    found = _loaders()
    total = QUICK_CASES if effort.quick else CASES
    share = total / sum(loader.weight for loader in found.values())
    blocks: list[Block] = []
    for name, loader in found.items():
        count = max(1, round(share * loader.weight))
        blocks += [(name, seed, min(BLOCK_SIZE, count - seed * BLOCK_SIZE)) for seed in range(-(-count // BLOCK_SIZE))]
    waiting = [block for block in blocks if progress.done.get(_key(block)) is None]
    with ProcessPoolExecutor(os.cpu_count()) as pool:  # unlike a Pool, it reports a worker that crashes
        for block, faults in zip(waiting, pool.map(_block, waiting), strict=True):
            progress.keep(_key(block), faults)
    findings = [fault for block in blocks for fault in progress.done.get(_key(block))]
    cases = sum(count for _, _, count in blocks)
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    return Outcome(SHOWS, f"{cases:,} files for {len(found)} loaders", verdict, tuple(findings))


@functools.cache
def _loaders() -> Mapping[str, Loader]:
    """Return the loaders; made once per process."""
    return loaders()


def _key(block: Block) -> str:
    return "{}, seed {}, {} cases".format(*block)


def _block(block: Block) -> list[str]:
    """Return the failures in one block of cases: loader, seed and case of each."""
    name, seed, count = block
    loader, generator = _loaders()[name], np.random.default_rng([seed, sum(name.encode())])
    findings = []
    with tempfile.TemporaryDirectory() as folder:
        for case in range(count):
            if fault := fault_of(loader, damaged(loader.seed, generator), Path(folder)):
                findings.append(f"{name}, seed {seed}, case {case}: {fault}")
    return findings

"""Part `loaders`: 100,000 randomly damaged files for all loaders in the processes of this part, and 2,000 damaged and hostile
files, each in a process of its own with limits on its time and its memory."""

import functools
import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from codegen.verify.outcomes import Effort, Outcome, Verdict
from tests.evidence.progress import Progress
from tests.hostile_files import HOSTILE
from tests.loader_cases import MF4, Loader, damaged, fault_apart, fault_of, loaders, readers_in_process

CASES, QUICK_CASES = 100_000, 2_500
APART_CASES, QUICK_APART_CASES = 2_000, 100
SIZES, QUICK_SIZES = (1.0, 0.5, 0.1, 0.01), (0.1,)
"""Sizes of hostile files; few, because making one may take longer than reading it. Each kind and size is read once."""
Block = tuple[str, int, int]
"""Loader, seed and number of its cases; a seed below zero: each in a process of its own. Or kind of hostile file, number of its
size in SIZES, and 1."""
BLOCK_SIZE, APART_BLOCK_SIZE = 200, 10
"""Cases per seed."""
SHOWS = "damaged and hostile files are read, or rejected in one line with the location, within 20 s and 2 GB"


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the cases on all processors."""
    del folders
    found = _loaders()
    # asammdf may crash on a damaged file.
    together = {name: loader.weight for name, loader in found.items() if loader.reader != MF4}
    blocks = _blocks(QUICK_CASES if effort.quick else CASES, together)
    apart = QUICK_APART_CASES if effort.quick else APART_CASES
    hostile = [(kind, SIZES.index(size), 1) for size in (QUICK_SIZES if effort.quick else SIZES) for kind in HOSTILE]
    blocks += _apart_blocks(apart - len(hostile), [*found]) + hostile
    waiting = [block for block in blocks if progress.done.get(_key(block)) is None]
    with ProcessPoolExecutor(os.cpu_count()) as pool:  # unlike a Pool, it reports a worker that crashes
        for block, faults in zip(waiting, pool.map(_block, waiting), strict=True):
            progress.keep(_key(block), faults)
    findings = [fault for block in blocks for fault in progress.done.get(_key(block))]
    counts = [sum(count for name, seed, count in blocks if _is_apart(name, seed) is apart) for apart in (False, True)]
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    figure = (
        f"{counts[0]:,} files for {len(found)} loaders; {counts[1]:,} in processes of their own, {len(hostile)} of them hostile"
    )
    return Outcome(SHOWS, figure, verdict, tuple(findings))


def _is_apart(name: str, seed: int) -> bool:
    return name in HOSTILE or seed < 0


def _blocks(total: int, weights: Mapping[str, float]) -> list[Block]:
    share = total / sum(weights.values())
    blocks: list[Block] = []
    for name, weight in weights.items():
        count = max(1, round(share * weight))
        blocks += [(name, seed, min(BLOCK_SIZE, count - seed * BLOCK_SIZE)) for seed in range(-(-count // BLOCK_SIZE))]
    return blocks


def _apart_blocks(total: int, names: Sequence[str]) -> list[Block]:
    """Return the blocks of as many cases for each name."""
    return [
        (name, -1 - number, min(APART_BLOCK_SIZE, count - number * APART_BLOCK_SIZE))
        for name, count in zip(names, np.diff(np.linspace(0, total, len(names) + 1).round().astype(int)).tolist(), strict=True)
        for number in range(-(-count // APART_BLOCK_SIZE))
    ]


@functools.cache
def _loaders() -> Mapping[str, Loader]:
    """Return the loaders; made once per process."""
    return loaders()


def _key(block: Block) -> str:
    return "{}, seed {}, {} cases".format(*block)


def _block(block: Block) -> list[str]:
    """Return the failures in one block of cases: loader, seed and case of each."""
    name, seed, count = block
    if name in HOSTILE:
        kind = HOSTILE[name]
        with tempfile.TemporaryDirectory() as folder:
            fault = fault_apart(_loaders()[kind.loader], kind.make(SIZES[seed]), Path(folder))
        return [f"{name}, size {SIZES[seed]}: {fault}"] if fault else []
    generator = np.random.default_rng([abs(seed), sum(name.encode()), int(seed < 0)])
    findings = []
    with tempfile.TemporaryDirectory() as folder:
        for case in range(count):
            if fault := _fault(name, seed < 0, generator, Path(folder)):
                findings.append(f"{name}, seed {seed}, case {case}: {fault}")
    return findings


def _fault(name: str, is_apart: bool, generator: np.random.Generator, folder: Path) -> str:
    loader = _loaders()[name]
    data = damaged(loader.seed, generator)
    if is_apart:
        return fault_apart(loader, data, folder)
    with readers_in_process():
        return fault_of(loader, data, folder)

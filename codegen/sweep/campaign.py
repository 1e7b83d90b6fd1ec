"""Run a campaign with any engine and merge its results. An interrupted campaign resumes with its missing chunks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from codegen.sweep import store
from codegen.sweep.chunk import Work, software
from codegen.sweep.engine import Engine
from codegen.sweep.plan import Plan

Progress = Callable[[int, int], None]


def run_campaign(plan: Plan, folder: Path, engine: Engine, progress: Progress | None = None) -> Path:
    """Simulate the runs that the folder does not contain yet and merge all runs into one file.

    Each chunk is complete on disk before it counts as done. After Ctrl-C, a kill or a loss of power, the same call resumes.

    Args:
        progress: called with (runs done, total runs).

    Returns:
        The path of the Parquet file, with one row for each run, by run number.

    Raises:
        CodegenError: see `store.open_folder`, `chunk.run_chunk` and the engine.
        KeyboardInterrupt: Ctrl-C; its text names the number of chunks kept.
    """
    store.require_pyarrow()
    for controller in plan.controllers:
        software(plan, controller)  # report compile errors before anything is written
    store.prepare(folder)
    with store.locked(folder):
        there = store.open_folder(folder, plan)
        try:
            return _drive(plan, folder, there, engine, progress)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(_what_is_kept(store.kept(folder, plan), plan.chunk_count)) from None


def _what_is_kept(kept: int, of: int) -> str:
    if kept == 0:
        return f"no chunk of {of} was finished; run the same command to start again"
    return f"{kept} of {of} chunks {'is' if kept == 1 else 'are'} kept; run the same command to resume"


def _drive(plan: Plan, folder: Path, there: set[int], engine: Engine, progress: Progress | None) -> Path:
    total, done = plan.spec.run_count, sum(len(plan.runs_of(chunk)) for chunk in there)
    if progress is not None and total:
        progress(done, total)
    missing = (chunk for chunk in range(plan.chunk_count) if chunk not in there)
    for chunk, table in engine.run(Work(plan), missing):
        store.save_part(folder, chunk, table, plan)
        done += len(plan.runs_of(chunk))
        if progress is not None:
            progress(done, total)
    return store.merge(folder, plan)

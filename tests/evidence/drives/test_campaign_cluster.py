"""Campaigns on a Dask cluster and after a kill: the same bytes, no finished chunk lost. Memory of long campaigns."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.errors import BuildError, CodegenError
from codegen.sweep import engine as engines
from codegen.sweep import plan as planning
from codegen.sweep.chunk import Table, Work
from codegen.sweep.engine import Dask, Threads, run_campaign
from codegen.sweep.plan import Plan
from codegen.sweep.store import RUNS_FILE, part_path
from codegen.sweep.versions import identity
from tests.sweep.conftest import ROOT, Recording, write_spec

TIMEOUT_S = 600.0
"""Timeout in s; only a failure waits this long."""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return planning.read(write_spec(tmp_path_factory.mktemp("spec")))


@pytest.fixture(scope="module")
def whole(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the file of the campaign, run by one thread."""
    return run_campaign(plan, tmp_path_factory.mktemp("campaign") / "one", Threads(1)).read_bytes()


def check_resumption(plan: Plan, folder: Path, whole: bytes) -> None:
    """Finish an interrupted campaign and check that it has the same bytes and runs no stored chunk again."""
    stored, engine = {path.name for path in (folder / "parts").iterdir()}, Recording()
    assert stored, "at least one chunk was finished; which one comes first is the scheduler's choice"
    assert run_campaign(plan, folder, engine).read_bytes() == whole
    assert {part_path(folder, number).name for number in engine.driven}.isdisjoint(stored)
    assert not (folder / "parts").exists()


@dataclass(frozen=True)
class DiesOnce:
    """Work whose process is killed within a chunk, the first time only."""

    work: Work
    mark: Path

    def __call__(self, number: int) -> Table:
        table = self.work(number)
        if number == 1 and not self.mark.exists():
            self.mark.touch()
            os._exit(1)
        return table


@dataclass(frozen=True)
class WrappedEngine:
    """Engine that modifies the work, runs it on another engine and calls `after` for each finished chunk."""

    engine: Dask
    change: Callable[[Any], Any] = lambda work: work
    after: Callable[[], object] = lambda: None

    def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        for finished in self.engine.run(self.change(work), numbers):
            yield finished
            self.after()


def lacking_instructions(_number: int) -> None:
    raise BuildError("no such instructions", where="--isa", remedy="take others")


def test_a_cluster_gives_the_same_bytes_despite_a_killed_worker(
    plan: Plan, whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import dask
    from distributed import LocalCluster

    died = tmp_path / "died"
    with (
        dask.config.set({"distributed.worker.daemon": False}),
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        contextlib.closing(Dask(cluster.scheduler_address)) as engine,
    ):
        assert run_campaign(plan, tmp_path / "dask", engine).read_bytes() == whole
        dying = WrappedEngine(engine, lambda work: DiesOnce(work, died))
        assert run_campaign(plan, tmp_path / "dying", dying).read_bytes() == whole
        assert died.exists()
        with pytest.raises(BuildError, match=r"^Dask worker tcp://\S+: --isa: no such instructions; take others$"):
            list(engine.run(lacking_instructions, [0]))
        monkeypatch.setattr(engines, "identity", lambda: {**identity(), "numpy": "0.1"})
        message = rf"^Dask worker tcp://\S+: it has numpy {np.__version__}, and the campaign 0\.1; install the same"
        with pytest.raises(BuildError, match=message):
            list(engine.run(Work(plan), [0]))


@contextlib.contextmanager
def dask_process(*arguments: str, root: Path = ROOT) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    with subprocess.Popen(command, cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextlib.contextmanager
def scheduler() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a scheduler; return the process and its address."""
    with dask_process("scheduler", "--host", "127.0.0.1", "--port", "0") as process:
        assert process.stderr is not None
        yield process, next(found[0] for line in process.stderr if (found := re.findall(r"tcp://127\.0\.0\.1:\d+", line)))


def test_a_worker_with_other_sources_that_joins_later_is_refused_and_nothing_of_it_is_kept(
    plan: Plan, whole: bytes, tmp_path: Path
) -> None:
    """The worker has the same version, and one other number in its sources."""
    for name in ("codegen", "hil_sim", "templates"):
        shutil.copytree(ROOT / name, tmp_path / "foreign" / name, ignore=shutil.ignore_patterns("__pycache__"))
    changed = tmp_path / "foreign/codegen/units.py"
    changed.write_text(changed.read_text(encoding="utf-8").replace("9.81", "9.82"), encoding="utf-8")
    options = ("--nthreads", "1", "--no-nanny", "--death-timeout", "60")
    with contextlib.ExitStack() as stack:
        _, address = stack.enter_context(scheduler())
        own = stack.enter_context(dask_process("worker", address, *options))
        engine = stack.enter_context(contextlib.closing(Dask(address)))

        def exchange_the_worker() -> None:
            if own.poll() is None:
                stack.enter_context(dask_process("worker", address, *options, root=tmp_path / "foreign"))
                own.kill()

        with pytest.raises(
            BuildError, match=r"^Dask worker tcp://\S+: it has sources \w+, and the campaign \w+; install"
        ) as caught:
            run_campaign(plan, tmp_path / "mixed", WrappedEngine(engine, after=exchange_the_worker))
        assert caught.value.exit_code == 2
    check_resumption(plan, tmp_path / "mixed", whole)


@pytest.mark.long
def test_a_dead_scheduler_is_reported_in_one_line_and_finished_chunks_are_kept(
    plan: Plan, whole: bytes, tmp_path: Path
) -> None:
    with (
        scheduler() as (process, address),
        dask_process("worker", address, "--nthreads", "1", "--no-nanny", "--death-timeout", "60"),
        contextlib.closing(Dask(address)) as engine,
        pytest.raises(CodegenError, match=rf"^{address}: the Dask scheduler went away.*run the same command again") as caught,
    ):
        run_campaign(plan, tmp_path / "lost", WrappedEngine(engine, after=lambda: (process.kill(), process.wait())))
    assert caught.value.exit_code == 2
    check_resumption(plan, tmp_path / "lost", whole)


def test_a_killed_campaign_resumes(plan: Plan, whole: bytes, tmp_path: Path) -> None:
    folder, spec = tmp_path / "killed", write_spec(tmp_path)
    command = [sys.executable, "-m", "codegen", "sweep", "--spec", str(spec), "-o", str(folder), "--workers", "1"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        end = time.monotonic() + TIMEOUT_S
        while not part_path(folder, 0).exists() and process.poll() is None and time.monotonic() < end:
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
    assert not (folder / RUNS_FILE).exists()
    check_resumption(plan, folder, whole)

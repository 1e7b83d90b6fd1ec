"""Campaigns: the same bytes whoever drives them, nothing lost by a kill, and each run as it would be alone."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from codegen import __version__
from codegen.errors import BuildError, CodegenError
from codegen.sil.batch import DIFFERENCE_MAX_FLIPPED
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.software import compile_build
from codegen.sil.vector import ISAS
from codegen.sweep import chunk as chunks
from codegen.sweep import plan as planning
from codegen.sweep import store
from codegen.sweep.campaign import run_campaign
from codegen.sweep.chunk import Table, Work, replay, run_chunk
from codegen.sweep.engine import Dask, Threads
from codegen.sweep.plan import Plan
from codegen.sweep.store import RUNS, part_path
from hil_sim.suite import plants
from tests.sweep.conftest import ROOT, SAMPLES, write_spec

PATIENCE = 600.0
"""s: only a failure waits so long."""


@pytest.fixture(scope="session")
def whole(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of the campaign, driven by one thread."""
    return run_campaign(plan, tmp_path_factory.mktemp("campaign") / "one", Threads(1))


def test_every_run_has_its_row(plan: Plan, whole: Path) -> None:
    assert plan.chunk_count == 3
    table = pq.read_table(whole)
    assert table.column("run").to_pylist() == list(range(6 * SAMPLES))
    assert table.column("sample").to_pylist() == [run // 6 for run in range(6 * SAMPLES)]
    assert table.column("scenario").to_pylist()[:6] == ["step-steer"] * 3 + ["sine-with-dwell"] * 3
    assert table.column("controller").to_pylist()[:4] == ["pi", "tracking", "passive", "pi"]
    # A sample is one car on one road, whoever drives it.
    friction = np.array(table.column("friction")).reshape(SAMPLES, 6)
    assert np.all(friction == friction[:, :1])
    assert len(set(friction[:, 0])) == SAMPLES


def test_what_a_run_does_not_have_is_null(whole: Path) -> None:
    table = pq.read_table(whole)
    dwell = np.array(table.column("scenario").to_pylist()) == "sine-with-dwell"
    assert set(np.flatnonzero(~dwell)) >= {
        row for row, value in enumerate(table.column("settled").to_pylist()) if value is not None
    }
    assert all(
        value is None for value, other in zip(table.column("overshoot_percent").to_pylist(), dwell, strict=True) if other
    )
    spun = np.array([value is not None for value in table.column("spun_at_s").to_pylist()])
    assert 0 < spun.sum() < spun.size
    assert all(
        value is None for value, lost in zip(table.column("sideslip_abs_max_deg").to_pylist(), spun, strict=True) if lost
    )


def test_two_threads_give_the_same_bytes(plan: Plan, whole: Path, tmp_path: Path) -> None:
    assert run_campaign(plan, tmp_path / "two", Threads(2)).read_bytes() == whole.read_bytes()


def test_another_seed_gives_others(plan: Plan, whole: Path) -> None:
    other = run_chunk(replace(plan, spec=plan.spec.model_copy(update={"seed": 6})), 0)
    assert not np.array_equal(other["friction"], run_chunk(plan, 0)["friction"])


@dataclass(frozen=True)
class DiesOnce:
    """Work whose process ends in the middle of a chunk, the first time."""

    work: Work
    mark: Path

    def __call__(self, number: int) -> Table:
        table = self.work(number)
        if number == 1 and not self.mark.exists():
            self.mark.touch()
            os._exit(1)
        return table


@dataclass(frozen=True)
class With:
    """An engine that is given other work than it is asked for."""

    engine: Dask
    mark: Path

    def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        return self.engine.run(DiesOnce(work, self.mark), numbers)


def test_a_dask_cluster_gives_the_same_bytes_and_a_dead_worker_loses_nothing(
    plan: Plan, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.worker.daemon": False}),
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
    ):
        engine = Dask(cluster.scheduler_address)
        try:
            assert run_campaign(plan, tmp_path / "dask", engine).read_bytes() == whole.read_bytes()
            died = tmp_path / "died"
            again = run_campaign(plan, tmp_path / "dying", With(engine, died))
            with pytest.raises(BuildError, match=r"^Dask worker tcp://\S+: --isa: no such instructions; take others$"):
                list(engine.run(lacking_instructions, [0]))
            monkeypatch.setattr("codegen.sweep.engine.versions", lambda: {"codegen": __version__, "numpy": "0.1"})
            told = rf"^Dask worker tcp://\S+: it has numpy {np.__version__}, and the campaign numpy 0\.1; install the same"
            with pytest.raises(BuildError, match=told):
                list(engine.run(Work(plan), [0]))
        finally:
            engine.close()
    assert died.exists()
    assert again.read_bytes() == whole.read_bytes()


def lacking_instructions(_number: int) -> None:
    raise BuildError("no such instructions", where="--isa", remedy="take others")


@dataclass(frozen=True)
class Loses:
    """An engine whose scheduler is killed when the first chunk is finished."""

    engine: Dask
    scheduler: subprocess.Popen[str]

    def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        for number, table in self.engine.run(work, numbers):
            yield number, table
            self.scheduler.kill()
            self.scheduler.wait()


@contextlib.contextmanager
def dask_process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def address_of(scheduler: subprocess.Popen[str]) -> str:
    assert scheduler.stderr is not None
    return next(found[0] for line in scheduler.stderr if (found := re.findall(r"tcp://127\.0\.0\.1:\d+", line)))


def test_a_scheduler_that_dies_is_told_in_one_line_and_what_was_finished_is_kept(
    plan: Plan, whole: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("distributed", "distributed.client"):  # wherever the library puts its own handlers
        monkeypatch.setattr(logging.getLogger(name), "handlers", [caplog.handler])
    folder = tmp_path / "lost"
    with dask_process("scheduler", "--host", "127.0.0.1", "--port", "0") as scheduler:
        address = address_of(scheduler)
        with dask_process("worker", address, "--nthreads", "1", "--no-nanny", "--death-timeout", "60"):
            engine = Dask(address)
            try:
                with pytest.raises(CodegenError, match="the Dask scheduler went away") as caught:
                    run_campaign(plan, folder, Loses(engine, scheduler))
            finally:
                engine.close()
    assert caught.value.exit_code == 2
    assert str(caught.value).startswith(address)
    assert "run the same command again" in str(caught.value)
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING] == []
    kept = {path.name for path in (folder / "parts").iterdir()}
    assert kept
    driven: list[int] = []

    class Counting(Threads):
        def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
            for number, table in super().run(work, numbers):
                driven.append(number)
                yield number, table

    assert run_campaign(plan, folder, Counting(1)).read_bytes() == whole.read_bytes()
    assert {part_path(folder, number).name for number in driven}.isdisjoint(kept)


def test_a_client_that_closes_itself_at_the_same_time_is_closed_all_the_same() -> None:
    with dask_process("scheduler", "--host", "127.0.0.1", "--port", "0") as scheduler:
        engine = Dask(address_of(scheduler))
        client = engine._client
        given_up: list[str] = []

        def already_given_up(reason: str) -> None:
            """What a connection does that is being given up, until the loop has run once more."""
            given_up.append(reason)
            if len(given_up) == 1:
                raise RuntimeError("Cannot change state of expiring Timeout")

        client.rpc._connecting["tcp://127.0.0.1:9"].add(already_given_up)
        engine.close()
    assert len(given_up) == 2
    assert client.status == "closed"


def test_nobody_at_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("codegen.sweep.engine.CONNECT_TIMEOUT", 1.0)
    with pytest.raises(CodegenError, match="no Dask scheduler answers"):
        Dask("tcp://127.0.0.1:9")
    with pytest.raises(CodegenError, match="is no address"):
        Dask("tcp://127.0.0.1:99999")


@pytest.mark.parametrize("says", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_another_program_at_the_address(says: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that waits to be spoken to, as does Dask's client, for ever; and one whose first bytes are taken for a size."""
    monkeypatch.setattr("codegen.sweep.engine.CONNECT_TIMEOUT", 1.0)
    connections: list[socket.socket] = []

    def listen() -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                connections.append(listener.accept()[0])
                connections[-1].sendall(says)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=listen, daemon=True)
        thread.start()
        with pytest.raises(CodegenError, match=r"no Dask scheduler answers \(what answers is another program\)"):
            Dask(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
    for connection in connections:
        connection.close()


def test_a_killed_campaign_goes_on(plan: Plan, spec: Path, whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    command = [sys.executable, "-m", "codegen", "sweep", "--spec", str(spec), "-o", str(folder), "--workers", "1"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        end = time.monotonic() + PATIENCE
        while not part_path(folder, 0).exists() and process.poll() is None and time.monotonic() < end:
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
    assert not (folder / RUNS).exists()
    driven: list[int] = []

    class Counting(Threads):
        def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
            for number, table in super().run(work, numbers):
                driven.append(number)
                yield number, table

    assert run_campaign(plan, folder, Counting(1)).read_bytes() == whole.read_bytes()
    assert 0 not in driven
    assert not (folder / "parts").exists()


def test_a_finished_campaign_is_not_driven_again(plan: Plan, whole: Path) -> None:
    class Nobody(Threads):
        def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
            assert list(numbers) == []
            return iter(())

    before = whole.stat().st_mtime_ns
    assert run_campaign(plan, whole.parent, Nobody(1)) == whole
    assert whole.stat().st_mtime_ns == before


def test_a_folder_with_other_things_is_left_alone(plan: Plan, whole: Path, tmp_path: Path) -> None:
    other = replace(plan, spec=plan.spec.model_copy(update={"seed": 6}))
    with pytest.raises(CodegenError, match="it holds another campaign"):
        run_campaign(other, whole.parent, Threads(1))
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(CodegenError, match="it holds other files"):
        run_campaign(plan, tmp_path, Threads(1))
    with pytest.raises(CodegenError, match="not a folder"):
        run_campaign(plan, tmp_path / "mine.txt", Threads(1))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_damaged_part_is_told(plan: Plan, tmp_path: Path) -> None:
    class One(Threads):
        def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
            for number, table in super().run(work, numbers):
                yield number, table
                part_path(tmp_path / "damaged", number).write_bytes(b"PAR1")

    with pytest.raises(CodegenError, match="remove it, and run the same command again"):
        run_campaign(plan, tmp_path / "damaged", One(1))


def test_a_part_that_cannot_be_read_is_driven_again(plan: Plan, whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"

    class Stops(Threads):
        def run(self, work: Any, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
            for number, table in super().run(work, numbers):
                yield number, table
                if number == 1:
                    raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_campaign(plan, folder, Stops(1))
    part_path(folder, 0).write_bytes(part_path(folder, 0).read_bytes()[:1000])
    (folder / "parts" / ".00000002.parquet.x.tmp").write_bytes(b"left by a kill")
    assert run_campaign(plan, folder, Threads(1)).read_bytes() == whole.read_bytes()
    assert not (folder / "parts").exists()


def test_a_damaged_file_is_told(plan: Plan, whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    shutil.copytree(whole.parent, folder)
    (folder / RUNS).write_bytes(whole.read_bytes()[:2000])
    with pytest.raises(CodegenError, match="it is damaged"):
        run_campaign(plan, folder, Threads(1))


def test_one_campaign_at_a_time_in_a_folder(plan: Plan, whole: Path) -> None:
    with store.locked(whole.parent), pytest.raises(CodegenError, match="another codegen sweep is at work"):
        run_campaign(plan, whole.parent, Threads(1))
    assert run_campaign(plan, whole.parent, Threads(1)) == whole


def test_another_instruction_set_is_another_campaign(plan: Plan, whole: Path) -> None:
    other = replace(plan, isa=next(isa for isa in ISAS if isa != plan.isa))
    with pytest.raises(CodegenError, match=rf"instruction set {plan.isa}, not {other.isa}, .*; give --isa {plan.isa}, or name"):
        store.check_same(whole.parent, other)


def test_a_machine_without_the_instructions_is_told(plan: Plan, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(chunks, "_COMPILED", {})
    monkeypatch.setattr(chunks, "machine_runs", lambda isa: isa == "none")
    monkeypatch.setattr(chunks, "best_isa", lambda: "none")
    with pytest.raises(BuildError, match="no instructions of x86-64-v3; drive the whole campaign with --isa none"):
        run_campaign(replace(plan, isa="x86-64-v3"), tmp_path / "out", Threads(1))
    assert not (tmp_path / "out").exists()


def test_the_memory_of_a_chunk_is_bounded(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    run_chunk(plan, 0)  # what is compiled and kept does not count
    per_sample = round(plan.config.controller.sampling_time_s / plan.config.plant.sampling_time_s)
    samples = max(profile.inputs.shape[0] for profile in plan.profiles) // per_sample
    of_one = 8 * planning.NUMBERS_PER_SAMPLE * samples
    tracemalloc.start()
    run_chunk(plan, 0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= of_one * plan.samples_per_chunk
    monkeypatch.setattr(planning, "CHUNK_BYTES", 10 * of_one)
    assert plan.samples_per_chunk == 10
    assert plan.chunk_count == SAMPLES // 10
    monkeypatch.setattr(planning, "CHUNK_BYTES", 1)
    assert plan.samples_per_chunk == 1


@pytest.mark.parametrize("run", [0, 1, 2, 3, 700, 6 * SAMPLES - 1, *range(10, 6 * SAMPLES, 61)])
def test_a_run_again_is_the_run(plan: Plan, whole: Path, run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "run_chunk", None)  # of its chunk it needs no other run
    found = replay(plan, run)
    row = {name: values[0] for name, values in pq.read_table(whole, filters=[("run", "=", run)]).to_pydict().items()}
    assert (found.controller, found.profile.name) == (row.pop("controller"), row.pop("scenario"))
    assert {name: value for name, value in row.items() if value is not None} == found.row
    assert next(iter(found.records)) == found.controller
    if "spun_at_s" not in found.row:
        begin = round(found.profile.steer_time / plan.config.controller.sampling_time_s)
        largest = np.degrees(np.abs(found.records[found.controller][begin:, 5]).max())
        assert found.row["sideslip_abs_max_deg"] == pytest.approx(largest, rel=1e-12)  # two roundings


@pytest.mark.parametrize("run", [6, 7, 8, 9, 10, 11, 30, 31])
def test_a_run_is_what_the_single_loop_gives(plan: Plan, run: int) -> None:
    """The factors reach the plant as they should: the configuration is changed, and one loop driven, noise left out."""
    quiet = {key: values for key, values in plan.spec.factors.items() if "noise" not in key}
    found = replay(replace(plan, spec=plan.spec.model_copy(update={"factors": quiet})), run)
    row, controller = found.row, plan.controllers[found.key.controller]
    change = plants.together(plants.mass(row["mass_percent"]), plants.stiffness(0.0, row["rear_stiffness_percent"]))
    software = compile_build(controller.files, controller.manifest, change(plan.config))
    inputs = found.profile.inputs.copy()
    inputs[:, INPUT_COLUMNS.index("speed")] = row["speed_km_h"] / 3.6
    inputs[:, INPUT_COLUMNS.index("steering_wheel_command")] *= row["steering_wheel_angle_deg"] / 90.0
    inputs[:, INPUT_COLUMNS.index("friction")] = row["friction"]
    options = LoopOptions(controller.controlled, delay_samples=round(row["delay_samples"]))
    wanted = ClosedLoop(software, options).run(inputs)
    until = math.inf if "spun_at_s" not in row else row["spun_at_s"] - 0.5
    before = wanted[:, 0] < until
    assert before.sum() > 50
    difference = np.abs(found.records[found.controller] - wanted)[before, :-1]
    assert difference.max() < DIFFERENCE_MAX_FLIPPED, difference.max(axis=0)


def test_noise_reaches_the_controller_and_not_the_car_s_own_signals(plan: Plan) -> None:
    quiet = {key: values for key, values in plan.spec.factors.items() if "noise" not in key}
    without, passive = replace(plan, spec=plan.spec.model_copy(update={"factors": quiet})), 2
    assert np.array_equal(replay(plan, passive).records["passive"], replay(without, passive).records["passive"])
    noisy, calm = (replay(each, 0).records["pi"][:20, 7] for each in (plan, without))  # straight on, before the driver steers
    assert not calm.any()
    assert np.count_nonzero(noisy) > 15


def test_more_samples_leave_the_first_chunks_as_they_were(plan: Plan, tmp_path: Path) -> None:
    longer = planning.read(write_spec(tmp_path, samples=5 * SAMPLES))
    one, other = run_chunk(plan, 0), run_chunk(longer, 0)
    assert one.keys() == other.keys()
    assert all(np.array_equal(one[key], other[key], equal_nan=True) for key in one)


def test_a_planted_fault_in_the_numbers_is_seen(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    real = chunks.lanes.cars

    def lighter(*given: Any) -> Any:
        table = real(*given)
        table[:, 0] *= 0.99
        return table

    monkeypatch.setattr(chunks.lanes, "cars", lighter)
    with pytest.raises(AssertionError):
        test_a_run_is_what_the_single_loop_gives(plan, 6)

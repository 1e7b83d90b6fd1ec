"""Campaigns: the same bytes from every engine, resumption, the folder, and runs identical to single ones."""

import math
import os
import shutil
import stat
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from codegen.errors import BuildError, CodegenError
from codegen.sil.batch import DIFFERENCE_MAX_FLIPPED
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.sil.software import compile_build
from codegen.sweep import chunk as chunks
from codegen.sweep import plan as planning
from codegen.sweep import store
from codegen.sweep.chunk import replay, run_chunk, software
from codegen.sweep.engine import Threads, run_campaign
from codegen.sweep.plan import Plan
from codegen.sweep.store import RUNS_FILE, part_path
from hil_sim.suite import cells
from tests.sweep.conftest import SAMPLES, Recording, write_spec


def with_seed(plan: Plan, seed: int) -> Plan:
    return replace(plan, spec=plan.spec.model_copy(update={"seed": seed}))


def without_noise(plan: Plan) -> Plan:
    quiet = {key: values for key, values in plan.spec.factors.items() if "noise" not in key}
    return replace(plan, spec=plan.spec.model_copy(update={"factors": quiet}))


def test_two_threads_give_the_same_bytes(plan: Plan, whole: Path, tmp_path: Path) -> None:
    assert run_campaign(plan, tmp_path / "two", Threads(2)).read_bytes() == whole.read_bytes()


# --- the folder ----------------------------------------------------------------------------------------------------


def cut(folder: Path, plan: Plan) -> None:
    part_path(folder, 0).write_bytes(part_path(folder, 0).read_bytes()[:1000])


def copied(folder: Path, plan: Plan) -> None:
    shutil.copy(part_path(folder, 1), part_path(folder, 0))


def shortened(folder: Path, plan: Plan) -> None:
    pq.write_table(pq.read_table(part_path(folder, 0))[:-1], part_path(folder, 0))


def without_a_column(folder: Path, plan: Plan) -> None:
    pq.write_table(pq.read_table(part_path(folder, 0)).drop_columns(["settled"]), part_path(folder, 0))


def a_pipe(folder: Path, plan: Plan) -> None:
    part_path(folder, 0).unlink()
    os.mkfifo(part_path(folder, 0))


def a_link_to_itself(folder: Path, plan: Plan) -> None:
    part_path(folder, 0).unlink()
    part_path(folder, 0).symlink_to(part_path(folder, 0).name)


@pytest.fixture(scope="module")
def interrupted(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a campaign that was interrupted after two chunks."""

    def interrupt(number: int) -> None:
        if number == 1:
            raise KeyboardInterrupt

    folder = tmp_path_factory.mktemp("interrupted") / "out"
    with pytest.raises(KeyboardInterrupt, match="2 of 3 chunks are kept; run the same command to resume"):
        run_campaign(plan, folder, Recording(interrupt))
    return folder


@pytest.mark.parametrize("damage", [cut, copied, shortened, without_a_column, a_pipe, a_link_to_itself])
def test_an_interrupted_campaign_resumes_and_a_damaged_part_is_run_again(
    plan: Plan, whole: Path, interrupted: Path, tmp_path: Path, damage: Callable[[Path, Plan], None]
) -> None:
    folder, again, idle, progress = tmp_path / "out", Recording(), Recording(), []
    shutil.copytree(interrupted, folder)
    damage(folder, plan)
    (folder / "parts" / ".00000002.parquet.x.tmp").write_bytes(b"left by a kill")
    made = run_campaign(plan, folder, again, lambda done, total: progress.append((done, total)))
    assert made.read_bytes() == whole.read_bytes()
    assert again.driven == [0, 2]
    first, last = (6 * len(plan.samples_of(chunk)) for chunk in (1, 2))
    assert progress == [(first, 1200), (2 * first, 1200), (2 * first + last, 1200)]
    assert not (folder / "parts").exists()
    assert run_campaign(plan, folder, idle) == made  # which is not run again
    assert idle.driven == []


def test_a_folder_with_other_contents_stays_unchanged(plan: Plan, whole: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    for wanted, folder, message in (
        (with_seed(plan, 6), whole.parent, "it holds another campaign"),
        (plan, tmp_path, "it holds other files"),
        (plan, tmp_path / "mine.txt", "not a folder"),
    ):
        with pytest.raises(CodegenError, match=message):
            run_campaign(wanted, folder, Threads(1))
    with store.locked(whole.parent), pytest.raises(CodegenError, match="another codegen sweep is using it"):
        run_campaign(plan, whole.parent, Threads(1))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_damaged_files_are_reported(plan: Plan, whole: Path, tmp_path: Path) -> None:
    folder = tmp_path / "part"
    with pytest.raises(CodegenError, match="remove it, and run the same command again"):
        run_campaign(plan, folder, Recording(lambda number: part_path(folder, number).write_bytes(b"PAR1")))
    shutil.copytree(whole.parent, tmp_path / "file")
    (tmp_path / "file" / RUNS_FILE).write_bytes(whole.read_bytes()[:2000])
    with pytest.raises(CodegenError, match="it is damaged"):
        run_campaign(plan, tmp_path / "file", Threads(1))
    for content in (b"\xff\xfe{}", b"{", b"[" * 1_000_000):
        (tmp_path / "file" / store.FACTS).write_bytes(content)
        with pytest.raises(CodegenError, match=r"it holds another campaign: campaign\.json has been changed since"):
            store.check_same(tmp_path / "file", plan)


def test_the_file_is_synced_before_its_parts_are_removed(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store.prepare(tmp_path)
    store.open_folder(tmp_path, plan)
    for chunk in range(plan.chunk_count):
        runs = np.array(plan.runs_of(chunk))
        store.save_part(tmp_path, chunk, {"run": runs, "spun_at_s": np.sqrt(runs)}, plan)
    happened: list[str] = []

    def noted(module: Any, name: str, word: Callable[[Any], str]) -> None:
        real = getattr(module, name)

        def note(*given: Any, **options: Any) -> None:
            happened.append(word(given[0]))
            real(*given, **options)

        monkeypatch.setattr(module, name, note)

    noted(os, "fsync", lambda number: "sync folder" if stat.S_ISDIR(os.fstat(number).st_mode) else "sync file")
    noted(os, "replace", lambda path: "replace")
    noted(shutil, "rmtree", lambda path: "remove parts")
    store.merge(tmp_path, plan)
    assert happened == ["sync file", "replace", "sync folder", "remove parts"]


# --- chunks and runs -----------------------------------------------------------------------------------------------


def test_a_chunk_depends_only_on_seed_and_number_and_its_memory_is_bounded(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_longer = run_chunk(planning.read(write_spec(tmp_path, samples=5 * SAMPLES)), 0)
    per_sample = round(plan.config.controller.sampling_time_s / plan.config.plant.sampling_time_s)
    samples = max(profile.inputs.shape[0] for profile in plan.profiles) // per_sample
    of_one = 8 * planning.NUMBERS_PER_SAMPLE * samples
    tracemalloc.start()  # the builds were compiled above and are not counted
    chunk = run_chunk(plan, 0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= of_one * plan.samples_per_chunk
    assert chunk.keys() == of_longer.keys()
    assert all(np.array_equal(chunk[key], of_longer[key], equal_nan=True) for key in chunk)
    assert not np.array_equal(chunk["friction"], run_chunk(with_seed(plan, 6), 0)["friction"])
    for limit, wanted in ((10 * of_one, 10), (1, 1)):
        monkeypatch.setattr(planning, "CHUNK_BYTES_MAX", limit)
        assert (plan.samples_per_chunk, plan.chunk_count) == (wanted, SAMPLES // wanted)


def test_a_processor_without_the_instructions_of_the_campaign(plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "machine_runs", lambda isa: isa == "none")
    monkeypatch.setattr(chunks, "best_isa", lambda: "none")
    other = replace(plan, isa="x86-64-v3", config=cells.actuator_lag(4.0)(plan.config))
    with pytest.raises(BuildError, match="no instructions of x86-64-v3; run the whole campaign with `isa='none'`"):
        software(other, plan.controllers[0])


@pytest.mark.parametrize("run", [0, 2, 511, 700, 6 * SAMPLES - 1, *range(10, 6 * SAMPLES, 245)])
def test_a_replayed_run_is_identical(plan: Plan, whole: Path, run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "run_chunk", None)  # no other run of its chunk is needed
    found = replay(plan, run)
    row = {name: values[0] for name, values in pq.read_table(whole, filters=[("run", "=", run)]).to_pydict().items()}
    assert (found.controller, found.profile.name) == (row.pop("controller"), row.pop("scenario"))
    assert {name: value for name, value in row.items() if value is not None} == found.row
    assert next(iter(found.records)) == found.controller
    fewer = replace(plan, controllers=(plan.controllers[run % 3],))  # another controller in the spec does not change a run
    if fewer.controllers[0].controlled:
        assert {**replay(fewer, run // 3).row, "run": float(run)} == found.row
    if "spun_at_s" not in found.row:
        begin = round(found.profile.steer_time / plan.config.controller.sampling_time_s)
        largest = np.degrees(np.abs(found.records[found.controller][begin:, 5]).max())
        assert found.row["sideslip_abs_max_deg"] == pytest.approx(largest, rel=1e-12)  # two roundings


@pytest.mark.parametrize("run", [6, 10])
def test_a_run_equals_the_single_loop(plan: Plan, run: int) -> None:
    """The factors reach the plant: the single loop runs with a changed configuration, both without noise."""
    found = replay(without_noise(plan), run)
    row, controller = found.row, plan.controllers[found.key.controller]
    change = cells.together(cells.mass(row["mass_percent"]), cells.stiffness(0.0, row["rear_stiffness_percent"]))
    built = compile_build(controller.files, controller.manifest, change(plan.config))
    inputs = found.profile.inputs.copy()
    inputs[:, INPUT_COLUMNS.index("speed")] = row["speed_km_h"] / 3.6
    inputs[:, INPUT_COLUMNS.index("steering_wheel_command")] *= row["steering_wheel_angle_deg"] / 90.0
    inputs[:, INPUT_COLUMNS.index("friction")] = row["friction"]
    wanted = ClosedLoop(built, LoopOptions(controller.controlled, delay_samples=round(row["delay_samples"]))).run(inputs)
    before = wanted[:, 0] < (math.inf if "spun_at_s" not in row else row["spun_at_s"] - 0.5)
    assert before.sum() > 50
    difference = np.abs(found.records[found.controller] - wanted)[before, :-1]
    assert difference.max() < DIFFERENCE_MAX_FLIPPED, difference.max(axis=0)


def test_noise_reaches_the_controller_and_not_the_cars_own_signals(plan: Plan) -> None:
    quiet, record = without_noise(plan), lambda one, run, name: replay(one, run).records[name]
    assert np.array_equal(record(plan, 2, "passive"), record(quiet, 2, "passive"))
    noisy, calm = (record(each, 0, "pi")[:, 7] for each in (plan, quiet))
    assert not calm[:20].any()  # straight ahead, before the driver steers
    assert np.count_nonzero(noisy != calm) > 15

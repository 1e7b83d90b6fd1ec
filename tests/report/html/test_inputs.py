"""What a report is made of: each file by what it is, and what is none of these refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from codegen.config import preset
from codegen.errors import CodegenError
from codegen.export import runs as exported
from codegen.report.html.inputs import FAULT_KEYS, named, read_files
from codegen.sil.software import RECORD_COLUMNS
from hil_sim.frames import Frame
from hil_sim.logs import BusLog

CAN = preset().can
FAULT = dict.fromkeys(FAULT_KEYS, 0.0) | {"injected": "a frame lost", "seen": [], "reached": "DEGRADED", "violations": []}


def record() -> np.ndarray:
    """Two samples with a number of its own in each place; the status is one that exists."""
    made = np.arange(24.0).reshape(2, len(RECORD_COLUMNS)) / 100.0
    made[:, 0], made[:, -1] = (0.0, 0.01), (0.0, 1.0)
    return made


def log(path: Path, periods: tuple[float, ...], *, ids: tuple[int, ...] = (0x101, 0x102), delay: float = 0.004) -> Path:
    """A log of cycles that begin after `periods` (s), each answered after `delay`."""
    with BusLog(path) as bus_log:
        now = 0.0
        for period in (*periods, 0.0):
            for identifier in ids:
                bus_log.write(Frame(identifier, bytes(8), now), received=False)
            if 0x101 in ids:
                bus_log.write(Frame(CAN.rear_steer_command.id, bytes(8), now + delay), received=True)
            now += period
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mf4"])
def test_a_run_is_read_from_every_format_that_is_written(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    exported.save(record(), path)
    found = read_files([f"mine={path}"], CAN)
    np.testing.assert_array_equal(found.runs["mine"], record())
    assert not found.logs
    assert found.faults is None


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".mf4"])
def test_a_log_of_the_bus_gives_its_times(tmp_path: Path, suffix: str) -> None:
    periods = (0.01, 0.012, 0.008)
    (found,) = read_files([str(log(tmp_path / f"bus{suffix}", periods))], CAN).logs
    # A log has microseconds or better.
    for name in ("VehicleMotion", "VehicleConditions"):
        np.testing.assert_allclose(found.periods[name], [10.0, 12.0, 8.0], atol=2e-3)
    np.testing.assert_allclose(found.answers, [4.0] * 4, atol=2e-3)
    assert found.cycle == 10.0


def test_a_frame_that_its_sender_hears_is_counted_once(tmp_path: Path) -> None:
    path = tmp_path / "echo.blf"
    with BusLog(path) as bus_log:
        for cycle in range(3):
            bus_log.write(Frame(0x101, bytes(8), 0.01 * cycle), received=False)
            bus_log.write(Frame(0x101, bytes(8), 0.01 * cycle + 1e-4), received=True)
    (found,) = read_files([str(path)], CAN).logs
    np.testing.assert_allclose(found.periods["VehicleMotion"], [10.0, 10.0], atol=2e-3)


def test_a_sample_without_an_answer_of_its_own_has_none(tmp_path: Path) -> None:
    """The command that comes after the next sample belongs to that one."""
    path = tmp_path / "bus.blf"
    with BusLog(path) as bus_log:
        for time in (0.0, 0.01, 0.02):
            bus_log.write(Frame(0x101, bytes(8), time), received=False)
        bus_log.write(Frame(0x201, bytes(8), 0.013), received=True)
    (found,) = read_files([str(path)], CAN).logs
    np.testing.assert_allclose(found.answers, [3.0], atol=2e-3)


def test_an_answer_in_simulated_time_comes_at_once(tmp_path: Path) -> None:
    """In lock-step a command has the time of its sample, and the log says nothing of punctuality."""
    (found,) = read_files([str(log(tmp_path / "bus.asc", (0.01,) * 5, delay=0.0))], CAN).logs
    np.testing.assert_allclose(found.answers, [0.0] * 6, atol=1e-3)
    assert found.is_simulated
    (real,) = read_files([str(log(tmp_path / "real.asc", (0.01, 0.0101)))], CAN).logs
    assert not real.is_simulated


def test_what_was_sent_counts_where_it_was_heard_too(tmp_path: Path) -> None:
    path = tmp_path / "echo.blf"
    with BusLog(path) as bus_log:
        for cycle, late in enumerate((0.0, 0.002, 0.0)):
            bus_log.write(Frame(0x101, bytes(8), 0.01 * cycle), received=False)
            bus_log.write(Frame(0x101, bytes(8), 0.01 * cycle + 1e-3 + late), received=True)
    (found,) = read_files([str(path)], CAN).logs
    np.testing.assert_allclose(found.periods["VehicleMotion"], [10.0, 10.0], atol=2e-3)


def test_the_faults_are_those_of_the_command(tmp_path: Path) -> None:
    path = tmp_path / "faults.json"
    path.write_text(json.dumps({"faults": [FAULT]}), encoding="utf-8")
    found = read_files([str(path)], CAN).faults
    assert found is not None
    assert [entry["injected"] for entry in found] == ["a frame lost"]


def test_names_come_from_the_file_or_from_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert named("C1=a/b.csv") == ("C1", Path("a/b.csv"))
    assert named("a/b.csv") == ("b", Path("a/b.csv"))
    Path("x=y.csv").touch()  # a file may be called so
    assert named("x=y.csv") == ("x=y", Path("x=y.csv"))


def text(content: str, suffix: str = ".csv") -> Callable[[Path], str]:
    def make(folder: Path) -> str:
        path = folder / f"file{suffix}"
        path.write_text(content, encoding="utf-8")
        return str(path)

    return make


def endless(folder: Path) -> str:
    path = folder / "run.csv"
    exported.save(np.vstack([record(), np.where(np.arange(12) == 0, np.inf, 0.0)]), path)
    return str(path)


def twice(folder: Path) -> str:
    path = folder / "run.csv"
    exported.save(np.tile(record()[:1], (2, 1)), path)
    return str(path)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder: str(folder / "none.csv"), "no such file"),
        (text("a,b\n1,2\n"), "not the header of a run"),
        (text(",".join(RECORD_COLUMNS) + "\n"), "fewer than two samples"),
        (twice, "time_s does not rise"),
        (endless, "time_s is not finite"),
        (text("not a log", ".blf"), "no log of a CAN bus"),
        (text("not parquet", ".parquet"), "no run that can be read"),
        (text("not MF4", ".mf4"), "no run that can be read"),
        (text("{}", ".json"), "not what `codegen faults --json` prints"),
        (text("[]", ".json"), "not what `codegen faults --json` prints"),
        (text('{"faults": [{"injected": 1}]}', ".json"), "not what `codegen faults --json` prints"),
        (text("x", ".txt"), "nothing that a report is made of"),
        (lambda folder: str(log(folder / "bus.blf", (0.01,), ids=(0x77,))), "no frame with an id of the build (0x101"),
    ],
)
def test_what_is_none_of_these_is_refused(tmp_path: Path, make: Callable[[Path], str], said: str) -> None:
    with pytest.raises(CodegenError) as error:
        read_files([make(tmp_path)], CAN)
    assert said in error.value.what
    assert error.value.remedy


def test_a_name_stands_for_one_file(tmp_path: Path) -> None:
    exported.save(record(), tmp_path / "run.csv")
    with pytest.raises(CodegenError, match="a second run called 'run'"):
        read_files([str(tmp_path / "run.csv"), str(tmp_path / "run.csv")], CAN)

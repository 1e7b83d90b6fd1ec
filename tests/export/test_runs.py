"""A run as MF4, Parquet, MAT and CSV: read back by other readers, bit for bit, with names, units and status texts."""

import csv
import json
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import asammdf
import numpy as np
import pytest
from pyarrow import parquet
from scipy.io import loadmat

from codegen.errors import CodegenError
from codegen.export.runs import EXPORT_COLUMNS, check_formats, save
from codegen.sil.software import RECORD_COLUMNS, Status

SUFFIX_OF_UNIT = {"s": "_s", "m/s": "_m_s", "m/s^2": "_m_s2", "rad": "_rad", "rad/s": "_rad_s", "": ""}
AWKWARD = [-0.0, 5e-324, -2.2250738585072014e-308, 1.7976931348623157e308, np.inf, -np.inf, np.nan, 0.1, 1 / 3, 1e16 + 2]
SAMPLES = 3000


@pytest.fixture(scope="module")
def record() -> np.ndarray:
    """Return numbers that a lossy format changes, each in each column, and every status."""
    record = np.random.default_rng(7).normal(size=(SAMPLES, len(RECORD_COLUMNS)))
    record[:, 0] = 0.01 * np.arange(SAMPLES)
    for column in range(1, len(RECORD_COLUMNS) - 1):
        record[column : column + len(AWKWARD), column] = AWKWARD
    record[:, -1] = np.arange(SAMPLES) % len(Status)
    return record


def same_bits(found: Any, wanted: np.ndarray) -> bool:
    found = np.asarray(found)
    return found.dtype == np.float64 and found.tobytes() == np.ascontiguousarray(wanted).tobytes()


def test_mf4_by_asammdf(record: np.ndarray, tmp_path: Path) -> None:
    save(record, tmp_path / "run.mf4")
    with asammdf.MDF(tmp_path / "run.mf4") as run:
        assert run.version == "4.10"
        assert run.start_time == datetime(2000, 1, 1, tzinfo=UTC)
        (group,) = run.groups
        assert [channel.name for channel in group.channels] == list(RECORD_COLUMNS)
        assert run.masters_db == {0: 0}
        for number, column in enumerate(EXPORT_COLUMNS):
            assert column.meaning and column.name.endswith(SUFFIX_OF_UNIT[column.unit])
            signal = run.get(column.name, raw=True)
            assert (signal.unit, signal.comment) == (column.unit, column.meaning)
            assert same_bits(signal.timestamps, record[:, 0])
            if column.name != "status":
                assert same_bits(signal.samples, record[:, number])
        assert run.get("status", raw=True).samples.tolist() == record[:, -1].tolist()
        names = [Status(int(value)).name for value in record[:, -1]]
        assert [text.decode() for text in run.get("status").samples] == names


def test_parquet_by_pyarrow(record: np.ndarray, tmp_path: Path) -> None:
    save(record, tmp_path / "run.parquet")
    table = parquet.read_table(tmp_path / "run.parquet")
    assert table.column_names == list(RECORD_COLUMNS)
    assert [column.null_count for column in table.columns] == [0] * len(RECORD_COLUMNS)  # NaN is a value, not null
    for number, name in enumerate(RECORD_COLUMNS[:-1]):
        assert same_bits(table.column(name).to_numpy(), record[:, number])
    assert str(table.schema.field("status").type) == "uint8"
    assert table.column("status").to_pylist() == record[:, -1].tolist()
    described = json.loads(table.schema.metadata[b"columns"])
    assert list(described) == list(RECORD_COLUMNS)
    for column in EXPORT_COLUMNS:
        assert (described[column.name]["unit"], described[column.name]["description"]) == (column.unit, column.meaning)
    assert described["status"]["values"] == {str(int(state)): state.name for state in Status}
    assert table.schema.metadata[b"made_by"].startswith(b"ars-codegen ")
    assert b"scenario" not in table.schema.metadata


def test_the_scenario_is_in_the_metadata(record: np.ndarray, tmp_path: Path) -> None:
    for suffix in (".mf4", ".parquet", ".mat", ".csv"):  # the last two have no metadata
        save(record, tmp_path / f"run{suffix}", "Step steer: 80 km/h")
    assert parquet.read_schema(tmp_path / "run.parquet").metadata[b"scenario"] == b"Step steer: 80 km/h"
    with asammdf.MDF(tmp_path / "run.mf4") as run:
        assert run.groups[0].channel_group.comment.endswith("; scenario: Step steer: 80 km/h")


def test_csv_by_the_standard_library(record: np.ndarray, tmp_path: Path) -> None:
    save(record, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="", encoding="ascii") as file:
        head, *rows = csv.reader(file)
    assert head == list(RECORD_COLUMNS)
    assert same_bits(np.array(rows)[:, :-1].astype(np.float64), record[:, :-1])
    assert [row[-1] for row in rows] == [str(int(value)) for value in record[:, -1]]


def test_mat_by_scipy(record: np.ndarray, tmp_path: Path) -> None:
    """Octave reads such a file in tests/evidence/guide (docs/simulink.md)."""
    save(record, tmp_path / "run.mat")
    found = loadmat(tmp_path / "run.mat")
    assert [name for name in found if not name.startswith("__")] == list(RECORD_COLUMNS)
    for number, name in enumerate(RECORD_COLUMNS[:-1]):
        assert found[name].shape == (SAMPLES, 1)
        assert same_bits(found[name][:, 0], record[:, number])
    assert found["status"].dtype == np.uint8
    assert found["status"][:, 0].tolist() == record[:, -1].tolist()


@pytest.mark.parametrize("suffix", [".mf4", ".parquet", ".mat", ".csv"])
def test_equal_runs_give_equal_bytes(record: np.ndarray, tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are written at another time, in another folder, by another user."""
    save(record, tmp_path / f"one{suffix}")
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() + 86_400.0)
    monkeypatch.setattr(time, "asctime", lambda: "tomorrow")
    monkeypatch.setenv("USER", "another")
    monkeypatch.chdir(tmp_path)
    save(record.copy(order="F"), Path(f"other{suffix.upper()}"))  # extensions ignore case
    content = (tmp_path / f"one{suffix}").read_bytes()
    assert content == Path(f"other{suffix.upper()}").read_bytes()
    assert str(tmp_path).encode() not in content


@pytest.mark.parametrize(("package", "suffix"), [("asammdf", ".mf4"), ("pyarrow", ".parquet")])
def test_a_missing_package_and_an_unknown_extension(monkeypatch: pytest.MonkeyPatch, package: str, suffix: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    message = rf'{package}, which writes {suffix}, is missing; pip install "{package}>=[\d.]+,<\d+"$'
    with pytest.raises(CodegenError, match=message):
        check_formats((Path(f"run{suffix}"),))
    check_formats((Path("run.csv"),))
    with pytest.raises(CodegenError, match=r"no format for a run; end its name in \.mf4, \.parquet, \.mat, \.csv"):
        check_formats((Path("run.mdf"),))

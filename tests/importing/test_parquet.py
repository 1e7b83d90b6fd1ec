"""Columns of Parquet files: times in a type of their own, and more rows than a small file may hold."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from codegen.importing import parquet


@pytest.fixture
def path(tmp_path: Path) -> Path:
    times = pd.to_timedelta(np.arange(4) * 10, unit="ms")
    table = pd.DataFrame(
        {"duration": times, "stamp": pd.Timestamp("2020-01-01", tz="UTC") + times, "vx": [1.0, 2.0, np.nan, 4.0]}
    )
    table.to_parquet(tmp_path / "drive.parquet")
    return tmp_path / "drive.parquet"


def test_times_become_nanoseconds(path: Path) -> None:
    assert parquet.columns(path)[0] == [("duration", "time"), ("stamp", "time"), ("vx", "other")]
    duration, stamp, vx = parquet.read(path, ["duration", "stamp", "vx"], 1000)
    np.testing.assert_array_equal(duration, [0.0, 1e7, 2e7, 3e7])
    np.testing.assert_array_equal(stamp, stamp[0] + duration)
    np.testing.assert_array_equal(vx, [1.0, 2.0, np.nan, 4.0])


def test_times_of_the_day_become_nanoseconds(tmp_path: Path) -> None:
    values = [0, 20, 40]
    columns = {
        "coarse": pa.array(values, pa.time32("ms")),
        "fine": pa.array([1000 * value for value in values], pa.time64("us")),
    }
    pq.write_table(pa.table(columns), tmp_path / "drive.parquet")
    assert parquet.columns(tmp_path / "drive.parquet")[0] == [("coarse", "time"), ("fine", "time")]
    for found in parquet.read(tmp_path / "drive.parquet", ["coarse", "fine"], 1000):
        np.testing.assert_array_equal(found, [0.0, 2e7, 4e7])


def test_dates_become_nanoseconds(tmp_path: Path) -> None:
    for kind, per_day in ((pa.date32(), 1), (pa.date64(), 86_400_000)):
        pq.write_table(pa.table({"time": pa.array([0, per_day], kind)}), tmp_path / "drive.parquet")
        assert parquet.columns(tmp_path / "drive.parquet")[0] == [("time", "time")]
        np.testing.assert_array_equal(parquet.read(tmp_path / "drive.parquet", ["time"], 1000)[0], [0.0, 86400e9])


def test_more_rows_than_the_limit_are_not_read(path: Path) -> None:
    assert len(parquet.read(path, ["vx", "stamp"], 4 * 2 * 8)) == 2
    with pytest.raises(ValueError, match=r"^4 rows, more than a file of its size may hold$"):
        parquet.read(path, ["vx", "stamp"], 4 * 2 * 8 - 1)

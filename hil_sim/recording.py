"""Recordings on disk: CSV with units in the column names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from codegen.arrays import FloatArray
from codegen.errors import CodegenError
from codegen.files import read_text, write_atomically
from codegen.sil.software import RECORD_COLUMNS

CSV_BYTES_MAX = 2**30
"""Largest file in bytes: some hours of driving."""


def to_csv(record: FloatArray) -> bytes:
    """Format a recording (samples, 12) as CSV with a header. Numbers read back to the same bits."""
    lines = [",".join(RECORD_COLUMNS)]
    status = RECORD_COLUMNS.index("status")
    for row in record.tolist():
        lines.append(",".join(str(int(value)) if index == status else repr(value) for index, value in enumerate(row)))
    return ("\n".join(lines) + "\n").encode("ascii")


def save_csv(record: FloatArray, path: Path) -> None:
    """Write a recording; what stood at `path` stays until the new file is complete. Raises CodegenError."""
    write_atomically(path, to_csv(record))


def load_csv(path: Path) -> FloatArray:
    """Read a recording (samples, 12) that `save_csv` wrote. Raises CodegenError with the file and line."""
    lines = read_text(path, CSV_BYTES_MAX, "give the CSV of a run").splitlines()
    if not lines or lines[0] != ",".join(RECORD_COLUMNS):
        raise CodegenError("not the header of a run", where=f"{path}, line 1", remedy=f"needed: {','.join(RECORD_COLUMNS)}")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            row = [float(text) for text in line.split(",")]
        except ValueError as error:
            raise CodegenError(str(error), where=f"{path}, line {number}", remedy="correct the number") from None
        if len(row) != len(RECORD_COLUMNS):
            raise CodegenError(
                f"{len(row)} values, {len(RECORD_COLUMNS)} needed",
                where=f"{path}, line {number}",
                remedy="record the run again",
            )
        rows.append(row)
    return np.array(rows).reshape(len(rows), len(RECORD_COLUMNS))

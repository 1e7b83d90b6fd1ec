"""Export a run as MF4, Parquet, MAT or CSV, selected by the extension. Columns, names and values are those of the CSV.

| format | written by | unit and meaning of a column | status |
|---|---|---|---|
| `.mf4` | asammdf, ASAM MDF 4.1 | unit and comment of the channel | uint8, with a conversion from value to text |
| `.parquet` | pyarrow | the file's metadata, key `columns`, JSON | uint8, its names in the metadata |
| `.mat` | SciPy, MATLAB 5 to 7.2, a vector for each column | the unit in the name | uint8 |
| `.csv` | `hil_sim.logs` | the unit in the name | whole number |

All other columns are float64. The scenario's title is in the comment of the MF4's channel group and in the metadata of a
Parquet file, key `scenario`. Files contain no clock time and no path, so equal runs give equal bytes with the same packages.
"""

from __future__ import annotations

import importlib.util
import io
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from codegen import __version__
from codegen.arrays import FloatArray
from codegen.configuration.signals import RECORDED
from codegen.errors import CodegenError
from codegen.files import write_atomically
from codegen.requirements import missing
from codegen.sil.software import RECORD_COLUMNS, Status
from codegen.units import unit_of_name
from hil_sim.logs import EPOCH, to_csv

MAT_HEADER_BYTES = 116
"""Length of the text at the beginning of a MATLAB file."""


@dataclass(frozen=True)
class Column:
    """A column of a run: its name, which ends with the unit, and its meaning."""

    name: str
    meaning: str

    @property
    def unit(self) -> str:
        """Symbol of its unit."""
        return unit_of_name(self.name).symbol


EXPORT_COLUMNS = (
    Column("time_s", "Time since the start of the run"),
    Column("speed_m_s", "Speed along the car's axis, negative in reverse"),
    Column("front_angle_rad", "Steer angle of the front road wheels, positive to the left"),
    Column("yaw_rate_rad_s", "Yaw rate, positive to the left"),
    Column("yaw_rate_reference_rad_s", "Yaw rate that the controller aims at"),
    Column("sideslip_rad", "Sideslip angle at the centre of gravity, positive to the left"),
    Column("lateral_acceleration_m_s2", "Lateral acceleration at the centre of gravity, positive to the left"),
    Column("rear_angle_command_rad", "Steer angle of the rear road wheels that the controller commands"),
    Column("rear_angle_rad", "Steer angle of the rear road wheels that the actuator has reached"),
    Column("slip_front_rad", "Slip angle at the middle of the front axle"),
    Column("slip_rear_rad", "Slip angle at the middle of the rear axle"),
    *(Column(each.variable, each.meaning.capitalize()) for each in RECORDED),
    Column("status", "What the step of the controller did"),
)
"""RECORD_COLUMNS with their units and meanings. Signs follow ISO 8855."""


def check_formats(paths: Iterable[Path]) -> None:
    """Check before a run that each extension has a format and the package for it is installed.

    Raises:
        CodegenError: with the path, and what to name or install instead.
    """
    for path in paths:
        form = RUN_FORMATS.get(path.suffix.lower())
        if form is None:
            known = ", ".join(RUN_FORMATS)
            raise CodegenError("no format for a run", where=path, remedy=f"end its name in {known}; a picture is drawn by plot")
        if form.package is not None and importlib.util.find_spec(form.package) is None:
            raise missing(form.package, f"writes {path.suffix}", path)


def save(record: FloatArray, path: Path, scenario: str = "") -> None:
    """Write a recording in the format of the extension, replacing `path` atomically.

    Args:
        record: (samples, columns), RECORD_COLUMNS.
        path: `.mf4`, `.parquet`, `.mat` or `.csv`.
        scenario: title of the scenario, for the metadata; "" if unknown. MAT and CSV have no metadata.

    Raises:
        CodegenError: no such format, a package is missing, or it cannot be written.
    """
    check_formats((path,))
    write_atomically(path, RUN_FORMATS[path.suffix.lower()].content(record, scenario))


def to_mf4(record: FloatArray, scenario: str = "") -> bytes:
    """Return a recording as compressed ASAM MDF 4.1: one channel group with the master `time_s`, starting at EPOCH."""
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import FileHistory

    content = io.BytesIO()
    with MDF(version="4.10") as mdf:
        mdf.start_time = datetime.fromtimestamp(EPOCH, UTC)
        time, *others = EXPORT_COLUMNS
        signals = [
            Signal(
                _values(record, column.name),
                record[:, 0].copy(),
                unit=column.unit,
                name=column.name,
                comment=column.meaning,
                conversion=_status_texts() if column.name == "status" else None,
                master_metadata=(time.name, 1),  # 1: its axis is time
            )
            for column in others
        ]
        comment = f"Run of a rear-steered car; signs follow ISO 8855{f'; scenario: {scenario}' if scenario else ''}"
        group = mdf.append(signals, acq_name="run", comment=comment)
        mdf.groups[group].channels[0].comment = time.meaning
        history = FileHistory()
        history.comment = (
            "<FHcomment><TX>Run</TX><tool_id>ars-codegen</tool_id><tool_vendor>ars-codegen</tool_vendor>"
            f"<tool_version>{__version__}</tool_version></FHcomment>"
        )
        mdf.file_history.append(history)
        for entry in mdf.file_history:
            entry.time_stamp = mdf.start_time
        mdf.save(content, compression=2, add_history_block=False)  # 2: transposed, then deflate
    return content.getvalue()


def to_parquet(record: FloatArray, scenario: str = "") -> bytes:
    """Return a recording as Parquet, compressed with Snappy, which every reader supports."""
    import pyarrow as pa
    from pyarrow import parquet

    columns: dict[str, dict[str, object]] = {
        column.name: {"unit": column.unit, "description": column.meaning} for column in EXPORT_COLUMNS
    }
    columns["status"]["values"] = {str(status.value): status.name for status in Status}
    metadata = {"columns": json.dumps(columns), "made_by": f"ars-codegen {__version__}"}
    metadata |= {"scenario": scenario} if scenario else {}
    table = pa.table({column.name: _values(record, column.name) for column in EXPORT_COLUMNS}, metadata=metadata)
    content = io.BytesIO()
    parquet.write_table(table, content, compression="snappy")
    return content.getvalue()


def to_mat(record: FloatArray) -> bytes:
    """Return a recording as a compressed MATLAB file with a column vector for each column of the run."""
    from scipy.io import savemat

    content = io.BytesIO()
    columns = {column.name: _values(record, column.name) for column in EXPORT_COLUMNS}
    savemat(content, columns, do_compression=True, oned_as="column")
    # The header is 116 bytes of text, which readers require to begin like this. SciPy writes the time of day into it.
    header = f"MATLAB 5.0 MAT-file, made by ars-codegen {__version__}".ljust(MAT_HEADER_BYTES).encode()
    return header + content.getvalue()[MAT_HEADER_BYTES:]


@dataclass(frozen=True)
class Format:
    """A file format: function that encodes a recording and the title of its scenario, and the package it requires."""

    content: Callable[[FloatArray, str], bytes]
    package: str | None = None


RUN_FORMATS = {
    ".mf4": Format(to_mf4, "asammdf"),
    ".parquet": Format(to_parquet, "pyarrow"),
    ".mat": Format(lambda record, _: to_mat(record)),
    ".csv": Format(lambda record, _: to_csv(record)),
}


def _values(record: FloatArray, name: str) -> npt.NDArray[np.float64] | npt.NDArray[np.uint8]:
    values = record[:, RECORD_COLUMNS.index(name)].copy()
    return values.astype(np.uint8) if name == "status" else values


def _status_texts() -> dict[str, object]:
    """Return the value-to-text conversion for asammdf; unknown values stay numbers."""
    texts: dict[str, object] = {}
    for number, status in enumerate(Status):
        texts |= {f"val_{number}": status.value, f"text_{number}": status.name}
    return texts

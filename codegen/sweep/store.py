"""Results on disk: a part for each chunk while the campaign runs, one Parquet file when it is done.

The file's metadata records what its content depends on. It contains no clock, host or path, so equal campaigns give equal bytes
with the same versions of the packages.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import io
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.errors import CodegenError
from codegen.files import read_file, replace_durably, require_regular, write_atomically
from codegen.interrupts import deferred
from codegen.requirements import missing
from codegen.sil.vector import ISAS
from codegen.sweep.chunk import Table
from codegen.sweep.plan import Plan
from codegen.sweep.versions import versions

WHOLE_COLUMNS = ("run", "sample")
YES_NO = ("settled", "meets_fmvss_126")
NAMES = ("scenario", "controller")
ROWS_PER_GROUP = 2**13
"""Approximate number of rows in a group of the finished file. A group is in memory while it is written, and its entry in the
footer until the file is closed. 2^13 rows of a step are 2 MB, their entry some 50 kB: about the minimum for a million runs.
"""
ROWS_PER_BATCH = 2**12
"""Largest number of rows in memory while the finished file is read."""

WRITING: Mapping[str, Any] = {"compression": "zstd", "write_page_checksum": True, "use_dictionary": list(NAMES)}
"""No dictionaries for figures: values hardly repeat, and building them would cost time, memory and a fifth of the file."""
READING: Mapping[str, Any] = {"page_checksum_verification": True, "pre_buffer": False}
"""Detect pages that a failing disk has changed. Buffered pages would stay in memory until the file is closed."""

FACTS_BYTES_MAX = 2**24
PART_BYTES_MAX = 2**30
FACTS, PARTS, RUNS_FILE = "campaign.json", "parts", "runs.parquet"


def require_pyarrow() -> None:
    """Raise CodegenError if pyarrow is missing."""
    if importlib.util.find_spec("pyarrow") is None:
        raise missing("pyarrow", "writes Parquet", "codegen sweep")


def facts_text(plan: Plan) -> str:
    """Return the content of `campaign.json`: all inputs of the results."""
    return json.dumps({**plan.facts(), "tools": versions()}, indent=1) + "\n"


def prepare(folder: Path) -> None:
    """Create the folder if it is missing. Raises CodegenError."""
    if (folder.exists() or folder.is_symlink()) and not folder.is_dir():
        raise CodegenError("not a folder", where=folder, remedy="name a folder for the campaign")
    with _Writable(folder):
        folder.mkdir(parents=True, exist_ok=True)


def open_folder(folder: Path, plan: Plan) -> set[int]:
    """Create and lock the folder of a campaign. Return the chunks that it already contains.

    Raises:
        CodegenError: it contains another campaign or other files.
    """
    text, there = facts_text(plan).encode(), _facts(folder)
    if there is None:
        if any(folder.iterdir()):
            raise CodegenError("it holds other files", where=folder, remedy="name a new or an empty folder")
        write_atomically(folder / FACTS, text)
    elif there != text:
        raise _other(there, plan, folder, "name another folder, or remove this one")
    if (folder / RUNS_FILE).is_file():
        _check_finished(folder / RUNS_FILE, plan)
        shutil.rmtree(folder / PARTS, ignore_errors=True)
        return set(range(plan.chunk_count))
    with _Writable(folder):
        (folder / PARTS).mkdir(exist_ok=True)
    return {chunk for chunk in range(plan.chunk_count) if _is_whole(folder, chunk, plan)}


def check_same(folder: Path, plan: Plan) -> None:
    """Raise CodegenError if the folder belongs to another campaign."""
    there = _facts(folder)
    if there is None:
        raise CodegenError("no campaign is there", where=folder, remedy="name the folder that codegen sweep wrote")
    if there != facts_text(plan).encode():
        raise _other(there, plan, folder, "use the spec and the builds of that campaign")


def _facts(folder: Path) -> bytes | None:
    """Return the bytes of `campaign.json`; None if there is none. Raises CodegenError."""
    path = folder / FACTS
    return read_file(path, FACTS_BYTES_MAX, "check its rights") if path.is_file() else None


def _check_finished(path: Path, plan: Plan) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            whole = file.metadata.num_rows == plan.spec.run_count
    except (OSError, pa.ArrowException):
        whole = False
    if not whole:
        raise _damaged(path)


def _damaged(path: Path) -> CodegenError:
    return CodegenError("it is damaged", where=path, remedy="remove it, and run the same command again")


def _is_whole(folder: Path, chunk: int, plan: Plan) -> bool:
    """Return whether a part belongs to its chunk. Damaged or foreign parts are simulated again."""
    try:
        _part(folder, chunk, plan)
    except CodegenError:
        return False
    return True


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder, so that a second campaign there cannot remove the files of the first.

    The lock ends with the process. Raises CodegenError.
    """
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise CodegenError(f"cannot be read ({error.strerror})", where=folder, remedy="check the path and its rights") from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise CodegenError(
                "another codegen sweep is using it", where=folder, remedy="wait for it, or name another folder"
            ) from None
        yield
    finally:
        os.close(handle)


def _other(content: bytes, plan: Plan, folder: Path, remedy: str) -> CodegenError:
    """Return the error of a folder with another campaign; it names the facts that differ from the plan."""
    try:
        there = json.loads(content)
    except (ValueError, RecursionError):  # no JSON, not even text, or nested without end
        return CodegenError(f"it holds another campaign: {FACTS} has been changed since", where=folder, remedy=remedy)
    facts = json.loads(facts_text(plan))
    # As text, because the order of controllers, scenarios and factors matters.
    names = [name for name in facts if not isinstance(there, dict) or json.dumps(there.get(name)) != json.dumps(facts[name])]
    if names == ["isa"] and there.get("isa") in ISAS:
        return CodegenError(
            f"it was simulated with the instruction set {there['isa']}, not {plan.isa}, whose results differ by rounding",
            where=folder,
            remedy=f"give `isa={there['isa']!r}`, or name another folder",
        )
    told = f"{', '.join(names) or 'something'} {'have' if len(names) > 1 else 'has'}"
    return CodegenError(f"it holds another campaign: {told} changed since", where=folder, remedy=remedy)


class _Writable:
    """Converts an OSError to a CodegenError."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, OSError):
            raise CodegenError(
                f"cannot be written ({error.strerror})", where=self.folder, remedy="check the path and its rights"
            ) from None


def part_path(folder: Path, chunk: int) -> Path:
    """Return the path of the part of a chunk."""
    return folder / PARTS / f"{chunk:08d}.parquet"


def kept(folder: Path, plan: Plan) -> int:
    """Return the number of complete chunks."""
    if (folder / RUNS_FILE).is_file():
        return plan.chunk_count
    return sum(1 for _ in (folder / PARTS).glob("[0-9]*.parquet"))


def save_part(folder: Path, chunk: int, table: Table, plan: Plan) -> None:
    """Write the part of a chunk atomically. Raises CodegenError."""
    import pyarrow.parquet as pq

    content = io.BytesIO()
    pq.write_table(to_arrow(table, plan), content, **WRITING)
    path = part_path(folder, chunk)
    if path.is_symlink() or path.is_fifo():  # nothing that a campaign wrote
        path.unlink()
    write_atomically(path, content.getvalue())


def to_arrow(table: Table, plan: Plan) -> Any:
    """Return a table with the types of the file: dictionaries for names, booleans for yes and no, null for missing figures."""
    import pyarrow as pa

    names = {
        "scenario": [profile.name for profile in plan.profiles],
        "controller": [controller.name for controller in plan.controllers],
    }
    columns = {}
    for name, values in table.items():
        if name in WHOLE_COLUMNS:
            columns[name] = pa.array(values.astype(np.int64))
        elif name in NAMES:
            columns[name] = pa.DictionaryArray.from_arrays(pa.array(values.astype(np.int8)), pa.array(names[name]))
        elif name in YES_NO:
            columns[name] = pa.array(values == 1.0, mask=np.isnan(values))
        else:
            columns[name] = pa.array(values, mask=np.isnan(values))
    made = pa.table(columns)
    return made.replace_schema_metadata(_metadata(made, plan))


def _metadata(table: Any, plan: Plan) -> dict[bytes, bytes]:
    """Return the metadata of a part: its campaign and its columns."""
    return {b"campaign": facts_text(plan).encode(), b"columns": ",".join(table.column_names).encode()}


def merge(folder: Path, plan: Plan) -> Path:
    """Merge all parts into one file, in the order of the runs, and remove them. Memory: one group of rows.

    Returns the path. Raises CodegenError: a part is damaged or another chunk's, or the file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    target = folder / RUNS_FILE
    if target.is_file():
        return target
    temporary = folder / f".{RUNS_FILE}.tmp"
    try:
        with _Writable(folder), deferred() as stop_if_asked:
            writer = None
            waiting: list[Any] = []
            rows = 0
            for chunk in range(plan.chunk_count):
                stop_if_asked()
                waiting.append(_part(folder, chunk, plan))
                rows += waiting[-1].num_rows
                if rows >= ROWS_PER_GROUP or chunk == plan.chunk_count - 1:
                    group = pa.concat_tables(waiting).unify_dictionaries()
                    writer = pq.ParquetWriter(temporary, group.schema, **WRITING) if writer is None else writer
                    writer.write_table(group, row_group_size=rows)
                    waiting, rows = [], 0
            if writer is not None:
                writer.close()
            replace_durably(temporary, target)  # before the parts go
    finally:
        temporary.unlink(missing_ok=True)
    pa.default_memory_pool().release_unused()
    shutil.rmtree(folder / PARTS, ignore_errors=True)
    return target


def _part(folder: Path, chunk: int, plan: Plan) -> Any:
    """Return the table of a part after checking its columns and runs. Raises CodegenError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    path, remedy = part_path(folder, chunk), "remove it, and run the same command again"
    require_regular(path, PART_BYTES_MAX, remedy)
    try:
        with pq.ParquetFile(path, **READING) as file:
            table = file.read(use_threads=False)
    except (OSError, pa.ArrowException) as error:
        raise CodegenError(f"it cannot be read ({error})", where=path, remedy=remedy) from None
    if table.schema.metadata != _metadata(table, plan):
        raise CodegenError("it is of another campaign, or has other columns", where=path, remedy=remedy)
    if table.column("run").to_pylist() != list(plan.runs_of(chunk)):
        raise CodegenError("it holds other runs than its chunk", where=path, remedy=remedy)
    return table


def read_batches(path: Path) -> Iterator[dict[str, npt.NDArray[Any]]]:
    """Yield the finished file in batches of at most ROWS_PER_BATCH rows: column -> values; NaN for null, names as text, yes and
    no as 1 and 0.

    Raises:
        CodegenError: it is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, **READING) as file:
            for batch in file.iter_batches(ROWS_PER_BATCH, use_threads=False):
                yield {name: _values(name, batch.column(name)) for name in batch.schema.names}
    except (OSError, pa.ArrowException):
        raise _damaged(path) from None
    finally:
        # Memory that the pool keeps would not be available to NumPy and Matplotlib.
        pa.default_memory_pool().release_unused()


def _values(name: str, column: Any) -> npt.NDArray[Any]:
    if name in WHOLE_COLUMNS:
        return np.asarray(column.to_numpy())
    if name in NAMES:
        # Each name is stored once and each row has a code: a string for each row would take more memory than the figures.
        return np.asarray(np.asarray(column.dictionary.to_pylist())[column.indices.to_numpy()])
    if name in YES_NO:
        column = column.cast("int8").cast("float64")
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)

"""Import of a map from a MATLAB file or a text table: find the quantities, convert to SI, check plausibility.

MATLAB files of the versions 4, 5, 6, 7 and 7.2 (save -v4, -v6, -v7) are read; 7.3 is HDF5 and is rejected. SciPy reads them in
a child process (`child`). On a damaged file it may crash (1.17 does) or request any amount of memory; then only the child
ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen import __version__
from codegen.arrays import AnyArray, FloatArray
from codegen.errors import CodegenError, one_line
from codegen.importing import child, quantities
from codegen.importing.quantities import LOGICAL_KIND, MAP_CHANNELS, UNIT_FACTORS
from codegen.importing.source import MIB, TABLE_BYTES_MAX, ImportFault, Source, read
from codegen.importing.table import AxisName, RawMap, read_table
from codegen.limits import Limits
from codegen.map_file.map import SCHEMA_VERSION, ReferenceMap, from_arrays
from codegen.map_file.tables import TABLE_UNITS

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
SAVE_AGAIN = "save it in MATLAB with save(name, 'vx', 'delta_f', 'yaw_rate', '-v7')"


@dataclass(frozen=True)
class Contents:
    """Contents of a MATLAB file.

    Attributes:
        variables: name -> array for each numeric or logical (0 and 1) one, in the file's order; in plain structs as "map.vx".
        nested: the names of structs inside structs, "lut.Breakpoints", which are not read.
    """

    variables: dict[str, AnyArray]
    nested: list[str]


def contents(source: Source) -> Contents:
    """Read a MATLAB file.

    Raises:
        ImportFault: it is HDF5, no MATLAB file, damaged, or too large.
    """
    data = source.data
    if HDF5_SIGNATURE in data[:1024] or (data[126:128] in (b"IM", b"MI") and 2 in data[124:126]):
        raise ImportFault("a MATLAB file of version 7.3 (HDF5), which is not read", where=source.path, remedy=SAVE_AGAIN)
    try:
        return Contents(*child.call("codegen.importing.matlab", "read", data, TABLE_BYTES_MAX, limits=Limits.of(len(data))))
    except MemoryError:
        remedy = "save the map's own variables only"
        raise ImportFault(f"over {TABLE_BYTES_MAX // MIB} MiB unpacked", where=source.path, remedy=remedy) from None
    except ImportError as error:
        what = f"SciPy, which reads it, cannot be imported ({one_line(error)})"
        remedy = "install the project's packages again, or save the map as a text table"
        raise ImportFault(what, where=source.path, remedy=remedy) from None
    except Exception as error:  # SciPy may raise anything
        what = f"damaged, or no MAT-file of version 4 to 7.2 ({one_line(error)})"
        raise ImportFault(what, where=source.path, remedy=SAVE_AGAIN) from None


MATLAB_ENDINGS = (".mat",)
SAVE_FLAT = "save vx, delta_f and yaw_rate"
TABLE_ENDINGS = (".csv", ".tsv", ".txt", ".dat")


@dataclass(frozen=True)
class Choices:
    """Options of the user for a file.

    Attributes:
        names: quantity key -> variable or column.
        units: the text of --units.
        rows: the axis that runs down the rows of the table; None where the file decides.
    """

    names: Mapping[str, str]
    units: str | None = None
    rows: AxisName | None = None


@dataclass(frozen=True)
class ImportedMap:
    """The imported map, notes for the user, and quantity key -> name and unit in the file."""

    reference_map: ReferenceMap
    said: tuple[str, ...]
    columns: dict[str, dict[str, str]]


def import_map(path: Path, choices: Choices) -> ImportedMap:
    """Read a map from a MATLAB file or a text table.

    Raises:
        ImportFault: the file cannot be read, a quantity or a unit is missing, or a unit cannot be right.
        MapError: it breaks the contract of the map.
    """
    given = quantities.parse_units(choices.units)
    source = read(path, TABLE_BYTES_MAX)
    with Limits.of(len(source.data)).enforced(path, ImportFault):
        return _read(source, choices, given)


def _read(source: Source, choices: Choices, given: Mapping[str, str]) -> ImportedMap:
    found = contents(source) if source.path.suffix.lower() in MATLAB_ENDINGS else None
    turned = replace(choices, rows="delta_f")
    try:
        raw = _raw(source, found, choices)
        imported = _imported(source, raw, given)
    except CodegenError as error:
        is_asked = choices.rows is not None or "rows=" in error.remedy
        if is_asked or not _fits(source, found, turned, given):
            raise
        remedy = f"{error.remedy}, or is it the other way round? `rows='delta_f'` would fit"
        raise type(error)(error.what, where=error.where, remedy=remedy) from None
    if raw.assumes_rows and _fits(source, found, turned, given):
        raise ImportFault("speeds and front angles could be either way round", where=source.path, remedy=ROWS_WANTED)
    return imported


ROWS_WANTED = "give `rows='vx'` if it has a row for each speed, else `rows='delta_f'`"


def _raw(source: Source, found: Contents | None, choices: Choices) -> RawMap:
    """Return the contents of a text table, or of a MATLAB file where `found` is given."""
    return _from_matlab(source, found, choices) if found is not None else read_table(source, choices.names, choices.rows)


def _fits(source: Source, found: Contents | None, choices: Choices, given: Mapping[str, str]) -> bool:
    try:
        _imported(source, _raw(source, found, choices), given)
    except CodegenError:
        return False
    return True


def _imported(source: Source, raw: RawMap, given: Mapping[str, str]) -> ImportedMap:
    """Return the map of the contents of a file."""
    path = source.path
    stray = sorted(given.keys() - raw.values.keys())
    if stray:
        raise ImportFault(f"{path.name} has no {stray[0]}", where="`units=`", remedy="leave it out")
    units = _units(raw, given, source)
    quantities.check_units(_judged(raw), units, path)
    arrays = {key: _in_si(array, key, units[key]) for key, array in raw.values.items()}
    if "feasible" not in arrays and arrays["yaw_rate"].ndim == 2:
        arrays["feasible"] = ~np.isnan(arrays["yaw_rate"])
    columns = {key: {"name": raw.names[key].text, "unit": units[key]} for key in raw.values}
    reference_map = replace(from_arrays(arrays, path), meta=_meta(source, columns))
    overruled = [
        f"{name.text} is taken in {given[key]}, as given with `units=`"
        for key, name in raw.names.items()
        if key in given and name.unit not in (None, given[key])
    ]
    infeasible = int(np.count_nonzero(~reference_map.feasible))
    said = [
        *raw.said,
        *overruled,
        *([f"infeasible, with no value: {infeasible} of {reference_map.feasible.size} cells"] if infeasible else []),
    ]
    return ImportedMap(reference_map, tuple(said), columns)


def _meta(source: Source, columns: dict[str, dict[str, str]]) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "units": dict(TABLE_UNITS),
        "source": {"file": source.name, "sha256": source.sha256, "variables": columns},
        "tools": {"codegen": __version__, "numpy": np.__version__},
    }


def _units(raw: RawMap, given: Mapping[str, str], source: Source) -> dict[str, str]:
    """Return the unit of every quantity. Raises ImportFault for the first without one, with the unit that fits the values."""
    units = {key: quantities.named_unit(key, raw.names[key], given, source.path) for key in raw.values}
    known = {key: unit for key, unit in units.items() if unit is not None}
    for key in units:
        if key in known:
            continue
        missing = [each for each in units if each not in known]
        likely = quantities.likely_units(_judged(raw), {each: known[each] for each in known if each != "feasible"})
        choice = {each: "|".join(UNIT_FACTORS[MAP_CHANNELS[each].kind]) for each in missing}
        pairs = ",".join(f"{each}={unit}" for each, unit in (likely or choice).items())
        raise ImportFault(
            f"the unit of {key} is not known",
            where=f"{source.path}: {raw.names[key].text}",
            remedy=f"add `units='{pairs}'`" + (" (these would fit the values)" if likely else ""),
        )
    return known


def _judged(raw: RawMap) -> dict[str, FloatArray]:
    """Return the values for the check of units: real numbers of feasible cells."""
    feasible = raw.values.get("feasible")
    judged = {}
    for key, array in raw.values.items():
        if MAP_CHANNELS[key].kind == LOGICAL_KIND:
            continue
        values = np.array(array, dtype=np.float64)
        if values.ndim == 2 and feasible is not None and feasible.shape == values.shape:
            values[feasible != 1] = np.nan
        judged[key] = values
    return judged


def _in_si(array: npt.NDArray[Any], key: str, unit: str) -> npt.NDArray[Any]:
    factor = UNIT_FACTORS[MAP_CHANNELS[key].kind][unit]
    return array if factor == 1.0 else np.asarray(array, dtype=np.float64) * factor


# --- MATLAB --------------------------------------------------------------------------------------------------------------


def _from_matlab(source: Source, found: Contents, choices: Choices) -> RawMap:
    """Return the map's variables of a MATLAB file: axes as vectors, tables with a row for each speed."""
    unread = f"structs inside structs are not read ({found.nested[0]}); {SAVE_FLAT}" if found.nested else ""
    names = quantities.choose(found.variables, choices.names, source.path, unread)
    values = {key: _real(found.variables[name.text], f"{source.path}: {name.text}") for key, name in names.items()}
    for key in ("vx", "delta_f"):
        values[key] = _vector(values[key], f"{source.path}: {names[key].text}")
    shape = (values["vx"].size, values["delta_f"].size)
    transposed = _is_transposed(values["yaw_rate"].shape, shape, choices.rows, f"{source.path}: {names['yaw_rate'].text}")
    said = [f"a MATLAB file with {', '.join(name.text for name in names.values())}"]
    if transposed:
        values = {key: array if key in ("vx", "delta_f") else array.T for key, array in values.items()}
        said.append(f"transposed: in the file the rows of {names['yaw_rate'].text} are delta_f")
    elif shape[0] == shape[1] and choices.rows is None:
        raise ImportFault(
            f"as many speeds as front angles, {shape[0]}: the table does not show what its rows are",
            where=f"{source.path}: {names['yaw_rate'].text}",
            remedy=ROWS_WANTED,
        )
    return RawMap(values, names, said)


def _real(array: npt.NDArray[Any], place: str) -> npt.NDArray[Any]:
    if array.dtype.kind == "c":
        raise ImportFault("complex numbers", where=place, remedy="save real(...) of it")
    return array


def _vector(array: npt.NDArray[Any], place: str) -> npt.NDArray[Any]:
    if array.size != max(array.shape, default=0):
        size = " x ".join(str(length) for length in array.shape)
        raise ImportFault(f"{size} values, where a vector is needed", where=place, remedy="save unique(...) of it")
    return array.ravel()


def _is_transposed(found: tuple[int, ...], wanted: tuple[int, int], rows: AxisName | None, place: str) -> bool:
    """Return whether a table of shape `found` has delta_f down its rows; `wanted` is (n, m)."""
    transposed = rows == "delta_f" or (rows is None and found != wanted and found == wanted[::-1])
    needed = wanted[::-1] if transposed else wanted
    if found != needed:
        shown = " x ".join(str(length) for length in found)
        remedy = "save a row for each vx and a column for each delta_f, or name the right variables"
        raise ImportFault(f"{shown} values, where the axes need {needed[0]} x {needed[1]}", where=place, remedy=remedy)
    return transposed

"""Objects with external linkage in the C of a build, for the manifest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from codegen.emit.map_view import AxisView, MapView, TableView
from codegen.units import NONE, Unit


def symbols_of(table: MapView, prefix: str, real: str, epk: str) -> dict[str, dict[str, Any]]:
    """Return type, shape, unit and section of each object by name. All are defined in `<prefix>_calibration.c`.

    A table is stored row by row, with one row for each speed. `unit` is the unit of the physical value. Raw numbers have a
    `scale` too, the physical value of a raw number 1.
    """
    found = {
        f"{prefix}_parameters_default": _symbol(f"{prefix}_parameters_t"),
        f"{prefix}_epk": _symbol("char", (len(epk) + 1,)),
        f"{prefix}_calibration_expected_checksum": _symbol("uint32_t"),
        **dict(_axes((table.speed, table.front_angle), real, "calibration")),
        **{each.name: _table(each, table, (table.speed, table.front_angle), real) for each in table.tables},
        f"{prefix}_constants": _symbol(f"{prefix}_constants_t", section="const"),
    }
    if table.grip is not None:
        axes, share = (table.grip.speed, table.grip.front_angle), table.grip.share
        found |= dict(_axes(axes, real, "const"))
        found[share.name] = _table(share, table, axes, real, "const")
    return found


def _table(
    table: TableView, of: MapView, axes: tuple[AxisView, AxisView], real: str, section: str = "calibration"
) -> dict[str, Any]:
    kind, layers = real if table.kind == "real" else table.kind, (len(of.layer_values),) if of.stacked else ()
    return _symbol(kind, (*layers, *(axis.size for axis in axes)), table.unit, section, table.scale)


def _axes(axes: tuple[AxisView, ...], real: str, section: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for axis in axes:
        yield axis.breakpoints, _symbol(real, (axis.size,), axis.unit, section)


def _symbol(
    kind: str, shape: tuple[int, ...] = (), unit: Unit = NONE, section: str = "calibration", scale: float | None = None
) -> dict[str, Any]:
    factor = {} if scale is None else {"scale": scale}
    return {"type": kind, "shape": list(shape), "unit": unit.symbol, "section": section, **factor}

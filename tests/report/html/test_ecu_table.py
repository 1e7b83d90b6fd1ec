"""The cells of a build with chosen breakpoints are those of the build, and the figure of error against flash holds them."""

from __future__ import annotations

import math
from pathlib import Path

from codegen.config import preset
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.write import write_folder
from codegen.refmap.place import Request
from codegen.refmap.place_sweep import flash_table
from codegen.refmap.solve import solve_case
from codegen.report.flash import flash_dict, flash_figure, flash_rows
from codegen.report.html.ecu_table import extended
from codegen.report.html.maps import NamedMap

CASE = "4ws-1"


def test_the_cells_are_those_of_the_build(tmp_path: Path) -> None:
    config = preset()
    reference_map = solve_case(config, CASE)
    options = BuildOptions("placed", request=Request(math.radians(0.5), None, "float", "--max-error 0.5deg/s"))
    folder = build(reference_map, config, options, BuildInputs("placed.npz", "0" * 64, "map"))
    write_folder(folder, tmp_path / "placed")
    _, table = extended(NamedMap("placed", reference_map), config, tmp_path / "placed")
    rules = folder.manifest["map"]["rules"]
    assert {row[1].partition(", from there")[0]: int(row[2]) for row in table.rows} == {
        rule["text"]: rule["cells"] for rule in rules.values()
    }
    assert "beyond the cap, continued" in {row[0] for row in table.rows}


def test_error_against_flash_is_drawn_and_told_alike() -> None:
    config = preset()
    found = flash_table(solve_case(config, CASE), config, 1, bounds=(math.radians(1.0), math.radians(0.5)))
    (axes,) = flash_figure(found, "name").axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    lines = {str(line.get_label()): line for line in axes.get_lines()}
    told = [point["flash_bytes"] for point in flash_dict(found)["placed"] if point["way"] == "uneven"]
    assert list(lines["uneven axes, float"].get_xdata()) == told
    assert [row[2] for row in flash_rows(found)] == [f"{size:,}" for size in told]
    assert list(lines["the map's own grid, float"].get_xdata()) == [found.grid_bytes]
    assert told == sorted(told)

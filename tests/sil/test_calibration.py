"""The map as calibration data: what `ars_map_valid` lets through, and that the lookup takes what stands in memory."""

from __future__ import annotations

import functools
from collections.abc import Callable

import pytest

from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.refmap.extend import TotalMap, extend
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import solve_stack
from tests import builds
from tests.sil import checks_calibration
from tests.sil.calibrated import Calibrated

MAP_C, CONTROLLER_C = "src/ars_map.c", "src/ars_controller.c"
GRIDS = {
    "even": {"speed_points": 9, "front_angle_points": 8},
    "uneven": {
        "speed_breakpoints_km_h": [20.0, 25.0, 31.0, 40.0, 60.0, 90.0, 120.0],
        "front_angle_breakpoints_deg": [0.1, 0.5, 1.0, 2.5, 4.0, 7.0, 10.0],
    },
}
FRICTIONS = {"even": (0.9,), "uneven": (0.5, 0.9)}
Check = Callable[[Calibrated], None]


@functools.cache
def made(grid: str) -> tuple[Folder, TotalMap]:
    """A small map, so that each of its numbers can be changed: of kind "tracking", which has both tables."""
    config = builds.TRACKING_CONFIG
    config = config.model_copy(update={"grid": type(config.grid)(**{**config.grid.model_dump(), **GRIDS[grid]})})
    frictions = FRICTIONS[grid]
    solved = solve_case(config, "4ws-2") if len(frictions) == 1 else solve_stack(config, "4ws-2", frictions)
    folder = build(solved, config, BuildOptions("sample"), BuildInputs("sample.npz", "0" * 64, "preset"))
    return folder, extend(solved, config)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("check", checks_calibration.CHECKS, ids=lambda check: check.__name__)
def test_a_calibrated_map(grid: str, check: Check) -> None:
    check(Calibrated.of(*made(grid)).restored())


TABLES, ORDER, EVENNESS, TO_THE_BIT, PARAMETERS, LOOKUP = checks_calibration.CHECKS
FAULTS = [
    (TABLES, "even", "(numbers[k] <= high)", "(numbers[k] <= (1.00001f * high))"),
    (TABLES, "even", "(numbers[k] >= low)", "(numbers[k] > low)"),
    (TABLES, "even", "inside = inside && (numbers[k] >= low)", "inside = (numbers[k] >= low)"),
    (TABLES, "uneven", "ars_map_rear_angle_table[1u][row]", "ars_map_rear_angle_table[0u][row]"),
    (ORDER, "even", "(breakpoints[k - 1u] < breakpoints[k])", "(breakpoints[k - 1u] <= breakpoints[k])"),
    (ORDER, "uneven", "increasing = increasing && ", "increasing = "),
    (ORDER, "even", "increasing = breakpoints[0] <= 0.0f", "increasing = true"),
    (EVENNESS, "even", "tolerance = 0.01f * step", "tolerance = 0.02f * step"),
    (EVENNESS, "even", "(deviation >= -tolerance) && ", ""),
    (TO_THE_BIT, "even", "(deviation <= tolerance)", "(deviation < tolerance)"),
    (TO_THE_BIT, "even", "(deviation >= -tolerance)", "(deviation > -tolerance)"),
    (PARAMETERS, "even", "        && ars_map_valid();", ";"),
    (LOOKUP, "even", "position.fraction = speed / at[1];", "position.fraction = speed / 5.5555553f;"),
    (LOOKUP, "uneven", "/ (at[position.lower + 1u] - at[position.lower]);", "/ (at[1] - at[0]);"),
]


@pytest.mark.parametrize(("check", "grid", "old", "new"), FAULTS, ids=lambda value: getattr(value, "__name__", None))
def test_a_fault_is_seen(check: Check, grid: str, old: str, new: str) -> None:
    folder, total = made(grid)
    (path,) = (path for path in (MAP_C, CONTROLLER_C) if old in folder.files[path].decode("ascii"))
    text = folder.files[path].decode("ascii")
    faulty = Folder({**folder.files, path: text.replace(old, new).encode("ascii")}, folder.manifest)
    with pytest.raises(AssertionError):
        check(Calibrated.of(faulty, total).restored())


def test_every_check_is_shown_to_be_able_to_fail() -> None:
    assert {check for check, *_ in FAULTS} == set(checks_calibration.CHECKS)

"""Builds to verify, in memory, each made once per run."""

import functools
from typing import Any

from codegen import configuration
from codegen.configuration import Config, Kind
from codegen.ecu_map.placement import Request
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case, solve_stack
from codegen.sil.software import Software, compile_build
from tests import shared
from tests.builds import SCHEDULE, UNEVEN_ANGLE, UNEVEN_SPEED, altered_folder

CASE = "4ws-2"
KINDS: tuple[Kind, ...] = ("tracking", "pi", "feedforward", "proportional")
FRICTIONS = (0.3, 0.5, 0.7, 0.9)
GRIDS: dict[str, dict[str, Any]] = {
    "even": {},
    "uneven": {"speed_breakpoints_km_h": UNEVEN_SPEED, "front_angle_breakpoints_deg": UNEVEN_ANGLE},
}
"""The uneven grid has 9 x 10 points, the even one 102 x 102: tests use the uneven one where the size does not matter."""


def config_of(kind: Kind, grid: str = "even") -> Config:
    """Return the recommended configuration with a kind of controller."""
    data = configuration.preset("recommended").model_dump(mode="json")
    data["controller"]["kind"] = kind
    data["controller"]["tracking"]["schedule"] = SCHEDULE
    data["grid"].update(GRIDS[grid])
    return configuration.parse(data, "test")


def build_of(
    reference_map: ReferenceMap,
    config: Config,
    source: str = "preset",
    precision: Precision = "single",
    prefix: str = "ars",
    request: Request | None = None,
) -> Folder:
    """Return the build of a map; `source` names the origin of the configuration."""
    options = BuildOptions("sample", prefix=prefix, precision=precision, request=request)
    return build(reference_map, config, options, BuildInputs("s.npz", "0" * 64, source))


@functools.cache
def made(kind: Kind = "tracking", grid: str = "even", layers: bool = False, precision: Precision = "single") -> Folder:
    """Return a build; with layers, its map is for four frictions."""
    config = config_of(kind, grid)

    def make() -> Folder:
        reference_map = solve_stack(config, CASE, FRICTIONS) if layers else solve_case(config, CASE)
        return build_of(reference_map, config, precision=precision)

    return shared.once(f"build to verify: {kind}, {grid}, {layers}, {precision}", make)


@functools.cache
def compiled(kind: Kind = "tracking", grid: str = "uneven") -> Software:
    """Return the build of a kind, compiled for this machine."""
    folder = made(kind, grid)
    return compile_build(folder.files, folder.manifest)


def with_text(folder: Folder, path: str, old: str, new: str) -> dict[str, bytes]:
    """Return the files with one text replaced. Raises LookupError unless it occurs exactly once."""
    return dict(altered_folder(folder, path, old, new).files)

"""Builds to run on the target, in memory. Made when first asked for, once a process."""

from __future__ import annotations

import functools
from typing import Any

from codegen import config as configuration
from codegen.config import Config, Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.refmap.solve import solve_case
from codegen.refmap.stack import solve_stack
from codegen.sil.software import Software, compile_build

CASE = "4ws-2"
KINDS: tuple[Kind, ...] = ("tracking", "pi", "feedforward", "proportional")

SCHEDULE = {
    "speed_km_h": [15.0, 20.0, 30.0, 42.5, 60.0, 80.0, 100.0, 120.0, 146.7, 179.3, 219.1, 267.8, 327.3, 400.0],
    "proportional_gain_s": [
        *(0.0015, 0.0197, 0.0425, 0.0866, 0.114, 0.133, 0.14, 0.144),
        *(0.142, 0.136, 0.123, 0.112, 0.098, 0.09),
    ],
    "integral_gain": [
        *(1.77, 1.72, 1.55, 1.2, 0.91, 0.67, 0.5, 0.38),
        *(0.28, 0.333, 0.35, 0.279, 0.288, 0.254),
    ],
}
"""As `codegen tune` makes it for the recommended configuration, rounded: the number of its points is what counts here."""

UNEVEN = {
    "speed_breakpoints_km_h": [20.0, 23.0, 30.0, 42.5, 60.0, 61.0, 90.0, 120.0],
    "front_angle_breakpoints_deg": [0.1, 0.5, 1.0, 2.0, 2.5, 4.0, 6.75, 10.0],
}
FRICTIONS = (0.3, 0.5, 0.7, 0.9)

GRIDS: dict[str, dict[str, Any]] = {"even": {}, "uneven": UNEVEN}


def config_of(kind: Kind, grid: str = "even") -> Config:
    """The recommended configuration with a kind of controller."""
    data = configuration.preset("recommended").model_dump(mode="json")
    data["controller"]["kind"] = kind
    data["controller"]["tracking"]["schedule"] = SCHEDULE
    data["grid"].update(GRIDS[grid])
    return configuration.parse(data, "test")


@functools.cache
def made(kind: Kind = "tracking", grid: str = "even", layers: bool = False, precision: Precision = "single") -> Folder:
    """A build; with layers, its map is for four frictions."""
    config = config_of(kind, grid)
    reference_map = solve_stack(config, CASE, FRICTIONS) if layers else solve_case(config, CASE)
    return build(reference_map, config, BuildOptions("sample", precision=precision), BuildInputs("s.npz", "0" * 64, "preset"))


@functools.cache
def compiled(kind: Kind = "tracking", grid: str = "even", layers: bool = False) -> Software:
    """The same for the host."""
    folder = made(kind, grid, layers)
    return compile_build(folder.files, folder.manifest)


def with_text(folder: Folder, path: str, old: str, new: str) -> dict[str, bytes]:
    """The files with one place of the C changed. Raises LookupError where the text does not stand there exactly once."""
    text = folder.files[path].decode("ascii")
    if text.count(old) != 1:
        raise LookupError(f"{path} holds {text.count(old)} times, instead of once: {old}")
    return {**folder.files, path: text.replace(old, new).encode("ascii")}

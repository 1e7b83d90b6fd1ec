"""The paper's 4WS-2 build, as `codegen build` makes it with default options, in memory."""

from __future__ import annotations

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case

CONFIG: Config = configuration.preset()
CASE = "4ws-2"


def paper_map() -> ReferenceMap:
    """Return the map of the paper's car."""
    return solve_case(CONFIG, CASE)


def paper_folder() -> Folder:
    """Return the generated files, single precision, prefix ars."""
    return build(paper_map(), CONFIG, BuildOptions(CASE), BuildInputs(f"{CASE}.npz", "0" * 64, "preset"))

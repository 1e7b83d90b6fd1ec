"""The paper's car, and its software compiled once for a whole run of this folder."""

from __future__ import annotations

import pytest

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.refmap.solve import solve_case
from codegen.sil.software import Software, compile_build


@pytest.fixture(scope="session")
def paper() -> Config:
    """The published vehicle."""
    return configuration.preset()


@pytest.fixture(scope="session")
def software(paper: Config) -> Software:
    """Its 4WS-2 build in single precision, with the plant, compiled."""
    reference_map = solve_case(paper, "4ws-2")
    folder = build(reference_map, paper, BuildOptions("4ws2"), BuildInputs("4ws2.npz", "0" * 64, "map"))
    return compile_build(folder.files, folder.manifest)

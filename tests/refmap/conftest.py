"""The paper's car, its three maps and their extensions, made once: a map takes milliseconds."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from codegen import config as configuration
from codegen.config import Config
from codegen.refmap.extend import TotalMap, extend
from codegen.refmap.map import ReferenceMap
from codegen.refmap.solve import solve_case


@pytest.fixture(scope="session")
def paper() -> Config:
    """The published vehicle."""
    return configuration.preset()


@pytest.fixture(scope="session")
def maps(paper: Config) -> Mapping[str, ReferenceMap]:
    """The map of each case, on the default grid of 101 by 100."""
    return {case: solve_case(paper, case) for case in paper.cases}


@pytest.fixture(scope="session")
def totals(paper: Config, maps: Mapping[str, ReferenceMap]) -> Mapping[str, TotalMap]:
    """Their extensions over the whole domain of an ECU."""
    return {case: extend(reference_map, paper) for case, reference_map in maps.items()}

"""The results of tests/refmap/cars.py as fixtures."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from codegen.config import Config
from codegen.refmap.extend import TotalMap
from codegen.refmap.map import ReferenceMap
from tests.refmap.cars import CASES, PAPER, paper_map, paper_total


@pytest.fixture(scope="session")
def paper() -> Config:
    """The configuration of the published vehicle."""
    return PAPER


@pytest.fixture(scope="session")
def maps() -> Mapping[str, ReferenceMap]:
    """The map of each case, on the default grid of 101 by 100."""
    return {case: paper_map(case) for case in CASES}


@pytest.fixture(scope="session")
def totals() -> Mapping[str, TotalMap]:
    """The extension of each map over the whole domain of an ECU."""
    return {case: paper_total(case) for case in CASES}

"""FMUs that several tests share; each is compiled when first asked for, once a process."""

from __future__ import annotations

import functools
from collections.abc import Callable

import pytest

from codegen.export.fmu.standard import Version
from codegen.export.fmu.variables import What
from tests.export import fmus

Maker = Callable[[str, What, Version], fmus.Made]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Maker:
    """`made(kind, what, version)`."""
    folder = tmp_path_factory.mktemp("fmu")
    return functools.cache(functools.partial(fmus.make, folder))

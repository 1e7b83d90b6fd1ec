"""What the tests of the checks share."""

from __future__ import annotations

import fcntl
import functools
import os
import pickle
from collections.abc import Callable
from typing import Any

import pytest

from codegen.config import Kind
from codegen.verify.budgets import check as budgets
from codegen.verify.check import Effort, Outcome, Subject
from tests.verify import builds

Once = Callable[[str, Callable[[], Any]], Any]
OfKind = Callable[..., Outcome]


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """`once(name, make)`: what takes long, made by the first worker that asks for it, for all workers of a run."""
    own = tmp_path_factory.getbasetemp()
    folder = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own

    def made(name: str, make: Callable[[], Any]) -> Any:
        place = folder / f"{name}.pickle"
        with place.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not place.exists():
                place.write_bytes(pickle.dumps(make()))
        return pickle.loads(place.read_bytes())

    return made


@pytest.fixture(scope="session")
def of_kind(once: Once) -> OfKind:
    """`of_kind(kind, grid, layers)`: what the check of the budgets tells of a build, as `codegen verify --quick` does."""

    def checked(kind: Kind, grid: str = "even", layers: bool = False) -> Outcome:
        folder = builds.made(kind, grid, layers)
        make = functools.partial(budgets.check, Subject("sample", folder.files, folder.manifest), Effort(quick=True))
        found: Outcome = once(f"budgets-{kind}-{grid}-{layers}", make)
        return found

    return checked

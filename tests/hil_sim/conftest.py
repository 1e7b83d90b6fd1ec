"""The paper's build, on disk and compiled, and longer timeouts for busy machines."""

from pathlib import Path

import pytest

from codegen.sil.software import Software
from hil_sim import bench, ecu_process
from tests import builds, shared


@pytest.fixture(scope="session")
def build_folder() -> Path:
    return shared.build_folder()


@pytest.fixture(scope="session")
def software() -> Software:
    return builds.paper().software


@pytest.fixture(autouse=True)
def long_timeouts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Raise time limits: test machines are busy, and only a failure waits this long."""
    for module, name in ((ecu_process, "START_TIMEOUT"), (ecu_process, "STOP_TIMEOUT"), (bench, "ANSWER_TIMEOUT")):
        monkeypatch.setattr(module, name, 300.0)

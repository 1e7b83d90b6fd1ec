"""Check `memory` without Frama-C. tests/evidence/verify has the faults that it finds."""

import pytest

from codegen.verify import memory
from codegen.verify.outcomes import Effort
from codegen.verify.tools import MissingTool
from tests.verify import builds, planted


def test_without_frama_c_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingTool, match="apt install frama-c-base"):
        memory.check(planted.subject_of(builds.made("pi", "uneven")), Effort())

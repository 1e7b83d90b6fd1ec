"""Run a scenario in software."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Software
from hil_sim.scenarios import Scenario


def run(software: Software, scenario: Scenario, *, controlled: bool = True) -> npt.NDArray[np.float64]:
    """A recording (samples, 12) of a scenario, columns RECORD_COLUMNS; `controlled=False` is the passive car."""
    loop = ClosedLoop(software, LoopOptions(controlled=controlled))
    return loop.run(scenario.inputs(software.config))

"""Measurements in MF4 files, read with asammdf. Only a child process imports it (see `child`): asammdf may crash."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from asammdf import MDF

from codegen.arrays import FloatArray


def columns(path: Path, names: Sequence[str]) -> list[FloatArray] | None:
    """Return the samples of the named channels; None for the log of a bus.

    Raises whatever asammdf raises for a damaged file.
    """
    with MDF(path) as mdf:
        if "CAN_DataFrame" in mdf.channels_db:
            return None
        return [mdf.get(name, raw=True).samples.astype(np.float64) for name in names]

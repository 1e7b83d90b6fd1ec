"""The figures: maps, cuts through them, tyres, runs, and the overview. Each function returns a Matplotlib Figure.

Degrees and km/h on paper, SI inside. Layer: above `sil` and `refmap`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.config import KM_H, Config, preset
from codegen.refmap.map import Binding, ReferenceMap
from codegen.report.style import (
    BLACK,
    BLUE,
    CASE_NAMES,
    FRONT_ANGLE,
    FRONT_ANGLE_LABEL,
    GREEN,
    GREY,
    INFEASIBLE_FACE,
    INFEASIBLE_HATCH,
    ORANGE,
    PURPLE,
    REAR_ANGLE,
    RUN_NAMES,
    SKY,
    SPEED_LABEL,
    VERMILION,
    WHITE,
    PlotError,
    new_figure,
    plain,
    save,
    style,
)
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

__all__ = [
    "PlotError",
    "front_angle_cut_figure",
    "map_figure",
    "overview_figure",
    "run_figure",
    "save",
    "three_maps_figure",
    "tyre_figure",
]

FloatArray = npt.NDArray[np.float64]

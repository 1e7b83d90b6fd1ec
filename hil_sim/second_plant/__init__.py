"""Second plant for cross-checks: a published multi-body model of a third party behind the interface of our own plant.

The model is the multi-body car (29 states) of PyPI's `commonroad-vehicle-models`, an optional dependency: extra "crosscheck".
`plant` imports it, derives the configuration of its car, and adds rear steering and the interface of
`codegen.sil.plant.Plant`, `run` closes the loop. See docs/second-plant.md.
"""

from hil_sim.second_plant.plant import MultiBodyPlant, car_of, published
from hil_sim.second_plant.run import StepCell, cells, run

__all__ = ["MultiBodyPlant", "StepCell", "car_of", "cells", "published", "run"]

"""A second car to check against: a published multi-body model of a third party, driven as our own plant is.

The model is the multi-body car (29 states) of PyPI's `commonroad-vehicle-models`, an optional dependency: extra "crosscheck".
`package` finds it, `rear_steer` makes its rear wheels steer, `car` derives the configuration that our tool chain needs of
that car, `plant` has the interface of `codegen.sil.plant.Plant`, `run` closes the loop around it. See docs/second-plant.md.
"""

from hil_sim.second_plant.package import car_of, published
from hil_sim.second_plant.plant import MultiBodyPlant
from hil_sim.second_plant.run import Cell, cells, run

__all__ = ["Cell", "MultiBodyPlant", "car_of", "cells", "published", "run"]

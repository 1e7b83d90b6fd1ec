"""Test set for rear-steering controllers: step steers of the configured car and of cars that differ from it.

- `cells`: operating points, and conditions: named combinations of a change of the car and a road.
- `subjects`: systems under test, a compiled controller or the passive car.
- `runs`: a step steer and its figures, and figures over all cells.
- `controller_properties`: rise times and tracking of a sine, margins, sample timing.
- `requirements`: required and measured figures. `tracking`: the whole test set in one call.

Do not tune gains on these cells. The design uses the linear family of `codegen.design.family`, this set the nonlinear plant.
Results are plain data with `to_dict`.
"""

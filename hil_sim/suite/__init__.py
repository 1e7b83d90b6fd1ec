"""The test set for controllers of rear steering: many step steers, of the car as configured and of cars that differ from it.

- `cells`: the operating points. `plants`: how the car may differ. `conditions`: one difference and one road, with a name.
- `subjects`: what is under test, a compiled controller or the passive car.
- `runs`: one step steer and its figures. `summary`: figures over all cells. `sine`, `price`: where a controller is slower.
- `requirements`: figures asked beside figures measured. `tracking`: all of it, in one call.

No gain may be chosen by looking at these cells: the design works on the linear family of `codegen.design.family`, this set on
the nonlinear plant. Results are plain data with `to_dict`.
"""

"""Identification of a car from measured drives: parameters with covariance, for the keys of `ars.toml`.

The two-track model of `codegen.vehicle` is fitted to all drives at once by multiple shooting: the drives are cut into segments
of a few seconds, whose initial states are free and eliminated (`estimate`). Measured speed and steering angles drive the model;
yaw rate, lateral acceleration and, where measured, sideslip are compared. The rear actuator is fitted to its command and its
angle in the same way, and the steering ratio is a straight line. `parameters` is the table of all quantities: key, what is
assumed before, bounds, manoeuvre. `start` finds a starting point from steady turns.

Each quantity has a weak prior around its configured value, whose spread also scales the singular value decomposition in
`identifiability`. A quantity that the drives hardly determine keeps its configured value. Standard deviations allow for
coloured residuals, and for the quantities that are not determined, which were free in the fit.

Layers, lowest first: the reading of logs (`reading`, `names`, `quantities` and below), drive, parameters, model, simulate,
shooting, start, estimate, identifiability, run, validation, model_error, doubts, outcome, result, summary.
"""

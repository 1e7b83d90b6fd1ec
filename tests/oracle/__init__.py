"""Second implementation of the control law in Python: controller, limiter, reference model and task, written from the headers
and the README of a build.

`check` drives the C and this side by side. Each class keeps one number type throughout and does its operations in the order in
which the C does them, so that the bits of a sample can be compared and not only its size. Shared with the generator are the
NumPy reference of the look-up, the tables of the tyres' curves, the CasADi function of the car, the values of the parameters
and the largest overshoot of the reference model; the numbers of the map are those that stand in the C. The authors are those of
the generator, so a common misreading of the specification is not found.
"""

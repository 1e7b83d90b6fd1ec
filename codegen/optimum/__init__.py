"""The optimisation: steady turns, constraints, and the solvers of the reference map."""

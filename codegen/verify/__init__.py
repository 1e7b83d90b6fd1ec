"""Checks of a finished build on the user's machine.

Each check is a package with a function `check.check`: `compilation`, `analysis`, `pil`, `budgets`, `law`, `proof`,
`sanitizers`, `fuzzing`. `runner` runs them; `record` and `manual` write the results. `target` emulates the ECU core; `drives`
and `suites` provide inputs that several checks share.

One package for each check, with its function in `check`: `compilation`, `analysis`, `pil`, `budgets`, `law`, `proof`,
`sanitizers`, `fuzzing`. `runner` runs them, `record` and `manual` write down what came of it; `target` is the ECU core that
several of them use, `drives` and `suites` are what several of them run.

Imports only from the layers up to `hil_sim`. What it needs beside them is the extra `verify`.
"""

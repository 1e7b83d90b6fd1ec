"""What makes the generated C trustworthy: checks of a finished build, on the user's machine.

One package for each check, with its function in `check`: `compilation`, `analysis`, `pil`, `budgets`, `law`, `proof`,
`sanitizers`, `fuzzing`. `runner` runs them, `record` and `manual` write down what came of it; `target` is the ECU core that
several of them use, `drives` and `suites` are what several of them run.

Imports only from the layers up to `hil_sim`. What it needs beside them is the extra `verify`.
"""

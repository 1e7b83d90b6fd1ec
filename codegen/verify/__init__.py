"""Checks of a finished build on the user's machine.

Each check is a package with a function `check.check`: `compilation`, `analysis`, `pil`, `budgets`, `law`, `proof`,
`sanitizers`. `runner` runs them; `record` and `manual` write the results. `target` emulates the ECU core; `drives` and `suites`
provide inputs that several checks share.

Imports only from the layers up to `hil_sim`. What it needs beside them is the extra `verify`.
"""

"""Checks of a finished build on the user's machine.

Each check is a function `check`, in the module `contracts`, `generator` or `memory`, or in the module `check` of a package:
`compilation`, `analysis`, `pil`, `budgets`, `sanitizers`. `runner` runs them, and `record` writes the results.
`target` emulates the ECU core; `drives` and `traffic` provide inputs that several checks share.

Imports only from the layers up to `hil_sim`. What it needs beside them is the extra `verify`.
"""

"""What makes the generated C trustworthy: run on the target's instruction set, and counted there.

Imports only from the layers up to `hil_sim`. What it needs beside them is the extra `verify`.
"""

"""What holds for every test: no screen, and the same examples on each run with no limit on their time."""

import os

from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

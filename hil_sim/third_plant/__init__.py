"""Third plant for cross-checks: the configured car with effects that the two-track plant and the controller's design omit.

`car` adds roll, tyres that differ between the axles, with relaxation lengths, and a rear actuator of second order with
backlash; `run` adds sensors with noise, bias and jitter and closes the loop. See docs/second-plant.md.
"""

from hil_sim.third_plant.car import DEFAULT, NONE, Differences, RollPlant
from hil_sim.third_plant.run import run

__all__ = ["DEFAULT", "NONE", "Differences", "RollPlant", "run"]

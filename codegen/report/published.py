"""Figures printed in the paper, for comparison.

Ryu, Hwang, Yoon, Choi: Constrained Optimization-Based Yaw-Rate Reference Map Generation for Active Rear Steering Control of
Four-Wheel Steering Vehicles.
"""

from __future__ import annotations

TABLE_SPEED_KM_H = 43.9
TABLE_FRONT_ANGLE_DEG = 4.0

PAPER_TABLE = {"fws": (15.35, 1.101), "4ws-1": (26.82, 1.08), "4ws-2": (21.35, 0.03)}
"""Optimisation results at that speed and front angle: yaw rate (deg/s) and |sideslip| (deg) of each case."""

PAPER_GAINS = {"4ws-1": 74.7, "4ws-2": 38.1}
"""Printed gains in yaw rate over FWS, %; the printed yaw rates themselves give 39.1 for 4WS-2."""

PAPER_RUNS = {"C1": (27.39, 0.44), "C2": (24.86, 0.22)}
"""Simulation results: largest yaw rate (deg/s) and smallest |sideslip| (deg)."""

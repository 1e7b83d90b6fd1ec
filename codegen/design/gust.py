"""Response of the linear loop to a gust: what the integral gain buys, and what it costs in margin.

A yaw moment acts on the car of `design.sampled` going straight ahead. Its heading and path follow from yaw rate and sideslip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from codegen.configuration import Config
from codegen.design.family import Member
from codegen.design.sampled import BETA, YAW_RATE, continuous, matrix_exponential
from codegen.vehicle.single_track import SingleTrack

MOMENT_N_M, DURATION_S, READ_AFTER_S = 3000.0, 1.5, 3.0
"""The gust, and the time after its end at which heading and path are read."""


@dataclass(frozen=True)
class GustResponse:
    """Largest heading, and heading and lateral deviation READ_AFTER_S after the gust."""

    heading_max_deg: float
    heading_deg: float
    path_m: float


def gust_response(config: Config, member: Member, speed: float, kp: float, ki: float) -> GustResponse:
    """Return the response of one car at a speed in m/s with the gains, and the delay of the design."""
    a, b = continuous(config, [member], np.array([speed]))
    period, size = config.controller.sampling_time_s, b.shape[-1]
    heading, path, command, moment = size, size + 1, size + 2, size + 3
    whole = np.zeros((size + 4, size + 4))
    whole[:size, :size], whole[:size, command] = a[0, 0], b[0, 0]
    inertia = SingleTrack.from_config(config).yaw_inertia * member.mass_factor * member.yaw_inertia_factor
    whole[YAW_RATE, moment] = 1.0 / inertia
    whole[heading, YAW_RATE] = 1.0
    whole[path, BETA] = whole[path, heading] = speed
    step = matrix_exponential(whole * period)
    state, integral, largest = np.zeros(size + 4), 0.0, 0.0
    waiting = [0.0] * config.designed_delay_samples
    for k in range(round((DURATION_S + READ_AFTER_S) / period)):
        integral += period * state[YAW_RATE]
        waiting.append(kp * state[YAW_RATE] + ki * integral)
        state[command], state[moment] = waiting.pop(0), MOMENT_N_M if k * period < DURATION_S - 0.5 * period else 0.0
        state = step @ state
        largest = max(largest, abs(float(state[heading])))
    return GustResponse(math.degrees(largest), math.degrees(float(state[heading])), float(state[path]))

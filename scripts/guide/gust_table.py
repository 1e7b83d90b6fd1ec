"""Table of the page on controllers: a gust against the margins, over the integral gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from codegen.design.family import nominal
from codegen.design.gust import gust_response
from codegen.design.margins import family_margins, gains_of, loop_margins
from codegen.design.sampled import frequency_grid, sample
from codegen.emit.laws import schedule_of
from codegen.map_file.map import load
from codegen.units import KM_H
from scripts.guide.markdown import table
from scripts.guide.suite_tables import BUILD

SPEED_KM_H, RELAXATION_M = 100.0, 0.4
FACTORS = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)


def markdown() -> str:
    """Return gust and margins for multiples of the designed integral gain of the committed map."""
    config = load(BUILD.with_suffix(".npz")).config
    assert config is not None
    speed = np.array([SPEED_KM_H * KM_H])
    kp, designed = gains_of(schedule_of(config))(speed)
    frequency = frequency_grid(config.controller.sampling_time_s)
    own = replace(nominal(config), relaxation_length=RELAXATION_M)
    slow = replace(own, actuator_lag=2.0 * own.actuator_lag)
    rows = []
    for factor in FACTORS:
        ki = factor * designed
        gust = gust_response(config, own, float(speed[0]), float(kp[0]), float(ki[0]))
        worst, _ = family_margins(config, speed, kp, ki)
        least, alone = (
            f"{found.gain_margin_db.flat[0]:.1f} dB, {found.phase_margin_deg.flat[0]:.0f} deg, {found.sensitivity.flat[0]:.2f}"
            for found in (worst, loop_margins(sample(config, [slow], speed), kp, ki, frequency))
        )
        gusts = (f"{gust.heading_max_deg:.2f} deg", f"{gust.heading_deg:.2f} deg", f"{gust.path_m:.2f} m")
        rows.append((f"{factor:g}", *gusts, least, alone))
    head = ("integral gain over the designed one", "heading, largest", "heading after 3 s", "path after 3 s")
    return table((*head, "worst of the family without its slow cars", "twice the lag and 0.4 m of relaxation"), rows)

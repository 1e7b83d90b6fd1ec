"""Path errors of each subject with a driver in the loop."""

from __future__ import annotations

from hil_sim.metrics import evaluate
from hil_sim.scenarios import PATH_SCENARIOS
from hil_sim.suite.subjects import Subject

FEEDFORWARD = "feedforward"
"""Baseline of controllers with feedback."""


def path_errors(subject: Subject) -> dict[str, float | None]:
    """Return scenario name -> rms path error in m; None for a car that spins. Raises BuildError."""
    software, config = subject.around(subject.config), subject.config
    errors = {}
    for name, scenario in PATH_SCENARIOS.items():
        driver = scenario.driver(config)
        assert driver is not None  # every scenario of this table has a path
        record = subject.loop(software).run_stepped(scenario.inputs(config), driver.steer)
        found = evaluate(scenario, config, {name: record}).runs[name]["path_error_rms_m"]
        errors[name] = None if found is None else float(found)
    return errors

"""The controller of kind "tracking" for a map: gains by design, the transient from step responses, the trim, and the
rate of the fail-safe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from codegen.configuration import Config, parse
from codegen.configuration.controller import TRIM_MAX_PERCENT
from codegen.design.tune import Design, design
from codegen.ecu_map.extend import extend
from codegen.ecu_map.model_excess import Excess, asks_for_more, model_excess
from codegen.map_file.map import ReferenceMap
from codegen.sil.batch import BatchSoftware
from codegen.tuning.fail_safe import FailSafeRate, tune_fail_safe
from codegen.tuning.transient import Response, compile_controller, tune_response, with_response

Progress = Callable[[int, int], None]

TRIM_TIME_MAX_S = 0.3
"""Largest time constant of the trim for a map of the nonlinear tyre; the trim must finish before the car counts as settled."""


@dataclass(frozen=True, eq=False)
class Tuned:
    """A configuration with its tuned controller, and the results of each step.

    Attributes:
        config: kind "tracking", with gain schedule, look ahead, trim and rate of the fail-safe.
        design: design of the gains.
        responses: lead and response gain at each speed of the schedule that was driven; empty for a map that was not solved.
        excess: excess of the reference model over the map where the trim was too small for it; None where it was enough.
        fail_safe: rate of the fail-safe, and the candidates; None for a map that was not solved.
        software: the build that was driven, without the parameters tuned on it (see `fail_safe.tuned_parameters`); None for
            a map that was not solved.
    """

    config: Config
    design: Design
    responses: tuple[Response, ...]
    excess: Excess | None
    fail_safe: FailSafeRate | None
    software: BatchSoftware | None

    @property
    def trim_is_enough(self) -> bool:
        """Whether the trim takes back all of the excess."""
        return self.excess is None or self.excess.trim_percent <= TRIM_MAX_PERCENT


def tune(reference_map: ReferenceMap, config: Config, progress: Progress | None = None, where: object = "tuned") -> Tuned:
    """Tune the controller of a configuration for a map; the same input gives the same numbers.

    Args:
        reference_map: solved for the car of the configuration.
        progress: called with (done, in all).
        where: the place that an error names.

    Raises:
        ConfigError: no gains meet the demands, see `design`.
        BuildError: no C compiler.
        MapError: see `model_excess`.
    """
    made = design(config, progress)
    config = with_tracking(config, {"schedule": made.schedule.model_dump(mode="json")}, where)
    config, excess = _with_trim(reference_map, config, where)
    if not reference_map.solved:
        return Tuned(config, made, (), excess, None, None)
    software = compile_controller(reference_map, config)
    ahead, responses = tune_response(reference_map, config, made.schedule, software, progress)
    config = with_tracking(config, with_response(config, made.schedule, ahead, responses), where)
    fail_safe = tune_fail_safe(reference_map, config, software, progress)
    config = with_controller(config, {"fail_safe": {"rate_deg_s": fail_safe.rate_deg_s}}, where)
    return Tuned(config, made, responses, excess, fail_safe, software)


def _with_trim(reference_map: ReferenceMap, config: Config, where: object) -> tuple[Config, Excess | None]:
    """Return the configuration with the trim that the map needs, and the excess where that is more than it had.

    Call it before the step responses: the trim is part of them.
    """
    if not asks_for_more(reference_map, config):
        return config, None
    tracking = config.controller.tracking
    config = with_tracking(config, {"trim_time_s": min(tracking.trim_time_s, TRIM_TIME_MAX_S)}, where)
    excess = model_excess(reference_map, extend(reference_map, config, config.steering.front_angle_stop), config)
    if excess.percent <= tracking.trim_max_percent:
        return config, None
    return with_tracking(config, {"trim_max_percent": min(float(excess.trim_percent), TRIM_MAX_PERCENT)}, where), excess


def with_tracking(config: Config, changes: Mapping[str, Any], where: object) -> Config:
    """Return the configuration with kind "tracking" and changed keys of [controller.tracking]."""
    return with_controller(config, {"tracking": changes}, where)


def with_controller(config: Config, changes: Mapping[str, Mapping[str, Any]], where: object) -> Config:
    """Return the configuration with kind "tracking" and changed keys of tables of [controller]."""
    data = config.model_dump(mode="json")
    data["controller"]["kind"] = "tracking"
    for table, values in changes.items():
        data["controller"][table] |= values
    return parse(data, where)

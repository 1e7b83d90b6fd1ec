"""The safety manual of a build, `verify.md`: on what terms it may be used, what is shown and how, and what is not."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.render import render
from codegen.errors import one_line
from codegen.verify.check import Outcome, Verdict
from codegen.verify.runner import CHECKS, Report

OFF = "off"


@dataclass(frozen=True)
class CheckView:
    """A check as the manual tells it."""

    title: str
    shows: str
    figure: str
    verdict: str
    findings: tuple[str, ...]
    limits: tuple[str, ...]
    tools: str


def manual(report: Report) -> str:
    """The text of `verify.md`, in Markdown."""
    subject = report.subject
    config = configuration.parse(subject.manifest["configuration"], "manifest.json: configuration")
    context = {
        "name": subject.manifest["name"],
        "build": {"prefix": subject.prefix, "PREFIX": subject.prefix.upper(), "id": subject.manifest["build_id"]},
        "options": subject.manifest["options"],
        "quick": report.effort.quick,
        "edited": subject.edited,
        "manifest_sha256": subject.manifest_sha256,
        "checks": [_check(name, outcome) for name, outcome in report.outcomes.items()],
        "counts": {str(verdict).replace(" ", "_"): report.count(verdict) for verdict in Verdict},
        "road": list(_road(config, subject.manifest)),
        "inputs": list(_inputs(config)),
        "actuator": list(_actuator(config)),
        "timing": list(_timing(config)),
        "loss": list(_loss(config, subject.manifest)),
        "files": [(path, hashlib.sha256(content).hexdigest()) for path, content in sorted(subject.sources().items())],
    }
    return render("verify/manual.md.j2", context).decode("ascii")


def _check(name: str, outcome: Outcome) -> CheckView:
    title = next((check.title for check in CHECKS if check.name == name), name)
    tools = ", ".join(f"{tool} {version}" for tool, version in outcome.tools.items())
    findings, limits = (tuple(_ascii(text) for text in texts) for texts in (outcome.findings, outcome.limits))
    return CheckView(
        title, _ascii(outcome.shows), _ascii(outcome.figure) or "-", str(outcome.verdict), findings, limits, _ascii(tools)
    )


def _ascii(text: str) -> str:
    """On one line, for a table of Markdown; a tool may say anything."""
    return one_line(text, limit=1000).encode("ascii", "replace").decode("ascii")


def _road(config: Config, manifest: Mapping[str, Any]) -> Iterator[str]:
    speed, angle = config.grid.speed_max_km_h, config.grid.front_angle_max_deg
    cap = manifest["map"]["lateral_acceleration_cap_m_s2"]
    yield (
        f"The map assumes a peak friction of {config.road.friction:g}. On less, the reference asks for more than the road "
        "gives, unless an estimate stands in `measurement.friction`; an estimate that is too high is believed."
    )
    yield f"No reference asks for more than {cap:.4g} m/s^2 of lateral acceleration, and for less with a lower estimate."
    yield f"The optimisation covers up to {speed:g} km/h and {angle:g} deg at the front wheels; beyond, rules extend the map."
    yield (
        "The map is of the car and the tyres of the configuration in `manifest.json`; other tyres, loads and pressures are "
        "another car."
    )


def _inputs(config: Config) -> Iterator[tuple[str, str, str]]:
    """Signal, range that is accepted, and what happens outside of it."""
    inputs = config.controller.inputs
    bad = "bad sample"
    yield "speed", f"+-{inputs.speed_max_km_h:g} km/h", bad
    yield "front angle", f"+-{inputs.front_angle_max_deg:g} deg", bad
    yield "yaw rate", f"+-{inputs.yaw_rate_max_deg_s:g} deg/s", bad
    yield "rear angle", f"+-{inputs.rear_angle_max_deg:g} deg, or NaN: not measured", bad
    yield "friction", f"0 to {inputs.friction_max:g}, or NaN: unknown", bad
    yield (
        "yaw rate against speed and steering",
        f"within {inputs.yaw_rate_tolerance_deg_s:g} deg/s of what they explain",
        f"held, after {inputs.implausible_time_s:g} s fail-safe",
    )


def _actuator(config: Config) -> Iterator[str]:
    actuator, controller, limiter = config.rear_actuator, config.controller, config.limiter
    largest = min(actuator.angle_max_deg, config.limits.rear_angle_max_deg)
    yield (
        f"The command is within +-{largest:g} deg; the actuator has to refuse, on its own, what it cannot do, and must hold or "
        "return where commands stop."
    )
    rates = [value for value in (controller.rear_rate_max_deg_s, limiter.rear_rate_max_deg_s) if value != OFF]
    if rates:
        yield f"The command moves by at most {min(rates):g} deg/s."
    else:
        yield "The command's rate is not limited in this build (`rear_rate_max_deg_s` is off): the actuator's own is the limit."
    if limiter.opposite_phase_max_deg != OFF:
        yield "Over speed, the angle against the front wheels is bounded by the limiter."
    else:
        yield "The bound of the angle against the front wheels over speed is off in this build."
    yield f"A lag of {1e3 * actuator.lag_s:g} ms was assumed where margins are told; a slower actuator has less of them."


def _timing(config: Config) -> Iterator[str]:
    period = 1e3 * config.controller.sampling_time_s
    yield f"The step, or the task, is called every {period:g} ms; gains, rates and times are wrong by as much as the period is."
    yield "A step is not interrupted by another call with the same state; a frame must not come in while the task runs."
    yield "Pointers are valid, parameters are asked of `parameters_valid` after each change, and nothing else writes the state."
    yield "At power-up the self-test passes before the actuator is enabled."


def _loss(config: Config, manifest: Mapping[str, Any]) -> Iterator[str]:
    fail_safe = config.controller.fail_safe
    held = fail_safe.degraded_samples_max
    acts_after = (held + 1) * 1e3 * config.controller.sampling_time_s
    yield (
        f"Up to {held} lost samples in a row hold the command; {acts_after:g} ms after the last good one the fail-safe acts: "
        f"held from {fail_safe.hold_above_km_h:g} km/h on, below it ramped to zero, at {fail_safe.rate_at_standstill_deg_s:g} "
        f"deg/s at rest and {fail_safe.rate_at_hold_speed_deg_s:g} deg/s just below that speed. "
        f"{fail_safe.recovery_samples} good samples end it."
    )
    yield "A held angle is right for the turn in which it was held: a driver who straightens the wheel at speed can spin."
    yield 'A rear angle of zero is not by itself a safe state: see "What to expect where the function is lost" in README.md.'
    yield "The vehicle has to tell the driver of the loss, and to slow down."
    margins = manifest["margins"]
    if margins is not None and not margins["enough"]:
        yield (
            f"**The feedback of this build has little margin from {margins['warns_from_km_h']:g} km/h"
            + (f" and is unstable from {margins['unstable_from_km_h']:g} km/h" if margins["unstable_from_km_h"] else "")
            + ".** What is shown below is about the code, not about the control law."
        )

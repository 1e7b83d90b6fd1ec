"""Controls of the page, and the configuration that results from their values.

The number boxes accept the range of the configuration's own models. A slider spans the useful part of that range; the comment
above the controls gives the reasons.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Literal, get_args

from pydantic.fields import FieldInfo

from codegen.configuration import Config
from codegen.configuration.section import Range
from codegen.errors import CodegenError
from codegen.map_file.map import on_road
from codegen.units import KM_H

Group = Literal["map", "controller", "step"]
Values = Mapping[str, float]

GROUP_TITLES: Mapping[Group, str] = {"step": "Step at the steering wheel", "controller": "Controller", "map": "Map"}

FLOAT_MAX = sys.float_info.max  # larger values are infinity and very long whole numbers
LAMBDA, FRICTION = "lambda", "road.friction"
WEIGHT_KEY = "sideslip_weight_per_s2"
SCALES = {
    "proportional_percent": "proportional_gain_s",
    "integral_percent": "integral_gain",
    "lead_percent": "lead_s",
    "response_percent": "response_gain_s",
}
"""Control -> the row of the gain schedule that it scales."""
SCHEDULE = "controller.tracking.schedule"
STEP_SPEED, STEP_ANGLE, STEP_ROAD = "step.speed_km_h", "step.angle_deg", "step.road_percent"


class ExploreError(CodegenError):
    """Settings that are invalid, or a page that cannot be served."""


@dataclass(frozen=True)
class Control:
    """One slider with its number box.

    Attributes:
        key: name on the page; for a configuration key, the dotted key.
        label, unit, help: texts for the user; `help` is one line.
        low, high, step: range and step of the slider; if logarithmic, `step` is the factor minus one.
        bounds: accepted values.
        value: start value.
        logarithmic: equal slider distances are equal ratios; if zero is accepted, it is an extra stop below `low`.
    """

    key: str
    group: Group
    label: str
    unit: str
    help: str
    low: float
    high: float
    step: float
    bounds: tuple[float, float] = (0.0, 1000.0)
    value: float = 0.0
    logarithmic: bool = False

    def check(self, value: object) -> float:
        """Return the requested number. Raises ExploreError if it is not a number, or out of range."""
        first, last = self.bounds
        unit = f" {self.unit}" if self.unit else ""
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= FLOAT_MAX:
            raise ExploreError("a number is needed", where=self.label, remedy=f"give {first:g} to {last:g}{unit}")
        if not first <= value <= last:
            raise ExploreError(
                f"{value:g} is outside {first:g} to {last:g}{unit}", where=self.label, remedy="check the value and its unit"
            )
        return float(value)


Rows = Mapping[str, tuple[tuple[str, str, str], tuple[float, float, float]]]
"""Key -> (label, unit, help) and (low, high, step)."""


def _controls(group: Group, rows: Rows, **common: Any) -> tuple[Control, ...]:
    return tuple(Control(key, group, *texts, *slider, **common) for key, (texts, slider) in rows.items())


# Ranges of the sliders. Angles and lateral acceleration: from nearly zero to the largest rear angles on the market and the grip
# of a racing tyre. lambda: from nearly no weight on sideslip to nearly no weight on yaw rate. Friction: from packed snow to
# warm asphalt. Gains: several times the paper's, and three times the tuned ones.
_LAMBDA: Rows = {LAMBDA: (("Sideslip weight λ", "1/s²", "Cost of sideslip against yaw rate"), (10.0, 1e5, 0.02))}
_MAP: Rows = {
    "limits.sideslip_max_deg": (("Sideslip limit", "deg", "Largest sideslip angle in a steady turn"), (0.5, 8.0, 0.1)),
    "limits.lateral_acceleration_max_g": (("Lateral acceleration limit", "g", "Largest in a steady turn"), (0.1, 1.2, 0.01)),
    "limits.rear_angle_max_deg": (("Rear angle limit", "deg", "Largest rear angle in the map"), (0.1, 10.0, 0.1)),
    "limits.slip_departure_percent": (
        ("Tyre slip limit", "%", "Largest departure of the tyre's force from its tangent"),
        (1.0, 30.0, 0.5),
    ),
    "limits.grip_use_max": (("Use of grip", "", "Largest share of an axle's lateral force"), (0.5, 0.995, 0.005)),
    "limits.yaw_gain_floor": (
        ("Floor of the yaw rate", "", "Least share of the passive car's yaw rate"),
        (0.0, 1.5, 0.01),
    ),
    "limits.reference_characteristic_speed_km_h": (
        ("Characteristic speed of the floor", "km/h", "From 80 km/h, a car of this characteristic speed is enough"),
        (40.0, 200.0, 1.0),
    ),
    FRICTION: (("Friction of the road", "", "Friction that the map assumes; the tyres stay the same"), (0.2, 1.2, 0.01)),
}
_PI: Rows = {
    "controller.proportional_gain_s": (
        ("Proportional gain", "s", "rad of rear angle for each rad/s of yaw-rate error"),
        (0.0, 0.3, 0.005),
    ),
    "controller.integral_gain": (("Integral gain", "", "rad of rear angle for each rad of integrated error"), (0.0, 5.0, 0.05)),
}
_ALL_GAINS = "Scales all gains over speed, in percent of those at the start"
_PERCENT = (0.0, 300.0, 1.0)
_SCALES: Rows = {
    "proportional_percent": (("Proportional gain", "%", _ALL_GAINS), _PERCENT),
    "integral_percent": (("Integral gain", "%", _ALL_GAINS), _PERCENT),
    "lead_percent": (("Look ahead", "%", "Scales the lead of the front angle, in percent of that at the start"), _PERCENT),
    "response_percent": (("Response gain", "%", "Scales the response gain, in percent of that at the start"), _PERCENT),
}
_TRACKING: Rows = {
    "controller.tracking.yaw_increasing_max_deg": (
        ("Feedback into the turn", "deg", "Largest feedback angle that increases the yaw rate"),
        (0.0, 3.5, 0.05),
    ),
    "controller.tracking.trim_max_percent": (
        ("Trim towards the map", "%", "Largest trim, in percent of the map's yaw rate"),
        (0.0, 10.0, 0.1),
    ),
}
_OF_KIND = {
    "pi": _controls("controller", _PI),
    "tracking": (*_controls("controller", _SCALES, value=100.0), *_controls("controller", _TRACKING)),
}
# The paper's step, on the road that the map is for.
_SPEED: Rows = {STEP_SPEED: (("Speed", "km/h", "Constant during the step"), (15.0, 150.0, 0.5))}
_ANGLE: Rows = {STEP_ANGLE: (("Steering wheel angle", "deg", "After the step"), (5.0, 180.0, 1.0))}
_ROAD: Rows = {
    STEP_ROAD: (
        ("Road under the car", "%", "Road friction in percent of the map's; unknown to the controller"),
        (30.0, 130.0, 1.0),
    )
}
_MAP_CONTROLS = (*_controls("map", _LAMBDA, logarithmic=True), *_controls("map", _MAP))
_STEP_CONTROLS = (
    *_controls("step", _SPEED, value=42.5),
    *_controls("step", _ANGLE, value=90.0),
    *_controls("step", _ROAD, bounds=(10.0, 200.0), value=100.0),
)


def controls_of(config: Config, case: str) -> tuple[Control, ...]:
    """Return the controls for a configuration and one of its cases, with bounds and start values."""
    # Of both limits of the tyre, only one acts.
    by_grip = config.case(case).tyre_model != "linear" and config.limits.grip_use_max is not None
    idle = "limits.slip_departure_percent" if by_grip else "limits.grip_use_max"
    return tuple(
        _started(control, config, case)
        for control in (*_MAP_CONTROLS, *_OF_KIND.get(config.controller.kind, ()), *_STEP_CONTROLS)
        if control.key != idle
    )


def _started(control: Control, config: Config, case: str) -> Control:
    if control.key == STEP_SPEED:
        top = config.top_speed_km_h
        return replace(control, bounds=(5.0, config.controller.inputs.speed_max_km_h), high=top, value=min(control.value, top))
    if control.key == STEP_ANGLE:
        most = config.steering.ratio * config.steering.front_angle_stop_deg
        return replace(control, bounds=(0.0, float(math.floor(most))))
    if control.group == "step" or control.key in SCALES:
        return control
    path = ("cases", case, WEIGHT_KEY) if control.key == LAMBDA else tuple(control.key.split("."))
    section: Any = config
    for part in path[:-1]:
        section = section[part] if isinstance(section, dict) else getattr(section, part)
    accepted = _range_of(type(section).model_fields[path[-1]])
    value = float(getattr(section, path[-1]))
    # The slider reaches to its start value. A logarithmic one has an extra stop for zero.
    low = control.low if control.logarithmic and value == 0.0 else min(control.low, value)
    bounds = (accepted.low, accepted.high)
    return replace(control, bounds=bounds, value=value, low=low, high=max(control.high, value))


def _range_of(key: FieldInfo) -> Range:
    """Return the accepted range of a key, also of one that may be left out."""
    inner = (getattr(part, "__metadata__", ()) for part in get_args(key.annotation))
    return next(each for each in (*key.metadata, *chain.from_iterable(inner)) if isinstance(each, Range))


def checked(controls: tuple[Control, ...], given: object) -> dict[str, float]:
    """Return key -> number for all controls; keys that are not given keep their start value.

    Raises:
        ExploreError: not a mapping, an unknown key, or an invalid value.
    """
    if not isinstance(given, dict):
        raise ExploreError("the settings must be a table of keys and values")
    known = {control.key: control for control in controls}
    for key in given:
        if key not in known:
            raise ExploreError(f"there is no setting {key!r}")
    return {key: control.check(given.get(key, control.value)) for key, control in known.items()}


def apply(start: Config, case: str, controls: tuple[Control, ...], values: Values) -> Config:
    """Return the configuration with the settings; unchanged settings keep their exact value.

    Raises:
        ConfigError: the models reject the configuration.
    """
    moved = {control.key: values[control.key] for control in controls if values[control.key] != control.value}
    config = on_road(start, moved.pop(FRICTION)) if FRICTION in moved else start
    if not any(_is_of_config(key) for key in moved):
        return config
    tracking = config.controller.tracking
    changes: dict[str, Any] = {}
    for key, value in moved.items():
        if key == LAMBDA:
            changes["cases"] = {case: {WEIGHT_KEY: value}}
        elif key in SCALES:
            assert tracking.schedule is not None  # a law with gains over speed
            untuned = {"lead_s": tracking.lead_s}.get(SCALES[key], 0.0)
            at_start = getattr(tracking.schedule, SCALES[key]) or [untuned] * len(tracking.schedule.speed_km_h)
            changes[f"{SCHEDULE}.{SCALES[key]}"] = [float(f"{gain * value / 100.0:.6g}") for gain in at_start]
            if key in ("proportional_percent", "integral_percent"):  # the stored margins belong to other gains
                changes |= dict.fromkeys(f"{SCHEDULE}.{name}" for name in ("gain_margin_db", "phase_margin_deg", "sensitivity"))
        elif _is_of_config(key):
            changes[key] = value
    return config.replace(changes)


def _is_of_config(key: str) -> bool:
    return not key.startswith("step.")


@dataclass(frozen=True)
class Step:
    """Step at the steering wheel: speed in m/s, angle in deg, and road friction as a fraction of the map's."""

    speed: float
    angle_deg: float
    road_share: float

    @classmethod
    def of(cls, values: Values) -> Step:
        """Return the step that checked values describe."""
        return cls(values[STEP_SPEED] * KM_H, values[STEP_ANGLE], values[STEP_ROAD] / 100.0)

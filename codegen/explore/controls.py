"""Controls of the page, and the configuration that their values give.

The bounds of what may be typed are those of the configuration's own models; a slider spans the part of them that is worth
dragging through, and the table below says why.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from pydantic import BaseModel

from codegen.configuration import Config, parse
from codegen.configuration.section import Range
from codegen.errors import CodegenError, ConfigError
from codegen.map_file.road import on_road
from codegen.units import KM_H

Group = Literal["map", "controller", "step"]
Values = Mapping[str, float]

GROUP_TITLES: Mapping[Group, str] = {"step": "Step at the steering wheel", "controller": "Controller", "map": "Map"}

FLOAT_MAX = sys.float_info.max  # beyond it are infinity, and whole numbers of hundreds of digits
LAMBDA, FRICTION = "lambda", "road.friction"
WEIGHT_KEY = "sideslip_weight_per_s2"
SCALES = {
    "proportional_percent": "proportional_gain_s",
    "integral_percent": "integral_gain",
    "lead_percent": "lead_s",
    "response_percent": "response_gain_s",
}
"""Control -> the row of the gain schedule that it scales."""
STEP_SPEED, STEP_ANGLE, STEP_ROAD = "step.speed_km_h", "step.angle_deg", "step.road_percent"


class ExploreError(CodegenError):
    """Settings that cannot be taken, or a page that cannot be served."""


@dataclass(frozen=True)
class Control:
    """One slider with its number box.

    Attributes:
        key: its name on the page; the dotted key in the configuration where it is one.
        label, unit, help: for people; `help` says in a line what it does.
        low, high, step: of the slider; `step` is a factor less one where it is logarithmic.
        bounds: of what may be typed.
        value: at the start.
        logarithmic: equal ways of the slider are equal ratios; zero, where it may be typed, is one stop more, below `low`.
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


# Where the sliders end. Angles and lateral acceleration: from next to nothing to the most that rear axles on the market steer,
# and to a racing tyre's grip. lambda: by ratios, from a map that hardly knows sideslip to one that knows nothing else.
# Friction: from packed snow to warm asphalt. Gains: several times the paper's, and three times the tuned ones.
_MAP_CONTROLS = (
    Control(
        LAMBDA, "map", "Sideslip weight λ", "1/s²", "How dear sideslip is beside yaw rate", 10.0, 1e5, 0.02, logarithmic=True
    ),
    Control(
        "limits.sideslip_max_deg", "map", "Sideslip limit", "deg", "Largest sideslip angle in a steady turn", 0.5, 8.0, 0.1
    ),
    Control(
        "limits.lateral_acceleration_max_g",
        "map",
        "Lateral acceleration limit",
        "g",
        "Largest in a steady turn",
        0.1,
        1.2,
        0.01,
    ),
    Control("limits.rear_angle_max_deg", "map", "Rear angle limit", "deg", "Largest that the map may ask for", 0.1, 10.0, 0.1),
    Control(
        "limits.slip_departure_percent",
        "map",
        "Tyre slip limit",
        "%",
        "How far the tyre's force may fall behind its straight line",
        1.0,
        30.0,
        0.5,
    ),
    Control(FRICTION, "map", "Friction of the road", "", "What the map is made for; the tyres stay the same", 0.2, 1.2, 0.01),
)
_PI_CONTROLS = (
    Control(
        "controller.proportional_gain_s",
        "controller",
        "Proportional gain",
        "s",
        "rad of rear angle for each rad/s of yaw-rate error",
        0.0,
        0.3,
        0.005,
    ),
    Control(
        "controller.integral_gain",
        "controller",
        "Integral gain",
        "",
        "rad of rear angle for each rad of integrated error",
        0.0,
        5.0,
        0.05,
    ),
)
_TRACKING_CONTROLS = (
    Control(
        "proportional_percent",
        "controller",
        "Proportional gain",
        "%",
        "Of the gains over speed at the start, all of them together",
        0.0,
        300.0,
        1.0,
        value=100.0,
    ),
    Control(
        "integral_percent",
        "controller",
        "Integral gain",
        "%",
        "Of the gains over speed at the start, all of them together",
        0.0,
        300.0,
        1.0,
        value=100.0,
    ),
    Control(
        *("lead_percent", "controller", "Look ahead", "%", "Of the lead over speed at the start, on the front angle"),
        *(0.0, 300.0, 1.0),
        value=100.0,
    ),
    Control(
        *(
            "response_percent",
            "controller",
            "Response gain",
            "%",
            "Of the gain over speed at the start, on what the model lacks",
        ),
        *(0.0, 300.0, 1.0),
        value=100.0,
    ),
    Control(
        "controller.tracking.yaw_increasing_max_deg",
        "controller",
        "Feedback into the turn",
        "deg",
        "Most that feedback may add where it turns the car more",
        0.0,
        3.5,
        0.05,
    ),
    Control(
        "controller.tracking.trim_max_percent",
        "controller",
        "Trim towards the map",
        "%",
        "Of the map's yaw rate, at most",
        0.0,
        10.0,
        0.1,
    ),
)
_OF_KIND = {"pi": _PI_CONTROLS, "tracking": _TRACKING_CONTROLS}
_STEP_CONTROLS = (
    # The paper's step, on the road that the map is for.
    Control(STEP_SPEED, "step", "Speed", "km/h", "Held all through the step", 15.0, 150.0, 0.5, value=42.5),
    Control(STEP_ANGLE, "step", "Steering wheel angle", "deg", "After the step", 5.0, 180.0, 1.0, value=90.0),
    Control(
        STEP_ROAD,
        "step",
        "Road under the car",
        "%",
        "Its friction, of the friction that the map is made for; the controller is not told",
        30.0,
        130.0,
        1.0,
        (10.0, 200.0),
        100.0,
    ),
)


def controls_of(config: Config, case: str) -> tuple[Control, ...]:
    """The controls of a configuration and a case of it, with their bounds and their values at the start."""
    return tuple(
        _started(control, config, case)
        for control in (*_MAP_CONTROLS, *_OF_KIND.get(config.controller.kind, ()), *_STEP_CONTROLS)
    )


def _started(control: Control, config: Config, case: str) -> Control:
    if control.key == STEP_SPEED:
        return replace(control, bounds=(5.0, config.controller.inputs.speed_max_km_h))
    if control.key == STEP_ANGLE:
        most = config.steering.ratio * config.steering.front_angle_stop_deg
        return replace(control, bounds=(0.0, float(math.floor(most))))
    if control.group == "step" or control.key in SCALES:
        return control
    path = ("cases", case, WEIGHT_KEY) if control.key == LAMBDA else tuple(control.key.split("."))
    value: Any = config
    for part in path:
        value = value[part] if isinstance(value, dict) else getattr(value, part)
    return _with_value(replace(control, bounds=_bounds(config, path)), float(value))


def _with_value(control: Control, value: float) -> Control:
    """Extend the slider to its start value. A logarithmic slider has an own stop for zero."""
    low = control.low if control.logarithmic and value == 0.0 else min(control.low, value)
    return replace(control, value=value, low=low, high=max(control.high, value))


def _bounds(config: Config, path: tuple[str, ...]) -> tuple[float, float]:
    """Return the range that the configuration's model accepts for a key."""
    section: Any = config
    for part in path[:-1]:
        section = section[part] if isinstance(section, dict) else getattr(section, part)
    assert isinstance(section, BaseModel)
    found = [each for each in type(section).model_fields[path[-1]].metadata if isinstance(each, Range)]
    return found[0].low, found[0].high


def checked(controls: tuple[Control, ...], given: object) -> dict[str, float]:
    """Key -> number, of all controls; what is not given keeps its value of the start.

    Raises:
        ExploreError: no mapping, an unknown key, or a value that is none.
    """
    if not isinstance(given, dict):
        raise ExploreError("the settings are no table of keys and values")
    known = {control.key: control for control in controls}
    for key in given:
        if key not in known:
            raise ExploreError(f"there is no setting {key!r}")
    return {key: control.check(given.get(key, control.value)) for key, control in known.items()}


def apply(start: Config, case: str, controls: tuple[Control, ...], values: Values) -> Config:
    """The configuration with the settings; what stands as at the start keeps its exact value.

    Raises:
        ConfigError: the models refuse the configuration.
    """
    moved = {control.key: values[control.key] for control in controls if values[control.key] != control.value}
    config = on_road(start, moved.pop(FRICTION)) if FRICTION in moved else start
    if not any(_is_of_config(key) for key in moved):
        return config
    data = config.model_dump(mode="json")
    for key, value in moved.items():
        if key == LAMBDA:
            data["cases"][case][WEIGHT_KEY] = value
        elif key in SCALES:
            tracking = data["controller"]["tracking"]
            schedule = tracking["schedule"]
            untuned = {"lead_s": tracking["lead_s"]}.get(SCALES[key], 0.0)
            at_start = schedule.get(SCALES[key]) or [untuned] * len(schedule["speed_km_h"])
            schedule[SCALES[key]] = [float(f"{gain * value / 100.0:.6g}") for gain in at_start]
            if key in ("proportional_percent", "integral_percent"):  # those were the margins of other gains
                schedule |= dict.fromkeys(("gain_margin_db", "phase_margin_deg", "sensitivity"))
        elif _is_of_config(key):
            section, _, name = key.rpartition(".")
            table = data
            for part in section.split("."):
                table = table[part]
            table[name] = value
    try:
        return parse(data, "settings")
    except ConfigError as error:
        raise ConfigError(error.what, where=error.where.removeprefix("settings: "), remedy=error.remedy) from None


def _is_of_config(key: str) -> bool:
    return not key.startswith("step.")


@dataclass(frozen=True)
class Step:
    """The step at the steering wheel: m/s, deg at the steering wheel, share of the map's friction that the road has."""

    speed: float
    angle_deg: float
    road_share: float

    @classmethod
    def of(cls, values: Values) -> Step:
        """Return the configuration with checked values."""
        return cls(values[STEP_SPEED] * KM_H, values[STEP_ANGLE], values[STEP_ROAD] / 100.0)

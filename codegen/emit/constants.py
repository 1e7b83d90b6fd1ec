"""Constants of map and vehicle in the generated C that calibration cannot change."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import SupportsFloat

import numpy as np

from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup, Real
from codegen.ecu_map.total import TotalMap
from codegen.emit.laws import Law, law_of
from codegen.units import M_S2, NONE, RAD, RAD_S, RAD_S2_M, S2_M, M, Unit
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import SLIP_SEARCH_MAX, AxleTyres


@dataclass(frozen=True)
class Constant:
    """A member of the C struct `<prefix>_constants_t`.

    Attributes:
        name: name of the member.
        value: value in SI units; a tuple has a number for each layer of a stack.
        unit: unit of the value.
        meaning: text for the comment in C.
    """

    name: str
    value: float | tuple[float, ...]
    unit: Unit
    meaning: str

    @property
    def values(self) -> tuple[float, ...]:
        """All numbers of the value, one or several."""
        return self.value if isinstance(self.value, tuple) else (self.value,)


def constants_of(config: Config, total: TotalMap, lookup: Lookup) -> tuple[Constant, ...]:
    """Return the constants of a build, in the order of the struct. Raises BuildError: see `law_of`."""
    law = law_of(config)
    return (
        *_scales(total, with_rear_angle=law.uses_rear_angle),
        *_caps(lookup, law, stacked=bool(total.layers)),
        *(_vehicle(lookup, stacked=bool(total.layers)) if law.uses_rear_angle else ()),
        *(_reference_model(config, total, lookup.real) if law.uses_reference_model else ()),
    )


def _scales(total: TotalMap, *, with_rear_angle: bool) -> Iterator[Constant]:
    if total.scales is not None:
        yield Constant("yaw_rate_scale", total.scales.yaw_rate, RAD_S, "yaw rate of a raw table value of 1")
        if with_rear_angle:
            yield Constant("rear_angle_scale", total.scales.rear_angle, RAD, "rear angle of a raw table value of 1")
        if total.grip is not None and total.grip.scale is not None:
            yield Constant("grip_share_scale", total.grip.scale, NONE, "grip share of a raw table value of 1")


def _caps(lookup: Lookup, law: Law, *, stacked: bool) -> Iterator[Constant]:
    """Yield the caps, rounded down so that they never exceed the bound."""
    meaning = "largest steady lateral acceleration that the constraints allow"
    if lookup.is_moving:
        yield Constant(
            "longitudinal_accelerations",
            _numbers(lookup.accelerations, stacked),
            M_S2,
            "longitudinal acceleration of each layer",
        )
    elif stacked:
        yield Constant("frictions", _numbers(lookup.frictions, stacked), NONE, "friction of each layer")
    if stacked:
        meaning = "largest steady lateral acceleration that the constraints allow, for each layer"
    yield Constant(f"lateral_acceleration_cap{'s' * stacked}", _numbers(lookup.caps, stacked), M_S2, meaning)
    per_friction = float(lookup.lateral_acceleration_cap_per_friction)
    if not lookup.is_moving:
        yield Constant(
            "lateral_acceleration_cap_per_friction",
            per_friction,
            M_S2,
            "largest lateral acceleration on slippery roads, per unit of friction",
        )
    elif law.uses_reference_model:
        for axle, shares in zip(("front", "rear"), lookup.axle_shares.T, strict=True):
            meaning = f"lateral peak of the {axle} axle relative to constant speed, for each layer"
            yield Constant(f"{axle}_shares", _numbers(shares, stacked), NONE, meaning)
    yield Constant("map_friction", float(lookup.friction), NONE, "road friction that the map assumes")


def _vehicle(lookup: Lookup, *, stacked: bool) -> Iterator[Constant]:
    """Yield the constants of the map's linear vehicle, from which the lookup computes the rear angle of a capped yaw rate."""
    own, plural = lookup.cars[lookup.own], "s" * stacked
    understeer = _numbers((car.understeer_coefficient for car in lookup.cars), stacked)
    slip = _numbers((car.rear_slip for car in lookup.cars), stacked)
    yield Constant("wheelbase", float(own.wheelbase), M, "wheelbase of the linear car")
    yield Constant(f"understeer_coefficient{plural}", understeer, S2_M, "understeer coefficient of the linear car")
    yield Constant("rear_arm", float(own.rear_arm), M, "distance from centre of gravity to rear axle")
    yield Constant(f"rear_slip_per_lateral_acceleration{plural}", slip, RAD_S2_M, "rear slip angle per lateral acceleration")
    yield Constant("sideslip_max", float(own.sideslip_max), RAD, "sideslip bound of the optimisation")
    yield Constant("rear_angle_max", float(own.rear_angle_max), RAD, "rear angle bound of the optimisation")


def _numbers(layers: Iterable[SupportsFloat], stacked: bool) -> float | tuple[float, ...]:
    """Return the number of each layer of a stack, or the one number of a single map."""
    numbers = tuple(map(float, layers))
    return numbers if stacked else numbers[-1]


def _reference_model(config: Config, total: TotalMap, real: Real) -> Iterator[Constant]:
    cap = total.lateral_acceleration_cap
    # Rounded up, so that the full grip is not mistaken for a road more slippery than the map's.
    per_grip = total.friction / cap * (1.0 + 4.0 * float(np.finfo(real).eps))
    slip = SingleTrack.from_config(config).rear_slip_per_lateral_acceleration
    yield Constant("grip_max", cap, M_S2, "largest lateral acceleration of the map on its road")
    yield Constant("friction_per_grip", per_grip, S2_M, "friction per lateral acceleration")
    yield Constant(
        "model_rear_slip_per_lateral_acceleration", slip, RAD_S2_M, "rear slip angle per lateral acceleration of the model"
    )
    half = 0.5 * min(AxleTyres.from_config(config).rear.peak_slip, SLIP_SEARCH_MAX)
    yield Constant("rear_slip_least", half, RAD, "rear slip angle at peak force: constant part")
    yield Constant(
        "rear_slip_per_friction",
        half / total.friction,
        RAD,
        "rear slip angle at peak force: part that grows with friction, per unit of friction",
    )

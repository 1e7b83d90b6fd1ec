"""Import of tyres from property files: the Magic Formula at the static wheel loads, as [tyre.front] and [tyre.rear].

The configuration's formula (`codegen.vehicle.tyre`) has no shifts and one E for both sides. A car has a left and a right tyre,
mirror images of each other, so the shifts of a file (ply steer, conicity) and the difference of E cancel over an axle: they are
removed, and their size is reported.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from codegen import configuration
from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.importing.magic_formula import TIR_BYTES_MAX, Curve, LateralFormula, parse, read_formula
from codegen.importing.source import ImportFault, Source, read
from codegen.importing.toml_edit import replace_values, with_text
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre, static_wheel_loads

Peak = Literal["file", "road"]
AXLES = ("front", "rear")
SLIP_MAX = math.radians(45.0)
SLIP_POINTS = 4501
NOTED_SHARE = 0.1
"""Relative difference of the file's peak friction from the road's that is reported."""
STIFFNESS_KEY, FACTOR_KEY = "cornering_stiffness_n_per_rad", "stiffness_factor_b_per_rad"


@dataclass(frozen=True)
class AxleImport:
    """Imported tyre of an axle, and its differences from the file. SI units; JSON-able by `dataclasses.asdict`.

    Attributes:
        axle: "front" or "rear".
        file, sha256, version, side: the file, its formula, and TYRESIDE.
        load: static wheel load, N.
        stiffness: B C D there, N/rad.
        peak: D there, N, and
        friction: D over the load.
        slip_at_peak: rad; None where the force rises up to 45 deg.
        slip_bound: rad, where the configuration's tyre uses limits.grip_use_max of its largest force; without that key, where
            it departs from its tangent by limits.slip_departure_percent.
        horizontal_shift, vertical_shift, asymmetry: SHy in rad, SVy in N and PEY3 of the file, removed.
        worst: largest difference of the two curves up to the slip bound, and
        worst_to_peak: up to the peak (20 deg without one), over the file's peak.
        stiffness_lighter, stiffness_heavier: relative error of the configuration's stiffness at 0.7 and 1.3 times the load.
        values: key of [tyre.front] or [tyre.rear] -> number.
    """

    axle: str
    file: str
    sha256: str
    version: str
    side: str
    load: float
    stiffness: float
    peak: float
    friction: float
    slip_at_peak: float | None
    slip_bound: float
    horizontal_shift: float
    vertical_shift: float
    asymmetry: float
    worst: float
    worst_to_peak: float
    stiffness_lighter: float
    stiffness_heavier: float
    values: dict[str, float]


@dataclass(frozen=True)
class TyreImport:
    """Text of the new ars.toml, both axles, and notes for the user."""

    text: str
    axles: tuple[AxleImport, ...]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return values for JSON."""
        return {axle.axle: {key: value for key, value in asdict(axle).items() if key != "axle"} for axle in self.axles}


def import_tyres(paths: Sequence[Path], given: Config | Path, peak: Peak = "file") -> TyreImport:
    """Put the tyres of one file (both axles) or two (front, rear) into a configuration.

    Args:
        paths: one or two `.tir` files.
        given: configuration of the car, or its ars.toml, whose text is edited.
        peak: "file": the peak at static load is the file's, independent of road.friction; "road": it is road.friction.

    Raises:
        ImportFault: a file or the car cannot give the tyre.
        ConfigError: the configuration cannot be read, or cannot hold the tyre.
    """
    config, text = with_text(given)
    loads = static_wheel_loads(config)
    files = [read(path, TIR_BYTES_MAX) for path in paths]
    sources = files if len(files) == 2 else files * 2
    formulas = [read_formula(parse(source)) for source in sources]
    curves = [_curve(formula, load, source) for formula, load, source in zip(formulas, loads, sources, strict=True)]
    values = [_values(formula, load, config, peak) for formula, load in zip(formulas, loads, strict=True)]
    for axle, source, numbers in zip(AXLES, sources, values, strict=True):
        name = "".join(character if character.isprintable() else "?" for character in source.name)  # valid in a comment
        remark = f"imported from {name}, SHA-256 {source.sha256}"
        text = replace_values(text, f"tyre.{axle}", numbers, {FACTOR_KEY: STIFFNESS_KEY}, remark)
    made = _checked(text, sources)
    tyres = AxleTyres.from_config(made)
    of_axles = zip(AXLES, (tyres.front, tyres.rear), tyres.slip_limits, strict=True)
    axles = tuple(
        _axle(*of_axle, source, formula, curve, numbers)
        for of_axle, source, formula, curve, numbers in zip(of_axles, sources, formulas, curves, values, strict=True)
    )
    return TyreImport(text, axles, tuple(_notes(axles, config, peak)))


def _curve(formula: LateralFormula, load: float, source: Source) -> Curve:
    """Return the curve at the car's wheel load. Raises ImportFault where the file does not cover it or gives no tyre."""
    if not formula.load_min <= load <= formula.load_max:
        span = f"{formula.load_min:.0f} to {formula.load_max:.0f} N"
        raise ImportFault(
            f"the car's wheel load of {load:.0f} N is outside FZMIN to FZMAX, {span}",
            where=source.path,
            remedy="take a tyre for this car, or check vehicle.mass_kg",
        )
    curve = formula.at(load)
    for name, value, remedy in (
        ("cornering stiffness", curve.stiffness, "check PKY1, PKY2 and PKY4"),
        ("peak force", curve.peak, "check PDY1 and PDY2"),
    ):
        if not (math.isfinite(value) and value > 0.0):
            raise ImportFault(f"a {name} of {value:.4g} at {load:.0f} N", where=source.path, remedy=remedy)
    return curve


def _values(formula: LateralFormula, load: float, config: Config, peak: Peak) -> dict[str, float]:
    """Return the keys of the configuration's tyre.

    D = friction (p1 + p2 dFz) Fz with dFz over the static load, the file's muy = a + b (Fz - Fz0')/Fz0': p1 is muy at the
    static load and p2 its slope there, both over road.friction. Both are straight lines of the load, so the peak is the file's
    at every load.
    """
    curve = formula.at(load)
    friction = curve.peak / load
    slope = formula.at(2.0 * load).peak / (2.0 * load) - friction
    over = config.road.friction if peak == "file" else friction
    sides = [min(curve.curvature * (1.0 - sign * curve.asymmetry), 1.0) for sign in (1.0, -1.0)]
    values = {
        STIFFNESS_KEY: curve.stiffness,
        "shape_factor_c": curve.shape,
        "curvature_factor_e": 0.5 * (sides[0] + sides[1]),
        "peak_factor_p1": friction / over,
        "peak_load_sensitivity_p2": slope / over,
        "horizontal_shift_deg": 0.0,
        "vertical_shift_n": 0.0,
    }
    return {key: float(f"{value:.9g}") for key, value in values.items()}  # far finer than any tyre is known


def _checked(text: str, sources: Sequence[Source]) -> Config:
    """Return the new configuration; its faults come from the files, because the old one was valid."""
    named = " and ".join(dict.fromkeys(str(source.path) for source in sources))
    try:
        return configuration.parse(tomllib.loads(text), named)
    except ConfigError as error:
        raise ImportFault(
            error.what, where=error.where, remedy="the file's tyre is beyond what ars.toml takes; check it"
        ) from None


def _axle(
    axle: str,
    tyre: MagicFormulaTyre,
    slip_bound: float,
    source: Source,
    formula: LateralFormula,
    curve: Curve,
    values: dict[str, float],
) -> AxleImport:
    load = tyre.static_load
    at_peak = _slip_at_peak(curve)
    lighter, heavier = (
        tyre.stiffness_factor * tyre.shape_factor * tyre.peak(other, tyre.nominal_friction) / formula.at(other).stiffness - 1.0
        for other in (0.7 * load, 1.3 * load)
    )
    return AxleImport(
        axle=axle,
        file=source.name,
        sha256=source.sha256,
        version=formula.version,
        side=formula.side,
        load=load,
        stiffness=curve.stiffness,
        peak=curve.peak,
        friction=curve.peak / load,
        slip_at_peak=at_peak,
        slip_bound=slip_bound,
        horizontal_shift=curve.horizontal_shift,
        vertical_shift=curve.vertical_shift,
        asymmetry=curve.asymmetry,
        worst=_worst(curve, tyre, slip_bound),
        worst_to_peak=_worst(curve, tyre, at_peak or math.radians(20.0)),
        stiffness_lighter=lighter,
        stiffness_heavier=heavier,
        values=values,
    )


def _slip_at_peak(curve: Curve) -> float | None:
    from scipy.optimize import minimize_scalar

    slips = np.linspace(0.0, SLIP_MAX, SLIP_POINTS)
    highest = int(np.argmax(curve.force(slips)))
    if highest == SLIP_POINTS - 1:
        return None
    around = (slips[max(highest - 1, 0)], slips[highest + 1])
    return float(minimize_scalar(lambda slip: -float(curve.force(slip)), bounds=around, method="bounded").x)


def _worst(curve: Curve, tyre: MagicFormulaTyre, slip_max: float) -> float:
    """Return the largest difference as a fraction of the file's peak."""
    slips = np.linspace(0.0, slip_max, 1001)
    return float(np.max(np.abs(tyre.force(slips) - curve.force(slips))) / curve.peak)


def _notes(axles: Sequence[AxleImport], config: Config, peak: Peak) -> list[str]:
    notes = []
    for axle in axles:
        if abs(axle.friction / config.road.friction - 1.0) > NOTED_SHARE:
            taken = f"p1 = {axle.values['peak_factor_p1']:.3g}; `peak='road'` takes the road's instead"
            if peak == "road":
                taken = "the road's is taken"
            of_file, of_road = f"{axle.friction:.3g}", f"{config.road.friction:g}"
            notes.append(f"{axle.axle}: the file's peak friction is {of_file}, road.friction is {of_road}: {taken}")
    if config.controller.tracking.schedule is not None:
        notes.append("controller.tracking.schedule was designed for the old tyres: solve the map and tune it again")
    return notes

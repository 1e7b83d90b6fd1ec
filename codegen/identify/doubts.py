"""Doubts: what an identification shows against its own values and deviations.

They are written into `[identified]`, and commands that use the deviations refuse the file until a key accepts them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from codegen.identify.model import AXLES
from codegen.identify.parameters import BY_NAME, CURVES
from codegen.identify.reached import PEAK_REACHED, Reached, exceeds_reached, linear_end, slip_limit, tyres_of
from codegen.identify.run import Identification
from codegen.identify.validation import Validation
from codegen.units import DEGREE

SLIP_FACTOR_MAX = 1.01
"""Largest slip that a map uses over the slip that was driven: both are rounded, and simulated with noise."""
FREE_RUN_FACTOR_MAX = 1.0
"""Largest error of the free run over that of one step. For a correct model it is 0.71: both are noise. At one, the error
of the model is as large as the noise."""
TINY = float(np.finfo(np.float64).tiny)
TURNING, FREE_RUN_SHARE_MAX = 1.0 * DEGREE, 0.15
"""Yaw rate (rms, rad/s) from which a drive shows whether it is predicted, and the fraction of it that is too large an error:
4 % for a multi-body car that rolls."""


def doubts(found: Identification, limits: Reached, validations: Sequence[Validation]) -> list[str]:
    """Return a line for each doubt.

    Args:
        limits: what the drives reached.
        validations: of drives that were held out, or else of the identified ones.
    """
    return [*_ends(found), *_beyond_the_drives(found, limits), *_predictions(validations)]


def _ends(found: Identification) -> Iterator[str]:
    """Yield each value at an end of its range."""
    for each in found.quantities.values():
        parameter = each.parameter
        if each.is_identified and (end := parameter.end_at(each.value)) is not None:
            shown = f"{end / parameter.size:.4g} {parameter.unit}".strip()
            yield f"{parameter.title} is at the end of its range, {shown}"


def _beyond_the_drives(found: Identification, limits: Reached) -> Iterator[str]:
    """Yield what of the tyres lies beyond the drives."""
    config = found.config
    tyres = tyres_of(config, found.values())
    for axle, curve, tyre, slip, friction, share in zip(
        AXLES, CURVES, tyres, limits.slip, limits.friction, limits.share, strict=True
    ):
        driven = f"the {slip / DEGREE:.1f} deg of slip that were driven"
        peak = found.quantities[curve[0]]
        if peak.is_identified and exceeds_reached(config.road.friction * peak.value, friction):
            yield f"{BY_NAME[curve[0]].title} is {peak.value:.3g}, where the drives reached a friction of {friction:.2f}"
        if peak.is_identified and share < PEAK_REACHED:
            where = f"at {tyre.peak_slip / DEGREE:.1f} deg" if np.isfinite(tyre.peak_slip) else "at no slip"
            yield f"the peak of the {axle} tyres, {where}, lies beyond {driven}"
        end = slip_limit(tyre, share, config) if config.limits.grip_use_max is not None else linear_end(tyre, config)
        if found.quantities[f"{axle}_stiffness"].is_identified and end > SLIP_FACTOR_MAX * slip:
            yield f"the slip bound of the {axle} axle, {end / DEGREE:.1f} deg, lies beyond {driven}, where its map ends"


def _predictions(validations: Sequence[Validation]) -> Iterator[str]:
    """Yield what the identified car does not predict as well as the noise allows: one line of each kind, of its worst drive."""
    lost: list[tuple[float, str]] = []
    wrong: list[tuple[float, str]] = []
    coloured: list[tuple[float, str]] = []
    for each in validations:
        run = each.identified
        error, size = run.yaw_rate_error, run.yaw_rate_size
        ratio = error / max(run.one_step_error, TINY)
        if error > FREE_RUN_SHARE_MAX * max(size, TURNING):
            text = (
                f"{each.name}: the free run of the identified car has an error of {error / DEGREE:.3g} deg/s, where "
                f"{size / DEGREE:.3g} deg/s were measured; check signs and units of all signals"
            )
            lost.append((error, text))
            continue
        if ratio > FREE_RUN_FACTOR_MAX:
            text = f"{each.name}: the free run has {ratio:.2g} times the error of one step, where 0.71 times is noise"
            wrong.append((ratio, f"{text}: the model is wrong by more than that"))
        if names := [name.replace("_", " ") for name, test in each.whiteness.items() if not test.is_white]:
            coloured.append(
                (ratio, f"{each.name}: the errors of {', '.join(names)} are no white noise: they are errors of the model")
            )
    for found in (lost, wrong, coloured):
        if found:
            more = f" (and {len(found) - 1} more drives)" if len(found) > 1 else ""
            yield f"{max(found)[1]}{more}"

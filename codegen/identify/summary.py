"""Tables and facts of an identification, for the terminal, for JSON and for the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from codegen.identify.model import AXLES
from codegen.identify.outcome import Outcome
from codegen.identify.parameters import Parameter
from codegen.identify.reading import Reading
from codegen.identify.result import understeer_gradient
from codegen.identify.run import Identification, IdentifiedQuantity
from codegen.identify.validation import Validation
from codegen.units import DEGREE, KM_H

CONFIDENCE_FACTOR = 1.96
"""Half of the width of a 95 % interval in standard deviations."""

ROUNDING = 1e-9
"""Largest rounding error, as a fraction of a quantity's spread before the drives."""

SIGNAL_HEADER = ("drive", "quantity", "signal", "unit", "samples", "period [ms]", "with a value [%]")
FINDING_HEADER = ("drive", "quantity", "finding", "lost", "what")
QUANTITY_HEADER = ("quantity", "value", "±95 %", "unit", "configured", "remark")
VALIDATION_HEADER = (
    "drive",
    "car",
    "free run, rms [deg/s]",
    "free run, largest [deg/s]",
    "one step, rms [deg/s]",
    "measured, rms [deg/s]",
    "lateral acceleration, rms [m/s^2]",
)
WHITENESS_HEADER = ("errors of", "lag one", "Q", "lags", "probability", "white")


def significant(value: float, digits: int) -> str:
    """Return a number with significant digits; large numbers without an exponent."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text else text


def _shown(value: float, parameter: Parameter, digits: int = 5) -> str:
    """Return a value in the unit of its key. Rounding errors, which drives without noise leave, count as zero."""
    return significant(value / parameter.size if abs(value) > ROUNDING * parameter.spread else 0.0, digits)


def _shown_to(value: float, parameter: Parameter, interval: str) -> str:
    """Return a value in the unit of its key, with as many decimals as its interval."""
    return f"{value / parameter.size:.{len(interval.partition('.')[2])}f}" if float(interval) else _shown(value, parameter)


def signal_rows(reading: Reading) -> list[tuple[str, ...]]:
    """Return rows of SIGNAL_HEADER: the source of each signal of each drive."""
    return [
        (drive.name, key, one.channel, one.unit, str(one.samples), f"{1e3 * one.period:.3g}", f"{100.0 * one.share:.1f}")
        for drive, sources in zip(reading.drives, reading.sources, strict=True)
        for key, one in sources.items()
    ]


def finding_rows(reading: Reading) -> list[tuple[str, ...]]:
    """Return rows of FINDING_HEADER."""
    return [
        (each.drive, each.quantity or "-", each.kind, str(each.lost) if each.lost else "-", each.text)
        for each in reading.findings
    ]


def quantity_row(quantity: IdentifiedQuantity) -> tuple[str, ...]:
    """Return a row of QUANTITY_HEADER."""
    parameter = quantity.parameter
    interval = _shown(CONFIDENCE_FACTOR * quantity.standard_deviation, parameter, 2) if quantity.is_uncertain else "-"
    return (
        parameter.title,
        _shown_to(quantity.value, parameter, interval) if quantity.is_identified else "-",
        interval if quantity.is_identified or not quantity.is_uncertain else f"({interval})",
        parameter.unit,
        _shown(quantity.configured, parameter),
        quantity.note,
    )


def quantity_rows(found: Identification) -> list[tuple[str, ...]]:
    """Return the rows of all quantities, the understeer gradient last."""
    gravity = found.config.road.gravity_m_s2
    value, deviation = (each / DEGREE * gravity for each in understeer_gradient(found))
    is_known = math.isfinite(deviation)
    interval = f"{CONFIDENCE_FACTOR * deviation:.2g}" if is_known else "-"
    gradient = (
        "understeer gradient",
        f"{value:.{len(interval.partition('.')[2])}f}" if is_known else "-",
        interval,
        "deg/g",
        "",
        "" if is_known else "needs both cornering stiffnesses",
    )
    return [*(quantity_row(each) for each in found.quantities.values()), gradient]


def reached_lines(outcome: Outcome) -> list[str]:
    """Return what the drives reached, as sentences, with 95 % intervals of the forces and of the slips at which a map ends."""
    found, one = outcome.found, outcome.reached
    speeds = " to ".join(dict.fromkeys(f"{each / KM_H:.0f}" for each in one.speed))
    lines = [f"The drives cover {speeds} km/h and a lateral acceleration up to {one.lateral_acceleration:.1f} m/s^2."]
    for axle, slip, friction, force in zip(AXLES, one.slip, one.friction, outcome.forces, strict=True):
        is_identified = found.quantities[f"{axle}_peak"].is_identified
        held = "the identified curve holds up to there" if is_identified else "D, C and E are as configured"
        lines.append(f"The {axle} tyres reached {slip / DEGREE:.1f} deg of slip and a friction of {friction:.2f}; {held}.")
        largest = f"{1e-3 * force.force:.2f} ± {1e-3 * CONFIDENCE_FACTOR * force.force_deviation:.2f} kN"
        limit = f"{force.slip_limit / DEGREE:.1f} ± {CONFIDENCE_FACTOR * force.slip_limit_deviation / DEGREE:.1f} deg"
        end = f"; a map ends at a slip of {limit}" if math.isfinite(force.slip_limit) else ""
        lines.append(f"The largest force of the {axle} axle was {largest}{end}.")
    return lines


def validation_rows(validations: Sequence[Validation]) -> list[tuple[str, ...]]:
    """Return rows of VALIDATION_HEADER: each drive with the identified and with the configured values."""
    rows = []
    for each in validations:
        for name, run in (("identified", each.identified), ("configured", each.configured)):
            angles = (run.yaw_rate_error, run.largest, run.one_step_error, run.yaw_rate_size)
            acceleration = f"{run.acceleration_error:.3f}" if math.isfinite(run.acceleration_error) else "-"
            rows.append((each.name, name, *(f"{value / DEGREE:.3f}" for value in angles), acceleration))
    return rows


def whiteness_rows(validation: Validation) -> list[tuple[str, ...]]:
    """Return rows of WHITENESS_HEADER."""
    return [
        (
            name.replace("_", " "),
            f"{test.first:.3f}",
            significant(test.statistic, 4),
            str(test.lags),
            f"{test.probability:.2g}",
            "yes" if test.is_white else "no",
        )
        for name, test in validation.whiteness.items()
    ]


def whiteness_line(validations: Sequence[Validation]) -> str:
    """Return a line with the number of drives in which the errors of each output may be white noise."""
    outputs = dict.fromkeys(name for each in validations for name in each.whiteness)
    tests = {name: [each.whiteness[name].is_white for each in validations if name in each.whiteness] for name in outputs}
    counts = [f"{name.replace('_', ' ')} in {sum(white)} of {len(white)} drives" for name, white in tests.items()]
    return f"errors that may be white noise (Ljung-Box): {', '.join(counts)}"


def to_dict(outcome: Outcome) -> dict[str, Any]:
    """Return all figures as JSON values, in the units that the names state; SI where there is none."""

    def finite(value: float) -> float | None:
        return value if math.isfinite(value) else None

    found, one, forces, validations = outcome.found, outcome.reached, outcome.forces, outcome.validations
    gradient = understeer_gradient(found)
    return {
        "quantities": {
            name: {
                "key": each.parameter.key or None,
                "unit": each.parameter.unit,
                "value": each.value / each.parameter.size if each.is_identified else None,
                "standard_deviation": finite(each.standard_deviation / each.parameter.size),
                "configured": each.configured / each.parameter.size,
                "note": each.note,
            }
            for name, each in found.quantities.items()
        },
        "understeer_gradient_rad_s2_m": {"value": gradient[0], "standard_deviation": finite(gradient[1])},
        "not_determined": [direction.text for direction in found.directions],
        "reached": {
            "speed_m_s": list(one.speed),
            "lateral_acceleration_m_s2": one.lateral_acceleration,
            "slip_rad": list(one.slip),
            "friction": list(one.friction),
            "share_of_peak": list(one.share),
            "force_n": [each.force for each in forces],
            "force_standard_deviation_n": [each.force_deviation for each in forces],
            "slip_limit_rad": [finite(each.slip_limit) for each in forces],
            "slip_limit_standard_deviation_rad": [finite(each.slip_limit_deviation) for each in forces],
        },
        "validation": [
            {
                "drive": each.name,
                **{
                    name: {
                        "free_run_rad_s": run.yaw_rate_error,
                        "one_step_rad_s": run.one_step_error,
                        "yaw_rate_rad_s": run.yaw_rate_size,
                        "lateral_acceleration_m_s2": finite(run.acceleration_error),
                    }
                    for name, run in (("identified", each.identified), ("configured", each.configured))
                },
                "white": {name: test.is_white for name, test in each.whiteness.items()},
            }
            for each in validations
        ],
        "model_error": outcome.model_error,
        "doubts": list(outcome.doubts),
        "notes": list(found.notes),
    }

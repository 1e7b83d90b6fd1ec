"""An identification with what its drives show about it: ranges, forces, predictions, grown deviations and doubts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from codegen.configuration import Config
from codegen.identify.doubts import doubts
from codegen.identify.drive import Drive
from codegen.identify.model_error import model_error, with_model_error
from codegen.identify.reached import AxleForce, Reached, axle_forces, reached
from codegen.identify.run import Identification, identify
from codegen.identify.validation import Validation, validate, validate_fitted


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of an identification.

    Attributes:
        found: with deviations that allow for the model errors of `validations`.
        reached: ranges of the drives. forces: of front and rear axle.
        validations: predictions of the drives that were held out, or else of the identified ones. is_held_out: which of them.
        model_error: relative to the outputs, see `model_error`. doubts: a line for each.
    """

    found: Identification
    reached: Reached
    forces: tuple[AxleForce, AxleForce]
    validations: tuple[Validation, ...]
    is_held_out: bool
    model_error: float
    doubts: tuple[str, ...]


def identify_and_predict(config: Config, drives: Sequence[Drive], held_out: Sequence[Drive]) -> Outcome:
    """Identify a car from drives and predict those that are held out, or else the same. Raises CodegenError, see `identify`."""
    first = identify(config, drives)
    validations = tuple(validate(first, drive) for drive in held_out) or tuple(validate_fitted(first, drives))
    error, of_acceleration = model_error(validations)
    found = with_model_error(first, error)
    limits = reached(found.vehicle, config)
    forces = axle_forces(first.vehicle, found.vehicle.covariance, config, of_acceleration)
    return Outcome(found, limits, forces, validations, bool(held_out), error, tuple(doubts(found, limits, validations)))

"""View model of the checksum over a build's calibration: the CRC-32 of the C, computed from the numbers in Python."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from codegen.configuration import Config
from codegen.emit.controller_view import parameters_by_path
from codegen.emit.dynamics_view import ReferenceModelView
from codegen.emit.map_view import MapView
from codegen.emit.parameters import Parameter
from codegen.emit.text import Precision, numpy_type


@dataclass(frozen=True)
class ChecksumView:
    """The checksum and the order of its parameters.

    Attributes:
        value: checksum of map, parameters and tyre curves.
        steps: number of four-bit table look-ups in its computation.
        parameters: fields of the parameter structs by their path, in order.
    """

    value: int
    steps: int
    parameters: Mapping[str, Parameter]


def checksum_view(config: Config, precision: Precision, map_view: MapView, model: ReferenceModelView | None) -> ChecksumView:
    """Return the view of a build. Raises BuildError: see `law_of`."""
    parameters = parameters_by_path(config)
    rest = b"".join(_bytes_of(each, precision) for each in parameters.values())
    if model is not None:
        rest += b"".join(_bytes([curve.compression, *curve.values], precision) for curve in model.curves.values())
    return ChecksumView(zlib.crc32(rest, map_view.checksum), 2 * map_view.flash_bytes + 2 * len(rest), parameters)


def _bytes_of(parameter: Parameter, precision: Precision) -> bytes:
    return parameter.value.to_bytes(2, "little") if isinstance(parameter.value, int) else _bytes(parameter.values, precision)


def _bytes(values: Iterable[float], precision: Precision) -> bytes:
    """Return the bytes of numbers in the target's precision, least significant byte first."""
    numbers = np.array(list(values), dtype=numpy_type(precision))
    return numbers.astype(numbers.dtype.newbyteorder("<")).tobytes()

"""View model of the checksum over a build's calibration: the CRC-32 of the C, computed from the numbers in Python."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from codegen.configuration import Config
from codegen.emit.controller_view import ControllerView, parameters_by_path
from codegen.emit.dynamics_view import ReferenceModelView
from codegen.emit.inputs_view import InputsView
from codegen.emit.limiter_view import LimiterView
from codegen.emit.map_view import MapView
from codegen.emit.parameters import Parameter, ParameterView
from codegen.emit.text import Precision, numpy_type


@dataclass(frozen=True)
class ChecksumView:
    """The checksum and the order of its parameters.

    Attributes:
        map: checksum of the map alone, as a C literal.
        whole: checksum of map, parameters and tyre curves, as a C literal.
        value: `whole` as a number.
        steps: number of four-bit table look-ups in its computation.
        parameters: fields of the parameter structs in order. The name of a field in a nested struct contains its path.
        has_arrays: whether one of the parameters is an array.
    """

    map: str
    whole: str
    value: int
    steps: int
    parameters: tuple[ParameterView, ...]
    has_arrays: bool


def checksum_view(
    config: Config,
    precision: Precision,
    map_view: MapView,
    controller: ControllerView,
    inputs: InputsView,
    limiter: LimiterView,
    model: ReferenceModelView | None,
) -> ChecksumView:
    """Return the view of a build. Raises BuildError: see `law_of`."""
    fields = (
        *controller.parameters,
        *(replace(view, name=f"inputs.{view.name}") for view in inputs.parameters),
        *(replace(view, name=f"limiter.{view.name}") for view in limiter.parameters),
    )
    rest = _bytes_of_parameters(parameters_by_path(config).values(), precision)
    if model is not None:
        rest += b"".join(_bytes([tyre.compression_value, *tyre.values], precision) for tyre in (model.front, model.rear))
    value = zlib.crc32(rest, map_view.checksum_value)
    return ChecksumView(
        map=map_view.checksum,
        whole=f"0x{value:08X}u",
        value=value,
        steps=map_view.checksum_steps + 2 * len(rest),
        parameters=fields,
        has_arrays=any(view.points for view in fields),
    )


def _bytes_of_parameters(parameters: Iterable[Parameter], precision: Precision) -> bytes:
    parts = []
    for parameter in parameters:
        if isinstance(parameter.value, int):
            parts.append(parameter.value.to_bytes(2, "little"))
        else:
            values = parameter.value if isinstance(parameter.value, tuple) else (parameter.value,)
            parts.append(_bytes(values, precision))
    return b"".join(parts)


def _bytes(values: Iterable[float], precision: Precision) -> bytes:
    """Return the bytes of numbers in the target's precision, least significant byte first."""
    numbers = np.array(list(values), dtype=numpy_type(precision))
    return numbers.astype(numbers.dtype.newbyteorder("<")).tobytes()

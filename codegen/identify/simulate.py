"""Compiled simulation of a model over segments, with derivatives, on all processors."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from codegen.arrays import FloatArray, IntArray
from codegen.emit.casadi_c import function_body
from codegen.emit.render import render
from codegen.identify.model import ShootingModel
from codegen.sil.compile import Library, compile_library

FLAGS = ("-O3",)


def sources(model: ShootingModel) -> dict[str, bytes]:
    """Return shooting.h and shooting.c of a model."""
    functions = (model.initial, model.derivative, model.slopes, model.output, model.output_slopes)
    context = {
        "model": {
            **{name: len(getattr(model, name)) for name in ("states", "starts", "inputs", "outputs", "parameters")},
            "functions": [
                {
                    "name": function.name(),
                    "first": function.name_in(0),
                    "outputs": [function.name_out(k) for k in range(function.n_out())],
                    "body": function_body(function, "double"),
                }
                for function in functions
            ],
        }
    }
    return {name: render(f"identify/{name}.j2", context) for name in ("shooting.h", "shooting.c")}


@lru_cache(maxsize=8)
def library_of(model: ShootingModel) -> Library:
    """Return the compiled model. Raises BuildError if there is no compiler."""
    return compile_library(model.name, sources(model), ["shooting.h"], include_folders=(".",), unit_flags={"shooting.c": FLAGS})


@dataclass(frozen=True, eq=False)
class Normal:
    """Cost and normal equations of m segments, by k parameters and s free initial states.

    Attributes:
        cost: (m,). gradient: (m, k + s). hessian: (m, k + s, k + s).
    """

    cost: FloatArray
    gradient: FloatArray
    hessian: FloatArray


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulation of m segments.

    Attributes:
        first, length: (m,) first sample and number of samples of each segment.
        substeps: integration steps in a sample. step: s, between samples.
        parameters, constants: p and c of the model.
        starts: (m, starts) free initial states.
        inputs: (samples * substeps * 3, inputs), as `shooting.h` describes.
    """

    model: ShootingModel
    first: IntArray
    length: IntArray
    substeps: int
    step: float
    parameters: FloatArray
    constants: FloatArray
    starts: FloatArray
    inputs: FloatArray

    def output(self) -> FloatArray:
        """Return the outputs (rows, outputs) of all segments, stacked. Raises BuildError without a compiler."""
        result = np.empty((int(self.length.sum()), len(self.model.outputs)))
        self._run("shooting_simulate", lambda row, _: (result[row:], None))
        return result

    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """Return the outputs, and their derivatives (rows, outputs, parameters + starts) by the parameters and by the free
        initial states of the row's own segment."""
        columns = len(self.model.parameters) + len(self.model.starts)
        result = np.empty((int(self.length.sum()), len(self.model.outputs)))
        slope = np.empty((*result.shape, columns))
        self._run("shooting_simulate", lambda row, _: (result[row:], slope[row:]))
        return result, slope

    def normal(self, measured: FloatArray, weight: FloatArray, scale: FloatArray, huber: float, average: int) -> Normal:
        """Return cost and normal equations.

        Args:
            measured: (rows, outputs), NaN where not compared. weight: (outputs,) or (m, outputs) 1 / noise.
            scale: (k,) factor of the derivatives by the parameters.
            huber: multiple of the noise beyond which an error counts linearly.
            average: number of samples whose mean error counts.
        """
        count, columns = len(self.first), len(self.model.parameters) + len(self.model.starts)
        found = Normal(np.empty(count), np.empty((count, columns)), np.empty((count, columns, columns)))
        measured, scale = np.ascontiguousarray(measured), np.ascontiguousarray(scale)
        weight = np.ascontiguousarray(np.broadcast_to(weight, (count, len(self.model.outputs))))
        given = scale, huber, average
        results = found.cost, found.gradient, found.hessian
        self._run("shooting_normal", lambda row, k: (measured[row:], weight[k:], *given, *(each[k:] for each in results)))
        return found

    def _run(self, name: str, rest: Callable[[int, int], tuple[Any, ...]]) -> None:
        """Call a function of the library on all processors; `rest` returns its last arguments from a row and a segment on."""
        library = library_of(self.model)
        cast, function = library.ffi.cast, getattr(library.lib, name)
        first, length = self.first.astype(np.intc), self.length.astype(np.intc)
        parameters, constants, starts, inputs = (
            np.ascontiguousarray(each, dtype=np.float64) for each in (self.parameters, self.constants, self.starts, self.inputs)
        )

        def pointer(value: Any) -> Any:
            if value is None:
                return library.ffi.NULL
            if isinstance(value, float | int):
                return value
            return cast("int *" if value.dtype == np.intc else "double *", value.ctypes.data)

        offsets = np.concatenate([[0], np.cumsum(length)])

        def run(part: tuple[int, int]) -> None:
            low, high = part
            given = (first[low:], length[low:])
            more = (parameters, constants, starts[low:], inputs, *rest(int(offsets[low]), low))
            function(high - low, *map(pointer, given), self.substeps, self.step, *map(pointer, more))

        workers = min(os.cpu_count() or 1, len(first))
        cuts = np.searchsorted(offsets, np.linspace(0, offsets[-1], workers + 1))
        parts = [(int(low), int(high)) for low, high in pairwise(cuts) if high > low]
        if len(parts) == 1:
            run(parts[0])
            return
        with ThreadPoolExecutor(len(parts)) as pool:
            list(pool.map(run, parts))

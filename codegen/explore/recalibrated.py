"""The generated C, compiled once, with the numbers of any settings, so that no compiler runs while a slider moves.

The numbers of the map and the parameters are in `ars_calibration.c`, behind symbols that the compiler cannot see through. This
copy puts them into writable sections. A test checks that it computes the same bits as a fresh build of the same settings.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import Lookup
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.constants import constants_of
from codegen.emit.controller_view import parameters_by_path
from codegen.emit.laws import law_of
from codegen.errors import BuildError
from codegen.map_file.map import ReferenceMap
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.compile import DEFAULT_FLAGS, Library, compile_library
from codegen.sil.software import Software, bench_sources, writable_flags

PREFIX = "ars"

_CONSTANTS_H = f"""#include "{PREFIX}_constants.h"
{PREFIX}_constants_t *writable_constants(void);
"""
_CONSTANTS_C = f"""#include "constants.h"
{PREFIX}_constants_t *writable_constants(void) {{ return ({PREFIX}_constants_t *)&{PREFIX}_constants; }}
"""

_using = threading.RLock()
"""Held while the numbers are written and used: they are global in the library, of which a process has only one."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """All numbers of one configuration.

    Attributes:
        config: the configuration.
        total: its map over the whole domain of an ECU.
        tables: name in C -> values, in single precision.
        constants: fields of the C struct of constants.
        parameters: numbers of the C struct of parameters by their path.
    """

    config: Config
    total: TotalMap
    tables: Mapping[str, npt.NDArray[np.float32]]
    constants: Mapping[str, float]
    parameters: Mapping[str, float | tuple[float, ...]]

    @classmethod
    def of(cls, total: TotalMap, config: Config) -> Calibration:
        """Return the values for a total map and its configuration. Raises BuildError: see `law_of`."""
        law = law_of(config)
        lookup = Lookup.from_map(total, np.float32)
        tables = {"yaw_rate_table": lookup.table}
        if law.uses_rear_angle:
            tables["rear_angle_table"] = lookup.rear_tables[lookup.own]
        return cls(
            config,
            total,
            tables,
            {each.name: each.values[0] for each in constants_of(config, total, lookup)},
            {path: each.value for path, each in parameters_by_path(config).items()},
        )


class Recalibrated:
    """The C of a map and a configuration, for any settings of the same car, grid and kind of controller.

    Raises:
        BuildError: there is no compiler, or the C does not compile here.
    """

    def __init__(self, reference_map: ReferenceMap, config: Config) -> None:
        inputs = BuildInputs("map.npz", "0" * 64, "map")
        files = build(reference_map, config, BuildOptions("explore", PREFIX), inputs).files
        sources = {path: content for path, content in files.items() if path.startswith(("include/", "src/"))}
        sources |= bench_sources(config, PREFIX, "single")
        sources |= {"bench/constants.h": _CONSTANTS_H.encode(), "bench/constants.c": _CONSTANTS_C.encode()}
        public = [path for path in sources if path.startswith("include/") and not path.endswith("_sections.h")]
        self.library: Library = compile_library(
            f"{PREFIX}_explore",
            sources,
            [*public, "bench/plant.h", "bench/loop.h", "bench/constants.h"],
            include_folders=("include", "bench"),
            flags=(*DEFAULT_FLAGS, *writable_flags(PREFIX)),
        )
        self._software = Software(self.library, PREFIX, "single", config)

    def run(self, calibration: Calibration, inputs: FloatArray, *, controlled: bool = True) -> FloatArray:
        """Return a recording (samples, 12) from rest, columns RECORD_COLUMNS; inputs as in `ClosedLoop.run`.

        Raises:
            BuildError: the C rejects the numbers.
        """
        with _using:
            parameters = self._take(calibration)
            software = replace(self._software, config=calibration.config)
            return ClosedLoop(software, LoopOptions(controlled=controlled, parameters=parameters)).run(inputs)

    def _take(self, calibration: Calibration) -> Any:
        ffi, lib = self.library.ffi, self.library.lib
        for name, values in calibration.tables.items():
            table = getattr(lib, f"{PREFIX}_map_{name}")
            buffer = ffi.buffer(ffi.addressof(table), ffi.sizeof(table))
            np.frombuffer(buffer, dtype=np.float32)[:] = values.ravel()
        parameters = self._software.parameters()
        for name, constant in calibration.constants.items():
            setattr(lib.writable_constants(), name, constant)
        for path, value in calibration.parameters.items():
            *structs, name = path.split(".")
            setattr(functools.reduce(getattr, structs, parameters), name, value)
        if not (lib.ars_map_valid() and lib.ars_parameters_valid(parameters)):
            raise BuildError("the generated code rejects these settings", remedy="undo the last change")
        return parameters

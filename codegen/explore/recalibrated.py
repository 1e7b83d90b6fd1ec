"""The generated C, compiled once, with the numbers of any setting: no compiler runs while a slider moves.

Tables and breakpoints of the map are calibration and the gains are parameters: both can be written as they are. Some numbers
that follow from limits and friction are constants in the C, so that the compiler may use them. In the explorer's copy, and in
no other, these few become variables; that the copy then computes what a fresh build of the same setting computes, bit for bit,
is tested.
"""

from __future__ import annotations

import re
import sys
import threading
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.ecu_map.extend import TotalMap, extend
from codegen.ecu_map.lookup import Lookup
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.controller_view import controller_view
from codegen.emit.inputs_view import inputs_view
from codegen.emit.laws import law_of
from codegen.emit.limiter_view import limiter_view
from codegen.emit.parameters import ParameterView
from codegen.emit.text import literal
from codegen.errors import BuildError
from codegen.map_file.map import ReferenceMap
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.compile import DEFAULT_FLAGS, Library, compile_library
from codegen.sil.software import Software, bench_sources
from codegen.vehicle.single_track import SingleTrack

FloatArray = npt.NDArray[np.float64]
Numbers = Mapping[str, float]

PREFIX = "ars"
HEADER = "explore.h"
# Of a name that linkers put among the data that may be written, though each object is const.
_SECTION = "__DATA,ars_calib" if sys.platform == "darwin" else ".data.calibration"
WRITABLE = f'-DARS_SECTION_CALIBRATION=__attribute__((section("{_SECTION}")))'

_MAP = ("lateral_acceleration_cap", "lateral_acceleration_cap_per_friction", "map_friction")
_MAP_STEERING = ("understeer_coefficient", "rear_slip_per_lateral_acceleration", "sideslip_max", "rear_angle_max")
_GRIP = ("grip_max", "friction_per_grip")

_using = threading.RLock()
"""The numbers are the library's own, and a process has one library of a name: who writes them runs with them."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """All numbers of one setting.

    Attributes:
        config: the setting.
        total: its map over the whole domain of an ECU.
        tables: name in C -> values, single precision.
        constants: name in the explorer's copy -> value.
        parameters: the C parameter struct's fields; `inputs` and `limiter` those of the structs inside it.
    """

    config: Config
    total: TotalMap
    tables: Mapping[str, npt.NDArray[np.float32]]
    constants: Numbers
    parameters: Mapping[str, Any]
    inputs: Mapping[str, Any]
    limiter: Mapping[str, Any]

    @classmethod
    def of(cls, total: TotalMap, config: Config) -> Calibration:
        """Return the values for a total map and its configuration. Raises BuildError: see `law_of`."""
        law = law_of(config)
        lookup = Lookup.from_map(total, np.float32)
        tables = {"yaw_rate_table": lookup.table}
        if law.uses_rear_angle:
            tables["rear_angle_table"] = lookup.rear_tables[-1]
        view = controller_view(config, total, PREFIX, "single", "float")
        inputs = inputs_view(config, PREFIX, "single", "float")
        limiter = limiter_view(config, PREFIX, "single", "float")
        constants = dict(
            zip(_MAP, (lookup.caps[-1], lookup.lateral_acceleration_cap_per_friction, lookup.friction), strict=True)
        )
        if law.uses_rear_angle:
            steering = lookup.cars[-1]
            constants |= zip(
                _MAP_STEERING,
                (steering.understeer_coefficient, steering.rear_slip, steering.sideslip_max, steering.rear_angle_max),
                strict=True,
            )
        if law.uses_reference_model:
            constants |= {name: _number(literal(getattr(view.grip, name), "single")) for name in _GRIP}
            constants["rear_slip"] = SingleTrack.from_config(config).rear_slip_per_lateral_acceleration
        return cls(
            config,
            total,
            tables,
            {name: float(x) for name, x in constants.items()},
            _fields(view.parameters),
            _fields(inputs.parameters),
            _fields(limiter.parameters),
        )


def _fields(views: tuple[ParameterView, ...]) -> dict[str, Any]:
    return {view.name: _value(view.value) for view in views}


def _value(text: str) -> float | int | list[float]:
    """Parse a C initialiser. The view's own text is the only source of a parameter's value."""
    if text.startswith("{"):
        return [_number(part) for part in text.strip("{} \n").replace("\n", " ").split(",")]
    return int(text.removesuffix("u")) if text.endswith("u") else _number(text)


def _number(text: str) -> float:
    return float(text.strip().removesuffix("f"))


class Recalibrated:
    """The C of a map and a configuration, ready for any setting of the same car, grid and kind of controller.

    Raises:
        BuildError: there is no compiler, or the C does not compile here.
    """

    def __init__(self, reference_map: ReferenceMap, config: Config) -> None:
        inputs = BuildInputs("map.npz", "0" * 64, "map")
        files = build(reference_map, config, BuildOptions("explore", PREFIX), inputs).files
        sources = {path: content for path, content in files.items() if path.startswith(("include/", "src/"))}
        total = extend(reference_map, config, config.steering.front_angle_stop)
        names = Calibration.of(total, config).constants
        sources = _with_variables(sources, tuple(names))
        sources |= bench_sources(config, PREFIX, "single")
        public = [path for path in sources if path.startswith("include/") and not path.endswith("_sections.h")]
        self.library: Library = compile_library(
            f"{PREFIX}_explore",
            sources,
            [*public, "bench/plant.h", "bench/loop.h"],
            include_folders=("include", "bench"),
            flags=(*DEFAULT_FLAGS, WRITABLE),
        )
        self._software = Software(self.library, PREFIX, "single", config)

    def run(self, calibration: Calibration, inputs: FloatArray, *, controlled: bool = True) -> FloatArray:
        """A recording (samples, 12) from rest, columns RECORD_COLUMNS; inputs as of `ClosedLoop.run`.

        Raises:
            BuildError: the C itself refuses the numbers.
        """
        with _using:
            parameters = self._take(calibration)
            software = replace(self._software, config=calibration.config)
            return ClosedLoop(software, LoopOptions(controlled=controlled, parameters=parameters)).run(inputs)

    def look_up(self, calibration: Calibration, speed: float, front_angle: FloatArray) -> npt.NDArray[np.float32]:
        """Yaw rate in rad/s as the C looks it up, for a speed in m/s and front angles (n,) in rad."""
        with _using:
            self._take(calibration)
            result: npt.NDArray[np.float32] = self._software.map_yaw_rate(speed, front_angle)
            return result

    def _take(self, calibration: Calibration) -> Any:
        ffi, lib = self.library.ffi, self.library.lib
        for name, values in calibration.tables.items():
            table = getattr(lib, f"{PREFIX}_map_{name}")
            buffer = ffi.buffer(ffi.addressof(table), ffi.sizeof(table))
            np.frombuffer(buffer, dtype=np.float32)[:] = values.ravel()
        for name, value in calibration.constants.items():
            setattr(lib.explore, name, value)
        parameters = self._software.parameters()
        structs = (parameters, parameters.inputs, parameters.limiter)
        given = (calibration.parameters, calibration.inputs, calibration.limiter)
        for struct, fields in zip(structs, given, strict=True):
            for name, value in fields.items():
                setattr(struct, name, value)
        if not (lib.ars_map_valid() and lib.ars_parameters_valid(parameters)):
            raise BuildError("the generated code refuses these settings", remedy="go back a step")
        return parameters


def _with_variables(sources: Mapping[str, bytes], names: Collection[str]) -> dict[str, bytes]:
    """The sources with the named constants taken from a struct `explore`.

    Raises:
        BuildError: a name is no constant in them, or the name of two.
    """
    result, found = dict(sources), Counter[str]()
    for path in (path for path in sources if path.startswith("src/")):
        text = sources[path].decode("ascii")
        for name in names:
            text, count = _with_variable(text, name)
            found[name] += count
        if text.encode("ascii") != sources[path]:
            result[path] = f'#include "{HEADER}"\n{text}'.encode("ascii")
    wrong = sorted(name for name in names if found[name] != 1)
    if wrong:
        raise BuildError(f"not one constant of the generated code: {', '.join(wrong)}", where="codegen.explore")
    members = "".join(f"    float {name};\n" for name in names) or "    float none;\n"
    declared = f"typedef struct {{\n{members}}} explore_t;\nextern explore_t explore;\n"
    result[f"include/{HEADER}"] = f"#ifndef EXPLORE_H\n#define EXPLORE_H\n{declared}#endif\n".encode("ascii")
    result["src/explore.c"] = f'#include "{HEADER}"\nexplore_t explore;\n'.encode("ascii")
    return result


def _with_variable(text: str, name: str) -> tuple[str, int]:
    """A source with one constant made a variable, and how many definitions there were: of a file, or inside a function."""
    text, of_file = re.subn(rf"^ARS_SECTION_CONST static const float {name} = [^;]+;.*\n", "", text, flags=re.MULTILINE)
    if of_file:
        text = re.sub(rf"(?<![\w.>]){name}\b", f"explore.{name}", text)
    text, inside = re.subn(rf"^( +const float {name} = )[^;]+;", rf"\g<1>explore.{name};", text, flags=re.MULTILINE)
    return text, of_file + inside

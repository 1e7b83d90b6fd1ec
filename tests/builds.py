"""Builds under test: each a map, its rendered folder and the compiled software.

A build is rendered and compiled on first use. All workers share its files (see `tests.shared`), and its compiled library
through the cache of `codegen.sil.compile`; a lock prevents two workers from compiling the same one.
"""

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from codegen import configuration
from codegen.configuration import Config, Kind
from codegen.ecu_map.extend import TotalMap, extend
from codegen.ecu_map.lookup import Lookup
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder, render_manifest
from codegen.emit.text import Precision
from codegen.map_file import map as refmap
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case, solve_stack
from codegen.sil.software import Measurement, Software, compile_build
from tests import shared

CONFIG = configuration.preset()
SCHEDULE = {
    "speed_km_h": [25.0, 42.5, 60.0, 80.0, 100.0, 120.0],
    "proportional_gain_s": [0.035, 0.05, 0.065, 0.08, 0.095, 0.109],
    "integral_gain": [1.74, 1.5, 1.2, 0.95, 0.78, 0.64],
    "lead_s": [-0.02, 0.03, 0.06, 0.05, 0.04, 0.05],
    "response_gain_s": [0.0, 0.15, 0.12, 0.08, 0.1, 0.05],
}
"""A schedule similar to that of `codegen tune`; fixed, so that no test depends on the design."""


LIMITER = {"rear_rate_max_deg_s": 40.0, "opposite_phase_speed_km_h": [60.0, 120.0], "opposite_phase_max_deg": [3.5, 1.5]}
"""Round numbers, so that a test can state its expectation."""


def _of_kind(kind: Kind) -> Config:
    """Return the recommended configuration, limiter and rate limit on, with another kind of controller, on the ideal plant."""
    data = configuration.preset("recommended").with_ideal_plant().model_dump()
    data["controller"]["kind"] = kind
    data["controller"]["tracking"]["schedule"] = SCHEDULE
    data["limiter"].update(LIMITER)
    return Config.model_validate(data)


CONFIGS: dict[Kind, Config] = {kind: CONFIG if kind == "pi" else _of_kind(kind) for kind in get_args(Kind)}
"""By kind; the PI is the paper's, without rate limit and limiter."""
TRACKING_CONFIG, FEEDFORWARD_CONFIG = CONFIGS["tracking"], CONFIGS["feedforward"]
PRECISIONS: tuple[Precision, ...] = ("single", "double")
SPEED, FRONT_ANGLE = 15.0, 0.07
"""m/s and rad: inside the solved part of the map, below the hold speed, far above standby."""


@dataclass(frozen=True, eq=False)
class Built:
    """A build in memory.

    Attributes:
        folder: the generated files. total: the map they contain. compile: returns the compiled C; `software` calls it once.
    """

    folder: Folder
    total: TotalMap
    compile: Callable[[], Software]

    @functools.cached_property
    def software(self) -> Software:
        """The compiled C."""
        return self.compile()

    @functools.cached_property
    def lookup(self) -> Lookup:
        """The NumPy reference in the precision of the build."""
        return Lookup.from_map(self.total, self.software.real)

    @property
    def real(self) -> Any:
        """NumPy type of the numbers."""
        return self.software.real

    @property
    def eps(self) -> float:
        """Spacing of the numbers at 1."""
        return float(np.finfo(self.software.real).eps)

    def next(self, value: float, toward: float) -> float:
        """Return the neighbour of a value in the precision of the build."""
        real = self.software.real
        return float(np.nextafter(real(value), real(toward)))

    def reference(self, speed: float = SPEED, front_angle: float = FRONT_ANGLE) -> float:
        """Return the reference yaw rate in rad/s on the road that the map assumes."""
        return float(self.lookup(speed, front_angle))

    def turn(self, error: float = 0.0, speed: float = SPEED, front_angle: float = FRONT_ANGLE, **others: Any) -> Measurement:
        """Return a turn with a yaw-rate error (rad/s, reference minus measured)."""
        return Measurement(speed, front_angle, self.reference(speed, front_angle) - error, **others)


def render(reference_map: ReferenceMap, config: Config, precision: Precision = "single") -> Folder:
    """Return the generated folder of a map, rendered once per run."""

    def make() -> Folder:
        options, inputs = BuildOptions("sample", precision=precision), BuildInputs("sample.npz", "0" * 64, "preset")
        return build(reference_map, config, options, inputs)

    own = reference_map.config and reference_map.config.model_dump_json()
    content = hashlib.sha256(refmap.to_bytes(reference_map)).hexdigest()
    folder: Folder = shared.once(f"render {precision} {content} {own} {config.model_dump_json()}", make)
    return folder


def make(reference_map: ReferenceMap, config: Config = CONFIG, precision: Precision = "single") -> Built:
    """Return the build of a map."""
    folder = render(reference_map, config, precision)

    def compiled() -> Software:
        with shared.locked(f"compile {hashlib.sha256(render_manifest(folder)).hexdigest()}"):
            return compile_build(folder.files, folder.manifest)

    return Built(folder, extend(reference_map, config), compiled)


@functools.cache
def paper_map() -> ReferenceMap:
    """Return the 4WS-2 map of the paper's car."""
    return solve_case(CONFIG, "4ws-2")


@functools.cache
def paper(precision: Precision = "single") -> Built:
    """Return the paper's build: 4WS-2 map, rate limit off."""
    return make(paper_map(), CONFIG, precision)


@functools.cache
def of_kind(kind: Kind, precision: Precision = "single") -> Built:
    """Return the build of a kind of controller with the paper's 4WS-2 map."""
    return paper(precision) if kind == "pi" else make(paper_map(), CONFIGS[kind], precision)


def altered_folder(folder: Folder, path: str, old: str, new: str) -> Folder:
    """Return a folder with one text in its C replaced. Raises LookupError unless it occurs exactly once."""
    text = folder.files[path].decode("ascii")
    if text.count(old) != 1:
        raise LookupError(f"{path} holds {text.count(old)} times, instead of once: {old}")
    return replace(folder, files={**folder.files, path: text.replace(old, new).encode("ascii")})


def _on_grid(**changes: Any) -> Config:
    return CONFIG.model_copy(update={"grid": CONFIG.grid.model_copy(update=changes)})


def _bare(speed: Any, front_angle: Any, yaw_rate: Any, **more: Any) -> ReferenceMap:
    arrays = {"vx": np.array(speed), "delta_f": np.array(front_angle), "yaw_rate": np.array(yaw_rate), **more}
    return refmap.from_arrays(arrays, "sample")


def _rough(friction: tuple[float, ...] = ()) -> ReferenceMap:
    """Return a map with uneven axes and unrelated values: no neighbour and no layer of a stack can replace another."""
    speed, front_angle = np.array([2.0, 3.0, 7.5, 8.0, 21.0, 40.0]), np.array([0.003, 0.01, 0.02, 0.1, 0.11])
    rng, shape = np.random.default_rng(3), (len(friction), 6, 5)
    ceiling = np.minimum(2.0, 19.0 / speed)[:, np.newaxis]  # the map contract allows 2 g
    yaw_rate = rng.uniform(0.02, 1.0, (6, 5)) * ceiling
    if not friction:
        return _bare(speed, front_angle, yaw_rate)
    more = {"delta_r": rng.uniform(-0.08, 0.08, (6, 5)), "friction": np.array(friction)}
    more["friction_yaw_rate"] = rng.uniform(0.02, 1.0, shape) * ceiling
    more["friction_delta_r"] = rng.uniform(-0.08, 0.08, shape)
    return _bare(speed, front_angle, yaw_rate, **more)


UNEVEN_SPEED = [20.0, 23.0, 30.0, 42.5, 60.0, 61.0, 90.0, 120.0]
UNEVEN_ANGLE = [0.1, 0.5, 1.0, 2.0, 2.5, 4.0, 6.75, 10.0]

UNEVEN: dict[str, Any] = {"speed_breakpoints_km_h": UNEVEN_SPEED, "front_angle_breakpoints_deg": UNEVEN_ANGLE}
MAPS: dict[str, Callable[[], ReferenceMap]] = {
    "paper": paper_map,
    "uneven speed": lambda: solve_case(_on_grid(speed_breakpoints_km_h=UNEVEN_SPEED), "4ws-2"),
    "uneven angle": lambda: solve_case(_on_grid(front_angle_breakpoints_deg=UNEVEN_ANGLE), "4ws-2"),
    "uneven": lambda: solve_case(_on_grid(**UNEVEN), "4ws-2"),
    "two points each": lambda: solve_case(_on_grid(speed_points=2, front_angle_points=2), "4ws-2"),
    "bare 2 x 2": lambda: _bare([5.0, 30.0], [0.02, 0.2], [[0.03, 0.3], [0.1, 0.15]]),
    "one cell": lambda: _bare([0.0, 30.0], [0.0, 0.7], [[0.0, 0.0], [0.0, 0.3]]),
    "even from zero": lambda: _bare(
        np.linspace(0.0, 30.0, 7), np.linspace(0.0, 0.7, 8), np.outer(np.linspace(0.0, 0.3, 7), np.linspace(0.0, 1.0, 8))
    ),
    "rough": _rough,
    "stack": lambda: solve_stack(_on_grid(speed_points=21, front_angle_points=20), "4ws-2", (0.3, 0.5, 0.7, 0.9)),
    "stack of two, uneven": lambda: solve_stack(_on_grid(**UNEVEN), "4ws-2", (0.4, 0.9)),
    "rough stack": lambda: _rough((0.2, 0.21, 0.6)),
}

"""A build with its references, over a library that can be replaced by one with mutated units."""

import ctypes
import functools
import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from codegen import configuration
from codegen.configuration import Config, Kind
from codegen.ecu_map.extend import TotalMap, extend
from codegen.ecu_map.placement import Placed, Request
from codegen.ecu_map.placement_error import MeasuredError
from codegen.ecu_map.storage import Scales, raw_of, values_of
from codegen.ecu_map.total import GripTable
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder, render_manifest
from codegen.map_file import map as refmap
from codegen.sil.software import Software
from codegen.sil.toolchain import compiler_command
from codegen.verify.outcomes import Subject
from tests import builds, shared
from tests.builds import Built
from tests.sil.library import OPTIMISED, Compiler, Opened, Tree, library_of
from tests.sil.units import Units

FAST_FRACTION = 0.15
"""Fraction of the random samples that `make test` uses; the mutation campaign uses all."""
GENERATED = Path(__file__).parents[2] / "generated"
RELAXATIONS_M = {"relaxation": 0.4, "ideal tyres": 0.0}
COMMITTED = {name: GENERATED / name for name in ("4ws2-paper", "4ws2")}


@dataclass(frozen=True)
class Mutated:
    """A mutated unit that replaces one of the build, named by its source path: object, number of the selected mutant, its C."""

    path: str
    object: Path
    number: int
    source: str


@dataclass(eq=False)
class Case:
    """A build under test; `built` and `units` call the library that `opened` holds.

    Attributes:
        sample_fraction: fraction of the random samples of a whole campaign that the judges use.
        kept: results that the judges compute once for a case, by name. known: the same for a build, whichever compiler made it.
    """

    name: str
    tree: Tree
    built: Built
    units: Units
    opened: Opened
    compiler: Compiler
    sample_fraction: float = 1.0
    mutated: Mutated | None = None
    kept: dict[str, Any] = field(default_factory=dict)
    known: dict[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> Kind:
        """Kind of the controller."""
        kind: Kind = self.built.software.config.controller.kind
        return kind

    @property
    def library(self) -> Path:
        """The compiled build."""
        return self.tree.root / "unaltered.so"

    def samples(self, count: int, least: int = 1) -> int:
        """Return how many of `count` random samples the judges use."""
        return max(least, round(self.sample_fraction * count))

    def object(self, source: str) -> Path:
        """Return the object of a source."""
        if self.mutated is not None and source == self.mutated.path:
            return self.mutated.object
        return self.tree.object(source)

    def compile(self) -> None:
        """Compile every source and open the library."""
        self.compiler.compile_all(self.tree)
        self._link(self.library, {})
        self.opened.open(self.library)

    def compile_instead(self, path: str, source: str) -> None:
        """Compile C that replaces a unit into its own library, for `select`. Raises BuildError."""
        changed = self._instead(path)
        changed.with_suffix(".c").write_text(source, encoding="ascii")
        self.compiler.compile(self.tree.root, changed.with_suffix(".c").name, changed)
        self._link(changed.with_suffix(".so"), {path: changed})

    def select(self, path: str, number: int, source: str) -> None:
        """Open the library of `compile_instead` and select one of its mutants, whose C is `source`."""
        changed = self._instead(path)
        self.opened.open(changed.with_suffix(".so"))
        self.mutated = Mutated(path, changed, number, source)
        self.select_in(changed.with_suffix(".so"))

    def select_in(self, library: Path) -> None:
        """Select the mutant in an open library that holds the mutated unit."""
        if self.mutated is not None:
            ctypes.CDLL(str(library)).mutant_select(self.mutated.number)

    def _instead(self, path: str) -> Path:
        return self.tree.root / f"mutants-{Path(path).stem}.o"

    def _link(self, library: Path, instead: Mapping[str, Path]) -> None:
        objects = [instead.get(path) or self.tree.object(path) for path in (*self.tree.units, *self.tree.others)]
        self.compiler.link(objects, library)


_of_builds: dict[str, tuple[Any, dict[str, Any]]] = {}
"""FFI with the types of a build, and results computed once per process, by the hash of build and map. The results hold structs
of the FFI."""


def committed(folder: Path, scratch: Path, compiler: Compiler, changed: Mapping[str, bytes] | None = None) -> Case:
    """Return the uncompiled case of a build on disk, with some files changed and with its map (FOLDER.npz)."""
    subject = Subject.read(folder)
    config = configuration.parse(subject.manifest["configuration"], "manifest.json: configuration")
    facts = {key: fact for key, fact in subject.manifest.items() if key not in ("files", "generator")}
    made = Folder({**subject.files, **(changed or {})}, facts)
    return made_case(subject.name, made, extend(refmap.load(folder.with_suffix(".npz")), config), config, scratch, compiler)


def made_case(name: str, made: Folder, total: TotalMap, config: Config, scratch: Path, compiler: Compiler) -> Case:
    """Return the uncompiled case of a build in memory."""
    tree = Tree.write(made, config, scratch)
    build = hashlib.sha256(render_manifest(made)).hexdigest()
    if build not in _of_builds:
        _of_builds[build] = (tree.ffi(), {})
    ffi, known = _of_builds[build]
    library, opened = library_of(tree, ffi)
    options = made.manifest["options"]
    software = Software(library, options["prefix"], options["precision"], config)
    units = Units(made, total, config, library)
    return Case(name, tree, Built(made, total, lambda: software), units, opened, compiler, known=known)


def named(name: str, scratch: Path, compiler: Compiler) -> Case:
    """Return the uncompiled case of a name: a committed build, else "KIND PRECISION" or "KIND MAP" of `tests.builds`.

    A suffix changes how the map is stored, "KIND MAP with int16" or "KIND MAP with grip", or the car, whose tyres otherwise are
    as configured: "KIND PRECISION with relaxation" or "KIND PRECISION with ideal tyres".
    """
    if name in COMMITTED:
        return committed(COMMITTED[name], scratch, compiler)
    plain, _, feature = name.partition(" with ")
    kind, _, which = plain.partition(" ")
    config = builds.CONFIGS[kind]  # type: ignore[index]
    if feature in RELAXATIONS_M:
        config = config.replace({"plant.relaxation_length_m": RELAXATIONS_M[feature]}, name)
    precision: Any = which if which in builds.PRECISIONS else "single"
    reference_map = builds.paper_map() if which in builds.PRECISIONS else builds.MAPS[which]()
    total = extend(reference_map, config)
    if not feature or feature in RELAXATIONS_M:
        return made_case(name, builds.render(reference_map, config, precision), total, config, scratch, compiler)
    total = _with_int16(total) if feature == "int16" else _with_grip(total)
    speeds, angles = ((float(axis[0]), float(axis[-1])) for axis in (reference_map.speed, reference_map.front_angle))
    placed = Placed(total, "uneven", 0, MeasuredError(), (0.0, 0.0), "table", speeds, angles, 1)
    options = BuildOptions("sample", request=Request(1.0, None, "float", ""))
    with mock.patch("codegen.emit.build.choose", return_value=placed):
        folder = build(reference_map, config, options, BuildInputs("sample.npz", "0" * 64, "preset"))
    return made_case(name, folder, total, config, scratch, compiler)


def _with_int16(total: TotalMap) -> TotalMap:
    """Return a map as the int16 tables of a build in single precision hold it."""
    scales = Scales.of(float(total.yaw_rate.max()), float(np.abs(total.rear_angle).max()), np.float32)
    stored = {name: values_of(raw_of(getattr(total, name), scale), scale) for name, scale in vars(scales).items()}
    return replace(total, scales=scales, **stored)


def _with_grip(total: TotalMap) -> TotalMap:
    """Return a map whose grip tables leave varied shares of the cap."""
    rng, axes = np.random.default_rng(5), (np.array([0.0, 5.0, 21.0, 50.0]), np.array([0.0, 0.05, 0.1, 0.7]))
    *layers, own = (replace(one, grip=GripTable(*axes, rng.uniform(0.2, 1.0, (4, 4)))) for one in total.stack)
    return replace(own, layers=tuple(layers))


def compiled(name: str, make: Callable[[Path, Compiler], Case]) -> Case:
    """Return a case in a folder of this process, compiled with the flags for use."""
    scratch = shared.folder() / f"case {name} {os.getpid()}"
    scratch.mkdir()
    found = make(scratch, Compiler(compiler_command(), OPTIMISED))
    found.sample_fraction = FAST_FRACTION
    found.compile()
    return found


@functools.cache
def case(name: str) -> Case:
    """Return the compiled case of a name; one per process."""
    return compiled(name, functools.partial(named, name))

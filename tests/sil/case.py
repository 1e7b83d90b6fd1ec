"""A committed build with what its tests hold it against, over a library that can be changed for one with a mutant."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.can_view import task_name
from codegen.emit.folder import Folder, render_manifest
from codegen.refmap import map as refmap
from codegen.refmap.extend import extend
from codegen.sil.software import Software
from codegen.verify.check import Subject
from tests.builds import CONFIGS, Built
from tests.sil.library import Compiler, Opened, Tree, library_of
from tests.sil.units import Units


@dataclass(frozen=True, eq=False)
class Case:
    """A build under test.

    Attributes:
        name: of its folder. tree: its sources and objects.
        built, units: as the tests take them; both call whatever `opened` has open.
        compiler: for all of it.
        instead: objects that take the place of the tree's own, by the path of the source.
        kept: what is made once for the tests of this case, by name.
        known: what is worked out once for the tests of this build, whoever compiles it, by name.
    """

    name: str
    tree: Tree
    built: Built
    units: Units
    opened: Opened
    compiler: Compiler
    instead: dict[str, Path] = field(default_factory=dict)
    kept: dict[str, Any] = field(default_factory=dict)
    known: dict[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """Of the controller."""
        return self.built.software.config.controller.kind

    @property
    def task_function(self) -> str:
        """Name of the C function that is the cyclic task."""
        software = self.built.software
        return f"{software.prefix}_{task_name(software.config.controller.sampling_time_s)}"

    def object(self, source: str) -> Path:
        """What a source was compiled to."""
        return self.instead.get(source) or self.tree.object(source)

    def open(self, path: Path) -> None:
        """Link what is compiled to a library, and let the tests call that."""
        self.compiler.link([self.object(source) for source in (*self.tree.units, *self.tree.others)], path)
        self.opened.open(path)


_of_builds: dict[str, tuple[Any, dict[str, Any]]] = {}
"""By the hash of a build and its map: the FFI that knows its types, and what is worked out for it, once a process. The second
holds structs of the first."""


def case_of(folder: Path, scratch: Path, compiler: Compiler, changed: Mapping[str, bytes] | None = None) -> Case:
    """The build in a folder, with the map beside it (FOLDER.npz), written to a scratch folder and not yet compiled.

    Args:
        changed: files with another content than the folder's.
    """
    subject = Subject.read(folder)
    config = configuration.parse(subject.manifest["configuration"], "manifest.json: configuration")
    made = Folder(
        {**subject.files, **(changed or {})},
        {key: fact for key, fact in subject.manifest.items() if key not in ("files", "generator")},
    )
    tree = Tree.write(made, config, scratch)
    numbers = folder.with_suffix(".npz")
    build = hashlib.sha256(render_manifest(made) + numbers.read_bytes()).hexdigest()
    if build not in _of_builds:
        _of_builds[build] = (tree.ffi(), {})
    ffi, known = _of_builds[build]
    library, opened = library_of(tree, ffi)
    total = extend(refmap.load(numbers), config)
    options = subject.manifest["options"]
    software = Software(library, options["prefix"], options["precision"], config)
    units = Units(made, total, limited(config))
    units.__dict__["library"] = library  # in place of the one that it would compile
    return Case(subject.name, tree, Built(made, total, software), units, opened, compiler, known=known)


def limited(config: Config) -> Config:
    """The configuration with a limiter that has something to do, of as many breakpoints: its parameters are arguments."""
    points = len(config.limiter.opposite_phase_speed_km_h)
    speeds = [60.0 + 60.0 * k / (points - 1) for k in range(points)]
    angles = [3.5 - 2.0 * k / (points - 1) for k in range(points)]
    own = CONFIGS["tracking"].limiter
    changed = {"rear_rate_max_deg_s": 40.0, "opposite_phase_speed_km_h": speeds, "opposite_phase_max_deg": angles}
    return config.model_copy(update={"limiter": own.model_copy(update=changed)})

"""A build from files: read them, name the build, hash its inputs, and compare or write the result."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder, differences, read_manifest
from codegen.emit.take_over import with_tools
from codegen.emit.text import Precision
from codegen.emit.write import write_folder
from codegen.errors import BuildError, within
from codegen.map_file import archive
from codegen.map_file import map as npz
from codegen.map_file.map import Chosen, ReferenceMap, choose_config


@dataclass(frozen=True)
class Prepared:
    """A rendered build and its inputs.

    Versions of tools are information: a build at the target that differs only in the versions that it names is up to date.
    """

    folder: Folder
    target: Path
    reference_map: ReferenceMap
    chosen: Chosen

    @property
    def recorded_tools(self) -> dict[str, str]:
        """Versions that the build at the target names; those of this build if there are none to compare."""
        own: dict[str, str] = self.folder.manifest["tools"]
        try:
            found: dict[str, str] = read_manifest(self.target)["tools"]
            is_like_own = found.keys() == own.keys() and all(isinstance(each, str) for each in found.values())
        except (BuildError, KeyError, AttributeError):
            return own
        return found if is_like_own else own

    @property
    def other_tools(self) -> list[str]:
        """Tools whose version differs from that in the manifest of the existing build, with both versions."""
        own, recorded = self.folder.manifest["tools"], self.recorded_tools
        return [f"{name} {recorded[name]}, here {own[name]}" for name in own if own[name] != recorded[name]]

    def differences(self) -> list[str]:
        """Return the changes that `write` would make. Raises BuildError: see `codegen.emit.folder.differences`."""
        return differences(with_tools(self.folder, self.recorded_tools), self.target)

    def write(self) -> bool:
        """Write the build unless the target is up to date, and return whether anything changed.

        Raises:
            BuildError: see `write_folder`.
        """
        recorded = with_tools(self.folder, self.recorded_tools)
        return write_folder(self.folder if differences(recorded, self.target) else recorded, self.target)


def prepare(
    map_path: Path,
    config_path: Path | None = None,
    target: Path | None = None,
    prefix: str = "ars",
    precision: Precision = "single",
) -> Prepared:
    """Read the map, choose the configuration and render the build; nothing is written.

    Args:
        target: output folder; by default generated/<stem of the map> in the current folder.

    Raises:
        MapError, ConfigError, BuildError: an input cannot be read, or the build cannot be rendered.
    """
    # The name is checked before the map is read, so that a bad one is reported at once.
    options = BuildOptions(name=map_path.stem, prefix=prefix, precision=precision)
    data = archive.read_map_file(map_path)  # read once, so that the hash is that of the map in use
    reference_map = npz.from_bytes(data, map_path)
    chosen = choose_config(reference_map, config_path)
    return prepare_map(reference_map, data, map_path, chosen, options, target)


def prepare_map(
    reference_map: ReferenceMap, data: bytes, path: Path, chosen: Chosen, options: BuildOptions, target: Path | None = None
) -> Prepared:
    """Render the build of a map whose file at `path` has the content `data`; nothing is written. See `prepare`."""
    inputs = BuildInputs(path.name, hashlib.sha256(data).hexdigest(), chosen.source)
    with within(path):
        folder = build(reference_map, chosen.config, options, inputs)
    return Prepared(folder, target or Path("generated") / path.stem, reference_map, chosen)

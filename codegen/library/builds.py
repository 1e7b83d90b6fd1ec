"""Builds: folders of generated C."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.folder import verify_hashes
from codegen.emit.manifest import read_build
from codegen.library.result import PathLike, Result, path_of, public


class Build(Result):
    """A folder of generated C.

    Attributes:
        folder: the folder.
        manifest: content of its `manifest.json`.
        files: paths of all files, relative to the folder.
        edited: files that were changed after the build.
        config: the configuration of the build.
    """

    def __init__(self, folder: Path, manifest: Mapping[str, Any], files: Iterable[str], edited: tuple[str, ...] = ()) -> None:
        self.folder, self.manifest, self.edited = folder, manifest, edited
        self.files = [*sorted(files), "manifest.json"]
        self.notes: tuple[str, ...] = edited_notes(folder, edited)
        self.warnings: tuple[str, ...] = ()

    @property
    def config(self) -> Config:
        return configuration.parse(self.manifest["configuration"], f"{self.folder}: manifest.json: configuration")

    def lines(self) -> list[str]:
        """Return the number of files and the part of the map that the limiter cuts off."""
        return [*self._headline(""), *self._facts()]

    def _headline(self, state: str) -> list[str]:
        return [f"{self.folder}: {len(self.files)} files{state}; start with {self.folder / 'README.md'}"]

    def _facts(self) -> list[str]:
        return [] if self.manifest["limiter_cut"]["cells"] else ["limiter: it cuts nothing off the map"]

    def to_dict(self) -> dict[str, Any]:
        """Return the files and the facts of the manifest that `codegen build --json` prints."""
        source, cut = self.manifest["inputs"]["configuration"]["source"], self.manifest["limiter_cut"]
        return {"build": str(self.folder), "files": self.files, "configuration": source, "limiter_cut": cut}


def edited_notes(folder: Path, edited: tuple[str, ...]) -> tuple[str, ...]:
    """Return a note for each generated file that was edited."""
    return tuple(f"{folder / path} was changed after the build; the changed file is used" for path in edited)


BuildLike = Build | PathLike
"""A build, or the path of its folder."""


@public
def load_build(folder: PathLike) -> Build:
    """Read a folder made by `build`. Raises CodegenError if it is none."""
    place = path_of(folder, "a build")
    manifest = read_build(place)
    return Build(place, manifest, manifest["files"], tuple(verify_hashes(place)))


def folder_of(given: Any) -> Path:
    """Return the folder of an argument that is a build or its path. Raises CodegenError."""
    return given.folder if isinstance(given, Build) else path_of(given, "a build")

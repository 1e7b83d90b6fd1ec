"""Configurations: read an `ars.toml`, take a preset, or create a file to edit."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast, get_args

from codegen import configuration
from codegen.configuration import Config, Preset, preset_text
from codegen.errors import CodegenError, suggestion
from codegen.files import make_folder, write_atomically
from codegen.library.result import PathLike, Result, path_of, public

ConfigLike = Config | PathLike
"""A configuration, or the path of its `ars.toml`."""


@public
def load_config(path: PathLike) -> Config:
    """Read and check an `ars.toml`. Raises CodegenError with the file, the key and the remedy."""
    return configuration.load(path_of(path, "an ars.toml"))


@public
def preset(name: str = "recommended") -> Config:
    """Return the published car with the "recommended" controller, or with that of the "paper". Raises CodegenError."""
    return configuration.preset(_known(name))


def _known(name: object) -> Preset:
    known = get_args(Preset)
    if name in known:
        return cast(Preset, name)
    raise CodegenError(f"there is no preset {name!r}", remedy=f"known: {', '.join(known)}{suggestion(str(name), known)}")


def known_config(config: ConfigLike) -> Config | Path:
    """Return an argument `config` as a configuration or a path. Raises CodegenError."""
    return config if isinstance(config, Config) else path_of(config, "a configuration")


def given_config(config: ConfigLike | None) -> Config | Path | None:
    """Return an optional argument `config` as `choose_config` takes it. Raises CodegenError."""
    return None if config is None else known_config(config)


def name_of(config: Config | Path) -> str:
    """Return the name of a configuration in messages."""
    return "the configuration" if isinstance(config, Config) else str(config)


@public
def schema() -> dict[str, Any]:
    """Return the JSON Schema of `ars.toml`, for completion in editors. Only `load_config` checks the rules between keys."""
    found = Config.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_untitled(found), "title": "ars.toml"}


def _untitled(found: Any) -> Any:
    """Return a schema without the titles that pydantic derives from the keys."""
    if isinstance(found, list):
        return [_untitled(each) for each in found]
    if not isinstance(found, dict):
        return found
    return {key: _untitled(each) for key, each in found.items() if not (key == "title" and isinstance(each, str))}


class NewConfig(Result):
    """A new `ars.toml` at `path`."""

    def __init__(self, path: Path, name: Preset) -> None:
        self.path, self._name = path, name

    def lines(self) -> list[str]:
        """Return a line with the next command."""
        then = "" if self._name == "paper" else ", codegen tune --map 4ws2.npz -o 4ws2.npz"
        solve = f"codegen solve --config {self.path} --case 4ws-2 -o 4ws2.npz"
        return [f"{self.path}: the paper's vehicle, to edit; next: {solve}{then}"]

    def to_dict(self) -> dict[str, Any]:
        """Return the path."""
        return {"configuration": str(self.path)}


@public
def init(folder: PathLike, preset: str = "recommended") -> NewConfig:
    """Create `folder`/ars.toml, the published vehicle with comments and units, to edit. Raises CodegenError if it exists."""
    name, place = _known(preset), path_of(folder, "a folder")
    path = place / "ars.toml"
    if path.exists() or path.is_symlink():
        raise CodegenError("exists already and was not changed", where=path, remedy="name another folder, or edit that file")
    make_folder(place)
    write_atomically(path, preset_text(name).encode("utf-8"))
    return NewConfig(path, name)

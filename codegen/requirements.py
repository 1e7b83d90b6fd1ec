"""The packages that codegen requires, from `pyproject.toml` or the metadata of the installed distribution."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen import DISTRIBUTION
from codegen.errors import CodegenError

EVERYTHING = "all"
PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


@dataclass(frozen=True)
class Requirement:
    """A package and its accepted versions.

    Attributes:
        bounds: version bounds as written, such as ">=2.4,<3".
        extra: extra that requires it; "" if it is always required.
        features: extras of the package itself, as written.
    """

    name: str
    bounds: str
    extra: str = ""
    features: str = ""

    def __str__(self) -> str:
        return f"{self.name}[{self.features}]{self.bounds}" if self.features else f"{self.name}{self.bounds}"

    def allows(self, version: str) -> bool:
        """Return whether a version is accepted, also a pre-release. One that PEP 440 does not know is not."""
        from packaging.specifiers import SpecifierSet

        return SpecifierSet(self.bounds).contains(version, prereleases=True)


def requirements() -> tuple[tuple[Requirement, ...], str]:
    """Return all requirements, and where they were read. The extra `all`, which only names the others, is omitted."""
    import tomllib
    from importlib.metadata import PackageNotFoundError, metadata

    if PYPROJECT.is_file():  # a checkout: its file is current even if an older one is installed
        project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
        listed = {"": project["dependencies"], **project.get("optional-dependencies", {})}
        return tuple(each for extra, lines in listed.items() for each in _parsed(lines, (extra,))), "pyproject.toml"
    try:
        found = metadata(DISTRIBUTION)
    except PackageNotFoundError:
        return (), "nothing: neither installed nor a checkout"
    extras = ("", *found.get_all("Provides-Extra", []))
    return tuple(_parsed(found.get_all("Requires-Dist", []), extras)), "the installed package"


def _parsed(lines: Iterable[str], extras: Sequence[str]) -> Iterator[Requirement]:
    """Yield the requirements that apply here, each with the first of `extras` that requires it."""
    from packaging.requirements import Requirement as Parsed

    for line in lines:
        read = Parsed(line)
        extra = next((name for name in extras if read.marker is None or read.marker.evaluate({"extra": name})), None)
        if extra is not None and extra != EVERYTHING and read.name != DISTRIBUTION:
            bounds = ",".join(sorted(map(str, read.specifier), reverse=True))
            yield Requirement(read.name, bounds, extra, ",".join(sorted(read.extras)))


def extras_of(requirements: Iterable[Requirement]) -> list[str]:
    """Return the names of the extras, in the order of the requirements."""
    return [extra for extra in dict.fromkeys(each.extra for each in requirements) if extra]


def pip_install(*packages: str) -> str:
    """Return the command that installs packages, with the versions that codegen accepts; the remedy for a missing one."""
    known = {each.name: each for each in requirements()[0]}
    return " ".join(("pip install", *(f'"{known.get(name, name)}"' for name in packages)))


def missing(package: str, purpose: str, where: object) -> CodegenError:
    """Return the error for a missing package; `purpose` is what it does, such as "writes MF4"."""
    return CodegenError(f"{package}, which {purpose}, is missing", where=where, remedy=pip_install(package))


def packages_of(extra: str) -> list[str]:
    """Return the names of the packages of an extra."""
    return [each.name for each in requirements()[0] if each.extra == extra]

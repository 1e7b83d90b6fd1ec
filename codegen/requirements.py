"""The packages that codegen requires, from `pyproject.toml` or the metadata of the installed distribution."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from codegen import DISTRIBUTION
from codegen.errors import CodegenError

EVERYTHING = "all"
PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"

_REQUIREMENT = re.compile(
    r"\s*(?P<name>[A-Za-z0-9][\w.-]*)\s*(?:\[(?P<extras>[^]]*)\])?\s*\(?(?P<bounds>[^;)]*)\)?\s*(?:;(?P<marker>.*))?"
)
_EXTRA = re.compile(r"""extra\s*==\s*['"](?P<extra>[^'"]+)['"]""")
_BOUND = re.compile(r"\s*(?P<operator>>=|<|==|<=|>|!=|~=)\s*(?P<version>[\w.]+)\s*")


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
        """Return whether a version is accepted. Compares only release numbers, which suffices for the bounds that the project
        uses: `>=` and `<`."""
        for bound in filter(None, self.bounds.split(",")):
            match = _BOUND.fullmatch(bound)
            if match is None:
                continue
            here, there = _numbers(version), _numbers(match["version"])
            if match["operator"] == ">=" and here < there:
                return False
            if match["operator"] == "<" and here >= there:
                return False
        return True


def requirements() -> tuple[tuple[Requirement, ...], str]:
    """Return all requirements, and where they were read. The extra `all`, which only names the others, is omitted."""
    import tomllib
    from importlib.metadata import PackageNotFoundError, requires

    if PYPROJECT.is_file():  # a checkout: its file is current even if an older one is installed
        project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
        listed = {"": project["dependencies"], **project.get("optional-dependencies", {})}
        read = (parse(line, extra) for extra, lines in listed.items() if extra != EVERYTHING for line in lines)
        return tuple(read), "pyproject.toml"
    try:
        lines = requires(DISTRIBUTION) or []
    except PackageNotFoundError:
        return (), "nothing: neither installed nor a checkout"
    return tuple(
        each for each in map(parse, lines) if each.extra != EVERYTHING and each.name != DISTRIBUTION
    ), "the installed package"


def parse(line: str, extra: str = "") -> Requirement:
    """Parse a requirement of PEP 508, `casadi<4,>=3.8; extra == "x"`; of the markers only the extra is used."""
    match = _REQUIREMENT.match(line)
    if match is None:
        raise ValueError(f"not a requirement: {line!r}")
    marked = _EXTRA.search(match["marker"] or "")
    bounds = ",".join(sorted(map(str.strip, match["bounds"].split(",")), reverse=True))
    return Requirement(match["name"], bounds, extra or (marked["extra"] if marked else ""), match["extras"] or "")


def extras_of(requirements: Iterable[Requirement]) -> list[str]:
    """Return the names of the extras, in the order of the requirements."""
    return [extra for extra in dict.fromkeys(each.extra for each in requirements) if extra]


def _numbers(version: str) -> tuple[int, ...]:
    """Return the release segment of PEP 440 without trailing zeros: 1.0 is 1."""
    numbers = [int(number) for number in re.match(r"\d*(?:\.\d+)*", version)[0].split(".") if number]  # type: ignore[index]
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


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

"""Python and the packages: which are there, whether they fit, and what each missing extra would add."""

from __future__ import annotations

import importlib
import platform
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version

from codegen.doctor.finding import Finding, State
from codegen.doctor.requirements import Requirement, extras_of
from codegen.errors import one_line

PYTHON = (3, 11)

SERVES = {
    "casadi": "the optimisation, the vehicle models, and their C",
    "cffi": "the generated C in Python",
    "click": "the command line",
    "jinja2": "the templates",
    "matplotlib": "pictures (--plot)",
    "msgpack": "the bus udp_multicast",
    "numpy": "arrays",
    "pycparser": "C declarations",
    "pydantic": "ars.toml",
    "python-can": "buses and their logs",
    "rich": "progress and the live view",
    "scipy": "frequency responses",
    "tomlkit": "editing ars.toml with its comments",
}
"""Purposes of the required packages."""

MODULES = {"python-can": "can"}
"""Names of modules that are not the package's own."""

EXTRAS = {
    "tools": "files of other tools: A2L of a linked program (codegen a2l), MF4 and Parquet (-o, --log), XCP (hil --xcp), the "
    "check of FMUs",
    "crosscheck": "a second plant, a third party's multi-body car, in codegen sil --suite",
    "verify": "codegen verify: compilers for ECU cores, emulated processors, MISRA checks, proofs; --run of codegen firmware "
    "without a cross compiler",
    "report": "codegen report and codegen explore: plots that can be turned, cut and read",
    "sweep": "codegen sweep: campaigns in Parquet, and clusters by Dask",
    "docs": "the guide, built from docs/",
    "dev": "what works on codegen itself: tests, types, lint, packaging",
}
"""Purpose of each extra."""


def python() -> Finding:
    """The interpreter."""
    fits = sys.version_info >= PYTHON
    wanted = ".".join(map(str, PYTHON))
    what = f"{platform.python_version()} ({sys.executable})" + ("" if fits else f"; needed is {wanted} or newer")
    remedy = "" if fits else f"install Python {wanted} or newer, and codegen in it"
    return Finding("Python", State.GOOD if fits else State.BAD, what, "", remedy, needed=True)


def needed(asked: Iterable[Requirement]) -> list[Finding]:
    """The packages that codegen always needs; each is imported, for one can be there and be broken."""
    return [_needed(each) for each in asked if not each.extra]


def extras(asked: Iterable[Requirement]) -> list[Finding]:
    """One finding for each extra: whole, or what is missing and what it would add."""
    listed = tuple(asked)
    return [_extra(name, [each for each in listed if each.extra == name]) for name in extras_of(listed)]


def install(*extras: str) -> str:
    """The command that installs codegen with extras, or as it is."""
    return f'pip install "ars-codegen[{",".join(extras)}]"' if extras else "pip install --force-reinstall ars-codegen"


def _needed(asked: Requirement) -> Finding:
    serves = SERVES.get(asked.name, "")
    remedy = f'pip install "{asked.name}{asked.bounds}"'
    found = _version(asked.name)
    if found is None:
        return Finding(asked.name, State.MISSING, f"not installed; needed is {asked.bounds}", serves, remedy, needed=True)
    if not asked.allows(found):
        return Finding(asked.name, State.BAD, f"{found}; needed is {asked.bounds}", serves, remedy, needed=True)
    try:
        importlib.import_module(MODULES.get(asked.name, asked.name))
    except Exception as error:  # a package that does not fit fails in any way
        what = f"{found} cannot be imported: {one_line(error, 120) or type(error).__name__}"
        again = f'pip install --force-reinstall "{asked.name}{asked.bounds}"'
        return Finding(asked.name, State.BAD, what, serves, again, needed=True)
    return Finding(asked.name, State.GOOD, found, serves, needed=True)


def _extra(name: str, asked: list[Requirement]) -> Finding:
    missing = [each.name for each in asked if _version(each.name) is None]
    others = [(each, found) for each in asked if (found := _version(each.name)) is not None and not each.allows(found)]
    serves = EXTRAS.get(name, "")
    wrong = [f"{each.name} {found} (needed is {each.bounds})" for each, found in others]
    if not missing and not wrong:
        return Finding(name, State.GOOD, f"{len(asked)} package{'s' * (len(asked) != 1)}", serves)
    parts = ([f"without {', '.join(missing)}"] if missing else []) + wrong
    return Finding(name, State.MISSING if missing else State.BAD, "; ".join(parts), serves, install(name))


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None

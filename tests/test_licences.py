"""The table of licences against what the packages say of themselves, and the licences of the project as tools read them."""

from __future__ import annotations

import importlib.metadata
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGE = (ROOT / "THIRD-PARTY-LICENSES.md").read_text(encoding="utf-8")
ROWS = {
    name: (needed, licence)
    for name, needed, licence in re.findall(r"^\| ([a-z0-9-]+) \| ([a-z, ]+) \| (.+) \|$", PAGE, re.MULTILINE)
    if name not in ("package", "files")
}

IN_WORDS = {
    "Apache-2.0": r"Apache Software License|Apache-2\.0",
    "BSD-2-Clause": r"2-Clause BSD|BSD License",
    "BSD-3-Clause": r"BSD License|BSD\b|Copyright.*SciPy",
    "ISC": r"ISC License",
    "LGPL-3.0-or-later": r"LGPLv3",
    "MIT": r"MIT\b",
    "MIT OR Apache-2.0": r"MIT OR Apache-2\.0",
    "PSF-2.0": r"Python Software Foundation License",
    "Public domain": r"Public [Dd]omain",
}
"""How packages write a licence that do not give it as an SPDX expression."""


def asked() -> dict[str, set[str]]:
    """Package -> the extras that need it, "always" for all."""
    found: dict[str, set[str]] = {}
    lists = {"always": PROJECT["dependencies"], **PROJECT["optional-dependencies"]}
    for extra, lines in lists.items():
        for line in lines if extra != "all" else ():
            found.setdefault(re.split(r"[^A-Za-z0-9-]", line)[0].lower(), set()).add(extra)
    return found


def said_by(name: str) -> tuple[str, str]:
    """The SPDX expression of a package's metadata, "" where it has none, and all else it says of its licence."""
    distribution = importlib.metadata.distribution(name)
    metadata = distribution.metadata
    texts = [metadata.get("License") or "", *(each for each in metadata.get_all("Classifier") or () if "License" in each)]
    if not any(texts):  # then the text itself
        files = [file for file in distribution.files or () if "licen" in file.name.lower() and "dist-info" in str(file)]
        texts = [file.read_text() for file in files]
    return metadata.get("License-Expression") or "", "\n".join(texts)


def test_the_table_names_every_package_and_no_other() -> None:
    assert len(ROWS) > 30
    assert {name: set(needed.split(", ")) for name, (needed, _) in ROWS.items()} == asked()


@pytest.mark.parametrize("name", sorted(asked()))
def test_the_licence_of(name: str) -> None:
    try:
        expression, words = said_by(name)
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(f"{name} is not installed")
    _, told = ROWS[name]
    if expression:
        assert told == expression
    else:
        assert re.search(IN_WORDS[told], words), words[:200]


def test_a_wrong_line_would_be_seen() -> None:
    _, words = said_by("casadi")
    assert not re.search(IN_WORDS["MIT"], words)
    assert not re.search(IN_WORDS["BSD-3-Clause"], words)


def test_the_projects_own_licence_is_the_mit_text_alone() -> None:
    lines = (ROOT / "LICENSE").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "MIT License"
    assert lines[2].startswith("Copyright (c) ")
    assert lines[-1] == "SOFTWARE."
    assert len(lines) == 21
    assert PROJECT["license"] == "MIT"


def test_the_licence_of_the_output_asks_for_nothing() -> None:
    text = (ROOT / "LICENSE-OUTPUT").read_text(encoding="utf-8")
    assert text.startswith("BSD Zero Clause License")
    assert "provided that" not in text
    assert "LICENSE-OUTPUT" in PAGE


def test_what_ships_in_a_build_has_a_line() -> None:
    """Every kind of file of the committed builds is named in the table of generated files."""
    table = PAGE.partition("## What covers")[2].partition("What a compiler adds")[0]
    for build in ("4ws2", "4ws2-tracking"):
        for path in (ROOT / "generated" / build).rglob("*"):
            place = path.relative_to(ROOT / "generated" / build)
            if path.is_file():
                names = (f"`{place.parts[0]}/`", f"`{place.name}`", f"`*{place.suffix}`")
                assert any(name in table for name in names), place

"""What CONTRIBUTING.md and the changelog say, as far as it can be looked up."""

from __future__ import annotations

import re
from pathlib import Path

import codegen
from codegen.cli import commands
from codegen.verify import runner

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")

INVENTED = ("identity.h", "law/straight", "verify/ascii", "cases_command", "build/", "dist/")
"""In the examples, or made by make."""


def test_every_file_that_it_names_is_there() -> None:
    named = set(re.findall(r"`((?:codegen|templates|hil_sim|tests|generated|docs|benchmarks)/[\w./*-]*)`", PAGE))
    assert len(named) > 25
    for name in named:
        if not any(word in name for word in INVENTED):
            assert list(ROOT.glob(name.rstrip("/"))), name


def test_the_names_in_those_files_are_there() -> None:
    for name, file in re.findall(r"`([A-Z_]{4,})`[^`]{0,30} (?:of|in) `((?:codegen|hil_sim|tests)/[\w./]+\.py)`", PAGE):
        assert re.search(rf"^{name}\b", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), (name, file)
    assert runner.CHECKS
    assert runner.SLOWEST_FIRST
    assert commands.MODULES


def test_its_links_lead_somewhere() -> None:
    for text in (PAGE, CHANGELOG, (ROOT / "THIRD-PARTY-LICENSES.md").read_text(encoding="utf-8")):
        for target in re.findall(r"\]\(([^)#]+)\)", text):
            assert target.startswith("https://") or (ROOT / target).is_file(), target


def test_the_changelog_keeps_the_form_of_keep_a_changelog() -> None:
    """https://keepachangelog.com/en/1.1.0/"""
    versions = re.findall(r"^## \[([^]]+)\](?: - \d{4}-\d\d-\d\d)?$", CHANGELOG, re.MULTILINE)
    assert versions[0] == "Unreleased"
    assert len(re.findall(r"^## ", CHANGELOG, re.MULTILINE)) == len(versions)
    kinds = re.findall(r"^### (.+)$", CHANGELOG, re.MULTILINE)
    assert set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert codegen.__version__ == "0.1.0" or codegen.__version__ in versions

"""Project files other than code: licences, lock file, CONTRIBUTING.md, Makefile and scripts/preflight.sh."""

import importlib.metadata
import itertools
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
EXTRAS = {name: lines for name, lines in PROJECT["optional-dependencies"].items() if name != "all"}
LOCK, RUN_LOCK = ((ROOT / name).read_text(encoding="utf-8") for name in ("requirements.lock", "requirements-run.lock"))
LICENCES = (ROOT / "THIRD-PARTY-LICENSES.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
FOUND = re.findall(r"^\| ([a-z0-9-]+) \| ([a-z, ]+) \| (.+) \|$", LICENCES, re.MULTILINE)
ROWS = {name: (needed, licence) for name, needed, licence in FOUND if name not in ("package", "files")}
# Licence wording of packages without an SPDX expression.
IN_WORDS = {"BSD-2-Clause": r"2-Clause BSD|BSD License", "BSD-3-Clause": r"BSD License|BSD\b|Copyright.*SciPy"}
IN_WORDS |= {"Apache-2.0": r"Apache Software License|Apache-2\.0", "PSF-2.0": r"Python Software Foundation License"}
IN_WORDS |= {"MIT OR Apache-2.0": r"MIT OR Apache-2\.0|(?s:(?=.*Apache License).*Permission is hereby)"}
IN_WORDS |= {"LGPL-3.0-or-later": r"LGPLv3", "ISC": r"ISC License", "Public domain": r"Public [Dd]omain"}


def licence_metadata_of(name: str) -> tuple[str, str]:
    """Return the SPDX expression in a package's metadata, or "", and all other metadata about its licence."""
    found = importlib.metadata.distribution(name)
    texts = [found.metadata.get("License") or "", *(x for x in found.metadata.get_all("Classifier") or () if "License" in x)]
    if not any(texts):  # then the text itself
        texts = [file.read_text() for file in found.files or () if "licen" in file.name.lower() and "dist-info" in str(file)]
    return found.metadata.get("License-Expression") or "", "\n".join(texts)


def test_the_table_of_licences_names_every_package_and_its_licence() -> None:
    asked: dict[str, set[str]] = {}
    for extra, lines in {"always": PROJECT["dependencies"], **EXTRAS}.items():
        for requirement in map(Requirement, lines):
            asked.setdefault(requirement.name, set()).add(extra)
    assert {name: set(needed.split(", ")) for name, (needed, _) in ROWS.items()} == asked
    for name, (_, stated) in ROWS.items():
        expression, words = licence_metadata_of(name)
        assert stated == expression if expression else re.search(IN_WORDS.get(stated, rf"{stated}\b"), words), (
            name,
            words[:200],
        )


def test_licences_of_the_project_and_of_its_output() -> None:
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").startswith(f"{PROJECT['license']} License\n\nCopyright (c) ")
    assert (ROOT / "LICENSE-OUTPUT").read_text(encoding="utf-8").startswith("BSD Zero Clause License")
    # Each kind of file of the committed builds is named in the table of generated files.
    table = LICENCES.partition("## What covers")[2].partition("Parts added by compilers")[0]
    for build in ("4ws2-paper", "4ws2"):
        for path in (ROOT / "generated" / build).rglob("*"):
            place = path.relative_to(ROOT / "generated" / build)
            names = (f"`{place.parts[0]}/`", f"`{place.name}`", f"`*{place.suffix}`")
            assert path.is_dir() or any(name in table for name in names), place


def pins(lock: str) -> dict[str, tuple[str, frozenset[str]]]:
    """Return the version and the hashes of each package of a lock file."""
    blocks = re.split(r"^(?=[a-z0-9-]+==)", lock, flags=re.MULTILINE)[1:]
    parts = (re.match(r"([a-z0-9-]+)==([^ ;\\]+)", block) for block in blocks)
    return {part[1]: (part[2], frozenset(re.findall("--hash=(sha256:[0-9a-f]{64})", part.string))) for part in parts if part}


def test_the_lock_file_pins_every_requirement_within_its_range() -> None:
    (everything,) = map(Requirement, PROJECT["optional-dependencies"]["all"])
    assert (everything.name, everything.extras) == ("ars-codegen", EXTRAS.keys())
    found = pins(LOCK)
    lines = [*PROJECT["dependencies"], *PYPROJECT["build-system"]["requires"], *itertools.chain(*EXTRAS.values())]
    for requirement in map(Requirement, lines):
        assert requirement.specifier.contains(found.get(requirement.name, ("0",))[0]), f"{requirement}: run make lock"
    assert [name for name, (_, hashes) in found.items() if not hashes] == []
    # Neither a local path nor an index: each machine uses its own package source.
    assert re.findall(r"://|^-|--(?!hash=)|@ ", LOCK + RUN_LOCK, re.MULTILINE) == []


def test_the_lock_file_of_the_run_time_has_the_same_pins_and_all_that_they_require() -> None:
    found = pins(RUN_LOCK)
    assert found.items() <= pins(LOCK).items()
    required = {*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["report"], *PYPROJECT["build-system"]["requires"]}
    required |= {"editables", *itertools.chain(*(importlib.metadata.requires(name) or () for name in found))}
    here = [each for each in map(Requirement, required) if not each.marker or each.marker.evaluate({"extra": ""})]
    assert {canonicalize_name(each.name) for each in here} <= found.keys()


def test_files_and_names_in_contributing_exist() -> None:
    invented = (
        "identity.h",
        "law/straight",
        "verify/ascii",
        "cases_command",
        "build/",
        "dist/",
        "parameter_table",
        "parameters_command",
    )  # by its examples, or by make
    named = set(re.findall(r"`((?:codegen|templates|hil_sim|tests|generated|docs|benchmarks)/[\w./*-]*)`", CONTRIBUTING))
    for name in named:
        assert any(word in name for word in invented) or list(ROOT.glob(name.rstrip("/"))), name
    for name, file in re.findall(r"`([A-Z_]{4,})`[^`]{0,30} (?:of|in) `((?:codegen|hil_sim|tests)/[\w./]+\.py)`", CONTRIBUTING):
        assert re.search(rf"^{name}\b", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), (name, file)


SHELL = shutil.which("sh") or "/bin/sh"
OLD_PYTHON = 'case "$2" in *version_info*) exit 1;; esac'
WITHOUT_VENV = 'case "$2" in *ensurepip*) exit 1;; esac'
WORKS, FAILS = "exit 0", "exit 1"


def make(*arguments: str) -> list[str]:
    return subprocess.check_output(["make", "--no-print-directory", *arguments], cwd=ROOT, text=True).splitlines()


def test_help_is_the_default() -> None:
    lines = make("help")
    assert lines and all(re.fullmatch(r"make \S+ +\S.{5,}", line) for line in lines)
    assert make() == lines


@pytest.mark.parametrize(
    ("programs", "lines"),
    [
        ({"python3": WORKS, "gcc": WORKS}, []),
        ({"cc": WORKS, "python3": OLD_PYTHON}, ["python3 is older than 3.11: install"]),
        ({"cc": WORKS, "python3": WITHOUT_VENV}, ["python3 has no venv: install it (Debian, Ubuntu: apt install python3-venv"]),
        ({"python3": WORKS, "cc": FAILS}, ["the C compiler 'cc' cannot be run or has no C library headers: install them"]),
        (
            {},
            [
                "python3 is missing: install Python 3.11 or newer (Debian, Ubuntu: apt install python3 python3-venv)",
                "a C compiler is missing: install one (Debian, Ubuntu: apt install gcc libc6-dev",
            ],
        ),
    ],
)
def test_preflight_names_everything_to_install(tmp_path: Path, programs: dict[str, str], lines: list[str]) -> None:
    """The script runs where only `programs` (name -> shell text) exist."""
    for name, text in programs.items():
        (tmp_path / name).write_text(f"#!{SHELL}\n{text}\n", encoding="utf-8")
        (tmp_path / name).chmod(0o755)
    command = [SHELL, ROOT / "scripts" / "preflight.sh"]
    result = subprocess.run(command, env={"PATH": str(tmp_path), "CC": ""}, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (2 if lines else 0, "")
    found = result.stderr.splitlines()
    assert [line[: len(start)] for line, start in zip(found, lines, strict=True)] == lines

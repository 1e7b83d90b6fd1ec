"""`codegen doctor`: findings for present, missing, outdated and broken requirements."""

import json
import os
import re
import socket
import tomllib
from pathlib import Path
from unittest.mock import Mock, call

import pytest

from codegen import doctor
from codegen import requirements as packages
from codegen.doctor import Finding, State
from codegen.requirements import Requirement, extras_of, pip_install, requirements

from .conftest import ROOT, Run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_requirements_match_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    assert pip_install("numpy", "cyclonedx-python-lib") == (
        'pip install "numpy>=2.4,<3" "cyclonedx-python-lib[json-validation]>=11.12,<12"'
    )
    asked, source = requirements()
    always = [re.split(r"\W*[<>=]", line)[0] for line in PROJECT["dependencies"]]
    assert (source, [each.name for each in asked if not each.extra]) == ("pyproject.toml", always)
    assert extras_of(asked) == [name for name in PROJECT["optional-dependencies"] if name != "all"]
    assert set(doctor.SERVES) == set(always)
    assert set(doctor.EXTRAS) >= PROJECT["optional-dependencies"].keys() - {"all"}
    monkeypatch.setattr(packages, "PYPROJECT", Path("no checkout"))
    installed, source = requirements()
    assert source == "the installed package" and set(installed) == set(asked)


def versions(monkeypatch: pytest.MonkeyPatch, **changed: str | None) -> None:
    """Make packages report another version; None: not installed."""
    real = doctor._version
    monkeypatch.setattr(doctor, "_version", lambda name: changed[name] if name in changed else real(name))


@pytest.mark.parametrize(
    ("version", "module", "state", "words"),
    [
        (None, "numpy", State.MISSING, "not installed; >=2.4,<3 is required"),
        ("1.26.4", "numpy", State.BAD, "1.26.4; >=2.4,<3 is required"),
        ("3.0", "numpy", State.BAD, "3.0; >=2.4,<3 is required"),
        ("unknown", "numpy", State.BAD, "unknown; >=2.4,<3 is required"),
        ("2.4.1", "numpy.no_such_part", State.BAD, "2.4.1 cannot be imported: "),
    ],
)
def test_a_needed_package(monkeypatch: pytest.MonkeyPatch, version: str | None, module: str, state: State, words: str) -> None:
    versions(monkeypatch, numpy=version)
    monkeypatch.setitem(doctor.MODULES, "numpy", module)
    found = doctor.needed(Requirement("numpy", ">=2.4,<3"))
    assert (found.state, found.stops) == (state, True)
    assert found.what.startswith(words)
    assert found.remedy.startswith("pip install ") and found.remedy.endswith(' "numpy>=2.4,<3"')


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip compiling, sending and waiting."""
    for name in ("module", "socketcan", "multicast", "punctuality"):
        monkeypatch.setattr(doctor, name, lambda name=name: Finding(name, State.GOOD, "as expected"))


def test_the_requirements_of_codegen_sil_determine_the_exit_code(
    run: Run, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    versions(monkeypatch, casadi="3.6.0", unicorn=None)
    answer = run("doctor", "--json")
    assert (answer.code, answer.err) == (1, 'error: codegen sil cannot work: casadi; pip install "casadi>=3.8,<4"\n')
    data = json.loads(answer.out)
    found = [(each["state"], each["needed"]) for each in data["needed"] if each["name"] == "casadi"]
    assert (data["ready"], found) == (False, [("bad", True)])
    assert {each["name"] for each in data["needed"]} == {"Python", *doctor.SERVES}  # none of an extra
    monkeypatch.setenv("CC", "no-such-compiler")
    answer = run("doctor")
    assert answer.code == 1
    for words in ("'no-such-compiler' does not exist", "without unicorn\n", '-> pip install "unicorn>=2.1.4,<3"\n'):
        assert words in answer.out


@pytest.mark.parametrize(
    ("names", "state", "what"),
    [
        (["can0"], State.MISSING, "there is no virtual interface; there is can0, which was not tested"),
        (["can0", "vcan0"], State.GOOD, "a frame went through vcan0"),
    ],
)
def test_no_frame_is_sent_on_a_bus_with_a_car(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: list[str], state: State, what: str
) -> None:
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text("280\n")
        (tmp_path / name / "flags").write_text("0xc1\n")
    monkeypatch.setattr(socket, "AF_CAN", 29, raising=False)
    monkeypatch.setattr(socket, "CAN_RAW", 1, raising=False)
    monkeypatch.setattr(doctor.socket, "socket", lambda *_: os.fdopen(os.dup(0)))
    monkeypatch.setattr(doctor, "exchange", exchange := Mock())
    found = doctor.socketcan(tmp_path)
    assert found.state is state and found.what.endswith(what)
    assert exchange.mock_calls == ([call("vcan0")] if "vcan0" in names else [])

"""`codegen doctor`: its findings where something is there, missing, too old or broken."""

import errno
import json
import os
import socket
import sys
import tomllib
from pathlib import Path
from unittest.mock import Mock, call

import pytest

from codegen.doctor import buses, clock, compiled, packages, programs
from codegen.doctor.finding import Finding, State
from codegen.doctor.requirements import Requirement, extras_of, parse, requirements

from .conftest import ROOT, Run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_a_requirement_in_metadata_and_the_versions_that_it_allows() -> None:
    assert parse('numpy<3,>=2.4; extra == "tools"') == Requirement("numpy", ">=2.4,<3", "tools")
    assert parse("pyelftools (>=0.33,<1) ; extra == 'verify'") == Requirement("pyelftools", ">=0.33,<1", "verify")
    assert parse('x[more]>=1; python_version < "3.12" and extra == "dev"') == Requirement("x", ">=1", "dev")
    bounds = Requirement("x", ">=3.8,<4")
    assert [bounds.allows(version) for version in ("3.8", "3.8.0", "3.10.1", "3.9rc1")] == [True] * 4
    assert [bounds.allows(version) for version in ("3.7.9", "4", "4.0")] == [False] * 3
    assert parse("plain") == Requirement("plain", "") and parse("plain").allows("0.1")


def test_requirements_are_those_of_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, source = requirements()
    always = [parse(line).name for line in PROJECT["dependencies"]]
    assert (source, [each.name for each in asked if not each.extra]) == ("pyproject.toml", always)
    assert extras_of(asked) == [name for name in PROJECT["optional-dependencies"] if name != "all"]
    assert set(packages.SERVES) == set(always)
    assert set(packages.EXTRAS) >= PROJECT["optional-dependencies"].keys() - {"all"}
    # Outside of a checkout they are those of the installed package.
    module = sys.modules["codegen.doctor.requirements"]
    lines = ["click<9,>=8.5", 'z3-solver<6,>=5.4; extra == "verify"', 'ars-codegen[verify]; extra == "all"']
    monkeypatch.setattr(module, "PYPROJECT", Path("nowhere"))
    monkeypatch.setattr(module, "requires", lambda name: lines)
    installed = (Requirement("click", ">=8.5,<9"), Requirement("z3-solver", ">=5.4,<6", "verify"))
    assert requirements() == (installed, "the installed package")


def versions(monkeypatch: pytest.MonkeyPatch, **changed: str | None) -> None:
    """Let packages have another version; None: they are not installed."""
    real = packages._version
    monkeypatch.setattr(packages, "_version", lambda name: changed[name] if name in changed else real(name))


@pytest.mark.parametrize(
    ("version", "module", "state", "words"),
    [
        (None, "numpy", State.MISSING, "not installed; needed is >=2.4,<3"),
        ("1.26.4", "numpy", State.BAD, "1.26.4; needed is >=2.4,<3"),
        ("2.4.1", "numpy.no_such_part", State.BAD, "2.4.1 cannot be imported: "),
    ],
)
def test_a_needed_package(monkeypatch: pytest.MonkeyPatch, version: str | None, module: str, state: State, words: str) -> None:
    versions(monkeypatch, numpy=version)
    monkeypatch.setitem(packages.MODULES, "numpy", module)
    (found,) = packages.needed([Requirement("numpy", ">=2.4,<3"), Requirement("other", "", "dev")])
    assert (found.state, found.stops) == (state, True)
    assert found.what.startswith(words)
    assert found.remedy.startswith("pip install ") and found.remedy.endswith(' "numpy>=2.4,<3"')


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled, sent or waited for."""
    for module, name in ((compiled, "module"), (buses, "socketcan"), (buses, "multicast"), (clock, "punctuality")):
        monkeypatch.setattr(module, name, lambda name=name: Finding(name, State.GOOD, "as expected"))


def test_the_needs_of_codegen_sil_decide_on_the_exit_code(run: Run, quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    versions(monkeypatch, casadi="3.6.0", unicorn=None)
    answer = run("doctor", "--json")
    assert (answer.code, answer.err) == (1, 'error: codegen sil cannot work: casadi; pip install "casadi>=3.8,<4"\n')
    data = json.loads(answer.out)
    found = [(each["state"], each["needed"]) for each in data["needed"] if each["name"] == "casadi"]
    assert (data["ready"], found) == (False, [("bad", True)])
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setenv("CC", "no-such-compiler")
    answer = run("doctor")
    assert (answer.code, "\x1b" in answer.out) == (1, False)
    assert "'no-such-compiler' does not exist" in answer.out
    lines = [line.strip() for line in answer.out.splitlines()]
    assert lines[0] == "Needed by every command"
    at = next(number for number, line in enumerate(lines) if line.split()[:2] == ["missing", "verify"])
    assert lines[at].endswith("without unicorn") and lines[at + 1].startswith("for codegen verify")
    assert lines[at + 2] == '-> pip install "ars-codegen[verify]"'


def test_other_programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "cmake"
    broken.write_text("#!/bin/sh\nexit 3\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    found = {each.name: (each.state, each.what, each.remedy, each.stops) for each in programs.programs()}
    assert found["qemu-system-arm"][::2] == (State.MISSING, "apt install qemu-system-arm")
    assert found["cmake"][:2] == (State.BAD, f"{broken} does not tell its version (exit code 3)")
    assert not any(stops for *_, stops in found.values())


@pytest.fixture
def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of the modules of a kernel and of its network interfaces; CAN sockets exist, and can be opened."""
    monkeypatch.setattr(socket, "AF_CAN", 29, raising=False)
    monkeypatch.setattr(socket, "CAN_RAW", 1, raising=False)
    monkeypatch.setattr(buses.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(buses, "MODULES", tmp_path)
    monkeypatch.setattr(buses.socket, "socket", lambda *_: os.fdopen(os.dup(0)))
    return tmp_path


MAKE = "sudo modprobe vcan && sudo ip link add dev vcan0 type vcan && sudo ip link set up vcan0"


@pytest.mark.parametrize(
    ("number", "modules", "what", "remedy"),
    [
        (errno.EAFNOSUPPORT, "kernel/net/can/can.ko.xz:\n", "the kernel's module is not loaded", MAKE),
        (errno.EAFNOSUPPORT, "kernel/net/ipv6/ipv6.ko:\n", "this kernel was built without CAN", "udp_multicast"),
        (errno.EAFNOSUPPORT, "", "this kernel has no CAN, or has not loaded it", f"{MAKE}; where that fails, take --bus udp"),
        (errno.EPERM, "", "this process may not open CAN sockets", "outside of the container"),
    ],
)
def test_a_kernel_without_can(
    kernel: Path, monkeypatch: pytest.MonkeyPatch, number: int, modules: str, what: str, remedy: str
) -> None:
    monkeypatch.setattr(buses.socket, "socket", Mock(side_effect=OSError(number, os.strerror(number))))
    (kernel / buses.platform.release()).mkdir()
    (kernel / buses.platform.release() / "modules.dep").write_text(modules)
    found = buses.socketcan()
    assert (found.state, found.what) == (State.MISSING, what)
    assert remedy in found.remedy


@pytest.mark.parametrize(
    ("flags", "is_lost", "state", "what"),
    [
        (None, False, State.MISSING, "there is no virtual interface; there is can0, on which nothing was tried"),
        (0x80, False, State.MISSING, "vcan0 is down"),
        (0xC1, True, State.BAD, "no frame goes through vcan0: nothing came"),
        (0xC1, False, State.GOOD, "a frame went through vcan0"),
    ],
)
def test_a_kernel_with_can(
    kernel: Path, monkeypatch: pytest.MonkeyPatch, flags: int | None, is_lost: bool, state: State, what: str
) -> None:
    for name, kind in {"lo": 772, "can0": 280, **({} if flags is None else {"vcan0": 280})}.items():
        (kernel / name).mkdir()
        (kernel / name / "type").write_text(f"{kind}\n")
    if flags is not None:
        (kernel / "vcan0/flags").write_text(f"{flags:#x}\n")
    monkeypatch.setattr(buses, "exchange", exchange := Mock(side_effect=TimeoutError if is_lost else None))
    found = buses.socketcan(kernel)
    assert found.state is state and found.what.endswith(what)
    assert exchange.mock_calls == ([call("vcan0")] if flags == 0xC1 else [])  # no frame goes out where a car could hear it

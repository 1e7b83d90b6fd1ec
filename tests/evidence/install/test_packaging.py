"""Contents of the wheel and of the source distribution, and `make clean`."""

import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import codegen

ROOT = Path(__file__).resolve().parents[3]


def build(kind: str, source: Path, target: Path) -> Path:
    """Call the build backend as pip does, in its own process because it uses the current folder."""
    script = f"import sys; from hatchling.build import build_{kind}; build_{kind}(sys.argv[1])"
    result = subprocess.run([sys.executable, "-c", script, str(target)], cwd=source, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    (made,) = target.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    with zipfile.ZipFile(build("wheel", ROOT, tmp_path_factory.mktemp("wheel"))) as archive:
        yield archive


def sources(folder: str, pattern: str) -> set[str]:
    return {path.relative_to(ROOT / folder).as_posix() for path in (ROOT / folder).rglob(pattern) if path.is_file()}


def test_the_wheel_has_modules_types_presets_and_templates_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    metadata = f"ars_codegen-{codegen.__version__}.dist-info"
    modules = {f"{package}/{name}" for package in ("ars_codegen", "codegen", "hil_sim") for name in sources(package, "*.py")}
    presets = {f"codegen/configuration/presets/{name}" for name in sources("codegen/configuration/presets", "*.toml")}
    templates = {f"codegen/_templates/{name}": f"templates/{name}" for name in sources("templates", "*")}
    copied = {**{name: name for name in modules | presets}, **templates}
    assert {
        "codegen/__init__.py",
        "hil_sim/__init__.py",
        "codegen/configuration/presets/paper-controller.toml",
    } <= copied.keys()
    assert len(templates) > 10
    names = {name for name in wheel.namelist() if not name.startswith(f"{metadata}/")}
    assert {"ars_codegen/py.typed", "codegen/py.typed", "hil_sim/py.typed"} <= names >= copied.keys()
    assert {name.split("/")[0] for name in names} == {"ars_codegen", "codegen", "hil_sim"}
    assert {name for name in names if name.startswith("codegen/_templates/")} == templates.keys()
    assert not [name for name in names if "__pycache__" in name or name.endswith((".pyc", ".so", ".o"))]
    for name, source in copied.items():
        assert wheel.read(name) == (ROOT / source).read_bytes()


def test_the_sdist_builds_the_same_wheel(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    (tmp_path / "sdist").mkdir()
    (tmp_path / "wheel").mkdir()
    with tarfile.open(build("sdist", ROOT, tmp_path / "sdist")) as archive:
        # The filter exists since Python 3.11.4; later versions warn without it.
        archive.extraction_filter = getattr(tarfile, "data_filter", None)
        archive.extractall(tmp_path)
    with zipfile.ZipFile(build("wheel", tmp_path / f"ars_codegen-{codegen.__version__}", tmp_path / "wheel")) as second:
        # RECORD lists the hash of every file.
        record = f"ars_codegen-{codegen.__version__}.dist-info/RECORD"
        assert second.read(record) == wheel.read(record)


def run(*command: str, folder: Path) -> str:
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


def ignored_files() -> list[str]:
    """Return an example of each pattern in .gitignore, and compiled Python in a folder with its own pattern."""
    patterns = [one for one in (ROOT / ".gitignore").read_text(encoding="utf-8").split() if one != "*.py[co]"]
    examples = [one.strip("/").replace("*", "x") + ("/x" if one.endswith("/") else "") for one in patterns]
    return [*examples, "tests/evidence/vcan/__pycache__/x.pyc"]


def test_clean_leaves_the_environment_and_the_files_that_git_tracks(tmp_path: Path) -> None:
    for name in ("Makefile", ".gitignore"):
        shutil.copy(ROOT / name, tmp_path / name)
    for name in (*ignored_files(), ".venv/bin/python", ".venv/lib/__pycache__/x.pyc", "codegen/config.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    run("git", "init", "-q", folder=tmp_path)
    run("git", "add", ".", folder=tmp_path)
    run("make", "clean", folder=tmp_path)
    left = run("git", "status", "--porcelain", "--ignored", folder=tmp_path).splitlines()
    assert [line for line in left if line.startswith("!!")] == ["!! .venv/"]
    assert (tmp_path / ".venv/lib/__pycache__/x.pyc").is_file()
    assert (tmp_path / "codegen/config.py").is_file()

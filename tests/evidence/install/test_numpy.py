"""Another numpy than that of the committed builds generates the same files from the same maps."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import BUILD, ROOT, TRACKING

OTHER = "2.3.5"


@pytest.fixture(scope="module")
def other_numpy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("numpy")
    pip = (sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--target", folder)
    subprocess.run([*pip, f"numpy=={OTHER}"], check=True)
    return folder


@pytest.mark.parametrize("build", [BUILD, TRACKING], ids=lambda folder: folder.name)
def test_a_committed_build_is_up_to_date_with_another_numpy(other_numpy: Path, build: Path) -> None:
    command = (sys.executable, "-m", "codegen", "build", "--map", build.with_suffix(".npz"), "-o", build, "--check")
    environment = {**os.environ, "PYTHONPATH": f"{other_numpy}{os.pathsep}{ROOT}"}
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (answer.returncode, answer.stdout) == (0, f"{build}: up to date\n"), answer.stderr
    assert f", here {OTHER}: the same files" in answer.stderr

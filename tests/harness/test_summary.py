"""The last line of `make test`."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = "import pytest\n\ndef test_good():\n    pass\n\ndef test_other():\n    pytest.skip('no cmake')\n"


def test_it_counts_skipped_tests_which_fail_the_run_in_ci(tmp_path: Path) -> None:
    (tmp_path / "test_sample.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-qq", "-n", "0", "-p", "tests.conftest", "-p", "no:cacheprovider"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")} | {"CI": "true"}
    ended = subprocess.run([*command, tmp_path], cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 1, ended.stdout + ended.stderr
    assert re.fullmatch(r"1 passed, 1 skipped, CPU \d+\.\d min", ended.stdout.splitlines()[-1])

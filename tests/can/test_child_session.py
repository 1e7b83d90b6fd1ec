"""What the tests marked `vcan` become in the pytest that was asked for them: each one's own result."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]

# A project of its own, with the hooks of this one.
FILES = {
    "pytest.ini": "[pytest]\nmarkers = vcan\n",
    "conftest.py": "from tests.can.conftest import *\n",
    "test_sample.py": """
import os
import pytest

@pytest.fixture(scope="module")
def module_fixture():
    yield

def test_unmarked(module_fixture):
    assert "VCAN_RUN" not in os.environ

@pytest.mark.vcan
def test_passes(vcan):
    assert os.environ["VCAN_RUN"]

@pytest.mark.vcan
@pytest.mark.parametrize("text", ["two words", "a::b[c]"])
def test_fails(vcan, text):
    print("printed over there")
    assert text == "something else"

@pytest.mark.vcan
def test_skips(vcan):
    pytest.skip("of no use")

@pytest.mark.vcan
@pytest.mark.xfail(strict=True)
def test_fails_as_expected(vcan):
    assert os.environ["VCAN_RUN"] == ""

@pytest.fixture
def broken():
    yield
    raise RuntimeError("not put away")

@pytest.mark.vcan
def test_breaks_after(vcan, broken):
    pass

@pytest.mark.vcan
def test_ends_pytest(vcan):
    os._exit(3)

@pytest.mark.vcan
def test_has_no_turn(vcan):
    pass
""",
    "no_way.py": """
import sys
from tests.can import child_session
child_session.PLACE = (sys.executable, "-c", "print('vcan_run: no way'); raise SystemExit(69)")
""",
    "too_long.py": """
import sys
from tests.can import child_session
child_session.PLACE = (sys.executable, "-c", "import sys, time; print('at work', flush=True); time.sleep(60)")
child_session.SECONDS_PER_TEST = 1.0
""",
    "test_second.py": """
def test_unmarked_too():
    pass
""",
}


class Result(NamedTuple):
    exit_code: int
    cases: dict[str, tuple[str, str]]
    """Of each test: passed, failure, error or skipped, and what is told."""


def run_sample(folder: Path, *options: str, **environment: str) -> Result:
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    result = subprocess.run(
        [sys.executable, "-m", "pytest", "--junitxml=results.xml", *options],
        cwd=folder,
        env={name: value for name, value in os.environ.items() if name != "CI"} | {"PYTHONPATH": str(ROOT)} | environment,
        capture_output=True,
        text=True,
    )
    cases = {}
    for case in ElementTree.parse(folder / "results.xml").iter("testcase"):
        told = [
            (part.tag, f"{part.get('message')}\n{part.text}") for part in case if part.tag in ("failure", "error", "skipped")
        ]
        cases[case.attrib["name"]] = told[-1] if told else ("passed", "")
    assert result.stderr == ""
    return Result(result.returncode, cases)


def skip_where_there_is_no_way(result: Result) -> None:
    outcome, told = result.cases["test_passes"]
    if outcome != "passed" and "vcan_run: " in told:
        pytest.skip(told)


def test_each_test_has_its_own_result(tmp_path: Path) -> None:
    exit_code, cases = result = run_sample(tmp_path)
    skip_where_there_is_no_way(result)
    assert exit_code == pytest.ExitCode.TESTS_FAILED
    assert {name: outcome for name, (outcome, _) in cases.items()} == {
        "test_unmarked": "passed",
        "test_passes": "passed",
        "test_fails[two words]": "failure",
        "test_fails[a::b[c]]": "failure",
        "test_skips": "skipped",
        "test_fails_as_expected": "skipped",
        "test_breaks_after": "error",
        "test_ends_pytest": "failure",
        "test_has_no_turn": "failure",
        "test_unmarked_too": "passed",
    }
    assert "AssertionError: assert 'two words' == 'something else'" in cases["test_fails[two words]"][1]
    assert "of no use" in cases["test_skips"][1]
    assert "RuntimeError: not put away" in cases["test_breaks_after"][1]
    for name in ("test_ends_pytest", "test_has_no_turn"):
        assert "ended with exit code 3 before this test did; its output:" in cases[name][1]


def test_in_ci_a_skipped_test_has_failed(tmp_path: Path) -> None:
    exit_code, cases = result = run_sample(tmp_path, "-k", "skips or passes or expected", CI="true")
    skip_where_there_is_no_way(result)
    assert exit_code == pytest.ExitCode.TESTS_FAILED
    assert {name: outcome for name, (outcome, _) in cases.items()} == {
        "test_passes": "passed",
        "test_skips": "failure",
        "test_fails_as_expected": "skipped",
    }
    assert "in CI no test here may be skipped: Skipped: of no use" in cases["test_skips"][1]


@pytest.mark.parametrize(("ci", "outcome"), [("", "skipped"), ("false", "skipped"), ("true", "failure")])
def test_where_there_is_no_way_the_reason_is_told(tmp_path: Path, ci: str, outcome: str) -> None:
    _, cases = run_sample(tmp_path, "-k", "passes or unmarked", "-p", "no_way", CI=ci)
    assert cases["test_passes"][0] == outcome
    assert "vcan_run: no way" in cases["test_passes"][1]
    assert cases["test_unmarked"][0] == cases["test_unmarked_too"][0] == "passed"


def test_one_that_never_ends_has_failed(tmp_path: Path) -> None:
    _, cases = run_sample(tmp_path, "-k", "passes or has_no_turn", "-p", "too_long")
    for name in ("test_passes", "test_has_no_turn"):
        assert cases[name][0] == "failure"
        assert "no result within 1 s; its output:\nat work\n" in cases[name][1]


@pytest.mark.parametrize(("ci", "exit_code"), [("", pytest.ExitCode.NO_TESTS_COLLECTED), ("true", pytest.ExitCode.INTERRUPTED)])
def test_in_ci_a_skipped_module_has_failed(tmp_path: Path, ci: str, exit_code: int) -> None:
    (tmp_path / "test_third.py").write_text("import pytest\npytest.importorskip('no_such_module')\n", encoding="utf-8")
    assert run_sample(tmp_path, "test_third.py", CI=ci).exit_code == exit_code

"""The part of the campaign that runs libFuzzer: what it finds, what it keeps, and what it reads from the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from codegen.emit.write import write_folder
from codegen.verify.check import Effort, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.libfuzzer import libfuzzer
from tests.verify import builds, planted

REPORT = """INFO: Running with entropic power schedule (0xFF, 100).
INFO: Loaded 1 modules   (457 inline 8-bit counters): 457 [0x5581, 0x5589),
#2\tINITED cov: 31 ft: 32 corp: 1/1b exec/s: 0 rss: 70Mb
#512\tREDUCE cov: 150 ft: 600 corp: 40/9Kb lim: 2048 exec/s: 0 rss: 71Mb L: 12/40 MS: 1 EraseBytes-
#3000\tDONE   cov: 272 ft: 900 corp: 77/20Kb lim: 2048 exec/s: 100 rss: 71Mb
"""


@pytest.fixture
def clang() -> libfuzzer.Compiler:
    try:
        return libfuzzer.find_clang()
    except MissingTool as error:
        pytest.skip(str(error))


def test_nothing_is_found_in_what_is_generated(clang: libfuzzer.Compiler, tmp_path: Path) -> None:
    write_folder(builds.made("pi"), tmp_path / "sample")
    outcome = libfuzzer.run([tmp_path / "sample"], Effort(), inputs=2_000)
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert list(outcome.figures) == ["sample can", "sample step"]
    for figures in outcome.figures.values():
        assert figures["inputs"] >= 2_000
        assert 0.4 < figures["reached"] / figures["edges"] < 1.0
        assert figures["corpus"] > 18


def test_an_input_that_breaks_something_is_kept(clang: libfuzzer.Compiler, tmp_path: Path) -> None:
    subject = planted.limiter(builds.made("pi"), "    if (input->demand > 0.05f) { ((volatile uint8_t *)self)[4096] = 0u; }")
    found = libfuzzer.fuzz(clang, subject, "step", "-runs=2000", tmp_path)
    (finding,) = found.findings
    (kept,) = tmp_path.iterdir()
    assert finding.startswith("src/ars_limiter.c:")
    assert "wrong address: heap-buffer-overflow, write of 1 bytes in ars_limiter_step" in finding
    assert finding.endswith(f"({kept.name})")
    assert kept.name.startswith("planted-step-crash-")


def test_figures_are_those_of_the_last_line() -> None:
    assert libfuzzer.read(REPORT, 0) == libfuzzer.Run(3000, 272, 457, 900, 77, ())


def test_a_property_and_an_end_without_a_word() -> None:
    broken = REPORT + "property not held: status has a name (5, 4)\n==1== ERROR: libFuzzer: deadly signal\n"
    assert libfuzzer.read(broken, 77).findings == ("property not held: status has a name (5, 4)",)
    slow = libfuzzer.read("==1== ERROR: libFuzzer: timeout after 20 seconds\nTest unit written to ./x-timeout-1\n", 70)
    assert slow == replace(slow, inputs=0, findings=("==1== ERROR: libFuzzer: timeout after 20 seconds (x-timeout-1)",))
    assert libfuzzer.read("", 1).findings == ("it ended with exit code 1",)


def test_without_clang_it_is_not_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingTool, match="no clang with libFuzzer"):
        libfuzzer.run([tmp_path], Effort())

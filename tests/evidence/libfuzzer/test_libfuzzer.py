"""libFuzzer finds a planted fault and keeps its input. Run by name; needs clang."""

import dataclasses
from pathlib import Path

import pytest

from codegen.verify.check import Subject
from codegen.verify.packages import MissingTool
from tests.evidence.libfuzzer import libfuzzer
from tests.evidence.parts import FOLDERS


def test_an_input_that_breaks_a_property_is_kept(tmp_path: Path) -> None:
    try:
        clang = libfuzzer.find_clang()
    except MissingTool as error:
        pytest.skip(str(error))
    subject, path, old = Subject.read(FOLDERS[0]), "src/ars_limiter.c", b"    self->rear_angle = clamp(target,"
    fault = b"    if (input->demand > 0.05f) { ((volatile uint8_t *)self)[4096] = 0u; }\n"
    assert subject.files[path].count(old) == 1
    files = {**subject.files, path: subject.files[path].replace(old, fault + old)}
    found = libfuzzer.fuzz(clang, dataclasses.replace(subject, files=files), "step", 2_000, tmp_path)
    (finding,), (kept,) = found.findings, tmp_path.iterdir()
    assert finding.startswith("src/ars_limiter.c:") and finding.endswith(f"({kept.name})")
    assert "wrong address: heap-buffer-overflow, write of 1 bytes in ars_limiter_step" in finding
    assert kept.name.startswith("4ws2-step-crash-")

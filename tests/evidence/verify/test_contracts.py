"""The runner of the contracts with CBMC: a unit is proved, and a planted fault is found."""

from pathlib import Path

import pytest

from codegen.emit.contracts.proof import Proof
from codegen.verify import cbmc
from codegen.verify.contracts import initialisation_harnesses, prove
from codegen.verify.on_host import software_of
from codegen.verify.outcomes import Subject
from tests.emit.rendered import laid_out, rendered


@pytest.mark.parametrize(
    ("sound", "planted", "verdict"), [("", "", "proved"), ("? rear_angle : 0.0f", "? rear_angle : 2.0f", "failed")]
)
def test_a_unit_is_proved_and_a_fault_is_found(tmp_path: Path, sound: str, planted: str, verdict: str) -> None:
    folder = laid_out(rendered("pi"), tmp_path / "build")
    source = folder / "src" / "ars_limiter.c"
    source.write_text(source.read_text().replace(sound, planted) if sound else source.read_text())
    (result,) = prove(folder, [Proof(name="ars_limiter_init", files=("src/ars_limiter.c",))], cbmc.installed())
    assert result.verdict == verdict


@pytest.mark.parametrize(("left_out", "verdict"), [("", "proved"), ("self->silent_calls = 0u;", "failed")])
def test_each_member_is_initialised(tmp_path: Path, left_out: str, verdict: str) -> None:
    folder = laid_out(rendered("pi"), tmp_path / "build")
    source = folder / "src" / "ars_task.c"
    source.write_text(source.read_text().replace(left_out, "", 1) if left_out else source.read_text())
    sources = [f"src/{path.name}" for path in sorted((folder / "src").glob("*.c"))]
    harnesses = dict(initialisation_harnesses(software_of(Subject.read(folder)), sources))
    for proof, harness in harnesses.items():
        (folder / proof.path).write_bytes(harness)
    results = prove(folder, harnesses, cbmc.installed())
    found = {each.harness: each.verdict for each in results}
    assert found == {
        "ars_controller_init_members": "proved",
        "ars_supervision_init_members": "proved",
        "ars_task_init_members": verdict,
    }

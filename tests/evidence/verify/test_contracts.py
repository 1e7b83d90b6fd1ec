"""The runner of the contracts with CBMC: a unit is proved, and a planted fault is found."""

from pathlib import Path

import pytest

from codegen.verify import cbmc
from codegen.verify.contracts import prove
from tests.emit.rendered import laid_out, rendered


@pytest.mark.parametrize(
    ("sound", "planted", "verdict"), [("", "", "proved"), ("? rear_angle : 0.0f", "? rear_angle : 2.0f", "failed")]
)
def test_a_unit_is_proved_and_a_fault_is_found(tmp_path: Path, sound: str, planted: str, verdict: str) -> None:
    folder = laid_out(rendered("pi"), tmp_path / "build")
    source = folder / "src" / "ars_limiter.c"
    source.write_text(source.read_text().replace(sound, planted) if sound else source.read_text())
    (result,) = prove(folder, cbmc.installed(), wanted=lambda name: name == "ars_limiter_init")
    assert result.verdict == verdict

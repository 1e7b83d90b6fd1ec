"""Which vectors the batch uses: seen in what was compiled, chosen by compiler and machine, refused where they would not run."""

import platform
import shutil
from pathlib import Path

import numpy as np
import pytest

from codegen.errors import BuildError
from codegen.sil import batch, vector
from codegen.sil.batch import Isa, Lanes, compile_batch, load_batch
from codegen.vehicle.dynamics import plant_parameters
from tests import builds
from tests.sil.test_batch import HERE, PROFILES

VECTORS = [isa for isa in vector.ISAS if isa != "none"]
GENERATED = Path(__file__).resolve().parents[2] / "generated"


def run(software: batch.BatchSoftware) -> bytes:
    return software.run(PROFILES["step steer"], Lanes(np.repeat([plant_parameters(builds.CONFIG)], 3, axis=0))).tobytes()


@pytest.mark.parametrize("isa", [isa for isa in VECTORS if isa in HERE])
def test_the_plant_calls_functions_of_vectors_and_of_nothing_else(isa: Isa) -> None:
    software = load_batch(GENERATED / "4ws2", isa)
    assert software.isa == isa
    names = software.software.compiled.path.read_bytes()
    assert vector.is_vectorised(software.software.compiled, isa)
    assert not any(vector.is_vectorised(software.software.compiled, other) for other in VECTORS if other != isa)
    assert b"\0atan\0" not in names


@pytest.mark.parametrize("lost", [("-DBATCH_VECTOR_LIBRARY",), ("-fno-builtin-sin", "-fno-builtin-cos")], ids=" ".join)
def test_a_silent_fallback_is_seen(lost: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Without some of its flags GCC makes a call for each number, and says nothing."""
    if HERE[0] == "none":
        pytest.skip("no vectors are to be had here")
    assert vector.compiler_offers(HERE[0])  # asked before the flags change
    kept = tuple(flag for flag in vector.FLAGS[HERE[0]] if flag not in lost)
    monkeypatch.setitem(vector.FLAGS, HERE[0], kept)
    folder = builds.paper().folder
    with pytest.raises(BuildError, match="made no vectors"):
        compile_batch(folder.files, folder.manifest, isa=HERE[0])
    assert compile_batch(folder.files, folder.manifest).isa != HERE[0], "where the choice is left, the next one is taken"


def test_a_machine_without_vectors_runs_one_number_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(platform, "machine", lambda: "aarch64")
        assert vector.best_isa() == "none"
    monkeypatch.setattr(vector, "_processor_flags", lambda: {"sse2", "avx"})
    assert vector.best_isa() == "none"
    folder = builds.paper().folder
    assert compile_batch(folder.files, folder.manifest).isa == "none"
    for isa in VECTORS:
        with pytest.raises(BuildError, match="no instructions of"):
            compile_batch(folder.files, folder.manifest, isa=isa)


def test_another_compiler_does_without_vectors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each compiler that is installed gives the same bits without vectors; none fuses or reorders."""
    folder = builds.paper().folder
    answers = {}
    for compiler in filter(shutil.which, ("cc", "gcc", "clang")):
        monkeypatch.setenv("CC", compiler)
        answers[compiler] = run(compile_batch(folder.files, folder.manifest, isa="none"))
    assert len(set(answers.values())) == 1


def test_numbers_below_the_normal_ones_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flags of fast mathematics at the linker would set the processor of the whole process to drop them."""
    run(load_batch(GENERATED / "4ws2"))
    assert np.float64(5e-324) * np.float64(1.0) > 0.0
    assert np.float64(2.3e-308) / np.float64(4.0) > 0.0

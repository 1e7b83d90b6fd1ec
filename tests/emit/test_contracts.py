"""Contracts of the generated C: they compile, belong to the build, and stay out of the ECU's software."""

import subprocess
from pathlib import Path

import pytest

from codegen.configuration import Kind
from codegen.configuration.e2e_profiles import ProfileName
from codegen.emit.contracts.proof import Proof
from codegen.emit.text import Precision
from codegen.sil.toolchain import compiler_command
from tests import builds
from tests.emit.rendered import laid_out, rendered
from tests.sil import e2e_profiles

STUBS = (
    "-D__CPROVER_assume(condition)=((void)(condition))",
    "-D__CPROVER_assert(condition,text)=((void)(condition),(void)(text))",
)
FLAGS = ("-std=c99", "-fsyntax-only", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Iinclude", "-Iverify", *STUBS)


@pytest.mark.parametrize(("kind", "precision"), [("pi", "single"), ("tracking", "double")])
def test_contracts_compile(tmp_path: Path, kind: Kind, precision: Precision) -> None:
    """tests/evidence/verify proves those of every kind in single precision."""
    folder = laid_out(rendered(kind, precision), tmp_path / "build")
    files = [str(path.relative_to(folder)) for path in sorted((folder / "verify").glob("*.c"))]
    assert len(files) > 40
    subprocess.run([*compiler_command(), *FLAGS, "-DCHECK_END", *files], cwd=folder, check=True)


@pytest.mark.parametrize("profile", ["1A", "2", "5"])
def test_the_lemma_of_the_crc_holds_for_each_polynomial(tmp_path: Path, profile: ProfileName) -> None:
    """Its assertion is evaluated for every byte."""
    folder = laid_out(builds.render(builds.paper_map(), e2e_profiles.config_of(profile)), tmp_path / "build")
    program = """
    #include <stdbool.h>
    static int failed;
    #define __CPROVER_assert(condition, text) (failed += (condition) ? 0 : 1)
    #include "verify/prove_lemma_crc.c"
    int main(void)
    {
        for (uint32_t byte = 0u; byte < 256u; byte++) { lemma_crc(byte); }
        return (failed == 0) ? 0 : 1;
    }
    """
    (folder / "lemma.c").write_text(program, encoding="ascii")
    subprocess.run([*compiler_command(), "-std=c99", "-Iinclude", "-Iverify", "lemma.c", "-o", "lemma"], cwd=folder, check=True)
    assert subprocess.run([folder / "lemma"], check=False).returncode == 0


@pytest.mark.parametrize("kind", ["tracking", "pi"])
def test_the_manifest_has_a_proof_of_files_of_the_build_for_each_harness(kind: Kind) -> None:
    folder = rendered(kind)
    proofs = [Proof.model_validate(each) for each in folder.manifest["proofs"]]
    assert sorted(proof.path for proof in proofs) == sorted(path for path in folder.files if path.startswith("verify/prove_"))
    for proof in proofs:
        assert f"\n * {proof.command()}\n".encode() in folder.files[proof.path]
        assert {*proof.files} <= folder.files.keys()


def test_every_replaced_function_is_proved() -> None:
    files = rendered("tracking").files
    assumed = {path.removeprefix("verify/assume_") for path in files if path.startswith("verify/assume_")}
    assert assumed and all(f"verify/prove_{name}" in files for name in assumed)


def test_no_build_file_takes_contracts() -> None:
    files = rendered("tracking").files
    for path in ("CMakeLists.txt", "ars.mk", "zephyr/CMakeLists.txt"):
        assert b"verify/" not in files[path]

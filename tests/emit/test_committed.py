"""The committed builds: their record of `codegen verify` describes these very files."""

import hashlib
import json
from pathlib import Path

import pytest

from codegen.emit.folder import MANIFEST, verify_hashes

GENERATED = Path(__file__).parents[2] / "generated"
BUILDS = ("4ws2", "4ws2-tracking")


@pytest.mark.parametrize("name", BUILDS)
def test_the_record_of_verify_is_about_the_files_that_lie_beside_it(name: str) -> None:
    folder = GENERATED / name
    record = json.loads((folder / "verify.json").read_bytes())
    assert record["build"]["manifest_sha256"] == hashlib.sha256((folder / MANIFEST).read_bytes()).hexdigest()
    assert record["effort"] == "whole"
    assert record["edited"] == verify_hashes(folder) == []
    assert {check["verdict"] for check in record["checks"].values()} == {"passed"}
    assert record["build"]["manifest_sha256"] in (folder / "verify.md").read_text(encoding="utf-8")

"""A kind of controller that is added to the tables is proved, and compared with its second implementation."""

from pathlib import Path

from tests.additions.copy import Copy
from tests.additions.test_kind import BUILD, MAP, add_kind

CHECK = """
from codegen.emit.contracts.proof import Proof
from codegen.verify import cbmc
from codegen.verify.outcomes import Subject
from codegen.verify.tools import stored
from codegen.verify.contracts import prove
from tests.oracle.check import check

found = check(Subject("share", folder.files, {"files": {}, **folder.manifest}))
assert not found.findings, found.findings

proofs = [Proof.model_validate(each) for each in folder.manifest["proofs"] if each["name"].startswith("ars_law_")]
with stored(folder.files) as place:
    results = prove(place, proofs, cbmc.installed())
assert [each.verdict for each in results] == ["proved", "proved"], results
"""


def test_a_kind_is_verified(tmp_path: Path) -> None:
    tree = Copy.into(tmp_path / "tree")
    add_kind(tree)
    tree.run("-c", BUILD + CHECK, str(MAP))

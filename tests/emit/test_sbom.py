"""The bill of materials of a build, read by the reference library of CycloneDX."""

import hashlib
import json

from cyclonedx.model.bom import Bom
from cyclonedx.model.component import ComponentType
from cyclonedx.schema import SchemaVersion

from tests.emit.rendered import rendered


def test_the_bill_of_materials_is_valid_and_lists_every_file_with_its_hash() -> None:
    from cyclonedx.validation.json import JsonStrictValidator  # takes seconds, which every worker would spend

    files = rendered("tracking").files
    text = files["sbom.cdx.json"].decode("ascii")
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    bom = Bom.from_json(json.loads(text))  # type: ignore[attr-defined]
    listed = {each.name: {each.content for each in each.hashes} for each in bom.components if each.type is ComponentType.FILE}
    assert listed == {path: {hashlib.sha256(data).hexdigest()} for path, data in files.items() if path != "sbom.cdx.json"}
    assert {each.type for each in bom.components} == {ComponentType.FILE, ComponentType.DATA, ComponentType.LIBRARY}
    assert {"ars-codegen", "casadi"} <= {tool.name for tool in bom.metadata.tools.components}

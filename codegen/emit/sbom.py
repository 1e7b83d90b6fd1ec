"""Software bill of materials of a build, `sbom.cdx.json`: CycloneDX 1.6 (ECMA-424) in JSON.

It lists the files of the build, the map from which they were generated, the tools that generated them, and the functions of the
C library that they call. It has no time stamp, so the same build gives the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Mapping
from typing import Any

FILE = "sbom.cdx.json"
LICENCES = [{"license": {"id": "0BSD"}}]


def sbom(files: Mapping[str, bytes], facts: Mapping[str, Any]) -> bytes:
    """Return the bill of materials.

    Args:
        files: content of the files of the build by path.
        facts: of the manifest: "name", "build_id", "version", "tools", "inputs" and "dynamics_library_functions" are used.
    """
    build = {
        "type": "library",
        "bom-ref": "build",
        "name": facts["name"],
        "version": facts["build_id"],
        "description": "Yaw-rate control for active rear steering, generated C99",
        "licenses": LICENCES,
    }
    tools = {"ars-codegen": facts["version"], **facts["tools"]}
    map_file = facts["inputs"]["map"]
    components = [
        {"type": "data", "bom-ref": "map", "name": map_file["file"], "hashes": _hashes(map_file["sha256"])},
        *(
            {
                "type": "file",
                "bom-ref": path,
                "name": path,
                "hashes": _hashes(hashlib.sha256(data).hexdigest()),
                "licenses": LICENCES,
            }
            for path, data in sorted(files.items())
        ),
    ]
    if functions := facts["dynamics_library_functions"]:
        text = f"C mathematical library of the target: {', '.join(functions)}; called by the vehicle dynamics only"
        components.append({"type": "library", "bom-ref": "libm", "name": "libm", "scope": "optional", "description": text})
    document = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "lifecycles": [{"phase": "build"}],
            "tools": {
                "components": [
                    {"type": "application", "name": name, "version": version, "purl": f"pkg:pypi/{name}@{version}"}
                    for name, version in tools.items()
                ]
            },
            "component": build,
        },
        "components": components,
        "dependencies": [{"ref": "build", "dependsOn": [each["bom-ref"] for each in components]}],
    }
    text = json.dumps(document, sort_keys=True)
    serial = uuid.uuid5(uuid.NAMESPACE_OID, text).urn
    return (json.dumps({**document, "serialNumber": serial}, indent=1) + "\n").encode("ascii")


def _hashes(sha256: str) -> list[dict[str, str]]:
    return [{"alg": "SHA-256", "content": sha256}]

"""Files that integrate a build into a C project (CMake, GNU make, Zephyr), and its software bill of materials.

`sbom.cdx.json` is CycloneDX 1.6 (ECMA-424) in JSON. It lists the files of the build, the map from which they were generated,
the tools that generated them, and the functions of the C library that they call. It has no time stamp, so the same build gives
the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from codegen.emit.folder import Folder
from codegen.emit.render import render


@dataclass(frozen=True)
class TakeOver:
    """Names that the templates of the integration files use in addition to the build.

    Attributes:
        sources: files of the controller and its task, relative to the build.
        dynamics_source: the file that needs the mathematical library; no other file needs it.
        zephyr_name: name of the Zephyr module and its library.
        ZEPHYR_NAME: its Kconfig symbol, long enough not to collide with a symbol of Zephyr for any prefix.
    """

    sources: tuple[str, ...]
    dynamics_source: str
    zephyr_name: str
    ZEPHYR_NAME: str

    @classmethod
    def of(cls, prefix: str, sources: Iterable[str]) -> Self:
        """Return the names for all sources of a build with this prefix."""
        dynamics, name = f"src/{prefix}_dynamics.c", f"{prefix}_rear_steering"
        return cls(tuple(source for source in sources if source != dynamics), dynamics, name, name.upper())


def take_over_files(context: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the integration files, content by path.

    Args:
        context: template context of a build; "build" and "dynamics" are used.
    """
    build = context["build"]
    known = {**context, "take_over": TakeOver.of(build.prefix, build.sources)}
    return {
        "CMakeLists.txt": render("CMakeLists.txt.j2", known),
        f"{build.prefix}.mk": render("makefile.mk.j2", known),
        "zephyr/CMakeLists.txt": render("zephyr/CMakeLists.txt.j2", known),
        "zephyr/Kconfig": render("zephyr/Kconfig.j2", known),
        "zephyr/module.yml": render("zephyr/module.yml.j2", known),
    }


SBOM_FILE = "sbom.cdx.json"
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


def with_tools(folder: Folder, tools: Mapping[str, str]) -> Folder:
    """Return a build with other tool versions in its manifest and its bill of materials."""
    facts = {**folder.manifest, "tools": dict(tools)}
    files = {path: data for path, data in folder.files.items() if path != SBOM_FILE}
    return Folder({**files, SBOM_FILE: sbom(files, facts)}, facts)


def _hashes(sha256: str) -> list[dict[str, str]]:
    return [{"alg": "SHA-256", "content": sha256}]

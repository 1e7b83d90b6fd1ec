"""The C inside an FMU: files of the build, the plant, the model around them, and the FMI functions.

All of it lies in one folder, so that any compiler finds every header beside the file that includes it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

from codegen.configuration import Config
from codegen.emit.render import render, verbatim
from codegen.emit.text import Precision
from codegen.export.fmu.model_view import context, rows
from codegen.export.fmu.standard import Version
from codegen.export.fmu.variables import Variable, What
from codegen.sil.plant import plant_sources

_INCLUDE = re.compile(rb'^#include "([^"]+)"', re.MULTILINE)


def build_sources(files: Mapping[str, bytes], prefix: str) -> dict[str, bytes]:
    """Return name -> content of the controller's sources in a build, and of every header and source they depend on."""
    named = {PurePosixPath(path).name: content for path, content in files.items()}
    found: dict[str, bytes] = {}
    waiting = [f"{prefix}_controller.h", f"{prefix}_calibration.c"]
    while waiting:
        name = waiting.pop()
        if name in named and name not in found:
            found[name] = named[name]
            waiting += [included.decode("ascii", "replace") for included in _INCLUDE.findall(named[name])]
            waiting.append(f"{name.removesuffix('.h')}.c")
    return found


def model_sources(
    what: What, version: Version, config: Config, prefix: str, precision: Precision, variables: Sequence[Variable], token: str
) -> dict[str, bytes]:
    """Return the wrapper: model, variables, instance, FMI functions and, if used, the plant."""
    seen = {
        **context(what, config, prefix, precision, variables),
        "variables": rows(variables, version),
        "token": token,
    }
    model = "plant_model.c" if what == "plant" else f"{what}_model.c.j2"
    templates = {
        "fmu_config.h": "fmu_config.h.j2",
        "model.h": "model.h.j2",
        "model.c": model,
        "variables.h": "variables.h",
        "variables.c": "variables.c.j2",
        "instance.h": "instance.h",
        "instance.c": "instance.c",
        f"fmi{version}.c": f"fmi{version}.c",
    }
    if version == "3":
        templates["fmi3_unsupported.c"] = "fmi3_unsupported.c"
    made = {
        name: render(f"fmu/{source}", seen) if source.endswith(".j2") else verbatim(f"fmu/{source}")
        for name, source in templates.items()
    }
    return {**made, **(plant_sources(config) if what != "controller" else {})}

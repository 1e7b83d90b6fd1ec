"""The AUTOSAR export of a build: ARXML files, and the adapter between the RTE and the controller in C."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from xml.etree import ElementTree

from codegen import __version__, configuration
from codegen.configuration import Config
from codegen.configuration.can import NODES
from codegen.emit.build import NAMED_NUMBERS, BuildView
from codegen.emit.can_view import CanView, Cause, task_view
from codegen.emit.folder import MANIFEST, Folder, read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.map_view import magnitude_bits
from codegen.emit.render import decimal, render
from codegen.emit.take_over import TakeOver
from codegen.emit.text import c_type, comment_text, literal, numpy_type
from codegen.errors import BuildError
from codegen.export.arxml.constraints import check_names, check_transformer
from codegen.export.arxml.view import (
    PLATFORM_TYPES,
    CalibrationView,
    map_views,
    message_views,
    parameter_views,
)
from codegen.sil.software import require_can_side
from codegen.units import KM_H, NONE, in_order

Protection = Literal["transformer", "task"]
"""Protection of the frames: the E2E transformer of the RTE, or the task of the build on raw frames."""

Access = Literal["explicit", "implicit"]
"""Reading by `Rte_Read` in the runnable, or by `Rte_IRead` from a buffer that the RTE fills before the runnable starts."""

WHAT = "autosar"
"""Manifest entry that distinguishes the export from a build."""

DATA_ID_MODES = {
    "both": ("ALL-16-BIT", 0),
    "alternating": ("ALTERNATING-8-BIT", 1),
    "nibble": ("LOWER-12-BIT", 3),
}
"""Names of the data id mode in a transformer, and its number in an end-to-end profile, for profiles with variants."""

QUEUE_LENGTH = 4
"""Frames of a message that wait for the task, in the variant on raw frames. The task is late if more than one waits."""

CALIBRATION_PERIOD_S = 1.0
"""Period of the runnable that takes over changed parameters, in s."""

REJECTED = Cause(16, "PARAMETERS_REJECTED", "the parameters of the RTE are not valid; others are in use", "")
"""Event of the adapter, beside those of the controller."""

EVENT_STATUS = "Dem_EventStatusType"
"""Type of the status of an event, with the name that the Dem has for it."""

SECTIONS = (
    ("CODE", "CODE", ""),
    ("CONST_UNSPECIFIED", "CONST", ""),
    ("CALIB_UNSPECIFIED", "CALPRM", ""),
    ("VAR_CLEARED_UNSPECIFIED", "VAR", "CLEARED"),
)
"""SwAddrMethods: name, section type and initialisation policy."""

_LAYOUTS = {"COM_AXIS": (1,), "CURVE": (1,), "MAP": (1, 2), "CUBOID": (1, 2, 3)}
"""Axes of a record layout; the values along the first one are adjacent."""


@dataclass(frozen=True)
class Export:
    """An export in memory.

    Attributes:
        folder: its files.
        arxml: path of the ARXML in it.
        edited: files of the build that were changed after generation.
    """

    folder: Folder
    arxml: str
    edited: tuple[str, ...]


def export(build: Path, protection: Protection = "transformer", access: Access = "explicit") -> Export:
    """Return the AUTOSAR export of a build without writing files.

    Raises:
        BuildError: implicit access to the queues of the task; settings of E2E that AUTOSAR does not allow for a transformer;
            names of messages that AUTOSAR does not allow; not a build, one of another version, or one whose calibration was
            changed.
    """
    if access == "implicit" and protection == "task":
        raise BuildError(
            "implicit access cannot read the queues of raw frames", remedy="give `e2e='transformer'`, or `access='explicit'`"
        )
    manifest = read_build(build)
    require_can_side(manifest, build)
    prefix = str(manifest["options"]["prefix"])
    edited = tuple(verify_hashes(build))
    _require_as_built(manifest, build, edited)
    files = read_files(build, manifest, ("src/",))
    config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    if protection == "transformer":
        check_transformer(config.can)
    context = _context(manifest, config, protection, access)
    component = context["component"]
    made = {
        f"{prefix}.arxml": _indented(render("arxml/main.j2", context)),
        "platform_types.arxml": _indented(render("arxml/platform.j2", context)),
        f"include/{component}_MemMap.h": render("autosar/memmap.h.j2", context),
        f"include/{prefix}_swc_version.h": render("autosar/version.h.j2", context),
        f"src/{prefix}_swc.c": render("autosar/swc.c.j2", context),
    }
    for path in sorted(files):
        unit = PurePosixPath(path).stem
        made[f"memmap/{unit}_memmap.c"] = render("autosar/unit.c.j2", {**context, "unit": unit})
    facts = {
        "schema_version": 1,
        "version": __version__,
        "what": WHAT,
        "name": manifest["name"],
        "options": {**manifest["options"], "e2e": protection, **({"access": access} if access == "implicit" else {})},
        "build": {
            "id": manifest["build_id"],
            "manifest_sha256": hashlib.sha256((build / MANIFEST).read_bytes()).hexdigest(),
            "edited": list(edited),
        },
    }
    return Export(Folder(made, facts), f"{prefix}.arxml", edited)


def _require_as_built(manifest: Mapping[str, Any], build: Path, edited: tuple[str, ...]) -> None:
    """Raise BuildError if the build's C may differ from what the adapter and the parameters assume."""
    if manifest["version"] != __version__:
        # The adapter shares internals of the task.
        what = f"it was made by codegen {comment_text(str(manifest['version']))}, and this is {__version__}"
        raise BuildError(what, where=build, remedy="build it again")
    calibration = f"src/{manifest['options']['prefix']}_calibration.c"
    if calibration in edited:
        what = f"{calibration} was changed after the build, and the parameters of the ARXML come from the configuration"
        raise BuildError(what, where=build, remedy="set the values in ars.toml and build it again")


def _indented(arxml: bytes) -> bytes:
    """Return ARXML with one element in a line. Raises BuildError if its names are not valid."""
    head, start, body = arxml.decode("ascii").partition("<AUTOSAR ")
    root = ElementTree.fromstring(start + body)
    check_names(root)
    ElementTree.indent(root)
    for prefix, uri in _NAMESPACES.items():
        ElementTree.register_namespace(prefix, uri)
    return f"{head}{ElementTree.tostring(root, encoding='unicode')}\n".encode("ascii")


_NAMESPACES = {"": "http://autosar.org/schema/r4.0", "xsi": "http://www.w3.org/2001/XMLSchema-instance"}


def _context(manifest: Mapping[str, Any], config: Config, protection: Protection, access: Access) -> dict[str, Any]:
    """Return the context of all templates."""
    options = manifest["options"]
    prefix, precision = str(options["prefix"]), options["precision"]
    parameters, tables = parameter_views(config, precision), map_views(manifest, prefix, precision)
    can, period = CanView(config, precision), config.controller.sampling_time_s
    calibrated = (*parameters, *tables)
    bits = numpy_type(precision)().itemsize * 8
    messages = message_views(can.messages, can.profile, (EVENT_STATUS, *(each.name for each in calibrated)))
    measured = (signal for message in messages for signal in message.signals)
    used = {NONE, *(each.unit for each in calibrated), *(signal.unit for signal in measured)}
    by_transformer = protection == "transformer"
    return {
        "build": _build_view(manifest, prefix),
        "component": prefix.capitalize(),
        "kind": options["kind"],
        "real": c_type(precision),
        **{name: literal(value, precision) for name, value in NAMED_NUMBERS.items()},
        "map": {"bits_type": f"uint{bits}_t", "magnitude_bits": magnitude_bits(bits)},
        "controller": {"sampling_time": literal(period, precision)},
        "measured": config.can.measured,
        "by_transformer": by_transformer,
        "is_implicit": access == "implicit",
        "can": can,
        "e2e": config.can.e2e,
        "messages": messages,
        "i_signals": {
            message.name: [signal.name for signal in message.signals] if by_transformer else [f"{message.name}_Frame"]
            for message in messages
        },
        "parameters": parameters,
        "tables": tables,
        "arrays": _arrays(calibrated),
        "layouts": _layouts(calibrated),
        "units": in_order(used),
        "event_status": EVENT_STATUS,
        "events": (*can.diagnostics, REJECTED),
        "nodes": NODES,
        "frame_bytes": can.frame_bytes,
        "platform_types": PLATFORM_TYPES,
        "profile": can.profile,
        "data_id_modes": DATA_ID_MODES.get(can.profile.data_id_mode),
        "sections": SECTIONS,
        "queue_length": QUEUE_LENGTH,
        "task": task_view(config),
        "period": decimal(period),
        "calibration_period": decimal(CALIBRATION_PERIOD_S),
        "timeout": decimal(period * config.can.e2e.window_size),
        "baudrate": can.baudrate,
        "version": (re.findall(r"\d+", str(manifest["version"])) + ["0"] * 3)[:3],
        "sources": (
            f"src/{prefix}_swc.c",
            *TakeOver.of(prefix, (path for path in manifest["files"] if path.startswith("src/"))).sources,
        ),
    }


def _build_view(manifest: Mapping[str, Any], prefix: str) -> BuildView:
    facts = manifest["map"]
    speed, angle = facts["speed_m_s"][-1], facts["front_angle_rad"][-1]
    return BuildView(
        name=comment_text(str(manifest["name"])),
        prefix=prefix,
        PREFIX=prefix.upper(),
        version=str(manifest["version"]),
        epk=str(manifest["build_id"]),
        domain=f"road friction {facts['friction']:g}, 0 to {speed / KM_H:.4g} km/h, front angles to {angle:.4g} rad",
        sources=(),
    )


def _arrays(calibrated: tuple[CalibrationView, ...]) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Return name -> type of a number and shape, of each array type."""
    return {each.array: (each.type, each.shape) for each in calibrated if each.shape}


def _layouts(calibrated: tuple[CalibrationView, ...]) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return category, type and axes of each record layout."""
    found = dict.fromkeys((each.category, each.type) for each in calibrated if each.shape)
    return [(category, type_, _LAYOUTS[category]) for category, type_ in found]

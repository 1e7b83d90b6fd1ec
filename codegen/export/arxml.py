"""The AUTOSAR export of a build: ARXML files, and the adapter between the RTE and the controller in C.

Settings of the E2E protection that AUTOSAR does not allow for a transformer, and names that it does not allow, are rejected:
System Template, constraints constr_3157, constr_3158, constr_3177 to constr_3181 and constr_3195; Generic Structure Template,
constr_2508.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal
from xml.etree import ElementTree

from codegen import __version__, configuration
from codegen.configuration import Config
from codegen.configuration.can import NODES, Can
from codegen.emit.build import NAMED_NUMBERS, BuildView
from codegen.emit.can_view import CanView, Cause, task_view
from codegen.emit.folder import MANIFEST, Folder, read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.map_view import magnitude_bits
from codegen.emit.render import decimal, render
from codegen.emit.take_over import TakeOver
from codegen.emit.text import c_type, comment_text, literal, numpy_type
from codegen.errors import BuildError
from codegen.export.arxml_view import (
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


DATA_ID_MIN = 0x100
"""Smallest data id of variant 1C, whose frames carry its high byte."""

OF_COM = ("I-SIGNAL", "I-SIGNAL-GROUP", "I-SIGNAL-I-PDU", "I-SIGNAL-I-PDU-GROUP")
"""Kinds of elements that become containers of one configuration, that of COM."""

_SHORT_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,127}\Z", re.ASCII)


def check_names(model: ElementTree.Element) -> None:
    """Check that each short name is valid and, in any letter case, the only one in its element and, for COM, in the model.

    Only the name of a message and the prefix of the build can cause a fault.

    Raises:
        BuildError: a name is not.
    """
    used, waiting = set[str](), [(model, "")]
    while waiting:
        element, path = waiting.pop()
        name, kind = element.findtext("{*}SHORT-NAME"), element.tag.rpartition("}")[2]
        if name is not None:
            path = f"{path}/{name}"
            keys = {path.casefold()} | ({name.casefold()} if kind in OF_COM else set())
            valid = _SHORT_NAME.match(name)
            if used & keys or not valid:
                what = f"two elements are called {name} in any letter case" if valid else "it does not begin with a letter"
                remedy = "rename the message of that name in ars.toml, in [can], and build it again"
                raise BuildError(f"{what}, which AUTOSAR does not allow", where=path, remedy=remedy)
            used |= keys
        waiting += [(child, path) for child in reversed(element)]


def check_transformer(can: Can) -> None:
    """Check that AUTOSAR allows the settings for a transformer.

    Raises:
        BuildError: it does not.
    """
    fault = next(_faults(can), None)
    if fault is not None:
        where, what = fault
        raise BuildError(
            f"{what}, which AUTOSAR does not allow for a transformer",
            where=where,
            remedy="change it in ars.toml and build again with `config=`, or give `e2e='task'`",
        )


def _faults(can: Can) -> Iterator[tuple[str, str]]:
    """Yield table and description of each fault. The configuration checks the rest of the constraints."""
    e2e, where = can.e2e, "[can.e2e]"
    for smaller, larger in (("max_error_state_invalid", "max_error_state_init"), ("min_ok_state_init", "min_ok_state_invalid")):
        low, high = getattr(e2e, smaller), getattr(e2e, larger)
        if low > high:
            yield where, f"{smaller} = {low} is above {larger} = {high}"
    for state in ("init", "valid", "invalid"):
        total = getattr(e2e, f"min_ok_state_{state}") + getattr(e2e, f"max_error_state_{state}")
        if total > e2e.window_size:
            yield where, f"min_ok_state_{state} + max_error_state_{state} = {total} is above window_size = {e2e.window_size}"
    if e2e.definition.has_synchronisation and e2e.max_delta_counter_init < 1:
        yield where, f"max_delta_counter_init = {e2e.max_delta_counter_init} is below 1"
    for role, message in can.messages().items():
        number = message.e2e_data_id
        if e2e.profile == "1C" and isinstance(number, int) and number < DATA_ID_MIN:
            yield f"[can.{role}]", f"the data id 0x{number:X} is below 0x{DATA_ID_MIN:X}"

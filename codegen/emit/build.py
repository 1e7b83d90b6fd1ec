"""Render the complete folder of a build, in memory, from map, configuration and options."""

from __future__ import annotations

import hashlib
import importlib.metadata
import math
import shlex
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from codegen import __version__, configuration
from codegen.configuration import Config, check_name
from codegen.configuration.signals import CARRIED, STATUSES
from codegen.design.margins import margin_range_km_h
from codegen.ecu_map.extend import RULE_TEXT, Rule, TotalMap, extend
from codegen.ecu_map.lookup import Lookup, error_bound
from codegen.ecu_map.placement import Placed, Request, choose
from codegen.emit import supervision
from codegen.emit.a2l_view import a2l, domain_text, manifest_objects, symbols_of
from codegen.emit.can_view import CanView, task_view
from codegen.emit.constants import constants_of
from codegen.emit.contracts.files import contract_files
from codegen.emit.controller_view import ControllerView, known_values, parameters_by_path
from codegen.emit.deviations import DEVIATIONS_FILE, deviations
from codegen.emit.dynamics_view import DynamicsView, ReferenceModelView
from codegen.emit.evidence import Evidence, grip_facts, margins_text, placement_facts, placement_text, request_facts
from codegen.emit.folder import Folder
from codegen.emit.inputs_view import InputsView
from codegen.emit.laws import law_of
from codegen.emit.limiter_view import LimiterView, cut_text
from codegen.emit.map_view import MapView
from codegen.emit.parameters import Parameter
from codegen.emit.render import render, verbatim
from codegen.emit.take_over import SBOM_FILE, sbom, take_over_files
from codegen.emit.text import Precision, c_type, check_prefix, comment_text, literal, numpy_type
from codegen.emit.xcp_view import xcp_view
from codegen.errors import BuildError, parts_of
from codegen.map_file import judged
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack

TOOLS = ("casadi", "jinja2", "numpy", "scipy")
HEADERS = (
    "sections",
    "checksum",
    "constants",
    "map",
    "inputs",
    "limiter",
    "parameters",
    "law",
    "controller",
    "dynamics",
    "e2e",
    "can",
    "supervision",
    "task",
)
SOURCES = ("calibration", *(header for header in HEADERS if header not in ("sections", "constants")), "selftest")
OF_REFERENCE_MODEL = ("grip", "reference_model")
"""Units of the laws that use the reference model."""
LINUX = ("ars_xcp.c", "ars_xcp.h")
"""C files of the Linux program that are the same in every build."""
MAP_FILE = "verify/map.npz"
"""Path of the map in a build, from which `codegen verify` renders the C again."""
BLANK_ID = "\0" * 8
"""Placeholder of the id while the files are rendered whose hash it is. No other text contains this character."""
NAMED_NUMBERS = {
    "zero": 0.0,
    "quarter": 0.25,
    "half": 0.5,
    "one": 1.0,
    "two": 2.0,
    "three": 3.0,
    "five": 5.0,
    "minus_one": -1.0,
}
"""Literals that every template may print."""
EXAMPLE_DURATION = 5.0
EXAMPLE_SPEED = 42.5 * KM_H


@dataclass(frozen=True)
class BuildInputs:
    """Inputs of a build as the manifest lists them: file names without folders, and SHA-256 of their bytes."""

    map_file: str
    map_sha256: str
    config_source: str


@dataclass(frozen=True)
class BuildOptions:
    """Options of a build: its name, the prefix of the C names, the precision of the numbers, and the request that the chosen
    breakpoints must meet (None: the breakpoints of the map)."""

    name: str
    prefix: str = "ars"
    precision: Precision = "single"
    request: Request | None = None

    def __post_init__(self) -> None:
        check_prefix(self.prefix)
        try:
            check_name(self.name)
        except ValueError as error:
            what, remedy = parts_of(error)
            raise BuildError(what, where="name of the build", remedy=f"rename the map or the output folder: {remedy}") from None


@dataclass(frozen=True)
class BuildView:
    """Facts of the build that every template may print; `epk` is the id as text."""

    name: str
    prefix: str
    PREFIX: str
    version: str
    epk: str
    domain: str
    sources: tuple[str, ...]

    @property
    def id(self) -> str:
        """The id as a C literal."""
        return f"0x{self.epk}u"


@dataclass(frozen=True)
class Checksum:
    """Checksum of map, parameters and tyre curves.

    Attributes:
        value: CRC-32 as the C computes it.
        steps: number of four-bit table look-ups in its computation.
        parameters: fields of the parameter structs by their path, in its order.
    """

    value: int
    steps: int
    parameters: Mapping[str, Parameter]


@dataclass(frozen=True)
class Example:
    """Steady turn of `example_main.c`: speed (m/s), front angle (rad), yaw-rate gain of the car (1/s), number of samples."""

    speed: float
    front_angle: float
    yaw_gain: float
    samples: int
    time_constant: float = 0.2
    duration: float = EXAMPLE_DURATION

    @property
    def speed_km_h(self) -> float:
        """Speed in km/h."""
        return self.speed / KM_H

    @property
    def front_angle_deg(self) -> float:
        """Front angle in deg."""
        return math.degrees(self.front_angle)


@dataclass(frozen=True)
class _Parts:
    """Inputs and results from which README and manifest are made."""

    reference_map: ReferenceMap
    config: Config
    options: BuildOptions
    inputs: BuildInputs
    total: TotalMap
    table: MapView
    error_bound: float
    placed: Placed | None


@dataclass(frozen=True)
class _Code:
    """C of a build by path, the template context of its other files, and the facts for the manifest."""

    files: dict[str, bytes]
    context: dict[str, Any]
    parts: _Parts
    facts: dict[str, Any]


def build(reference_map: ReferenceMap, config: Config, options: BuildOptions, inputs: BuildInputs) -> Folder:
    """Render all files of a build.

    Args:
        reference_map: solved or bare.
        config: configuration of car and controller; that of the map unless the user named another one.

    Raises:
        BuildError, MapError: see `extend` and `check_prefix`.
    """
    judgement = judged.current(reference_map, config)
    config = with_signals(reference_map, config)
    code = _code(reference_map, config, options, inputs)
    evidence = Evidence(reference_map, code.parts.total, config, numpy_type(options.precision))
    context, prefix = {**code.context, "readme": _readme_facts(code.parts, evidence)}, options.prefix
    contracts, proofs = contract_files(context)
    files = {
        **code.files,
        f"{prefix}.dbc": render("dbc.j2", context),
        f"{prefix}.a2l": a2l(code.facts, config),
        **take_over_files(context),
        **contracts,
        "README.md": render("README.md.j2", context),
    }
    files[DEVIATIONS_FILE] = render("deviations.md.j2", {**context, "deviations": deviations(files)})
    files[MAP_FILE] = npz.to_bytes(judged.with_judgement(reference_map, None))
    files[SBOM_FILE] = sbom(files, code.facts)
    manifest = {
        **code.facts,
        **evidence.to_dict(),
        "proofs": [each.model_dump(exclude_defaults=True) for each in proofs],
        **({} if judgement is None else {judged.KEY: judgement}),
    }
    return Folder(files=files, manifest=manifest)


def code_again(manifest: Mapping[str, Any], files: Mapping[str, bytes]) -> Folder:
    """Render headers and sources again from manifest and map of a build of this version.

    Raises:
        BuildError: the files have no map.
        MapError, ConfigError: as `build`.
    """
    if MAP_FILE not in files:
        raise BuildError("missing", where=MAP_FILE, remedy="build again with `codegen build`")
    reference_map = npz.from_bytes(files[MAP_FILE], MAP_FILE)
    config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    given = manifest["options"]
    request = None
    if "storage" in given:
        request = Request(given["max_error_rad_s"], given["max_flash_bytes"], given["storage"], "")
    options = BuildOptions(manifest["name"], given["prefix"], given["precision"], request)
    return build_code(reference_map, config, options, BuildInputs("", "", ""))


def build_code(reference_map: ReferenceMap, config: Config, options: BuildOptions, inputs: BuildInputs) -> Folder:
    """Render headers and sources only, for compiling in memory. They equal those of `build` and take a fraction of the time.

    The manifest lacks the evidence (`codegen.emit.evidence`).

    Raises:
        BuildError, MapError: as `build`.
    """
    code = _code(reference_map, with_signals(reference_map, config), options, inputs)
    return Folder({path: text for path, text in code.files.items() if path.startswith(("include/", "src/"))}, code.facts)


def build_facts(reference_map: ReferenceMap, config: Config) -> dict[str, Any]:
    """Return the manifest of a map's default build without hashes and without the consequences of a loss, which take long.

    Raises:
        BuildError, MapError: as `build`.
    """
    config, options = with_signals(reference_map, config), BuildOptions("checked")
    code = _code(reference_map, config, options, BuildInputs("", "", ""))
    evidence = Evidence(reference_map, code.parts.total, config, numpy_type(options.precision))
    return {**code.facts, **evidence.to_dict(with_loss=False)}


def with_signals(reference_map: ReferenceMap, config: Config) -> Config:
    """Return the configuration with the signal that a stack over longitudinal acceleration needs in its frame.

    Raises:
        ConfigError: the default place of the signal is taken.
    """
    can = config.can.with_signal(ACCELERATION_STACK.key) if reference_map.quantity is ACCELERATION_STACK else config.can
    if can is config.can:
        return config
    return config.replace({"can": can}, "a stack over longitudinal acceleration needs its signal")


def _code(reference_map: ReferenceMap, config: Config, options: BuildOptions, inputs: BuildInputs) -> _Code:
    law = law_of(config)
    placed = _placed(reference_map, config, options)
    total = placed.total if placed else extend(reference_map, config, config.steering.front_angle_stop)
    check_inputs(reference_map, config)
    more = OF_REFERENCE_MODEL if law.uses_reference_model else ()
    headers, sources = (*HEADERS, *more), (*SOURCES, *more)
    real = c_type(options.precision)
    view = BuildView(
        name=comment_text(options.name),
        prefix=options.prefix,
        PREFIX=options.prefix.upper(),
        version=__version__,
        epk=BLANK_ID,
        domain=domain_text(total.friction, total.speed[-1], total.front_angle[-1]),
        sources=tuple(f"src/{options.prefix}_{source}.c" for source in sources),
    )
    lookup = Lookup.from_map(total, numpy_type(options.precision))
    table = MapView(total, lookup, config, options.precision, options.prefix)
    constants = constants_of(config, total, lookup)
    dynamics = DynamicsView(config, options.precision)
    context: dict[str, Any] = {
        "build": view,
        "map": table,
        "constants": constants,
        "controller": ControllerView(config, known_values(total, lookup)),
        "law": law,
        "inputs": InputsView(config),
        "limiter": LimiterView(config),
        "model": (ReferenceModelView(config, options.precision, per_axle=table.moving) if law.uses_reference_model else None),
        "dynamics": dynamics,
        "can": CanView(config, options.precision),
        "measured": config.can.measured,
        "carried": CARRIED,
        "statuses": STATUSES,
        "supervision": supervision,
        "task": task_view(config),
        "xcp": xcp_view(config, task_view(config).function),
        "config": config,
        "precision": options.precision,
        "example": _example(reference_map, config),
        "real": real,
        **{name: literal(value, options.precision) for name, value in NAMED_NUMBERS.items()},
    }
    context["checksum"] = _checksum(config, options.precision, table, context["model"])
    objects = manifest_objects(
        options.prefix, options.precision, context["controller"], context["inputs"], context["limiter"], table, context["can"]
    )
    prefix = options.prefix
    files = {
        **{f"include/{prefix}_{name}.h": render(f"include/{name}.h.j2", context) for name in headers},
        **{f"src/{prefix}_{name}.c": render(f"src/{name}.c.j2", context) for name in sources},
        "example/example_main.c": render("example/example_main.c.j2", context),
        "linux/ars_ecu_config.h": render("linux/ars_ecu_config.h.j2", context),
        "linux/ars_ecu.c": render("linux/ars_ecu.c.j2", context),
        **{f"linux/{name}": verbatim(f"linux/{name}") for name in LINUX},
    }
    identity = _build_id(files)
    files = {path: text.replace(BLANK_ID.encode(), identity.encode()) for path, text in files.items()}
    context["build"] = replace(view, epk=identity)
    bound = error_bound(total, numpy_type(options.precision))
    parts = _Parts(reference_map, config, options, inputs, total, table, bound, placed)
    facts = {**_facts(parts, dynamics, context["checksum"], identity), **objects.to_dict()}
    return _Code(files, context, parts, facts)


def _checksum(config: Config, precision: Precision, map_view: MapView, model: ReferenceModelView | None) -> Checksum:
    parameters = parameters_by_path(config)
    rest = b"".join(
        each.value.to_bytes(2, "little") if isinstance(each.value, int) else _bytes(each.values, precision)
        for each in parameters.values()
    )
    if model is not None:
        rest += b"".join(_bytes([curve.compression, *curve.values], precision) for curve in model.curves.values())
    return Checksum(zlib.crc32(rest, map_view.checksum), 2 * map_view.flash_bytes + 2 * len(rest), parameters)


def _bytes(values: Iterable[float], precision: Precision) -> bytes:
    """Return the bytes of numbers in the target's precision, least significant byte first."""
    numbers = np.array(list(values), dtype=numpy_type(precision))
    return numbers.astype(numbers.dtype.newbyteorder("<")).tobytes()


def _placed(reference_map: ReferenceMap, config: Config, options: BuildOptions) -> Placed | None:
    if options.request is None:
        return None
    tables = 2 if law_of(config).uses_rear_angle else 1
    return choose(reference_map, config, options.request, tables, numpy_type(options.precision))


def check_inputs(reference_map: ReferenceMap, config: Config) -> None:
    """Reject input ranges that exclude speeds or yaw rates of the map, and feedback that begins above half of its speeds."""
    controller, inputs = config.controller, config.controller.inputs
    fastest = reference_map.speed[-1] / KM_H
    _, whole = controller.feedback_speeds_km_h
    if whole > 0.5 * fastest:
        key, share = ("enable_speed_km_h", "half") if controller.waits_for_speed else ("slow_speed_km_h", "a quarter")
        raise BuildError(
            f"{getattr(controller, key):g} km/h is more than {share} of the map's last speed, {fastest:.4g} km/h",
            where=f"controller.{key}",
            remedy="lower it, or solve the map to higher speeds",
        )
    if inputs.speed_max_km_h < fastest:
        raise BuildError(
            f"{inputs.speed_max_km_h:g} km/h is below the map's last speed, {fastest:.4g} km/h",
            where="controller.inputs.speed_max_km_h",
            remedy="raise it, or solve the map to lower speeds: larger values are treated as faults",
        )
    asked = reference_map.feasible & (reference_map.speed >= whole * KM_H)[:, np.newaxis]
    largest = math.degrees(np.where(asked, reference_map.yaw_rate, 0.0).max())
    if inputs.yaw_rate_max_deg_s < largest:
        raise BuildError(
            f"{inputs.yaw_rate_max_deg_s:g} deg/s is below the map's largest yaw rate, {largest:.4g} deg/s",
            where="controller.inputs.yaw_rate_max_deg_s",
            remedy="raise it, with room for a spin: larger values are treated as faults",
        )


def _build_id(files: Mapping[str, bytes]) -> str:
    """Return eight hexadecimal digits that change with any path or byte of the C, in which the id itself is blank.

    All headers and sources of a build contain them. Nothing else changes them: builds with the same id are the same program.
    """
    hashes = "".join(f"{hashlib.sha256(text).hexdigest()} {path}\n" for path, text in sorted(files.items()))
    return hashlib.sha256(hashes.encode()).hexdigest()[:8].upper()


def _example(reference_map: ReferenceMap, config: Config) -> Example:
    """Return a steady turn inside the map: the speed nearest to the paper's and half of its largest feasible front angle."""
    rows = np.flatnonzero(reference_map.feasible.any(axis=1) & (reference_map.speed > 0.0))
    row = rows[np.argmin(np.abs(reference_map.speed[rows] - EXAMPLE_SPEED))]
    speed = float(reference_map.speed[row])
    front_angle = 0.5 * float(reference_map.front_angle[np.flatnonzero(reference_map.feasible[row])[-1]])
    gain = float(SingleTrack.from_config(reference_map.config or config).yaw_gain(speed))
    samples = round(EXAMPLE_DURATION / config.controller.sampling_time_s)
    return Example(speed, front_angle, gain, samples)


def rule_counts(total: TotalMap) -> dict[Rule, int]:
    """Count the cells of a total map by the rule that made them."""
    counts = Counter(total.rule.ravel().tolist())
    return {rule: counts[rule.value] for rule in Rule if counts[rule.value]}


def _readme_facts(parts: _Parts, evidence: Evidence) -> dict[str, Any]:
    config, options, inputs, total = parts.config, parts.options, parts.inputs, parts.total
    reference_map = parts.reference_map
    flags = "" if options.prefix == "ars" else f" --prefix {options.prefix}"
    flags += "" if options.precision == "single" else f" --precision {options.precision}"
    flags += f" {options.request.words}" if options.request else ""
    flags += "" if inputs.config_source in ("map", "preset") else f" --config {shlex.quote(comment_text(inputs.config_source))}"
    return {
        "origin": f"case {reference_map.case} of the optimisation" if reference_map.solved else "a table from another tool",
        # Printed only for models other than the linear one, so that older builds stay byte-identical.
        "tyre": "" if reference_map.tyre_model == "linear" else reference_map.tyre_model or "",
        "map_file": comment_text(inputs.map_file),
        "flags": flags,
        "borrowed": inputs.config_source == "preset",
        "precision": options.precision,
        "kind": config.controller.kind,
        "title": law_of(config).title,
        "margins": margins_text(evidence.margins),
        "loss": evidence.loss_rows(),
        "limiter_cut": cut_text(evidence.limiter_cut.to_dict()),
        "margin_range": _margin_range(config),
        "loss_share": evidence.loss.share_of_feasible,
        "loss_percent": _percent(evidence.loss.share_of_feasible),
        "rules": [(rule.value, count, RULE_TEXT[rule]) for rule, count in rule_counts(total).items()],
        "cells": total.yaw_rate.size,
        "error_bound": f"{parts.error_bound:.2g}",
        "flash": parts.table.flash_bytes,
        "placement": placement_text(parts.placed) if parts.placed else "",
        "degraded_samples": config.controller.fail_safe.degraded_samples_max,
        "fail_safe_ms": f"{(config.controller.fail_safe.degraded_samples_max + 1) * config.controller.sampling_time_s * 1e3:g}",
        "fail_safe_rate": f"{config.controller.fail_safe.rate_deg_s:g}",
        "recovery_samples": config.controller.fail_safe.recovery_samples,
        "cap_share": f"{total.lateral_acceleration_cap / config.road.gravity_m_s2:.3g}",
    }


def _stack_facts(total: TotalMap) -> dict[str, Any]:
    """Return the values of the layers, rising."""
    if total.quantity is not ACCELERATION_STACK:
        return {"frictions": [layer.friction for layer in total.stack]}
    return {
        "frictions": [total.friction],
        "longitudinal_accelerations": [layer.acceleration for layer in total.stack],
        "lateral_acceleration_caps_m_s2": [layer.lateral_acceleration_cap for layer in total.stack],
    }


def _margin_range(config: Config) -> str:
    first, last = margin_range_km_h(config)
    is_beyond = last < config.controller.inputs.speed_max_km_h
    return f"{first:g} to {last:g} km/h" + (" (the last gains hold beyond)" if is_beyond else "")


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100.0 * share:.1f} %"


def _facts(parts: _Parts, dynamics: DynamicsView, checksum: Checksum, identity: str) -> dict[str, Any]:
    config, options, inputs, total = parts.config, parts.options, parts.inputs, parts.total
    reference_map, table = parts.reference_map, parts.table
    return {
        "schema_version": 1,
        "version": __version__,
        "tools": {tool: importlib.metadata.version(tool) for tool in TOOLS},
        "name": options.name,
        "build_id": identity,
        "options": {
            "prefix": options.prefix,
            "precision": options.precision,
            "kind": config.controller.kind,
            **(request_facts(options.request) if options.request else {}),
        },
        "inputs": {
            "map": {"file": inputs.map_file, "sha256": inputs.map_sha256, "case": reference_map.case},
            "configuration": {
                "source": inputs.config_source,
                "sha256": hashlib.sha256(config.to_json().encode()).hexdigest(),
            },
        },
        "configuration": config.model_dump(mode="json"),
        "map": {
            "solved": reference_map.solved,
            "speed_m_s": [float(value) for value in total.speed],
            "front_angle_rad": [float(value) for value in total.front_angle],
            "lateral_acceleration_cap_m_s2": total.lateral_acceleration_cap,
            "friction": total.friction,
            "lookup_error_bound_rad_s": parts.error_bound,
            **_stack_facts(total),
            "flash_bytes": table.flash_bytes,
            "checksum_crc32": f"{table.checksum:08x}",
            "rules": {rule.value: {"cells": count, "text": RULE_TEXT[rule]} for rule, count in rule_counts(total).items()},
            "rule_by_speed_and_front_angle": ["".join(row) for row in total.rule],
            **grip_facts(total),
            **(placement_facts(parts.placed) if parts.placed else {}),
        },
        "calibration": {"checksum_crc32": f"{checksum.value:08x}"},
        "symbols": symbols_of(table, options.prefix, c_type(options.precision), identity),
        "dynamics_library_functions": dynamics.math_functions,
    }

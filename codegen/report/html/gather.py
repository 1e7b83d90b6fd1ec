"""Content of a report from the user's files and, for a build, from runs of its C."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.emit.laws import is_untuned
from codegen.emit.manifest import read_build
from codegen.errors import CodegenError, within
from codegen.figures.maps import NamedMap
from codegen.figures.runs import is_passive
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap, choose_config
from codegen.metrics.step import STEADY_WINDOW
from codegen.report.bus_tables import fault_data
from codegen.report.html.inputs import Files, read_files
from codegen.report.html.report import Material, to_compare
from codegen.report.html.runs import HANDLING_SCENARIOS, RESPONSE
from codegen.sil.software import load
from codegen.sweep.region import Region, confirm, region
from hil_sim.bench import run, run_through_can
from hil_sim.fault_catalogue import run_all
from hil_sim.scenario_files import find, of_run
from hil_sim.scenarios import DEFAULT_SCENARIO, Scenario
from hil_sim.suite.subjects import Build, Subject, around_folder, of_folder

Steps = Callable[[int, int], None]

PASSIVE = "passive car"
COMPARED_KINDS = ("pi", "tracking")
"""Kinds of controller that a build is compared with: the paper's and the recommended one."""


@dataclass(frozen=True)
class Request:
    """Arguments of the command.

    Attributes:
        map_path: the map, or its place in messages. compare: maps to compare with; none selects that of the car without rear
        steering.
        build: folder of its C. runs: arguments of `--run`. scenario: recorded or to be simulated; None selects the default, or
        that of the recordings.
        simulate: whether to simulate a build without recordings, and to test its faults.
        channel: the bus of the logs that is used; None for all.
        map, data: the map and the content of its file, if they were read before.
        recorded: name -> recording of runs that are no files.
    """

    map_path: Path
    compare: Sequence[Path | NamedMap] = ()
    build: Path | None = None
    runs: Sequence[str] = ()
    scenario: str | Scenario | None = None
    simulate: bool = True
    channel: str | None = None
    map: ReferenceMap | None = None
    data: bytes | None = None
    recorded: Mapping[str, FloatArray] = field(default_factory=dict)

    def scenario_for(self, config: Config) -> Scenario:
        """Return the named scenario, else the default one. Raises CodegenError if there is none of that name."""
        return self.scenario if isinstance(self.scenario, Scenario) else find(self.scenario or DEFAULT_SCENARIO, config)


@dataclass(frozen=True)
class Read:
    """The user's files, read and checked.

    Attributes:
        request: arguments of the command.
        material: content of the files.
        scenario: recorded or to be simulated; None without a build and a recording.
    """

    request: Request
    material: Material
    scenario: Scenario | None


def read(request: Request) -> Read:
    """Read all files; nothing is solved or simulated yet.

    Raises:
        CodegenError: a file is missing or invalid, or the scenario does not exist.
    """
    one = npz.load(request.map_path) if request.map is None else request.map
    chosen = choose_config(one, None)
    config, notes = chosen.config, list(chosen.notes)
    if request.build is not None:  # it defines the car, even for a bare map
        manifest = read_build(request.build)
        with within(request.build):
            config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
        notes = _differences(request, config, one.config)
    others: list[NamedMap] = []
    for given in request.compare:
        taken = {request.map_path.stem, *(other.name for other in others)}
        if isinstance(given, NamedMap):
            others.append(given if given.name not in taken else replace(given, name=f"{given.name} {len(taken)}"))
        else:
            others.append(NamedMap(given.stem if given.stem not in taken else str(given), npz.load(given)))
    files = read_files(request.runs, config.can, request.channel)
    if request.recorded:
        paths = {**{name: Path(name) for name in request.recorded}, **files.paths}
        files = replace(files, runs={**request.recorded, **files.runs}, paths=paths)
    scenario = None
    if files.runs:
        scenario = _scenario_of(files, request, config)
        _require_step(files, scenario)
    elif request.scenario is not None or (request.build is not None and request.simulate):
        scenario = request.scenario_for(config)
    material = Material(
        NamedMap(request.map_path.stem, one),
        others,
        config,
        configured=one.config is not None or request.build is not None,
        build=request.build,
        runs=files.runs or None,
        scenario=scenario if files.runs else None,
        logs=files.logs,
        faults=files.faults,
        notes=[*notes, *files.notes, *(f"{log.name}: {text}." for log in files.logs for text in log.findings)],
    )
    return Read(request, material, scenario)


def gather(found: Read, steps: Steps) -> Material:
    """Solve and run what the files do not contain.

    Args:
        found: content of the files.
        steps: called with the number of finished parts, and of all parts.

    Raises:
        CodegenError: the build does not compile.
    """
    material, config = found.material, found.material.config
    steps(1, PARTS)
    if found.request.build is not None:
        material = _driven(found, material, steps)
    elif material.configured and not is_untuned(config):
        material = replace(material, loops={config.controller.kind: config})
    material = _compared(material)
    if material.loops and not material.regions:
        material = replace(material, regions=_linear_regions(material.loops))
    steps(PARTS, PARTS)
    warnings = [f"{name}: {found.disagreement}." for name, found in material.regions.items() if found.disagreement]
    return replace(material, notes=(*material.notes, *warnings))


PARTS = 6


def _compared(material: Material) -> Material:
    """Add the default map for comparison if the user names none."""
    other = None if material.others else to_compare(material.map.map)
    return material if other is None else replace(material, others=[other])


def _linear_regions(loops: Mapping[str, Config]) -> dict[str, Region]:
    """Return the stable regions of the linearised loops that have feedback."""
    found = {name: region(config) for name, config in loops.items()}
    return {name: linear for name, linear in found.items() if linear is not None}


def _is_built_from(request: Request) -> bool:
    """Return whether the build was made from the map of the report."""
    data = request.map_path.read_bytes() if request.data is None else request.data
    given = hashlib.sha256(data).hexdigest()
    return request.build is not None and read_build(request.build)["inputs"]["map"]["sha256"] == given


def _differences(request: Request, config: Config, own: Config | None) -> list[str]:
    found = []
    if not _is_built_from(request):
        found.append(f"{request.build} was built from another map than {request.map_path}.")
    if own is not None and (own.vehicle, own.tyre, own.road) != (config.vehicle, config.tyre, config.road):
        found.append("The build's configuration describes another car than the map was solved for.")
    return found


def _scenario_of(files: Files, request: Request, config: Config) -> Scenario:
    """Return the scenario that the user names, else the one of the first recording."""
    if request.scenario is not None:
        return request.scenario_for(config)
    name, path = next(iter(files.paths.items()))
    return replace(of_run(files.runs[name], path), subject=f"Recording {name}")


def _require_step(files: Files, scenario: Scenario) -> None:
    """Reject a run that ends before the figures of the scenario can be computed."""
    for name, record in files.runs.items():
        end, needed = float(record[-1, 0]), scenario.steer_time + STEADY_WINDOW
        if scenario.kind == "step" and end < needed:
            what = f"it ends at {end:g} s, and {scenario.name} is judged up to {needed:g} s"
            raise CodegenError(what, where=files.paths[name], remedy="name the recorded scenario with `scenario=`")


def _driven(found: Read, material: Material, steps: Steps) -> Material:
    """Add the build's own runs, the faults, and the loops to compare."""
    build, scenario, config = found.request.build, found.scenario, material.config
    assert build is not None
    kind: str = config.controller.kind
    loops = {kind: config}
    if not found.request.simulate or scenario is None:
        return replace(material, loops=loops)
    regions = _linear_regions(loops)
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the C of a region releases the interpreter lock
        confirmed = {name: pool.submit(_confirm, linear, around_folder(build)) for name, linear in regions.items()}
        material = _compared(material)
        steps(2, PARTS)
        own_map = material.map.map if _is_built_from(found.request) else None
        baselines, left_out = _baselines(build, kind, own_map)
        loops |= {subject.name: subject.config for subject in baselines}
        steps(3, PARTS)
        linear_baselines = _linear_regions({subject.name: subject.config for subject in baselines})
        confirmed |= {
            subject.name: pool.submit(_confirm, linear_baselines[subject.name], subject.around)
            for subject in baselines
            if subject.name in linear_baselines
        }
        software = load(build)
        runs = dict(material.runs or {})
        if not runs:
            runs[kind] = run(software, scenario)
            for subject in baselines:
                runs[subject.name] = run(subject.around(config), scenario)
        steps(4, PARTS)
        if not any(is_passive(name) for name in runs):
            runs[PASSIVE] = run(software, scenario, controlled=False)
        more = {
            each.name: {kind: run(software, each), PASSIVE: run(software, each, controlled=False)}
            for each in (HANDLING_SCENARIOS, RESPONSE)
        }
        faults = material.faults
        if faults is None:
            faults = fault_data(run_all(config, lambda one: run_through_can(software, one)))
        steps(5, PARTS)
        regions = {name: job.result() for name, job in confirmed.items()}
    here = replace(material, runs=runs, scenario=scenario, driven=more, faults=faults, look_up=software.map_yaw_rate)
    return replace(here, loops=loops, regions=regions, notes=(*material.notes, *left_out))


def _confirm(linear: Region, build: Build) -> Region:
    return confirm(linear, build.generated.files, build.generated.manifest)


def _baselines(build: Path, kind: str, reference_map: ReferenceMap | None) -> tuple[list[Subject], list[str]]:
    """Return other controllers on the map of a build; none for a map of the user's own, which cannot be solved again.

    Args:
        reference_map: the map of the build; None solves it again.
    """
    try:
        comparison = of_folder(build).comparison(reference_map=reference_map)
    except CodegenError as error:
        return [], [f"No other controller is shown: {error}"]
    return [subject for subject in comparison.baselines if subject.name in COMPARED_KINDS and subject.name != kind], list(
        comparison.notes
    )

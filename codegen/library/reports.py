"""Reports: one HTML file of a map, a build and its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from codegen.arrays import FloatArray
from codegen.emit.folder import check_output
from codegen.errors import CodegenError
from codegen.figures.maps import NamedMap
from codegen.files import write_atomically
from codegen.library.builds import BuildLike, folder_of
from codegen.library.logs import paths_of
from codegen.library.maps import Map, MapLike, map_of
from codegen.library.result import PathLike, Progress, Result, Work, path_of, public
from codegen.library.runs import CONTROLLED, Run
from codegen.report.html.gather import Request, gather, read
from codegen.report.html.inputs import named
from codegen.report.html.page import charts_of, render, require_plotly
from codegen.report.html.report import sections
from hil_sim.scenarios import Scenario


class Report(Result):
    """A report that was written.

    Attributes:
        path: the HTML file.
        sections, charts: their names.
    """

    def __init__(self, path: Path, size: int, sections: Sequence[str], charts: Sequence[str], notes: Sequence[str]) -> None:
        self.path, self.sections, self.charts, self.notes = path, tuple(sections), tuple(charts), tuple(notes)
        self._size = size

    def lines(self) -> list[str]:
        """Return the number of sections and charts."""
        counts = f"{len(self.sections)} sections, {len(self.charts)} charts, {self._size / 1e6:.1f} MB"
        return [f"{self.path}: {counts}; open it in a browser"]

    def to_dict(self) -> dict[str, Any]:
        """Return the names of all sections and charts."""
        facts = {"report": str(self.path), "bytes": self._size, "sections": list(self.sections)}
        return {**facts, "charts": list(self.charts), "notes": list(self.notes)}

    def _repr_html_(self) -> str:
        return f"<pre>{''.join(self.lines())}</pre>"


@public
def report(
    map: MapLike,
    path: PathLike,
    *,
    compare: Sequence[MapLike] = (),
    build: BuildLike | None = None,
    runs: Sequence[Run | PathLike] = (),
    scenario: str | Path | None = None,
    channel: str | None = None,
    simulate: bool = True,
    progress: Progress | None = None,
) -> Report:
    """Write one self-contained HTML file: maps, curves, runs, margins, faults, timing, verification, manifest.

    With a build, its C is simulated with other controllers and the passive car, and bus faults are injected, unless `runs` has
    the results. Needs the extra `report`.

    Args:
        map: the map, or its path.
        path: the .html file to write.
        compare: maps to compare with; by default that of the same car without rear steering.
        build: a build, or the path of its folder.
        runs: runs, or files: recordings, logs of the bus, the JSON of `codegen faults`, each as "FILE" or "NAME=FILE".
        scenario: of the recordings, or to simulate; by default that of the first run.
        channel: the bus of the logs that is used.
        simulate: False shows only what is given.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: a file cannot be read, or a package is missing.
    """
    require_plotly("report")
    output = path_of(path, "the path of a report")
    given = [each for each in runs if isinstance(each, Run)]
    files = [str(each) for each in paths_of([each for each in runs if not isinstance(each, Run)], "a run")]
    inputs = [map, *compare, *(named(each)[1] for each in files)]
    check_output(output, ".html", [Path(each) for each in inputs if isinstance(each, (str, Path))])
    with Work(progress).stage("report") as tell:
        found = map_of(map)
        known: str | Scenario | None = None if scenario is None else str(scenario)
        if known is None and given:
            known = given[0].recording.scenario
        request = Request(
            found.path or Path(f"{found.name}.npz"),
            [_compared(each) for each in compare],
            None if build is None else folder_of(build),
            files,
            known,
            simulate,
            channel,
            found.reference_map,
            found.data,
            _named(given),
        )
        material = gather(read(request), tell)
        made = list(sections(material))
        content = render(f"{material.map.name}: from the map to the ECU", made)
    write_atomically(output, content)
    names = [section.name for section in made], [chart.name for chart in charts_of(made)]
    return Report(output, len(content), *names, material.notes)


def _compared(given: MapLike) -> Path | NamedMap:
    return NamedMap(given.name, given.reference_map) if isinstance(given, Map) else path_of(given, "a map")


def _named(runs: Sequence[Run]) -> Mapping[str, FloatArray]:
    """Return name -> recording: of one run its kind of controller, of several the kinds with numbers."""
    kinds = [run.config.controller.kind for run in runs]
    names: list[str] = [f"{kind} {k}" if kinds.count(kind) > 1 else kind for k, kind in enumerate(kinds, start=1)]
    found = {name: run.recording.records[CONTROLLED] for name, run in zip(names, runs, strict=True)}
    if len({run.scenario for run in runs}) > 1:
        raise CodegenError("the runs are of different scenarios", where="runs", remedy="make a report for each")
    return found

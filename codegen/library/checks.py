"""Plausibility of a configuration, a map or a build, and the judgement of the car."""

from __future__ import annotations

from typing import Any

from codegen.configuration import Config
from codegen.errors import CheckFailed, CodegenError
from codegen.judgement import check as checking
from codegen.judgement.model import Judgement
from codegen.library.builds import Build
from codegen.library.configurations import ConfigLike, given_config
from codegen.library.maps import Map, place_of
from codegen.library.result import PathLike, Progress, Result, Work, path_of, public
from codegen.map_file.map import choose_config


class Check(Result):
    """Result of a check.

    Attributes:
        kind: "configuration", "map" or "build".
        warnings: implausible values, contradictions, and where the car is worse with the controller than without.
        judgement: the comparison of the car with and without its controller; None if there is none.
        facts: what was found, as JSON values.
    """

    def __init__(self, subject: str, found: checking.Found) -> None:
        self.kind, self.facts, self.notes, self.warnings = found.kind, found.facts, found.notes, found.warnings
        self.judgement: Judgement | None = found.judgement
        self._subject, self._lines = subject, found.lines
        if found.warnings:
            one = len(found.warnings) == 1
            count = "1 warning" if one else f"{len(found.warnings)} warnings"
            self.failure = CheckFailed(count, where=subject, remedy=f"resolve {'it' if one else 'them'}")

    def lines(self) -> list[str]:
        """Return the facts, and the judgement of the car."""
        return [*self._lines, *([] if self.warnings else ["no warnings"])]

    def to_dict(self) -> dict[str, Any]:
        """Return the same, with notes and warnings."""
        return {
            "subject": self._subject,
            "kind": self.kind,
            **self.facts,
            "notes": list(self.notes),
            "warnings": list(self.warnings),
        }


@public
def check(
    subject: Map | Build | Config | PathLike,
    config: ConfigLike | None = None,
    *,
    drive: bool = False,
    progress: Progress | None = None,
) -> Check:
    """Check a configuration, a map or a build for implausible values and contradictions; no file is changed.

    Args:
        subject: what to check, or its path.
        config: check a map with this configuration; by default with its own.
        drive: judge the car now; by default the judgement that `tune` stored is used.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: it cannot be read, or is none of the three.
    """
    given = given_config(config)
    name = place_of(subject) if isinstance(subject, Map) else "the configuration"
    if not isinstance(subject, (Map, Config)):
        subject = path_of(subject.folder if isinstance(subject, Build) else subject, "a configuration, a map or a build")
        name = str(subject)
    with Work(progress).stage(f"checking {name}") as tell:
        if isinstance(subject, Map):
            chosen = choose_config(subject.reference_map, given)
            return Check(name, checking.check_map(subject.reference_map, chosen, name, drive, tell))
        if isinstance(subject, Config):
            if given is not None:
                raise CodegenError("only a map is checked with another configuration", where="config", remedy="leave it out")
            return Check(name, checking.check_configuration(choose_config(None, subject), name, drive, tell))
        return Check(name, checking.check_path(subject, given, drive=drive, progress=tell))

"""All checks, in the order of the output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from codegen import __version__
from codegen.doctor import buses, clock, compiled, packages, programs
from codegen.doctor.finding import Finding
from codegen.doctor.requirements import requirements


@dataclass(frozen=True)
class Section:
    """Findings of one kind."""

    key: str
    title: str
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class Examination:
    """All that was found.

    Attributes:
        read_from: where the wanted versions of packages were read.
    """

    sections: tuple[Section, ...]
    read_from: str

    @property
    def stopping(self) -> tuple[Finding, ...]:
        """Findings that prevent `codegen sil` from working."""
        return tuple(finding for section in self.sections for finding in section.findings if finding.stops)

    def to_dict(self) -> dict[str, Any]:
        """Return the findings for JSON."""
        sections = {
            section.key: [{**asdict(finding), "state": str(finding.state)} for finding in section.findings]
            for section in self.sections
        }
        facts = {"codegen": __version__, "ready": not self.stopping, "requirements": self.read_from}
        return {**facts, **sections}


def examine(done: Callable[[int, int], None] | None = None) -> Examination:
    """Run all checks.

    Args:
        done: called after each section with the counts of finished and of all sections.
    """
    asked, read_from = requirements()
    to_ask: tuple[tuple[str, str, Callable[[], list[Finding]]], ...] = (
        ("needed", "Needed by every command", lambda: [packages.python(), *packages.needed(asked)]),
        ("compiler", "C on this machine", lambda: [programs.compiler(), compiled.cache(), compiled.module()]),
        ("extras", "Extras", lambda: packages.extras(asked)),
        ("programs", "Programs", programs.programs),
        ("buses", "Buses", lambda: [buses.socketcan(), buses.multicast()]),
        ("clock", "Real time", lambda: [clock.punctuality(), clock.real_time()]),
    )
    sections = []
    for count, (key, title, ask) in enumerate(to_ask, start=1):
        sections.append(Section(key, title, tuple(ask())))
        if done is not None:
            done(count, len(to_ask))
    return Examination(tuple(sections), read_from)

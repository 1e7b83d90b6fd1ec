"""The list of scenarios."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from codegen.library.result import Result, public
from hil_sim.scenarios import listing


class Scenarios(Result):
    """The built-in scenarios; `names` lists them."""

    def __init__(self) -> None:
        self._listed = listing()
        self.names = tuple(each.name for each in self._listed)

    def lines(self) -> list[str]:
        """Return the scenarios with their descriptions, sources and bus faults."""
        lines = []
        for entry in self._listed:
            lines += [f"{entry.name}: {entry.what} ({entry.duration_s:g} s)", f"    {entry.source}"]
            lines += [f"    fault: {fault}" for fault in entry.faults]
        own = "Your own: a recorded .csv, or a .toml with base, changes and [[faults]]; see docs/interface.md."
        return [*lines, f"\n{own}"]

    def to_dict(self) -> Any:
        """Return a list of the same."""
        return [asdict(entry) for entry in self._listed]


@public
def scenarios() -> Scenarios:
    """Return the built-in scenarios."""
    return Scenarios()

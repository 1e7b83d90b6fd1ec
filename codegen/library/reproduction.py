"""The paper: its maps, tables and runs."""

from __future__ import annotations

from typing import Any

from codegen.library.result import PathLike, Progress, Result, Work, path_of, public


class Paper(Result):
    """The paper's tables beside ours, and the files that were written."""

    def __init__(self, folder: PathLike, progress: Progress | None) -> None:
        with Work(progress).stage("reproducing the paper") as tell:
            tell(0, 1, "loading")
            from codegen.report.paper import reproduce

            self._found = reproduce(path_of(folder, "a folder"), done=tell)

    def lines(self) -> list[str]:
        """Return the tables."""
        return list(self._found.lines())

    def to_dict(self) -> dict[str, Any]:
        """Return the same figures."""
        return self._found.to_dict()


@public
def paper(folder: PathLike, *, progress: Progress | None = None) -> Paper:
    """Reproduce the paper: solve its three maps, build the C, run C1 and C2, and compare its tables with ours.

    Args:
        folder: for maps, C, plots, runs and the report.
        progress: called with the share of the work that is done.
    """
    return Paper(folder, progress)

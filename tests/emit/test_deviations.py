"""Reading `deviations.md` back: no entry is idle. `tests/verify` compares it with the code and the analysers."""

import functools
from collections.abc import Mapping

from codegen.configuration import Kind
from codegen.emit.deviations import DEVIATIONS_FILE, ENTRIES, deviations, read_deviations
from codegen.optimum.solve import solve_stack
from tests import builds
from tests.emit.rendered import KINDS, rendered


@functools.cache
def files_of(kind: Kind) -> Mapping[str, bytes]:
    """Return the files of a build. The map of kind "tracking" is uneven and for two frictions."""
    if kind != "tracking":
        return rendered(kind).files
    config = builds.CONFIGS[kind]
    config = config.model_copy(update={"grid": config.grid.model_copy(update=builds.UNEVEN)})
    return builds.render(solve_stack(config, "4ws-2", (0.5, 0.9)), config).files


def test_the_rows_of_a_build_read_back_and_every_entry_has_one_and_a_reason() -> None:
    rows = {kind: list(deviations(files_of(kind))) for kind in KINDS}
    for kind, wanted in rows.items():
        assert [row for _, row in read_deviations(files_of(kind)[DEVIATIONS_FILE].decode("ascii"))] == wanted
    assert {row.rule for found in rows.values() for row in found} == {entry.rule for entry in ENTRIES}
    assert all(len(entry.reason.split()) > 5 for entry in ENTRIES)

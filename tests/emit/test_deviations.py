"""`deviations.md` describes the files beside it; `tests/verify` compares it with the findings of analysers."""

import functools
from collections.abc import Mapping

import pytest

from codegen.config import Kind
from codegen.emit.deviations import ENTRIES, FILE, category_of, deviations, excerpt, read_deviations
from codegen.emit.text import Precision
from codegen.refmap.stack import solve_stack
from tests import builds
from tests.emit.rendered import EACH_KIND_AND_DOUBLE, KINDS, rendered


@functools.cache
def made(kind: Kind, precision: Precision = "single") -> Mapping[str, bytes]:
    """Files of a build. The map of kind "tracking" is uneven and for two frictions."""
    if kind != "tracking":
        return rendered(kind, precision).files
    config = builds.CONFIGS[kind]
    config = config.model_copy(update={"grid": config.grid.model_copy(update=builds.UNEVEN)})
    return builds.render(solve_stack(config, "4ws-2", (0.5, 0.9)), config, precision).files


@pytest.mark.parametrize(("kind", "precision"), EACH_KIND_AND_DOUBLE)
def test_each_row_names_a_line_of_the_build(kind: Kind, precision: Precision) -> None:
    files = made(kind, precision)
    rows = [row for _, row in read_deviations(files[FILE].decode("ascii"))]
    assert rows == list(deviations(files))
    places = [(row.file, row.line, row.rule) for row in rows]
    assert len(set(places)) == len(places)
    assert [(file, line) for file, line, _ in places] == sorted((file, line) for file, line, _ in places)
    for row in rows:
        line = files[row.file].decode("ascii").split("\n")[row.line - 1]
        assert row.code == excerpt(line)
        assert row.category == category_of(row.rule) != "mandatory"
        assert len(row.reason.split()) > 5


def test_every_entry_has_a_line_in_some_build() -> None:
    used = {row.rule for kind in KINDS for row in deviations(made(kind))}
    assert used == {entry.rule for entry in ENTRIES}

"""Directives whose text is made from the code when the guide is built, so that it says what the code does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import config_tables
import evidence_tables
import interface_tables
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class FromCode(SphinxDirective):
    """Parses the Markdown that `text` returns where the directive stands."""

    has_content = False
    text: ClassVar[Callable[..., str]]

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()  # the code may change where the page does not
        made = self.parse_text_to_nodes(type(self).text(*self.arguments), allow_section_headings=True)
        for node in made:
            for table in node.findall(nodes.table):
                table["classes"].append("from-code")
        return made


def _directive(make: Callable[..., str], arguments: int = 0) -> type[FromCode]:
    return type(make.__name__, (FromCode,), {"text": staticmethod(make), "required_arguments": arguments})


def _draw(app: Sphinx) -> None:
    import figures

    figures.draw_all(app.srcdir / "_figures")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives, and draw the figures before the pages are read."""
    app.add_directive("ars-toml", _directive(config_tables.markdown))
    app.add_directive("identified-quantities", _directive(config_tables.quantities_markdown))
    app.add_directive("names-toml", _directive(config_tables.names_markdown))
    app.add_directive("can-matrix", _directive(interface_tables.can_matrix))
    app.add_directive("diagnostics", _directive(interface_tables.diagnostics))
    app.add_directive("run-columns", _directive(interface_tables.run_columns))
    app.add_directive("exit-codes", _directive(interface_tables.exit_codes))
    app.add_directive("c-functions", _directive(interface_tables.c_functions, arguments=1))
    app.add_directive("evidence-summary", _directive(evidence_tables.summary))
    app.add_directive("evidence-details", _directive(evidence_tables.details))
    app.add_directive("planted-faults", _directive(evidence_tables.planted_faults))
    app.connect("builder-inited", _draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

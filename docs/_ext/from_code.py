"""Directives whose text is made from the code when the guide is built, so that it says what the code does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import evidence_tables
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class FromCode(SphinxDirective):
    """Parses the Markdown that `text` returns where the directive stands."""

    has_content = False
    text: ClassVar[Callable[[], str]]

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()  # the code may change where the page does not
        made = self.parse_text_to_nodes(type(self).text(), allow_section_headings=True)
        for node in made:
            for table in node.findall(nodes.table):
                table["classes"].append("from-code")
        return made


def _directive(make: Callable[[], str]) -> type[FromCode]:
    return type(make.__name__, (FromCode,), {"text": staticmethod(make)})


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("evidence-summary", _directive(evidence_tables.summary))
    app.add_directive("evidence-details", _directive(evidence_tables.details))
    app.add_directive("planted-faults", _directive(evidence_tables.planted_faults))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

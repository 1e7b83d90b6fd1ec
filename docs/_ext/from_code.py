"""The label of the page on the evidence, made when the guide is built: it depends on the code of the moment."""

from __future__ import annotations

from typing import Any

from sphinx.application import Sphinx

from scripts.guide.evidence_tables import LABEL, label


def _add_label(_app: Sphinx, _page: str, source: list[str]) -> None:
    if LABEL in source[0]:
        source[0] = source[0].replace(LABEL, label())


def setup(app: Sphinx) -> dict[str, Any]:
    """Replace the place of the label in the sources that Sphinx reads."""
    app.connect("source-read", _add_label)
    return {"parallel_read_safe": True}

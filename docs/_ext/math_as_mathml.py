"""Formulae as MathML, which browsers draw by themselves: no script, no font and no network, also from a file on disk."""

from __future__ import annotations

from html import escape
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.math import get_node_equation_number


def _mathml(text: str, display: str) -> str:
    """One formula; its TeX stands beside it for those who cannot see it."""
    # The converter knows `aligned` by the name that it has outside of another formula.
    mathml: str = convert(text.strip().replace("{aligned}", "{align*}"), display=display)
    if ">&<" in mathml or "merror" in mathml or "\\" in mathml:
        raise ExtensionError(f"a formula that cannot be converted: {text.strip()}")
    return mathml.replace("<math ", f'<math alttext="{escape(" ".join(text.split()), quote=True)}" ', 1)


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(_mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    identifier = f' id="{node["ids"][0]}"' if node["ids"] else ""
    writer.body.append(f'<div class="formula"{identifier}>{_mathml(node.astext(), "block")}')
    if node.get("number"):
        writer.body.append(f'<span class="eqno">({get_node_equation_number(writer, node)})</span>')
    writer.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

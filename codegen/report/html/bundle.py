"""Plotly's JavaScript from the installed package. Pages embed it, so that they work offline."""

from __future__ import annotations

import importlib.util

from codegen.errors import CodegenError


def require_plotly(command: str) -> None:
    """Check that Plotly is installed, before long computations.

    Args:
        command: name of the command, for the message.

    Raises:
        CodegenError: Plotly is not installed.
    """
    if importlib.util.find_spec("plotly") is None:
        remedy = 'pip install "ars-codegen[report]"'
        raise CodegenError("plotly, which draws its pictures, is missing", where=f"codegen {command}", remedy=remedy)


def plotly_javascript() -> str:
    """Return the whole bundle of Plotly.js for a `<script>` element (about 5 MB).

    Raises:
        CodegenError: Plotly is not installed.
    """
    require_plotly("report")
    from plotly.offline import get_plotlyjs

    text: str = get_plotlyjs()
    # A browser ends a script at the first closing tag in its text.
    return text.replace("</script", r"<\/script").replace("<!--", r"<\!--")

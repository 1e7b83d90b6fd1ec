"""Plotly's JavaScript, from the installed package: pages carry it along, and fetch nothing."""

from __future__ import annotations

import importlib.util

from codegen.errors import CodegenError


def require_plotly(command: str) -> None:
    """Refuse before anything is worked out.

    Args:
        command: that needs it, for the message.

    Raises:
        CodegenError: Plotly is not installed.
    """
    if importlib.util.find_spec("plotly") is None:
        remedy = 'pip install "ars-codegen[report]"'
        raise CodegenError("plotly, which draws its pictures, is missing", where=f"codegen {command}", remedy=remedy)


def plotly_javascript() -> str:
    """The whole bundle of Plotly.js, fit for a `<script>` element (about 5 MB).

    Raises:
        CodegenError: Plotly is not installed.
    """
    require_plotly("report")
    from plotly.offline import get_plotlyjs

    text: str = get_plotlyjs()
    # Where the text of a script holds its own end, a browser stops reading there.
    return text.replace("</script", r"<\/script").replace("<!--", r"<\!--")

"""A report as plain data, and its HTML: one file that works offline.

Sections hold paragraphs, tables and charts. The file contains its style, its scripts, Plotly and all data.
"""

from __future__ import annotations

import html
import importlib.util
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from codegen import __version__
from codegen.emit.render import templates_root
from codegen.figures.data import Chart, packed
from codegen.requirements import missing


def require_plotly(command: str) -> None:
    """Check that Plotly is installed, before long computations.

    Args:
        command: name of the command, for the message.

    Raises:
        CodegenError: Plotly is not installed.
    """
    if importlib.util.find_spec("plotly") is None:
        raise missing("plotly", "draws its pictures", f"codegen {command}")


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


_CODE = re.compile(r"`([^`]+)`")
_SQUARE = re.compile(r"\b(m|s)\^2")


def render(title: str, sections: Sequence[Section]) -> bytes:
    """Return the bytes of a report. Equal sections give equal bytes, with the same version of Plotly.

    Raises:
        CodegenError: Plotly is not installed.
    """
    folder = templates_root() / "report"
    environment = Environment(
        loader=FileSystemLoader(folder, encoding="utf-8"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["prose"] = prose
    environment.filters["kind"] = lambda block: type(block).__name__.lower()
    return (
        environment.get_template("report.html.j2")
        .render(
            title=title,
            version=__version__,
            sections=sections,
            style=Markup((folder / "style.css").read_text(encoding="utf-8")),
            plotly=Markup(plotly_javascript()),
            script=Markup((folder / "report.js").read_text(encoding="utf-8")),
            data=Markup(_data(sections)),
        )
        .encode("utf-8")
    )


def prose(text: str) -> Markup:
    """Return text as HTML; words between backticks are code, and m^2 and s^2 are m² and s²."""
    return Markup(_SQUARE.sub(r"\1²", _CODE.sub(r"<code>\1</code>", html.escape(text, quote=False))))


def charts_of(sections: Sequence[Section]) -> list[Chart]:
    """Return all charts, in the order of the page."""
    found: list[Chart] = []
    for section in sections:
        for block in section.blocks:
            found += [block] if isinstance(block, Chart) else list(block.charts) if isinstance(block, Gallery) else []
    return found


def _data(sections: Sequence[Section]) -> str:
    """Return the data of the charts as JSON that ends no script element."""
    cuts = next((asdict(block)["data"] for section in sections for block in section.blocks if isinstance(block, Cuts)), None)
    data: dict[str, Any] = {"charts": {chart.name: chart.figure for chart in charts_of(sections)}, "cuts": cuts}
    return json.dumps(data, default=packed, allow_nan=False, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")


@dataclass(frozen=True)
class Text:
    """A paragraph; `kind` is "", "lead" or "notice". In `text`, words between backticks are code."""

    text: str
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of text under a header.

    Attributes:
        caption: what it shows. header: a text for each column.
        words: columns that hold words, counted from zero; the others are numbers, flush right.
        verdicts: text of a cell -> "good" or "bad", to highlight the cell.
        hashes: whether cells are hashes or paths, in small type.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: Sequence[int] = (0,)
    verdicts: Mapping[str, str] = field(default_factory=dict)
    hashes: bool = False


@dataclass(frozen=True)
class Tile:
    """A figure in large type: its title, the value with its unit, and a comparison; `look` is "", "good" or "bad"."""

    title: str
    value: str
    detail: str
    look: str = ""


@dataclass(frozen=True)
class Tiles:
    """Figures side by side."""

    tiles: Sequence[Tile]


@dataclass(frozen=True)
class Gallery:
    """Charts side by side if there is room, else below each other; `width` is the minimum width of each, in CSS."""

    charts: Sequence[Chart]
    width: str = "26rem"


@dataclass(frozen=True)
class Cuts:
    """The map cut at a front angle and at a speed, moved by sliders; `data` as `maps._cut_data` makes it."""

    data: Mapping[str, Any]
    caption: str


Block = Text | Table | Tiles | Chart | Gallery | Cuts


@dataclass(frozen=True)
class Section:
    """A heading and its content; `name` is the id in the page. The section is folded unless `is_open`."""

    name: str
    title: str
    blocks: Sequence[Block]
    is_open: bool = False

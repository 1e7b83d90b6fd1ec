"""The page and its assets, as bytes. The page loads nothing from elsewhere."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from codegen.emit.laws import law_of
from codegen.emit.render import environment, templates_root
from codegen.explore.controls import GROUP_TITLES, Control
from codegen.explore.explorer import Explorer
from codegen.report.html.blocks import scale_of
from codegen.report.html.page import plotly_javascript
from codegen.report.style import BLACK, CONTROLLER_COLOURS, REAR_STEER, SIDESLIP, YAW_RATE

FILE = "ars.toml"
_TABLES = {"yaw_rate": YAW_RATE, "sideslip": SIDESLIP, "rear_angle": REAR_STEER}

SECURITY_POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self' 'unsafe-inline'",  # Plotly writes style attributes and a style sheet of its own
        "img-src 'self' data: blob:",  # a heat map is an image of its own making
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)


@dataclass(frozen=True)
class Asset:
    """A file that the server delivers."""

    content: bytes
    kind: str


def controller_colours() -> str:
    """Return CSS with the colour of each kind of controller as --now, and of the passive car as --passive; black is --ink."""
    colours = {kind: "var(--ink)" if colour == BLACK else colour for kind, colour in CONTROLLER_COLOURS.items()}
    passive = colours.pop("passive")
    rules = [f':root[data-kind="{kind}"] {{ --now: {colour}; }}' for kind, colour in colours.items()]
    return "\n".join((f":root {{ --passive: {passive}; }}", *rules, ""))


def assets() -> dict[str, Asset]:
    """Return path -> asset, without the page itself. Raises CodegenError if Plotly is not installed."""
    root = templates_root()
    style, script = "text/css; charset=utf-8", "text/javascript; charset=utf-8"
    return {
        "/style.css": Asset((root / "report" / "style.css").read_bytes(), style),
        "/explore.css": Asset(controller_colours().encode("ascii") + (root / "explore" / "explore.css").read_bytes(), style),
        "/plots.js": Asset((root / "explore" / "plots.js").read_bytes(), script),
        "/explore.js": Asset((root / "explore" / "explore.js").read_bytes(), script),
        "/plotly.js": Asset(plotly_javascript().encode("utf-8"), script),
    }


def page(explorer: Explorer, key: str, page_number: int) -> Asset:
    """Render the page of an exploration.

    Args:
        key: access key that requests must carry.
        page_number: distinguishes the requests of this page from those of others.
    """
    groups = [
        {"key": group, "title": title, "controls": [each for each in explorer.controls if each.group == group]}
        for group, title in GROUP_TITLES.items()
    ]
    context = {
        "name": explorer.name,
        "case": explorer.case,
        "kind": explorer.start.controller.kind,
        "title": law_of(explorer.start).title,
        "file": FILE,
        "groups": [group for group in groups if group["controls"]],
        "adjustable": any(each.group == "controller" for each in explorer.controls),
        "notes": explorer.notes,
        "data": _embedded(
            {
                "key": key,
                "page": page_number,
                "file": FILE,
                "scales": {name: scale_of(quantity.colours) for name, quantity in _TABLES.items()},
                "controls": [_control(each) for each in explorer.controls],
            }
        ),
    }
    text = environment().get_template("explore/page.html.j2").render(page=context)
    return Asset(text.encode("utf-8"), "text/html; charset=utf-8")


def _control(control: Control) -> dict[str, Any]:
    names = ("key", "label", "unit", "low", "high", "step", "bounds", "value", "logarithmic")
    return {name: getattr(control, name) for name in names}


def _embedded(data: Mapping[str, Any]) -> str:
    """Return JSON that cannot end a script element."""
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")

"""The layout of CAN frames as a drawing, from a DBC."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from codegen.configuration.signals import SIGNALS
from codegen.figures.data import BLACK, MUTED, ORANGE, SKY, WHITE
from codegen.figures.draw import THEME_COLOURS, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY = THEME_COLOURS[MUTED]
_COLOURS = {
    **{"crc": "#D9D9D9", "counter": "#D9D9D9", "status": ORANGE, "qualifier": ORANGE},
    **{each.name.lower(): ORANGE for each in SIGNALS if each.is_flag},
}


def frames(dbc: Path) -> Figure:
    """The layout of each message of a DBC: bytes from left to right, in each byte bit 7 on the left."""
    import cantools

    messages = cantools.database.load_file(dbc).messages
    with style():
        figure = new_figure(7.4, 4.0)
        axes = figure.subplots()
        axes.set(xlim=(-0.05, 64.05), ylim=(-1.1, 3.0 * len(messages) - 0.3))
        axes.set_axis_off()
        for row, message in enumerate(messages):
            y = 3.0 * (len(messages) - 1 - row)
            axes.text(0.0, y + 1.95, f"{message.name}  0x{message.frame_id:X}, from {message.senders[0]}", weight="bold")
            _draw_frame(axes, message, y)
        for byte in range(8):
            axes.text(8 * byte + 4, -0.35, f"byte {byte}", ha="center", va="top", color=GREY, fontsize=8)
    return figure


def _draw_frame(axes: Axes, message: Any, y: float) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((0.0, y), 64.0, 1.6, facecolor=WHITE, edgecolor=GREY, hatch="///", linewidth=0.0, alpha=0.35))
    axes.add_patch(Rectangle((0.0, y), 64.0, 1.6, facecolor="none", edgecolor=GREY, linewidth=0.6))
    for signal in message.signals:
        word = next((word for word in _COLOURS if word in signal.name.lower()), "")
        colour = _COLOURS.get(word, SKY)
        bits = range(signal.start, signal.start + signal.length)  # Intel byte order: as the committed builds have it
        for byte in sorted({bit // 8 for bit in bits}):
            own = [bit % 8 for bit in bits if bit // 8 == byte]
            left, width = 8 * byte + 7 - max(own), len(own)
            axes.add_patch(Rectangle((left, y), width, 1.6, facecolor=WHITE, edgecolor="none"))
            axes.add_patch(Rectangle((left, y), width, 1.6, facecolor=colour, edgecolor="none", alpha=0.5))
        lefts = [8 * (bit // 8) + 7 - bit % 8 for bit in bits]
        low, high = min(lefts), max(lefts) + 1
        axes.add_patch(Rectangle((low, y), high - low, 1.6, facecolor="none", edgecolor=BLACK, linewidth=0.8))
        name = signal.name.split("_", 1)[-1] if signal.length < 16 else signal.name
        narrow = signal.length <= 4
        axes.text(
            0.5 * (low + high),
            y + 0.8,
            name,
            ha="center",
            va="center",
            fontsize=6.5 if narrow else 8.5,
            rotation=90 if narrow else 0,
        )

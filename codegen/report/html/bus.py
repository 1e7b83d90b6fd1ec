"""Charts of the timing on the bus: periods of the frames, and time from a sample to its command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from codegen.arrays import FloatArray
from codegen.figures.data import BLUE, GREEN, ORANGE, VERMILION, Chart, axis, layout, numbers
from codegen.report.html.blocks import Block, Gallery, Table, Text
from codegen.report.html.inputs import BusTimes

COLOURS = (BLUE, ORANGE, VERMILION)
BINS = 120
HISTOGRAM_SPAN_MIN_MS = 0.1
"""Minimum span of a histogram, in ms."""
ANSWER = "Command after the motion frame"


def bus_blocks(logs: Sequence[BusTimes]) -> Iterator[Block]:
    """Yield histograms and a table for each log."""
    for number, log in enumerate(logs, start=1):
        yield Text(f"{log.name}: period of the frames (nominal {log.cycle:g} ms), and time from a sample to its command.")
        if log.is_simulated:
            yield Text("These times are simulated. They do not measure the timing of the ECU.", "notice")
        for text in log.findings:
            yield Text(f"{text}.", "notice")
        yield Gallery(list(_histograms(log, number)))
        rows = [_times_row(f"{name}, period", values) for name, values in log.periods.items()]
        if log.answers.size:
            rows.append(_times_row(ANSWER, log.answers))
        yield Table(f"{log.name}: times in ms", ("", "number", "median", "99 %", "least", "largest"), rows)


def _times_row(what: str, values: FloatArray) -> tuple[str, ...]:
    shares = (np.median(values), np.percentile(values, 99.0), values.min(), values.max())
    return what, f"{values.size:,}", *(f"{float(value):.3f}" for value in shares)


def _histograms(log: BusTimes, number: int) -> Iterator[Chart]:
    if log.periods:
        edges = _edges(np.concatenate(list(log.periods.values())))  # the same for all, so that they can be compared
        for k, ((name, values), colour) in enumerate(zip(log.periods.items(), COLOURS, strict=False), start=1):
            yield _histogram(values, edges, f"Period of {name} (ms)", colour, f"can-{number}-{k}")
    if log.answers.size:
        yield _histogram(log.answers, _edges(log.answers), f"{ANSWER} (ms)", GREEN, f"can-{number}-answer")


def _edges(values: FloatArray) -> FloatArray:
    low, high = float(values.min()), float(values.max())
    if high - low < HISTOGRAM_SPAN_MIN_MS:  # centre times that are all equal
        low, high = (low + high - HISTOGRAM_SPAN_MIN_MS) / 2.0, (low + high + HISTOGRAM_SPAN_MIN_MS) / 2.0
    return np.linspace(low, high, BINS + 1)


def _histogram(values: FloatArray, edges: FloatArray, title: str, colour: str, name: str) -> Chart:
    counts, _ = np.histogram(values, edges)
    bars = {
        "type": "bar",
        "x": numbers((edges[:-1] + edges[1:]) / 2.0),
        "y": counts.tolist(),
        "width": float(edges[1] - edges[0]),
        "marker": {"color": colour, "line": {"width": 0}},
        "hovertemplate": "%{y} frames around %{x:.3f} ms<extra></extra>",
    }
    look = layout(
        bargap=0.0,
        showlegend=False,
        xaxis=axis(title, range=[float(edges[0]), float(edges[-1])], zeroline=False),
        yaxis=axis("Frames", type="log", dtick=1, range=[-0.3, float(np.log10(max(int(counts.max()), 2))) + 0.2]),
    )
    told = f"{title}: median {np.median(values):.3f}, largest {values.max():.3f}."
    return Chart(name, {"data": [bars], "layout": look}, told, f"Histogram. {told}", 300)

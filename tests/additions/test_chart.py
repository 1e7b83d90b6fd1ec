"""A chart of the report is one module and its line in the list of sections."""

from __future__ import annotations

from tests.additions.copy import ROOT, Copy

CHART = '''"""Largest lateral acceleration of the map over speed."""

from __future__ import annotations

import numpy as np

from codegen.figures.data import BLUE, SPEED_TITLE, Chart, axis, layout, line
from codegen.figures.maps import NamedMap


def acceleration_chart(one: NamedMap) -> Chart:
    """Return the largest product of speed and feasible yaw rate at each speed, in m/s^2."""
    table = np.where(one.map.feasible, one.map.yaw_rate, np.nan)
    largest = one.map.speed * np.fmax.reduce(table, axis=1)
    look = layout(xaxis=axis(SPEED_TITLE), yaxis=axis("Lateral acceleration (m/s²)", rangemode="tozero"))
    figure = {"data": [line(one.speed_km_h, largest, one.name, BLUE)], "layout": look}
    caption = "Largest lateral acceleration of a feasible turn at each speed."
    return Chart("acceleration", figure, caption, caption)
'''
CHECK = """
import sys
from pathlib import Path

import numpy as np

from codegen.report.html.gather import Request, gather, read
from codegen.report.html.page import charts_of, render
from codegen.report.html.report import sections

material = gather(read(Request(Path(sys.argv[1]))), lambda done, total: None)
made = list(sections(material))
(chart,) = [chart for chart in charts_of(made) if chart.name == "acceleration"]
one = material.map.map
expected = [float((speed * rates[cells]).max()) for speed, rates, cells in zip(one.speed, one.yaw_rate, one.feasible)]
assert np.allclose(chart.figure["data"][0]["y"], expected, rtol=1e-12)
page = render("test", made).decode()
assert 'id="chart-acceleration"' in page and chart.caption in page
"""


def test_a_chart_touches_at_most_three_files(tree: Copy) -> None:
    tree.add("codegen/report/html/acceleration.py", CHART)
    report = "codegen/report/html/report.py"
    tree.replace(
        report,
        "from codegen.report.html.page import Block",
        "from codegen.report.html.acceleration import acceleration_chart\nfrom codegen.report.html.page import Block",
    )
    tree.after(report, "    yield Gallery(heat_map_charts(one))\n", "    yield acceleration_chart(one)\n")
    tree.run("-c", CHECK, str(ROOT / "generated" / "4ws2.npz"))
    map_file = ROOT / "generated" / "4ws2.npz"
    tree.commands(f"report --map {map_file} --no-simulation -o report.html")
    assert len(tree.touched) <= 3

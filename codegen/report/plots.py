"""All figures: maps, cuts through them, tyres, runs, the overview. Each function returns a Matplotlib Figure.

Labels are in degrees and km/h, arguments in SI units.
"""

from codegen.report.map_difference_plot import map_difference_figure, overview_figure
from codegen.report.map_plots import front_angle_cut_figure, map_figure, three_maps_figure
from codegen.report.run_plots import run_figure
from codegen.report.scenario_plots import scenario_figure
from codegen.report.style import PlotError, save
from codegen.report.tyre_plots import tyre_figure

__all__ = [
    "PlotError",
    "front_angle_cut_figure",
    "map_difference_figure",
    "map_figure",
    "overview_figure",
    "run_figure",
    "save",
    "scenario_figure",
    "three_maps_figure",
    "tyre_figure",
]

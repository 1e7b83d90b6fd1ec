"""The explorer: a local page to change settings, with the map, the step response and the margins updated at once.

It uses the palette and the Plotly bundle of `report`; `cli` uses it.
"""

"""The explorer: a local page on which settings are moved and the map, the step response and the margins follow at once.

Above `report`, whose palette and bundle of Plotly it shares, and below `cli`.
"""

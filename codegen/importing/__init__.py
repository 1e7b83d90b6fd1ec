"""Import of maps from MATLAB files and text tables, and of tyres from tyre property files.

Layers: see `tests/test_layers.py`.
"""

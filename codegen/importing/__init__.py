"""What comes in: maps from MATLAB files and text tables, tyres from tyre property files.

Layers: see `tests/test_layers.py`.
"""

"""Identification of a car's parameters from measured drives.

Layers: see `tests/test_layers.py`.
"""

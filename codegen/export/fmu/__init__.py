"""Functional Mock-up Units: controller, plant or closed loop of a build as FMI 2.0 or 3.0 co-simulation.

variables defines the interface to the simulator, description writes it as XML, and export collects the C, compiles it and packs
all of it.
"""

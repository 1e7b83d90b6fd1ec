"""Functional Mock-up Units: controller, plant or closed loop of a build as FMI 2.0 or 3.0 co-simulation.

variables and parameters define the interface to the simulator, description writes it as XML, sources collects the C, binary
compiles it, and archive packs all of it.
"""

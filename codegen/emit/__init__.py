"""Rendering of a map and a configuration to C."""

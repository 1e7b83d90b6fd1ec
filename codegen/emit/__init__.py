"""Render a map and a configuration to C."""

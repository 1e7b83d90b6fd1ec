"""Warnings about a car, a map or a build that can be computed without driving it.

Each function returns lines of text: what was found, where, and a remedy. A plausible car has none.
"""

"""Cores of ECUs in this process: C compiled for them, and run there."""

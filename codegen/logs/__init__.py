"""Logs of a CAN bus: one reader for every command, which accounts for each frame of a file."""

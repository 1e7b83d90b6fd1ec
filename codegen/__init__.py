"""Generate and verify C for active rear steering (ARS) from vehicle data."""

__version__ = "0.1.0"

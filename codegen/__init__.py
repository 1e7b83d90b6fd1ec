"""Generate and verify C for active rear steering (ARS) from vehicle data."""

__version__ = "0.1.0"

DISTRIBUTION = "ars-codegen"
"""Name of the distribution. `ars_codegen` recognises this package by this line."""

"""From vehicle data to checked C for active rear steering (ARS)."""

__version__ = "0.1.0"

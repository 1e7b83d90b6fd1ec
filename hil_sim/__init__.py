"""The bench: plant, ECU, bus, scenarios and recordings."""

"""The bench: plant, ECU, bus, scenarios and recordings. Layer 6: imports `codegen` up to `sil`."""

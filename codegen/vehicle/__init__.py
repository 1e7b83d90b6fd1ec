"""Tyres and vehicle models. Layer 2: imports `errors` and `config`."""

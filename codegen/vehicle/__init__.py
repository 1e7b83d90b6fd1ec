"""Tyres and vehicle models."""

"""Judgement of a car with the controller against the car without it, and warnings that need no drive."""

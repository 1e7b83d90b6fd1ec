"""The feedback's gains by design: the family of cars, its sampled loops, their margins, the search. Layer 3, below the map.

Imports `errors`, `config` and `vehicle`.
"""

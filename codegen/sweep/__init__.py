"""Campaigns: the closed loop in C over thousands of cars, roads and manoeuvres.

`spec` (what is varied) -> `plan` (runs by number) -> `lanes` (numbers of the plant) -> `chunk` (a batch in C, its figures)
-> `engine` (chunks by any engine, into one Parquet file) -> `summary`.
"""

"""Checks of `codegen doctor` on a machine. Layer: beside `report`; imports `errors`, `sil` and `hil_sim`.

Each module checks one subject and returns findings; none of them raises because something is missing or broken.
"""

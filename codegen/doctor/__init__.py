"""Checks of `codegen doctor` on a machine. It is on the same layer as `report` and imports `errors`, `sil` and `hil_sim`.

Each module checks one subject and returns findings; none of them raises because something is missing or broken.
"""

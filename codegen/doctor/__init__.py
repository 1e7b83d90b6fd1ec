"""What `codegen doctor` finds out about a machine. Layer: beside `report`; imports `errors`, `sil` and `hil_sim`.

Each module asks after one thing and gives findings; none of them raises because something is missing or broken.
"""

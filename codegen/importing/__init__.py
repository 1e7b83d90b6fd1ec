"""What comes in: maps from MATLAB files and text tables, tyres from tyre property files.

Layer 4: imports `errors`, `files`, `config`, `vehicle` and `refmap`.
"""

"""An independent implementation of the Magic Formula from the books: shifts, both sides, one slip at a time.

`mf6` is H. B. Pacejka, Tire and Vehicle Dynamics, 3rd edition, 4.E19 to 4.E30 at zero camber and spin; `mf5` is the lateral
force at pure slip of MF-Tyre 5.2 and of PAC2002. Coefficients are given here as numbers in SI units.
"""

from collections.abc import Mapping
from math import atan, radians, sin, tan

Coefficients = Mapping[str, float]

ONES = dict.fromkeys(("LFZO", "LCY", "LMUY", "LEY", "LKY", "LHY", "LVY"), 1.0)

PAC2002 = {
    **ONES,
    **{"FNOMIN": 5200.0, "LFZO": 1.05, "LCY": 1.02, "LMUY": 0.95, "LEY": 0.9, "LKY": 1.1, "LVY": 0.8},
    **{"PCY1": 1.32, "PDY1": -0.98, "PDY2": 0.15, "PEY1": -0.85, "PEY2": -0.42, "PEY3": 0.11, "PKY1": -23.5, "PKY2": 1.93},
    **{"PHY1": 0.0031, "PHY2": -0.0012, "PVY1": 0.021, "PVY2": -0.014},
}
MF52 = {  # the file uses kN and degrees
    **ONES,
    **{"FNOMIN": 4600.0, "PCY1": 1.41, "PDY1": 1.05, "PDY2": -0.12, "PEY1": 0.35, "PEY2": -0.6, "PEY3": -0.3},
    **{"PKY1": 0.36 / radians(1.0), "PKY2": 1.6, "PHY1": radians(0.12), "PHY2": radians(0.05), "PVY1": -0.02, "PVY2": 0.01},
}
MF61 = {
    **ONES,
    **{"FNOMIN": 5000.0, "LMUY": 0.9, "LKY": 0.97, "INFLPRES": 230e3, "NOMPRES": 250e3},
    **{"PCY1": 1.27, "PDY1": 1.06, "PDY2": -0.11, "PEY1": -0.4, "PEY2": -0.55, "PEY3": 0.16},
    **{"PKY1": -24.1, "PKY2": 1.72, "PKY4": 1.87, "PHY1": 0.0022, "PHY2": -0.0009, "PVY1": 0.031, "PVY2": 0.012},
    **{"PPY1": -0.55, "PPY2": -0.06, "PPY3": -0.17, "PPY4": 0.08},
}
MF62 = {**MF61, "PKY4": 2.05, "INFLPRES": 2.9, "NOMPRES": 2.6, "PEY3": -0.22, "PCY1": 1.38, "PKY1": -21.3}


def mf5(p: Coefficients, alpha: float, load: float) -> float:
    """Return Fy in N at a slip angle in rad and a load in N, in the axes of the file."""
    fz0 = p["FNOMIN"] * p["LFZO"]
    dfz = (load - fz0) / fz0
    shift = (p["PHY1"] + p["PHY2"] * dfz) * p["LHY"]
    x = alpha + shift
    c = p["PCY1"] * p["LCY"]
    d = (p["PDY1"] + p["PDY2"] * dfz) * p["LMUY"] * load
    e = (p["PEY1"] + p["PEY2"] * dfz) * (1.0 - p["PEY3"] * (1.0 if x >= 0.0 else -1.0)) * p["LEY"]
    k = p["PKY1"] * p["FNOMIN"] * sin(2.0 * atan(load / (p["PKY2"] * p["FNOMIN"] * p["LFZO"]))) * p["LFZO"] * p["LKY"]
    b = k / (c * d)
    return d * sin(c * atan(b * x - e * (b * x - atan(b * x)))) + load * (p["PVY1"] + p["PVY2"] * dfz) * p["LVY"] * p["LMUY"]


def mf6(p: Coefficients, alpha: float, load: float) -> float:
    """Return the same as `mf5` for versions 6.1 and 6.2."""
    fz0 = p["LFZO"] * p["FNOMIN"]
    dfz, dpi = (load - fz0) / fz0, (p["INFLPRES"] - p["NOMPRES"]) / p["NOMPRES"]
    k = p["PKY1"] * fz0 * (1.0 + p["PPY1"] * dpi) * p["LKY"]
    k *= sin(p["PKY4"] * atan((load / fz0) / (p["PKY2"] * (1.0 + p["PPY2"] * dpi))))
    x = tan(alpha) + (p["PHY1"] + p["PHY2"] * dfz) * p["LHY"]
    c = p["PCY1"] * p["LCY"]
    d = (p["PDY1"] + p["PDY2"] * dfz) * (1.0 + p["PPY3"] * dpi + p["PPY4"] * dpi * dpi) * p["LMUY"] * load
    e = (p["PEY1"] + p["PEY2"] * dfz) * (1.0 - p["PEY3"] * (1.0 if x >= 0.0 else -1.0)) * p["LEY"]
    b = k / (c * d)
    return d * sin(c * atan(b * x - e * (b * x - atan(b * x)))) + load * (p["PVY1"] + p["PVY2"] * dfz) * p["LVY"] * p["LMUY"]


def shifts(p: Coefficients, load: float) -> tuple[float, float]:
    """Return SHy in rad and SVy in N."""
    dfz = load / (p["LFZO"] * p["FNOMIN"]) - 1.0
    return (p["PHY1"] + p["PHY2"] * dfz) * p["LHY"], load * (p["PVY1"] + p["PVY2"] * dfz) * p["LVY"] * p["LMUY"]

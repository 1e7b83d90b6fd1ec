"""Tyre property files, `.tir`, in the TeimOrbit format of Adams and MF-Tyre, and the pure lateral slip that they hold.

Sections in brackets, KEY = value, comments from `!` or `$`, text in quotation marks, small and capital letters alike. Tables
([SHAPE] and the like) are skipped. The section of a key matters only for units: MASS is a unit and an inertia.

The formula is that at zero camber and without turn slip. MF 6.1 and 6.2: H. B. Pacejka, Tire and Vehicle Dynamics, 3rd edition
(2012), equations 4.E1 to 4.E3 and 4.E19 to 4.E30, with the digressive friction factor (4.E8) off. They differ from each other
in camber, overturning moment and contact, not here. MF 5.2 and PAC2002 are the same without pressure, with PKY4 = 2, and with
the slip angle itself instead of its tangent.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.importing.source import MIB, ImportFault, Source, text_of

TIR_BYTES_MAX = MIB
"""Size limit; a file has about 20 KiB."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?\Z", re.ASCII)
UNITS_SECTION = "UNITS"
KEY = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z", re.ASCII)


@dataclass(frozen=True)
class Entry:
    """A value as written in the file, without quotation marks, and its line."""

    text: str
    line: int
    section: str


@dataclass(frozen=True)
class PropertyFile:
    """The entries of a file, in capital letters.

    Attributes:
        source: the file.
        entries: key -> entry, of all sections but [UNITS].
        units: key -> entry of [UNITS].
    """

    source: Source
    entries: Mapping[str, Entry]
    units: Mapping[str, Entry]

    def text(self, key: str, default: str = "") -> str:
        """Return the text of a key; `default` where it is missing."""
        return self.entries[key].text if key in self.entries else default

    def number(self, key: str, section: str, default: float | None = None) -> float:
        """Return the number of a key; `default` where it is missing.

        Raises:
            ImportFault: it is no finite number, or it is missing and has no default; names the section that it belongs to.
        """
        entry = self.entries.get(key)
        if entry is None or not entry.text:
            if default is not None:
                return default
            raise ImportFault(f"{key} is missing", where=self.source.path, remedy=f"add it to [{section}]")
        where = f"{self.source.path}, line {entry.line}"
        if not NUMBER.match(entry.text):
            raise ImportFault(f"{key} = {entry.text!r} is no number", where=where, remedy="give a number")
        value = float(entry.text.lower().replace("d", "e"))  # Fortran writes 1.0D+3
        if not math.isfinite(value):
            raise ImportFault(f"{key} = {entry.text} is too large", where=where, remedy="give a finite number")
        return value

    def place(self, key: str) -> str:
        """Return file and line of a key; the file alone where it is missing."""
        entry = self.entries.get(key) or self.units.get(key)
        return f"{self.source.path}, line {entry.line}" if entry else str(self.source.path)


def parse(source: Source) -> PropertyFile:
    """Parse a file. Raises ImportFault: it is no property file, or a key has two different values."""
    entries: dict[str, Entry] = {}
    units: dict[str, Entry] = {}
    section, sections = "", 0
    for number, raw in enumerate(text_of(source).split("\n"), start=1):
        line = _without_comment(raw).strip()
        if line.startswith("["):
            section, sections = line.strip("[] \t").upper(), sections + 1
            continue
        left, equals, right = line.partition("=")
        key = left.strip().upper()
        if not equals or not KEY.match(key):
            continue
        target = units if section == UNITS_SECTION else entries
        entry = Entry(right.strip().strip("'\"").strip(), number, section)
        if key in target and target[key].text != entry.text:
            raise ImportFault(
                f"{key} is there twice (first in line {target[key].line})",
                where=f"{source.path}, line {number}",
                remedy="leave one out",
            )
        target.setdefault(key, entry)
    if not sections or not entries:
        remedy = "a .tir has sections such as [LATERAL_COEFFICIENTS] and lines KEY = value"
        raise ImportFault("no tyre property file", where=source.path, remedy=remedy)
    return PropertyFile(source, entries, units)


def _without_comment(line: str) -> str:
    """Return the line up to the first `!` or `$` outside of quotation marks."""
    quote = ""
    for position, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character in "!$":
            return line[:position]
    return line


VERSION_BY_FITTYP = {6: "MF 5.2", 21: "MF 5.2", 52: "MF 5.2", 61: "MF 6.1", 62: "MF 6.2"}
"""FITTYP of the file -> formula. 6 is MF-Tyre 5.2, 21 the same with MF-Swift."""
PAC2002 = "PAC2002"
WITH_PRESSURE = ("MF 6.1", "MF 6.2")

LATERAL, SCALING = "LATERAL_COEFFICIENTS", "SCALING_COEFFICIENTS"
SCALE_FACTORS = ("LFZO", "LCY", "LMUY", "LEY", "LKY", "LHY", "LVY")
COEFFICIENTS = ("PCY1", "PDY1", "PDY2", "PEY1", "PEY2", "PEY3", "PKY1", "PKY2")
SHIFTS = ("PHY1", "PHY2", "PVY1", "PVY2")
PRESSURE = ("PPY1", "PPY2", "PPY3", "PPY4")

STIFFNESS_LOW, STIFFNESS_HIGH = 3.0, 100.0
"""1/rad, of |PKY1|, the largest cornering stiffness over the nominal load: tyres of trucks have 5, racing slicks 60."""
PRESSURE_RATIO_MAX = 0.5
"""Largest |dpi|: beyond it the formula is not fitted, and the two pressures probably have different units."""


@dataclass(frozen=True)
class Curve:
    """Pure lateral slip at one load, F(alpha), rising with slip, without the shifts of the file, which are separate attributes.

    Attributes:
        stiffness: K = B C D, N/rad, above zero.
        shape: C.
        peak: D, N, above zero.
        curvature: E, the mean of both sides.
        asymmetry: PEY3, by which E differs between the sides.
        horizontal_shift: SHy, rad, as in the file.
        vertical_shift: SVy, N, as in the file.
        tangent: whether the formula takes tan(alpha) instead of alpha.
    """

    stiffness: float
    shape: float
    peak: float
    curvature: float
    asymmetry: float
    horizontal_shift: float
    vertical_shift: float
    tangent: bool

    def force(self, slip_angle: npt.ArrayLike) -> FloatArray:
        """Return the force in N at slip angles in rad, without shifts: the mean of a left and a right tyre (4.E19)."""
        slip = np.asarray(slip_angle, dtype=np.float64)
        x = self.stiffness / (self.shape * self.peak) * (np.tan(slip) if self.tangent else slip)
        sides = [min(self.curvature * (1.0 - sign * self.asymmetry), 1.0) for sign in (1.0, -1.0)]
        forces = [np.sin(self.shape * np.arctan(x - e * (x - np.arctan(x)))) for e in sides]
        result: FloatArray = 0.5 * self.peak * (forces[0] + forces[1])
        return result


@dataclass(frozen=True)
class LateralFormula:
    """Checked coefficients of a file.

    Attributes:
        version: "PAC2002", "MF 5.2", "MF 6.1" or "MF 6.2".
        values: key -> number, all of COEFFICIENTS, SHIFTS, SCALE_FACTORS, PKY4 and (6.1 and 6.2) PRESSURE.
        nominal_load: FNOMIN in N.
        load_min, load_max: FZMIN and FZMAX in N; zero and inf where the file has none.
        pressure_change: dpi = (INFLPRES - NOMPRES)/NOMPRES; 0 without pressure.
        angle: rad for one unit of angle of the file.
        side: TYRESIDE as written in the file.
    """

    version: str
    values: dict[str, float]
    nominal_load: float
    load_min: float
    load_max: float
    pressure_change: float
    angle: float
    side: str

    def at(self, load: float) -> Curve:
        """Return the curve at a wheel load in N."""
        value = self.values
        reference = value["LFZO"] * self.nominal_load  # 4.E1
        dfz, dpi = load / reference - 1.0, self.pressure_change  # 4.E2a, 4.E2b
        grip = 1.0 + value["PPY3"] * dpi + value["PPY4"] * dpi**2
        friction = (value["PDY1"] + value["PDY2"] * dfz) * grip * value["LMUY"]  # 4.E23
        angle_of_load = math.atan(load / reference / (value["PKY2"] * (1.0 + value["PPY2"] * dpi)))
        stiffness = value["PKY1"] * reference * (1.0 + value["PPY1"] * dpi) * math.sin(value["PKY4"] * angle_of_load)  # 4.E25
        # The sign at a small load depends on the axes of the file (ISO: negative, SAE: positive); a tyre always pushes back.
        outward = math.copysign(1.0, value["PKY1"] * value["PKY2"] * value["PKY4"])
        return Curve(
            stiffness=outward * stiffness * value["LKY"] / self.angle,
            shape=value["PCY1"] * value["LCY"],  # 4.E21
            peak=math.copysign(1.0, value["PDY1"]) * friction * load,  # 4.E22
            curvature=(value["PEY1"] + value["PEY2"] * dfz) * value["LEY"],  # 4.E24
            asymmetry=value["PEY3"],
            horizontal_shift=(value["PHY1"] + value["PHY2"] * dfz) * value["LHY"] * self.angle,  # 4.E27
            vertical_shift=load * (value["PVY1"] + value["PVY2"] * dfz) * value["LVY"] * value["LMUY"],  # 4.E29
            tangent=self.version in WITH_PRESSURE,
        )


def read_formula(file: PropertyFile) -> LateralFormula:
    """Return the lateral formula of a file.

    Raises:
        ImportFault: another format, a coefficient missing or impossible, units that are not known or cannot be right.
    """
    version = _version(file)
    force, angle = _units(file)
    values = {key: file.number(key, LATERAL) for key in COEFFICIENTS}
    values |= {key: file.number(key, LATERAL, 0.0) for key in SHIFTS}
    values |= {key: file.number(key, SCALING, 1.0) for key in SCALE_FACTORS}
    pressure = _pressure_change(file) if version in WITH_PRESSURE else 0.0
    needs_pressure = pressure != 0.0
    values |= {key: file.number(key, LATERAL, None if needs_pressure else 0.0) for key in PRESSURE}
    values["PKY4"] = file.number("PKY4", LATERAL) if version in WITH_PRESSURE else 2.0
    if version not in WITH_PRESSURE:
        values |= dict.fromkeys(PRESSURE, 0.0)
    _check(file, values, angle)
    nominal = file.number("FNOMIN", "VERTICAL") * force
    load_min, load_max = (
        file.number(key, "VERTICAL_FORCE_RANGE", default) * (force if key in file.entries else 1.0)
        for key, default in (("FZMIN", 0.0), ("FZMAX", 1e9))
    )
    if not 100.0 <= nominal <= 100e3:
        raise ImportFault(
            f"FNOMIN is {nominal:.4g} N, which no tyre is made for", where=file.place("FNOMIN"), remedy="check FORCE in [UNITS]"
        )
    side = file.text("TYRESIDE", "not said")
    return LateralFormula(version, values, nominal, load_min, load_max, pressure, angle, side)


def _version(file: PropertyFile) -> str:
    """Return the version from FITTYP, or from PROPERTY_FILE_FORMAT for PAC2002 (Adams writes no FITTYP, or 6)."""
    form = file.text("PROPERTY_FILE_FORMAT").upper()
    known = "PAC2002, and FITTYP 6, 21, 52 (MF 5.2), 61 (MF 6.1), 62 (MF 6.2)"
    if form == PAC2002 and int(file.number("FITTYP", "MODEL", 6.0)) == 6:
        return PAC2002
    if "FITTYP" not in file.entries:
        said = f"PROPERTY_FILE_FORMAT {form!r}" if form else "neither FITTYP nor PROPERTY_FILE_FORMAT"
        raise ImportFault(f"{said}: not a format that is read", where=file.source.path, remedy=f"read are {known}")
    fit = file.number("FITTYP", "MODEL")
    if fit not in VERSION_BY_FITTYP:
        raise ImportFault(f"FITTYP {fit:g} is not read", where=file.place("FITTYP"), remedy=f"read are {known}")
    return VERSION_BY_FITTYP[int(fit)]


def _units(file: PropertyFile) -> tuple[float, float]:
    """Return N for one unit of force and rad for one unit of angle."""
    sizes = {
        "FORCE": {"newton": 1.0, "n": 1.0, "knewton": 1e3, "kilonewton": 1e3, "kn": 1e3},
        "ANGLE": {"radian": 1.0, "rad": 1.0, "degree": math.pi / 180.0, "deg": math.pi / 180.0},
    }
    found = []
    for key, known in sizes.items():
        entry = file.units.get(key)
        choice = {"FORCE": "'newton' or 'kN'", "ANGLE": "'radian' or 'degree'"}[key]
        if entry is None:
            remedy = f"add {key} = {choice} to [UNITS]"
            raise ImportFault(f"[UNITS] does not have {key}", where=file.source.path, remedy=remedy)
        word = entry.text.lower()
        size = known.get(word, known.get(word.removesuffix("s")))
        if size is None:
            raise ImportFault(f"{key} = {entry.text!r} is not known", where=file.place(key), remedy=f"give {choice}")
        found.append(size)
    return found[0], found[1]


def _pressure_change(file: PropertyFile) -> float:
    """Return dpi (4.E2b), from pressures in any common unit; 0 for a file without pressures."""
    section = "OPERATING_CONDITIONS"
    if "INFLPRES" not in file.entries and "NOMPRES" not in file.entries:
        return 0.0
    pressure, nominal = file.number("INFLPRES", section), file.number("NOMPRES", section)
    if nominal <= 0.0 or abs(pressure / nominal - 1.0) > PRESSURE_RATIO_MAX:
        raise ImportFault(
            f"INFLPRES {pressure:g} is too far from NOMPRES {nominal:g} (more than {100 * PRESSURE_RATIO_MAX:g} %)",
            where=file.place("INFLPRES"),
            remedy="give both in Pa, or a pressure that the file was made for",
        )
    return pressure / nominal - 1.0


def _check(file: PropertyFile, values: dict[str, float], angle: float) -> None:
    for key in ("PCY1", "LFZO", "LCY", "LMUY", "LKY"):
        if values[key] <= 0.0:
            raise ImportFault(f"{key} = {values[key]:g}", where=file.place(key), remedy="give a number above zero")
    for key in ("PDY1", "PKY1", "PKY2", "PKY4"):
        if values[key] == 0.0:
            raise ImportFault(f"{key} = 0: a tyre without grip or stiffness", where=file.place(key), remedy="give its value")
    relative = abs(values["PKY1"]) / angle
    if not STIFFNESS_LOW <= relative <= STIFFNESS_HIGH:
        other = "degree" if angle == 1.0 else "radian"
        factor = 180.0 / math.pi if angle == 1.0 else math.pi / 180.0
        fits = STIFFNESS_LOW <= relative * factor <= STIFFNESS_HIGH
        remedy = f"ANGLE = '{other}' in [UNITS] would fit" if fits else "check PKY1 and [UNITS]"
        what = f"PKY1 = {values['PKY1']:g} is a stiffness of {relative:.3g} times the load for a radian, which no tyre has"
        raise ImportFault(what, where=file.place("PKY1"), remedy=remedy)

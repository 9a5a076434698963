"""What the title of a column says: which quantity it is, and in which unit.

Units are read, never guessed: from the title (`G' (Pa)`, `Shear Strain [%]`, `omega_rad_per_s`) or from the row below.
Without a unit, a modulus is in Pa and an angular frequency in rad/s (there is one usual unit, and the sweep says so);
a strain (per cent or fraction?) and a plain frequency (Hz or rad/s?) without a unit are errors.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

from cavirheo.errors import InputError
from cavirheo.reading.tabular import column_of, plain_unit

# Titles as exported, without accents, spaces and capitals; in English, German and French, as the programs speak.
_STORAGE = "storagemodulus shearstoragemodulus elasticmodulus shearmoduluselasticcomponent speichermodul"
_STORAGE += " modulestockage moduleconservation moduledestockage moduledeconservation moduleelastique"
_LOSS = "lossmodulus shearlossmodulus viscousmodulus shearmodulusviscouscomponent verlustmodul"
_LOSS += " moduleperte moduledeperte modulevisqueux"
_OMEGA = "angularfrequency angfrequency angularfreq angfreq omega ω w kreisfrequenz frequenceangulaire pulsation"
_AMPLITUDE = "oscillationstrain complexshearstrain strainamplitude shearstrainamplitude oscillationstrainamplitude"
_STRAIN = "shearstrain strain gamma γ γ0 gamma0 scherdeformation deformation deformationdecisaillement"
_INTERVAL = "actionname interval intervalno step stepname segment sweep sample run repeat replicate test"
_COLUMNS = (  # column, which to prefer where two titles name one, titles
    ("storage", 0, [f"{a}{t}{b}" for t in _STORAGE.split() for a, b in (("", ""), ("g'", ""), ("", "g'"))]),
    ("storage", 0, ["g'", "gp", "gprime", "gstorage"]),
    ("loss", 0, [f"{a}{t}{b}" for t in _LOSS.split() for a, b in (("", ""), ("g''", ""), ("", "g''"))]),
    ("loss", 0, ["g''", "gpp", "gdp", "gdoubleprime", "gloss"]),
    ("omega", 0, _OMEGA.split()),
    ("omega", 1, ["frequency", "freq", "frequenz", "frequence"]),
    ("strain", 0, _AMPLITUDE.split()),
    ("strain", 1, _STRAIN.split()),
    ("interval", 0, _INTERVAL.split()),
)
_TITLES = {title: (kind, preference) for kind, preference, titles in _COLUMNS for title in titles}
_PASCAL = {"Pa": 1.0, "pa": 1.0, "kPa": 1e3, "KPa": 1e3, "kpa": 1e3, "MPa": 1e6, "GPa": 1e9, "mPa": 1e-3, "dyncm2": 0.1}
_PER_SECOND = dict.fromkeys(("rads", "radsec", "radpers", "rads-1", "rads1", "radsec-1"), 1.0)
_INVERSE_SECOND = dict.fromkeys(("1s", "s-1", "pers", "1sec"), 1.0)  # Hz or rad/s: only the name can tell
_HERTZ = {"Hz": 2 * math.pi, "hz": 2 * math.pi, "HZ": 2 * math.pi, "kHz": 2e3 * math.pi, "mHz": 2e-3 * math.pi}
_FRACTION = dict.fromkeys(("1", "-", "–", "—", "fraction", "dimensionless", "unitless"), 1.0)
_UNITS = {
    "storage": _PASCAL,
    "loss": _PASCAL,
    "omega": _PER_SECOND | _INVERSE_SECOND | _HERTZ,
    "strain": dict.fromkeys(("%", "percent", "pct"), 0.01) | _FRACTION,
    "interval": {},
}
_UNITS_BY_KIND: dict[Any, dict[str, float]] = {kind: _UNITS[kind[0]] for kind in set(_TITLES.values())}
NAMES = {"storage": "G'", "loss": "G''", "omega": "frequency", "strain": "strain"}
_UNDECLARED = {
    "strain": "{title!r} has no unit, and per cent and fraction differ by a factor of 100; write it into the header: "
    "'Strain (%)' or 'Strain [1]'",
    "omega": "{title!r} has no unit, and Hz and rad/s differ by a factor of 2 pi; write it into the header: "
    "'Frequency (Hz)' or 'Angular frequency (rad/s)'",
}


class SweepColumn(NamedTuple):
    """One column of a table of moduli; `preference`: 0 where another title of its kind is less exact."""

    at: int
    title: str
    kind: str
    preference: int
    unit: str | None

    def factor(self) -> float:
        """From the column's unit to SI. Raises InputError for a unit that is missing or unknown."""
        plain = self.kind == "omega" and self.preference == 1
        if self.unit is None and (self.kind == "strain" or plain):
            raise InputError(_UNDECLARED[self.kind].format(title=self.title), "rheometer.no_unit")
        if self.unit is None:
            return 1.0
        unit, units = plain_unit(self.unit), _UNITS[self.kind]
        if plain and unit in _INVERSE_SECOND:
            title = self.title if self.unit in self.title else f"{self.title} {self.unit}"
            raise InputError(_UNDECLARED[self.kind].format(title=title), "rheometer.no_unit")
        if unit not in units:
            known = {"strain": "%, 1", "omega": "rad/s, Hz"}.get(self.kind, "Pa, kPa, MPa")
            raise InputError(
                f"the unit {self.unit!r} of {self.title!r} is not known; known: {known}", "rheometer.unknown_unit"
            )
        return units[unit]

    def note(self) -> str:
        """What was done to the unit; nothing where there was nothing to do."""
        if self.unit is None:
            return f"{self.title!r} has no unit: taken to be in {'rad/s' if self.kind == 'omega' else 'Pa'}"
        if self.kind == "omega" and plain_unit(self.unit) in _HERTZ:
            return f"{self.title!r} is in {self.unit}: converted to rad/s by 2 pi"
        return ""


@cache
def read_title(title: str) -> tuple[str, int, str | None]:
    """("storage" | "loss" | "omega" | "strain" | "interval" | "", preference, unit or None) of a column's title."""
    if title[:1] in "0123456789+-.":
        return "", 0, None
    kind, unit = column_of(title, _TITLES, _UNITS_BY_KIND)
    return (*(kind or ("", 0)), unit)

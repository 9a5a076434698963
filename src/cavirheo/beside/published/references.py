"""Published values of sets of measurements, as a CSV file that is written by hand (docs/compare.md).

One line per set, method and quantity, so that a method is added by adding lines:

    set,files,density,method,quantity,mean,std,source
    gel 1 %,gel_1/*.mat,1004,IMR,G_kPa,6.44,1.64,doi:...
    gel 1 %,,,IMR,mu_Pa_s,0.020,0.009,
    gel 1 %,,,rheometer,G_kPa,1.30,,

| column | holds |
|---|---|
| set | the name of the set of measurements (needed) |
| files | its file, subfolder or glob, relative to the folder; default: the name of the set |
| method, quantity, mean, std | a published value; a line without any of them only names a set. std may be left out |
| model, window, stretch, rmax_um, medium, density, sound_speed, surface_tension, pressure, temperature | as the options of `cavirheo infer`, for the whole set: on one of its lines or on all |
| source, note | free text |

Quantities: G_Pa, G_kPa (or shear_modulus_Pa, shear_modulus_kPa) and mu_Pa_s, mu_mPa_s (or viscosity_...).
Empty lines and lines that begin with # are left out.
"""  # noqa: E501

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from cavirheo.errors import InputError
from cavirheo.physics.media import Medium, medium
from cavirheo.reading.tabular import Row, read_sheets
from cavirheo.writing.document import Model

OURS = "cavirheo"  # the method's name for our own answers
G, MU = "shear_modulus_Pa", "viscosity_Pa_s"
_UNITS = {
    "G_Pa": (G, 1.0),
    "G_kPa": (G, 1e3),
    "shear_modulus_Pa": (G, 1.0),
    "shear_modulus_kPa": (G, 1e3),
    "mu_Pa_s": (MU, 1.0),
    "mu_mPa_s": (MU, 1e-3),
    "viscosity_Pa_s": (MU, 1.0),
    "viscosity_mPa_s": (MU, 1e-3),
}
_CONSTANTS = {
    "density": "kg/m3", "sound_speed": "m/s", "surface_tension": "N/m", "pressure": "Pa", "temperature": "K",
}  # fmt: skip
_NUMBERS = {"window": "collapses", "stretch": "R_max/R_0", "rmax_um": "um", **_CONSTANTS}
_SETTINGS = ("files", "model", "medium", *_NUMBERS)
_VALUE = ("method", "quantity", "mean", "std")
_COLUMNS = ("set", *_VALUE, *_SETTINGS, "source", "note")


class MethodValue(Model):
    """What one method says of one quantity, SI: published, or the mean ± standard deviation over our n shots."""

    mean: float | None = None
    std: float | None = None
    n: int | None = None
    source: str = ""


@dataclass
class ReferenceSet:
    """What the file says about one set. `where` is its first line; `given` tells which line gave a setting; `values`
    is by (method, quantity).
    """

    name: str
    where: str
    settings: dict[str, Any] = field(default_factory=dict)
    given: dict[str, str] = field(default_factory=dict)
    values: dict[tuple[str, str], MethodValue] = field(default_factory=dict)
    medium: Medium = field(default_factory=Medium)

    @property
    def files(self) -> str:
        return str(self.settings.get("files", self.name))


def read_references(path: str | Path) -> list[ReferenceSet]:
    """The sets in the order of their first lines.

    Raises:
        InputError: the file cannot be read or has a mistake; the message names line, column and what was expected.
    """
    try:
        (sheet,) = read_sheets(Path(path), lambda cells: "set" in cells, most=1, marks="#")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})", "references.file") from None
    except InputError as error:
        raise error.within(str(path)) from None
    (first, head), *rows = sheet.rows or [Row(1, [])]
    _check_head(head, f"{path}, line {first}")
    sets: dict[str, ReferenceSet] = {}
    methods: dict[str, _Line] = {}
    for number, cells in rows:
        cells = cells if len(head) > 1 else [" ".join(cells)]  # names alone: nothing separates columns
        if any(cells[len(head) :]):
            found = f"{path}, line {number}: {len(cells)} cells, expected the {len(head)} of the header"
            raise InputError(f'{found}; text with a comma in it needs quotes: "a, b"', "references.cells")
        line = _Line(f"{path}, line {number}", number, dict(zip(head, cells, strict=False)))
        if not line["set"]:
            raise line.mistake("set", "the name of a set of measurements")
        about = sets.setdefault(line["set"], ReferenceSet(line["set"], line.where))
        _add_settings(about, line)
        if any(line[name] for name in _VALUE):
            _add_value(about, line)
        known = methods.setdefault(line["method"].casefold(), line)
        if known["method"] != line["method"]:
            raise line.mistake("method", f"it as on line {known.number}: {known['method']!r}")
    if not sets:
        raise InputError(
            f"{path}: no set; expected lines below the header, such as: gel_1,IMR,G_kPa,6.44,1.64", "references.no_set"
        )
    for about in sets.values():
        constants = {name: about.settings[name] for name in _CONSTANTS if name in about.settings}
        try:
            about.medium = medium(about.settings.get("medium", "water"), **constants)
        except InputError as error:
            raise error.within(f"{about.where}, set {about.name!r}") from None
    return list(sets.values())


@dataclass
class _Line:
    """One line of the file; `line[column]` is its text, empty where there is none."""

    where: str
    number: int
    cells: dict[str, str]

    def __getitem__(self, column: str) -> str:
        return self.cells.get(column, "")

    def mistake(self, column: str, expected: str) -> InputError:
        where = f"{self.where}, column {column}"
        return InputError(f"{where}: {self[column]!r}; expected {expected}", f"references.{column}")

    def value(self, column: str, unit: str, *, zero: bool = False) -> float:
        """The number in a column; it may be 0 where `zero` says so."""
        try:
            value = float(self[column])
        except ValueError:
            value = float("nan")
        if not isfinite(value) or value < 0 or (value == 0 and not zero):
            raise self.mistake(column, f"a number {'from' if zero else 'above'} 0 ({unit})")
        return value


def _check_head(head: list[str], where: str) -> None:
    if "set" not in head:
        found, expected = ", ".join(head) or "nothing", ",".join(_COLUMNS)
        raise InputError(f"{where}: no column set; found: {found}; expected {expected}", "references.head")
    for name in head:
        place = f"{where}, column {name or '(empty)'}"
        if name not in _COLUMNS:
            raise InputError(f"{place}: not known; expected one of {', '.join(_COLUMNS)}", "references.head")
        if head.count(name) > 1:
            raise InputError(f"{place}: {head.count(name)} times; expected once", "references.head")


def _add_settings(about: ReferenceSet, line: _Line) -> None:
    for name in filter(line.__getitem__, _SETTINGS):
        value: Any = line[name]
        if name == "window":
            if not value.isdigit() or int(value) < 1:
                raise line.mistake(name, "a whole number of collapses from 1")
            value = int(value)
        elif name in _NUMBERS:
            value = line.value(name, _NUMBERS[name], zero=name == "surface_tension")
        if about.settings.setdefault(name, value) != value:
            raise line.mistake(name, f"{about.settings[name]} as in {about.given[name]}, or an empty cell")
        about.given.setdefault(name, line.where)


def _add_value(about: ReferenceSet, line: _Line) -> None:
    method = line["method"]
    if not method:
        raise line.mistake("method", "who measured, such as IMR or rheometer")
    if method.casefold() == OURS:
        raise line.mistake("method", "another name: this one is of our own answers")
    if line["quantity"] not in _UNITS:
        raise line.mistake("quantity", f"one of {', '.join(_UNITS)}")
    quantity, factor = _UNITS[line["quantity"]]
    mean = line.value("mean", line["quantity"])
    std = line.value("std", line["quantity"], zero=True) if line["std"] else None
    if (method, quantity) in about.values:
        raise line.mistake("quantity", f"one {quantity} of {about.name!r} by {method}")
    scaled = [None if value is None else float(f"{value * factor:.12g}") for value in (mean, std)]  # 6.44e3 is 6440
    about.values[method, quantity] = MethodValue(mean=scaled[0], std=scaled[1], source=line["source"])

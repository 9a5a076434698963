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

import csv
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from cavirheo.errors import InputError
from cavirheo.physics.media import Medium, medium

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


@dataclass(frozen=True)
class Published:
    """A value from the literature, SI; `std` None where none is given."""

    mean: float
    std: float | None = None
    source: str = ""


@dataclass
class ReferenceSet:
    """What the file says about one set. `lines` tells which line gave a setting; `values` is by (method, quantity)."""

    name: str
    line: int
    settings: dict[str, Any] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    values: dict[tuple[str, str], Published] = field(default_factory=dict)
    medium: Medium = field(default_factory=Medium)

    @property
    def files(self) -> str:
        return str(self.settings.get("files", self.name))


def read_references(path: str | Path) -> list[ReferenceSet]:
    """The sets in the order of their first lines.

    Raises:
        InputError: the file cannot be read or has a mistake; the message names line, column and what was expected.
    """
    rows = _rows(Path(path))
    head_line, head = next(rows, (1, []))
    head = [name.strip() for name in head]
    _check_head(head, f"{path}, line {head_line}")
    sets: dict[str, ReferenceSet] = {}
    methods: dict[str, tuple[str, int]] = {}
    for line, cells in rows:
        where = f"{path}, line {line}"
        if len(cells) > len(head):
            raise InputError(
                f"{where}: {len(cells)} cells, expected the {len(head)} of the header; text with a comma in it needs "
                'quotes: "a, b"'
            )
        row = {name: cell.strip() for name, cell in zip(head, cells, strict=False)}
        name = row.get("set", "")
        if not name:
            raise InputError(f"{where}, column set: empty; expected the name of a set of measurements")
        about = sets.setdefault(name, ReferenceSet(name, line))
        _add_settings(about, row, line, where)
        _add_value(about, row, where)
        if method := row.get("method", ""):
            known, first = methods.setdefault(method.casefold(), (method, line))
            if known != method:
                raise InputError(f"{where}, column method: {method!r}; expected it as on line {first}: {known!r}")
    if not sets:
        raise InputError(f"{path}: no set; expected lines below the header, such as: gel_1,IMR,G_kPa,6.44,1.64")
    for about in sets.values():
        constants = {name: about.settings[name] for name in _CONSTANTS if name in about.settings}
        try:
            about.medium = medium(about.settings.get("medium", "water"), **constants)
        except InputError as error:
            raise InputError(f"{path}, line {about.line}, set {about.name!r}: {error}") from None
    return list(sets.values())


def _rows(path: Path) -> Any:
    """(line, cells) of each line that is neither empty nor a comment."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            for cells in reader:
                if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#"):
                    yield reader.line_num, cells
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError(f"{path}: cannot be read as a CSV file ({reason})") from None


def _check_head(head: list[str], where: str) -> None:
    if "set" not in head:
        raise InputError(
            f"{where}: no column set; found: {', '.join(head) or 'nothing'}; expected {','.join(_COLUMNS)}"
        )
    for name in head:
        if name not in _COLUMNS:
            raise InputError(f"{where}, column {name or '(empty)'}: not known; expected one of {', '.join(_COLUMNS)}")
        if head.count(name) > 1:
            raise InputError(f"{where}, column {name}: {head.count(name)} times; expected once")


def _add_settings(about: ReferenceSet, row: dict[str, str], line: int, where: str) -> None:
    for name in _SETTINGS:
        text = row.get(name, "")
        if not text:
            continue
        value: Any = text
        if name == "window":
            if not text.isdigit() or int(text) < 1:
                raise InputError(f"{where}, column window: {text!r}; expected a whole number of collapses from 1")
            value = int(text)
        elif name in _NUMBERS:
            value = _number(text, f"{where}, column {name}", _NUMBERS[name], zero=name == "surface_tension")
        if about.settings.setdefault(name, value) != value:
            raise InputError(
                f"{where}, column {name}: {text}, but line {about.lines[name]} says {about.settings[name]} for the set "
                f"{about.name!r}; expected one value for a set, or an empty cell"
            )
        about.lines.setdefault(name, line)


def _add_value(about: ReferenceSet, row: dict[str, str], where: str) -> None:
    if not any(row.get(name) for name in _VALUE):
        return
    method, quantity = row.get("method", ""), row.get("quantity", "")
    if not method:
        raise InputError(f"{where}, column method: empty; expected who measured, such as IMR or rheometer")
    if method.casefold() == OURS:
        raise InputError(f"{where}, column method: {method!r} are our own answers; expected another name")
    if quantity not in _UNITS:
        raise InputError(f"{where}, column quantity: {quantity!r}; expected one of {', '.join(_UNITS)}")
    name, factor = _UNITS[quantity]
    mean = _number(row.get("mean", ""), f"{where}, column mean", quantity)
    text = row.get("std", "")
    std = _number(text, f"{where}, column std", quantity, zero=True) if text else None
    if (method, name) in about.values:
        raise InputError(f"{where}: a second {name} of {about.name!r} by {method}; expected one")
    scaled = [None if value is None else float(f"{value * factor:.12g}") for value in (mean, std)]  # 6.44e3 is 6440
    assert scaled[0] is not None
    about.values[method, name] = Published(scaled[0], scaled[1], row.get("source", ""))


def _number(text: str, where: str, unit: str, *, zero: bool = False) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value) or value < 0 or (value == 0 and not zero):
        raise InputError(f"{where}: {text!r}; expected a number {'from' if zero else 'above'} 0 ({unit})")
    return value

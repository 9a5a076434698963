"""Published values of sets of measurements, as a CSV file that is written by hand (docs/how-to/compare.md).

One line per set, method and quantity, so that a method is added by adding lines:

    set,files,density,method,quantity,mean,std,source
    gel 1 %,gel_1/*.mat,1004,IMR,G_kPa,6.44,1.64,doi:...
    gel 1 %,,,IMR,mu_Pa_s,0.020,0.009,
    gel 1 %,,,rheometer,G_kPa,1.30,,

A line without method, quantity, mean and std only names a set. Settings stand on one line of a set or on all. Empty
lines and lines that begin with # are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, NonNegativeFloat, PositiveFloat, PositiveInt, ValidationError

from cavirheo.errors import InputError
from cavirheo.physics.media import Medium, medium
from cavirheo.reading.tabular import Row, read_sheets
from cavirheo.writing.document import Record

OURS = "cavirheo"  # the method's name for our own answers
G, MU = "shear_modulus_Pa", "viscosity_Pa_s"
_UNITS = {
    **dict.fromkeys(("G_Pa", "shear_modulus_Pa"), (G, 1.0)),
    **dict.fromkeys(("G_kPa", "shear_modulus_kPa"), (G, 1e3)),
    **dict.fromkeys(("mu_Pa_s", "viscosity_Pa_s"), (MU, 1.0)),
    **dict.fromkeys(("mu_mPa_s", "viscosity_mPa_s"), (MU, 1e-3)),
}
_CONSTANTS = ("density", "sound_speed", "surface_tension", "pressure", "temperature")
_SETTINGS = ("files", "model", "medium", "window", "stretch", "rmax_um", *_CONSTANTS)


class _ReferenceLine(BaseModel):
    """One line of the file: its columns and what they may hold. The settings are as the options of `infer`, SI."""

    model_config = ConfigDict(allow_inf_nan=False)

    set: str
    method: str | None = None
    quantity: str | None = None
    mean: PositiveFloat | None = None
    std: NonNegativeFloat | None = None
    files: str | None = None  # file, subfolder or glob, relative to the folder; default: the name of the set
    model: str | None = None
    medium: str | None = None
    window: PositiveInt | None = None
    stretch: PositiveFloat | None = None
    rmax_um: PositiveFloat | None = None
    density: PositiveFloat | None = None
    sound_speed: PositiveFloat | None = None
    surface_tension: NonNegativeFloat | None = None
    pressure: PositiveFloat | None = None
    temperature: PositiveFloat | None = None
    source: str = ""
    note: str = ""


_COLUMNS = tuple(_ReferenceLine.model_fields)


class MethodValue(Record):
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
    methods: dict[str, tuple[str, str]] = {}
    for number, cells in rows:
        where = f"{path}, line {number}"
        cells = cells if len(head) > 1 else [" ".join(cells)]  # names alone: nothing separates columns
        if any(cells[len(head) :]):
            found = f"{where}: {len(cells)} cells, expected the {len(head)} of the header"
            raise InputError(f'{found}; text with a comma in it needs quotes: "a, b"', "references.cells")
        row = {name: cell for name, cell in zip(head, cells, strict=False) if cell}
        try:
            line = _ReferenceLine(**row)  # type: ignore[arg-type]  # text, which it turns into numbers
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            column = str(wrong["loc"][0])
            expected = "a name" if column == "set" else wrong["msg"].removeprefix("Input should be ")
            raise _mistake(where, column, row.get(column, ""), expected) from None
        about = sets.setdefault(line.set, ReferenceSet(line.set, where))
        for name, value in line.model_dump(include=set(_SETTINGS), exclude_none=True).items():
            if about.settings.setdefault(name, value) != value:
                expected = f"{about.settings[name]} as in {about.given[name]}, or an empty cell"
                raise _mistake(where, name, row[name], expected)
            about.given.setdefault(name, where)
        _add_value(about, line, where)
        if line.method:
            known, there = methods.setdefault(line.method.casefold(), (line.method, where))
            if known != line.method:
                raise _mistake(where, "method", line.method, f"{known!r} as in {there}")
    if not sets:
        example = "gel_1,IMR,G_kPa,6.44,1.64"
        raise InputError(f"{path}: no set; expected lines below the header, such as: {example}", "references.no_set")
    for about in sets.values():
        constants = {name: about.settings[name] for name in _CONSTANTS if name in about.settings}
        try:
            about.medium = medium(about.settings.get("medium", "water"), **constants)
        except InputError as error:
            raise error.within(f"{about.where}, set {about.name!r}") from None
    return list(sets.values())


def _mistake(where: str, column: str, found: Any, expected: str) -> InputError:
    return InputError(f"{where}, column {column}: {found or ''!r}; expected: {expected}", f"references.{column}")


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


def _add_value(about: ReferenceSet, line: _ReferenceLine, where: str) -> None:
    """The published value of a line, if it has one."""
    if not any((line.method, line.quantity, line.mean, line.std is not None)):
        return
    if not line.method:
        raise _mistake(where, "method", "", "who measured, such as IMR or rheometer")
    if line.method.casefold() == OURS:
        raise _mistake(where, "method", line.method, "another name: this one is of our own answers")
    if line.quantity not in _UNITS:
        raise _mistake(where, "quantity", line.quantity, f"one of {', '.join(_UNITS)}")
    if line.mean is None:
        raise _mistake(where, "mean", "", f"a number above 0 ({line.quantity})")
    quantity, factor = _UNITS[line.quantity]
    if (line.method, quantity) in about.values:
        raise _mistake(where, "quantity", line.quantity, f"one {quantity} of {about.name!r} by {line.method}")
    scaled = [None if value is None else float(f"{value * factor:.12g}") for value in (line.mean, line.std)]
    about.values[line.method, quantity] = MethodValue(mean=scaled[0], std=scaled[1], source=line.source)

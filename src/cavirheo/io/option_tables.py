"""Tables that an option names: a declared column, and the pressure far from the bubble over time.

A declared column, such as a concentration or a temperature, has shots, files or groups and one number each:

    shot,concentration_percent
    gel_1.csv,0.5
    gel_2.csv,1.0

A line names a curve, else a file (with or without its ending), else a group. Instead of a table, the word R_max: what
each recording says of itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io.files import guarded
from cavirheo.io.formats import TIME_UNITS
from cavirheo.io.tables import Name, Term, Vocabulary, read_columns

SIZE = "R_max"  # the word
LOG_SIZE = "log10(R_max/µm)"  # the column that it stands for
_LISTED = 5  # names in a message
_DECLARED = Vocabulary(
    {"any": Term("")},
    "expected a first line with two titles, such as shot,concentration_percent, and below it a name and a number each",
    ["any"],
    dict.fromkeys(("columns", "empty"), "column.head") | dict.fromkeys(("number", "comma", "width"), "column.number"),
    fallback=lambda title: Name("any" if title else ""),
)


_TRACE = Vocabulary(
    {
        "time": Term("t time zeit temps tiempo 時間 时间", TIME_UNITS),
        "pressure": Term("p pressure druck pression presion 圧力 压力 壓力", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}),
    },
    "expected a pressure trace with the columns time_us,pressure_kPa",
    ("time", "pressure"),
    dict.fromkeys(("columns", "empty", "no_unit", "unit"), "trace.header") | {"twice": "trace.twice"},
)


def with_column(curves: Sequence[RadiusCurve], path: str | Path) -> list[RadiusCurve]:
    """The curves, each with its value, of a table or of `SIZE`, which a curve without R_max has not.

    Raises:
        InputError: the file cannot be read, is no such table, names what is not there, or gives a curve no value; or
            all curves of each group have one value, so that nothing can be seen of a trend.
    """
    if is_size(path):
        title, with_values = LOG_SIZE, with_size(curves)
    else:
        title, values = read_column(path)
        require(bool(values), f"{path}: no line below the titles, the second of which is {title}", "column.empty")
        with_values, unknown, without = with_given_values(curves, title, values)
        names = listed([curve.name for curve in curves])
        message = f"{path}: nothing here is called {listed(unknown)}; there is {names}"
        require(not unknown, message, "column.unknown")
        message = f"{path}: no value of {title} for {listed(without)}: add a line for the shot, its file or its group"
        require(not without, message, "column.missing")
    groups: dict[tuple[str, str], set[float]] = {}
    for curve in with_values:
        groups.setdefault((curve.group, curve.group_source), set()).update(curve.column.values())
    names = listed([name for name, _ in groups])
    message = f"{path}: one value of {title} in each group ({names}): a trend needs several"
    message += "; --group folder makes one group of all files of a folder"
    require(any(len(numbers) > 1 for numbers in groups.values()), message, "column.constant")
    return with_values


def is_size(path: str | Path) -> bool:
    """Whether the R_max of each shot is meant, and no table. Raises InputError: there is a file of that name."""
    message = f"{SIZE} stands for the R_max of each shot, but a file has this name: rename the file (to {SIZE}.csv)"
    require(str(path) != SIZE or not Path(path).is_file(), message, "column.size")
    return str(path) == SIZE


def with_size(curves: Sequence[RadiusCurve]) -> list[RadiusCurve]:
    """The curves, with log10 of their R_max in um as far as they have one."""
    labelled = list(curves)
    for k, curve in enumerate(curves):
        with suppress(InputError):  # no scale, or no maximum
            labelled[k] = curve.labelled(column={LOG_SIZE: float(np.log10(1e6 * curve.max_radius))})
    return labelled


def with_given_values(
    curves: Sequence[RadiusCurve], title: str, values: Mapping[str, float]
) -> tuple[list[RadiusCurve], list[str], list[str]]:
    """The curves, with their values as far as there are any; names that no curve has; curves without a value."""
    names_of_curves: set[str] = set()
    labelled, without = [], []
    for curve in curves:
        source = Path(curve.source)
        names = [curve.name, source.name, source.stem, curve.group]  # by which a line may name it, the closest first
        names_of_curves.update(names)
        value = next((values[name] for name in names if name in values), None)
        labelled.append(curve if value is None else curve.labelled(column={title: value}))
        without += [curve.name] if value is None else []
    return labelled, [name for name in values if name not in names_of_curves], without


def read_column(path: str | Path) -> tuple[str, dict[str, float]]:
    """The title of the numbers, and the number of each name. Raises InputError: the file is no such table."""
    path = Path(path)
    with guarded(path):
        (table,) = read_columns(path, _DECLARED)
        two = len(table.titles) == 2 and len(table.columns) == 2
        require(two, f"the titles are {', '.join(table.titles[:3])}; {_DECLARED.expected}", "column.head")
        names, numbers = table.columns
        values: dict[str, float] = {}
        for (line, texts), name, value in zip(table.rows, names.text, numbers.numbers, strict=True):
            message = f"line {line}: expected a name and a number, found {listed(texts)}"
            require(len(texts) == 2 and bool(np.isfinite(value)), message, "column.number")
            require(name not in values, f"line {line}: {name} is there twice", "column.twice")
            values[name] = float(value)
    return numbers.title, values


def listed(names: Sequence[str]) -> str:
    """The first of them, for a message."""
    unlike = list(dict.fromkeys(names))
    return (", ".join(unlike[:_LISTED]) or "nothing") + f" and {len(unlike) - _LISTED} more" * (len(unlike) > _LISTED)


def read_trace(path: Path) -> tuple[Floats, Floats, list[str]]:
    """(n,) times in s, (n,) pressures above the ambient one in Pa, and notes of what was recognised or left out, from
    the columns time_us and pressure_kPa (or in other units, which must be named).

    Raises InputError: the file cannot be read, has no such columns, or a cell that is no number.
    """
    with guarded(path):
        (table,) = read_columns(path, _TRACE)
        return table.column("time").si, table.column("pressure").si, table.notes

"""The number of each shot along which a trend is asked for (`--column`): of a table, or log10 of its R_max."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, listed
from cavirheo.io.files import guarded
from cavirheo.io.tables import Name, Term, Vocabulary, read_columns

R_MAX = "R_max"  # given instead of the path of a table
LOG_R_MAX = "log10(R_max/µm)"  # title of the column that `R_MAX` stands for
_COLUMN_TABLE = Vocabulary(
    {"any": Term("")},
    "expected a first line with two titles, such as shot,concentration_percent, and below it a name and a number each",
    ["any"],
    dict.fromkeys(("columns", "empty"), "column.head") | dict.fromkeys(("number", "comma", "width"), "column.number"),
    fallback=lambda title: Name("any" if title else ""),
)


def with_column(curves: Sequence[RadiusCurve], path: str | Path) -> list[RadiusCurve]:
    """Return the curves, each with its value from a table (`read_column`), or log10 of its R_max if `path` is `R_MAX`.

    Raises InputError: no such table, a name without a curve, a curve without a value, or no group with several values.
    """
    labelled = list(curves)
    if str(path) == R_MAX:
        if Path(path).is_file():
            message = f"{R_MAX} stands for the R_max of each shot, but a file has this name: rename it (to {R_MAX}.csv)"
            raise InputError(message, "column.size")
        for k, curve in enumerate(curves):
            with suppress(InputError):  # no scale, or no maximum
                labelled[k] = curve.labelled(column={LOG_R_MAX: float(np.log10(1e6 * curve.max_radius))})
    else:
        title, values = read_column(path)
        known: set[str] = set()
        for k, curve in enumerate(curves):
            source = Path(curve.source)
            names = [curve.name, source.name, source.stem, curve.group]  # names for it in a table, most specific first
            known.update(names)
            if name := next((name for name in names if name in values), None):
                labelled[k] = curve.labelled(column={title: values[name]})
        if not values:
            raise InputError(f"{path}: no line below the titles, the second of which is {title}", "column.empty")
        if unknown := [name for name in values if name not in known]:
            there = listed([curve.name for curve in curves])
            raise InputError(f"{path}: nothing here is called {listed(unknown)}; there is {there}", "column.unknown")
        if without := [curve.name for curve in labelled if not curve.column]:
            message = f"{path}: no value of {title} for {listed(without)}"
            raise InputError(f"{message}: add a line for the shot, its file or its group", "column.missing")
    groups: dict[tuple[str, str], set[float]] = {}
    for curve in labelled:
        groups.setdefault((curve.group, curve.group_source), set()).update(curve.column.values())
    if not any(len(numbers) > 1 for numbers in groups.values()):
        message = f"{path}: one value in each group ({listed([name for name, _ in groups])}): a trend needs several"
        raise InputError(f"{message}; --group folder makes one group of all files of a folder", "column.constant")
    return labelled


def read_column(path: str | Path) -> tuple[str, dict[str, float]]:
    """Return (the title of the numbers, the number for each name) of a table such as

        shot,concentration_percent
        gel_1.csv,0.5
        gel_2.csv,1.0

    A name is that of a curve, a file (with or without its ending) or a group. Raises InputError: no such table.
    """
    with guarded(Path(path)) as source:
        (table,) = read_columns(source, _COLUMN_TABLE)
        if not len(table.titles) == len(table.columns) == 2:
            titles = ", ".join(table.titles[:3])
            raise InputError(f"the titles are {titles}; {_COLUMN_TABLE.expected}", "column.head")
        names, numbers = table.columns
        values: dict[str, float] = {}
        for (line, texts), name, value in zip(table.rows, names.text, numbers.numbers, strict=True):
            if len(texts) != 2 or not np.isfinite(value):
                message = f"line {line}: expected a name and a number, found {listed(texts)}"
                raise InputError(message, "column.number")
            if name in values:
                raise InputError(f"line {line}: {name} is there twice", "column.twice")
            values[name] = float(value)
    return numbers.title, values

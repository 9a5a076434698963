"""The table in a sheet: its titles, found below whatever stands above them, with the units of the row below.

Rows of means, sums and the like at its end are no measurements; a first column without a title numbers the rows.
Everything that is left out is counted in `notes`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.reading.header import plain_title
from cavirheo.reading.number_format import Cells, is_number, number
from cavirheo.reading.tabular import IsHeader, Row, Sheet

Column = Callable[[str], tuple[Any, str | None]]  # (kind, unit) of a title; a kind that is false is not known

_SUMMARIES = {  # as titles.plain_title writes them
    word
    for words in (
        "mean average avg median sum total std sd stdev stddev standarddeviation min max minimum maximum",
        "mittel mittelwert durchschnitt summe gesamt standardabweichung moyenne mediane somme ecarttype",
        "media promedio suma mediana desviacionestandar desviaciontipica 平均 平均值 合計 标准差 標準偏差",
    )
    for word in words.split()
}


class Table(NamedTuple):
    """titles: with units. rows: of data. notes: what was left out or recognised. above: the lines over the titles."""

    titles: Cells
    rows: list[Row]
    notes: list[str]
    above: list[str]


def find_table(sheet: Sheet, is_header: IsHeader, column: Column) -> Table | None:
    """The first table of a sheet whose titles are a header; None where there is none.

    Raises:
        InputError: a title and the row below it name two units ("tabular.units"), or a row is wider or all rows are
            narrower than the titles ("tabular.width").
    """
    at = next((k for k, row in enumerate(sheet.rows) if _has_words(row.cells) and is_header(row.cells)), None)
    if at is None:
        return None
    titles, rows = sheet.rows[at].cells, sheet.rows[at + 1 :]
    above = [" ".join(row.cells) for row in sheet.rows[: min(at, 1000)]]
    notes = [*sheet.notes, *([f"{_lines(at)} above the titles left out"] if at else [])]
    if rows and (units := _units_below(titles, rows[0], column)):
        notes.append(f"units from the row below the titles: {', '.join(filter(None, rows[0].cells))}")
        titles, rows = units, rows[1:]
    rows, said = without_summary(rows)
    if _first_numbers_rows(titles, rows):
        titles = ["", *titles]
        said.append("a first column without a title, which numbers the rows, left out")
    refuse_wider(rows, titles)
    return Table(titles, rows, notes + said, [*sheet.comments, *above])


def _has_words(cells: Cells) -> bool:
    return not all(map(is_number, cells))


def _lines(count: int) -> str:
    return f"{count} line" + "s" * (count > 1)


def _units_below(titles: Cells, row: Row, column: Column) -> Cells | None:
    """The titles with the units that stand in the row below them; None where it holds none."""
    if any(is_number(cell) and re.search(r"\d", cell) for cell in row.cells):
        return None
    merged, found = list(titles), False
    for k, (title, cell) in enumerate(zip(titles, row.cells, strict=False)):
        kind, unit = column(title)
        below = column(f"{kind} ({cell.strip('[]() ')})")[1] if kind and cell.strip("[]() -") else None
        both = f"the column {title!r} has the unit {unit!r} in its title, and {cell!r} in the row below"
        require(None in (unit, below) or unit == below, both, "tabular.units")
        if below and column(f"{title} ({below})")[0] == kind:
            merged[k], found = title if unit else f"{title} ({below})", True
    return merged if found else None


def without_summary(rows: list[Row]) -> tuple[list[Row], list[str]]:
    """(the rows without those of a mean, a sum and the like at their end, a note if there were any).

    A word that comes twice is the name of something.
    """
    words: list[str] = []
    for row in reversed(rows):
        word = next((cell for cell in row.cells if plain_title(cell) in _SUMMARIES), None)
        if word is None:
            break
        words.insert(0, word)
    if not words or len(set(map(plain_title, words))) < len(words):
        return rows, []
    return rows[: -len(words)], [f"{_lines(len(words))} of {', '.join(words)} at the end left out"]


def _first_numbers_rows(titles: Cells, rows: list[Row]) -> bool:
    """Whether each row has one cell more than there are titles, and the first ones count the rows.

    Without any decimal point the further cell may as well come from decimal commas.
    """
    if len(rows) < 2 or not all(len(row.cells) == len(titles) + 1 for row in rows):
        return False
    firsts = [int(row.cells[0]) if row.cells[0].isdecimal() else -9 for row in rows]
    counted = firsts == list(range(firsts[0], firsts[0] + len(rows))) and firsts[0] in (0, 1)
    return counted and any(row.cells[-1] for row in rows) and any("." in cell for row in rows for cell in row.cells)


def numbers(rows: list[Row], at: int) -> Floats:
    """(rows,) the column `at`, counted from 0; NaN where a cell is missing.

    Raises:
        InputError: as `number`; the message names the row.
    """
    values = np.full(len(rows), np.nan)
    for k, (row, cells) in enumerate(rows):
        try:
            values[k] = number(cells[at]) if at < len(cells) else np.nan
        except InputError as error:
            raise error.within(f"row {row}") from None
    return values


def refuse_wider(rows: list[Row], header: Cells) -> None:
    """Raises InputError ("tabular.width"): a row with more cells than the header has titles."""
    for row, cells in rows:
        if any(cells[len(header) :]):
            why = f"row {row} has {len(cells)} cells, the header {len(header)} (a decimal comma?)"
            raise InputError(why, "tabular.width")

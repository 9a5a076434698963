"""The one reader of tables: text of every dialect or a workbook goes in with a vocabulary, columns in SI come out.

A vocabulary holds the quantities that columns may have, the words that name each, as people write them (`R [um]`,
`Zeit / µs`), and its units. Titles are found below whatever stands above them, with units in them or in the row below.
Everything that is left out or recognised is counted in `notes`; rows of means, sums and the like are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import islice, takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.io.formats import CellTexts, Row, Sheet, is_number, number, plain, plain_title, read_sheets, unit_of

_LONGEST = 120  # characters of a title; more is a sentence, and takes time
# of rows that are no measurements, as `plain_title` writes them
_SUMMARIES = "mean average avg median sum total std sd stdev stddev min max mittel mittelwert summe moyenne media"
_LISTED = 8  # titles in a message
_SPACES_AND_BRACKETS = re.compile(r"[\s\[\]()]+")


class Name(NamedTuple):
    """What a title names. kind: of the vocabulary, "" for none. unit: as the vocabulary has it, as written where it
    stands in brackets and is not known, None where there is none. number: "2" of R2, else ""."""

    kind: str = ""
    unit: str | None = None
    number: str = ""


@dataclass(frozen=True)
class Term:
    """What a column may hold."""

    words: str  # titles that name it, separated by spaces, as `plain_title` writes them
    units: Mapping[str, float] = field(default_factory=dict)  # factor to SI of each; NaN: known, but cannot be used
    unit: str | None = None  # of a title that names none; None where it must name one
    label: str = ""  # its name in messages
    hint: str = ""  # how to write its unit, where it is missing
    twice: str = "keep the one that counts"  # how to mend a table with two columns of it


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """What the columns of a table may hold, by kind. With sections a file holds several tables, each under its own
    titles."""

    terms: Mapping[str, Term]
    expected: str  # in a table, for messages
    need: Sequence[str]  # columns whose titles are a header, "time|frame" for one of two
    codes: Mapping[str, str] = field(default_factory=dict)  # of errors, where they are not "tabular.…"
    fallback: Callable[[str], Name] | None = None  # what a title names that no term does
    sections: bool = False
    bare: bool = False  # whether numbers without titles are a table, too

    def name(self, title: str) -> Name:
        """What a title such as `time_us`, `R [um]`, `Shear Strain (%)` or `omega in rad/s` names."""
        return _name(self, title)

    def name_by_words(self, title: str) -> Name:
        """As `name`, by the words of the vocabulary alone."""
        if len(title) > _LONGEST:
            return Name()
        text, with_foreign_unit = plain(title).strip(), Name()
        for cut in re.finditer(r"\s*[\s_\[(/,.\-]\s*((in|en)\s)?", text):
            kind = self._kinds.get(plain_title(text[: cut.start()]))
            if kind is None:
                continue
            written = text[cut.end() :].rstrip("]), ")
            if unit := unit_of(written, self.terms[kind].units):
                return Name(kind, unit)
            if re.fullmatch(r"\s*[\[(][^\[\]()]+[\])]\s*", text[cut.start() :]):
                with_foreign_unit = Name(kind, written)
        kind = self._kinds.get(plain_title(text))
        return Name(kind) if kind else with_foreign_unit

    def is_header(self, texts: CellTexts) -> bool:
        """Whether a row has the titles of all columns that a table needs; one of numbers is none."""
        kinds = {self.name(cell).kind for cell in texts}
        return not all(map(is_number, texts)) and all(not kinds.isdisjoint(kind.split("|")) for kind in self.need)

    def code(self, mistake: str) -> str:
        return self.codes.get(mistake, f"tabular.{mistake}")

    def term(self, kind: str) -> Term:
        """Of a kind; one without units of what is not known."""
        return self.terms.get(kind, Term(""))

    @cached_property
    def _kinds(self) -> dict[str, str]:
        return {plain_title(word): kind for kind, term in self.terms.items() for word in term.words.split()}


@lru_cache(4096)
def _name(vocabulary: Vocabulary, title: str) -> Name:
    if is_number(title):
        return Name()
    name = vocabulary.name_by_words(title)
    return vocabulary.fallback(title) if vocabulary.fallback and not name.kind else name


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a table; what is in its cells is read when it is asked for."""

    table: Table
    at: int  # its place, from 0
    title: str  # as it is written, with a unit from the row below
    name: Name

    @property
    def unit(self) -> str | None:
        """That the title names, else that of the vocabulary for a title without one; None where it must name one."""
        return self.name.unit if self.name.unit is not None else self._term.unit

    @property
    def text(self) -> list[str]:
        """(rows,) cells; "" where there is none."""
        return [texts[self.at] if self.at < len(texts) else "" for _, texts in self.table.rows]

    @cached_property
    def numbers(self) -> Floats:
        """(rows,) in the unit of the column; NaN where a cell is missing. Raises InputError: a cell is no number."""
        values = np.full(len(self.table.rows), np.nan)
        for k, (row, cell) in enumerate(zip(self.table.rows, self.text, strict=True)):
            try:
                values[k] = number(cell)
            except InputError as error:
                mistake = error.code.removeprefix("tabular.")
                message = f"row {row.number}, column {self.title!r}: {error}"
                raise InputError(message, self.table.vocabulary.code(mistake)) from None
        return values

    @property
    def si(self) -> Floats:
        """(rows,) in SI. Raises InputError as `numbers` and `factor`."""
        return self.numbers * self.factor

    @property
    def factor(self) -> float:
        """From the unit of the column to SI. Raises InputError: the unit is missing or not known."""
        units, unit, vocabulary = self._term.units, self.unit, self.table.vocabulary
        if not units:
            return 1.0
        has_unit = unit is not None and not np.isnan(units.get(unit, 1.0))
        first_units = ", ".join([name for name in units if name.isascii()][:4])
        hint = self._term.hint or f"write it into the title, as in {self.title.split()[0]} ({next(iter(units))})"
        require(has_unit, f"{self.title!r} has no unit: {hint}; {vocabulary.expected}", vocabulary.code("no_unit"))
        unknown = f"{self.title!r} has the unknown unit {unit!r} ({first_units}); {vocabulary.expected}"
        require(unit in units, unknown, vocabulary.code("unit"))
        return units[str(unit)]

    @property
    def assumed(self) -> list[str]:
        """A note where the vocabulary says the unit, and the title none."""
        message = f"{self.title!r} has no unit: taken to be in {self._term.unit}"
        return [message] if self.name.unit is None and self._term.unit else []

    @property
    def _term(self) -> Term:
        return self.table.vocabulary.term(self.name.kind)


@dataclass(frozen=True, eq=False)
class Table:
    """A table below its titles."""

    vocabulary: Vocabulary  # that it is read with
    titles: CellTexts  # as they are written, with units from the row below
    rows: list[Row]  # of data
    notes: list[str]  # what was left out or recognised
    line: int = 1  # number of that of the titles
    sheet: str = ""  # its name in a workbook

    @cached_property
    def columns(self) -> list[Column]:
        """Those that the vocabulary knows."""
        names = map(self.vocabulary.name, self.titles)
        return [Column(self, at, self.titles[at], name) for at, name in enumerate(names) if name.kind]

    def all(self, kind: str) -> list[Column]:
        return [column for column in self.columns if column.name.kind == kind]

    def only(self, kind: str) -> Column | None:
        """The one column of a kind, if there is any. Raises InputError: there are two."""
        return single(self.all(kind))

    def column(self, kind: str) -> Column:
        """The one column of a kind that the table must have. Raises InputError: there are two."""
        column = self.only(kind)
        assert column is not None
        return column

    def part(self, rows: list[Row]) -> Table:
        """The same with these rows alone."""
        return replace(self, rows=rows)


def single(columns: Sequence[Column]) -> Column | None:
    """The one column of one kind, if there is one. Raises InputError: there are two."""
    if len(columns) > 1:
        vocabulary, kind = columns[0].table.vocabulary, columns[0].name.kind
        two = " and ".join(repr(column.title) for column in columns[:2])
        term = vocabulary.term(kind)
        message = f"two columns for {term.label or kind}: {two}; {term.twice}"
        raise InputError(message, vocabulary.code("twice"))
    return columns[0] if columns else None


def read_columns(path: Path, vocabulary: Vocabulary) -> list[Table]:
    """The table of a text file (formats.py) or of a workbook's first sheet; with sections all tables of all sheets.
    There is at least one, and no row has more cells than there are titles.

    Raises:
        InputError: the file cannot be read (`read_sheets`), has no such titles ("columns") or nothing below them
            ("rows", where the vocabulary has that code), a row is wider than the titles ("width"), or a column has two
            units ("units"); with the codes of the vocabulary.
    """
    sheets = read_sheets(path, vocabulary.is_header, most=None if vocabulary.sections else 1)
    tables = [table for sheet in sheets for table in _tables(sheet, vocabulary)]
    rows = [row.texts for sheet in sheets for row in sheet.rows]
    if not tables and vocabulary.bare and rows and all(map(is_number, rows[0])):
        return [Table(vocabulary, [], sheets[0].rows, list(sheets[0].notes), sheet=sheets[0].name)]
    if not tables:
        raise _no_titles(rows, vocabulary)
    filled = "rows" not in vocabulary.codes or any(table.rows for table in tables)
    require(filled, f"a header but no rows of data; {vocabulary.expected}", vocabulary.code("rows"))
    return tables


def _no_titles(rows: list[CellTexts], vocabulary: Vocabulary) -> InputError:
    """That no row is a header: the row that is closest to one, and what it lacks."""
    if not rows:
        return InputError(f"no rows of data; {vocabulary.expected}", vocabulary.code("empty"))
    closest = max(rows, key=lambda row: len({vocabulary.name(cell).kind for cell in row} - {""}))
    kinds = {vocabulary.name(cell).kind for cell in closest}
    titles = ", ".join(repr(title[:30]) for title in closest[:_LISTED])
    missing = [kind for kind in vocabulary.need if kinds.isdisjoint(kind.split("|"))]
    names = " and ".join(vocabulary.term(kind.split("|")[0]).label or kind.split("|")[0] for kind in missing)
    lack = f"no column{'s' * (len(missing) > 1)} for {names} among {titles}"
    return InputError(f"{lack}; {vocabulary.expected}", vocabulary.code("columns"))


def _tables(sheet: Sheet, vocabulary: Vocabulary) -> Iterator[Table]:
    """The tables of a sheet: the first one, or with sections each one. Raises InputError as `read_columns`."""
    headers = (k for k, row in enumerate(sheet.rows) if vocabulary.is_header(row.texts))
    starts = list(headers if vocabulary.sections else islice(headers, 1))
    for at, end in zip(starts, [*starts[1:], None], strict=False):
        rows, notes = sheet.rows[at + 1 : end], list(sheet.notes)
        notes += [f"{at} line{'s' * (at > 1)} above the titles left out"] if at and not vocabulary.sections else []
        titles, below = _with_units(sheet.rows[at].texts, rows, vocabulary)
        rows = rows[len(below) :]
        units = ", ".join(cell for row in below for cell in row.texts if cell)
        notes += [f"units from the row below the titles: {units}"] if units else []
        if vocabulary.sections:
            rows = list(takewhile(lambda row: not _begins_section(row), rows))
        for row in rows:
            message = f"row {row.number} has {len(row.texts)} cells, the header {len(titles)}"
            hint = "is a comma decimal, or part of a text that needs quotes?"
            require(not any(row.texts[len(titles) :]), f"{message}: {hint}", vocabulary.code("width"))
        measured = any(vocabulary.term(vocabulary.name(title).kind).units for title in titles)
        last = rows[-1].texts if rows and measured else []
        if word := next((cell for cell in last if plain_title(cell) in _SUMMARIES.split()), ""):
            message = f"row {rows[-1].number} is a {word} and no measurement: remove it, and others like it"
            raise InputError(message, vocabulary.code("summary"))
        yield Table(vocabulary, titles, rows, notes, sheet.rows[at].number, sheet.name)


def _begins_section(row: Row) -> bool:
    """Whether a row ends a table: "[step]", "Result:", "Frequency sweep - 2"."""
    filled = [cell for cell in row.texts if cell]
    return filled[0].startswith("[") or filled[0].endswith(":") or not any(map(is_number, filled))


def _with_units(titles: CellTexts, rows: list[Row], vocabulary: Vocabulary) -> tuple[CellTexts, list[Row]]:
    """(the titles with the units of the rows of words below them, these rows).

    Raises InputError: a title names one unit and a row below it another, or the two make another title.
    """
    titles, units = list(titles), list(takewhile(lambda row: _are_words(titles, row.texts, vocabulary), rows))
    for _, texts in units:
        for k, (title, cell) in enumerate(zip(titles, texts, strict=False)):
            kind, unit, _ = vocabulary.name(title)
            units_of_kind, bare = vocabulary.term(kind).units, cell.strip("[]() ")
            below = unit_of(bare, units_of_kind)
            if not units_of_kind or (below is None and is_number(bare)):
                continue
            both = f"the column {title!r} has the unit {unit!r} in its title, and {cell!r} in the row below"
            require(unit in (None, below or bare), both, vocabulary.code("units"))
            if not unit:
                titles[k] = f"{title} ({_SPACES_AND_BRACKETS.sub(' ', bare)})"
                no_unit = f"{cell[:30]!r} in the row below the title {title!r} is no unit of it; {vocabulary.expected}"
                require(vocabulary.name(titles[k]).kind == kind, no_unit, vocabulary.code("units"))
    return titles, units


def _are_words(titles: CellTexts, texts: CellTexts, vocabulary: Vocabulary) -> bool:
    """Whether a row has words and units, not numbers, in the columns that have units."""
    units = [vocabulary.term(vocabulary.name(title).kind).units for title in titles]
    measured = [(cell, of_kind) for cell, of_kind in zip(texts, units, strict=False) if of_kind and cell]
    words = [cell for cell, of_kind in measured if unit_of(cell.strip("[]() "), of_kind) is None or not is_number(cell)]
    words = words or (texts if vocabulary.sections else [])
    return not all(map(is_number, words)) and not any(is_number(cell) and re.search(r"\d", cell) for cell in words)

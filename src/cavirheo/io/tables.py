"""The one reader of tables: text of every dialect or a workbook goes in with a vocabulary, columns in SI come out.

Text: tab, semicolon, comma or spaces separate the cells; a quoted cell may hold the separator; where commas do not
separate, they may be decimal. UTF-8, UTF-16 with its mark, else Latin-1. Lines that begin with # or % are comments,
except the titles over columns of numbers (numpy.savetxt writes them so).
Workbooks: .xlsx, .xls, .xlsb, .ods; the visible sheets in the order of their tabs.

What a comma means is decided once for all rows of numbers in a sheet: `1,5` and `0,123` have decimal commas. Where all
may be thousands (`1,234` alone), or numbers with a comma stand beside others with a point, they are refused.

A vocabulary holds the quantities that columns may have, the words that name each, as people write them (`R [um]`,
`Zeit / µs`), and its units. Titles are found below whatever stands above them, with units in them or in the row below.
Everything that is left out or recognised is counted in `notes`; rows of means, sums and the like are refused.
"""

from __future__ import annotations

import csv
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import islice, takewhile
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, from_cell, is_float, require, without_unseen
from cavirheo.io import limits

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_WORDS_OF_UNITS = {
    "s": "sec second seconds sekunde sekunden seconde secondes segundo segundos 秒",
    "ms": "msec millisecond milliseconds millisekunden millisecondes milisegundos ミリ秒 毫秒",
    "us": "usec microsecond microseconds mikrosekunden microsecondes microsegundos マイクロ秒 微秒",
    "ns": "nsec nanosecond nanoseconds nanosekunden nanosecondes nanosegundos ナノ秒 纳秒",
    "m": "meter meters metre metres metros",
    "mm": "millimeter millimeters millimetre millimetres milimetros ミリメートル 毫米",
    "um": "micron microns micrometer micrometers micrometre micrometres mikrometer micrometros マイクロメートル 微米",
    "px": "pixel pixels pix pixeles ピクセル 像素",
}
_UNITS_BY_WORD = {word: unit for unit, words in _WORDS_OF_UNITS.items() for word in words.split()}
_SEPARATORS = ("\t", ";", ",", None)  # None: spaces
_UTF16 = (b"\xff\xfe", b"\xfe\xff")  # its marks
_MISSING = {"nan", "na", "n/a", "null", "none", "#n/a"}
_WITH_COMMA = re.compile(r"[+-]?\d+,\d*(e[+-]?\d+)?", re.I)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_WITH_POINT = re.compile(r"[+-]?(\d+\.\d*|\.\d+)(e[+-]?\d+)?", re.I)
_LONGEST = 120  # characters of a title; more is a sentence, and takes time
# of rows that are no measurements, as `plain_title` writes them
_SUMMARIES = "mean average avg median sum total std sd stdev stddev min max mittel mittelwert summe moyenne media"
_LISTED = 8  # titles in a message


class Row(NamedTuple):
    """One row that is not empty; `number`: of its line in the file or row in the sheet, from 1."""

    number: int
    texts: list[str]


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

    @lru_cache(4096)  # noqa: B019  a vocabulary lives as long as the program
    def name(self, title: str) -> Name:
        """What a title such as `time_us`, `R [um]`, `Shear Strain (%)` or `omega in rad/s` names."""
        if is_number(title):
            return Name()
        name = self.name_by_words(title)
        return self.fallback(title) if self.fallback and not name.kind else name

    def name_by_words(self, title: str) -> Name:
        """As `name`, by the words of the vocabulary alone."""
        if len(title) > _LONGEST:
            return Name()
        text, with_foreign_unit = _plain(title).strip(), Name()
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

    def is_header(self, texts: list[str]) -> bool:
        """Whether a row has the titles of all columns that a table needs; one of numbers is none."""
        return not all(map(is_number, texts)) and not self.missing(texts)

    def missing(self, texts: list[str]) -> list[str]:
        """The columns that a table needs and these titles do not name."""
        kinds = {self.name(cell).kind for cell in texts}
        return [kind for kind in self.need if kinds.isdisjoint(kind.split("|"))]

    def term(self, title: str) -> Term:
        """What a title names; one without units of what is not known."""
        return self.terms.get(self.name(title).kind, Term(""))

    def error(self, mistake: str, message: str) -> InputError:
        """With the code of the vocabulary."""
        return InputError(message, self.codes.get(mistake, f"tabular.{mistake}"))

    @cached_property
    def _kinds(self) -> dict[str, str]:
        return {plain_title(word): kind for kind, term in self.terms.items() for word in term.words.split()}


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a table; what is in its cells is read when it is asked for."""

    table: Table
    at: int  # its place, from 0
    title: str  # as it is written, with a unit from the row below
    name: Name
    term: Term

    @property
    def unit(self) -> str | None:
        """That the title names, else that of the vocabulary for a title without one; None where it must name one."""
        return self.name.unit if self.name.unit is not None else self.term.unit

    @property
    def text(self) -> list[str]:
        """(rows,) cells; "" where there is none."""
        return [texts[self.at] if self.at < len(texts) else "" for _, texts in self.table.rows]

    @cached_property
    def numbers(self) -> Floats:
        """(rows,) in the unit of the column; NaN where a cell is missing. Raises InputError: a cell is no number, or
        one with a comma of unknown meaning."""
        return np.array([self._number(*pair) for pair in zip(self.table.rows, self.text, strict=True)], dtype=float)

    def _number(self, row: Row, cell: str) -> float:
        if is_float(cell):
            return float(cell)
        vocabulary, place = self.table.vocabulary, f"row {row.number}, column {self.title!r}: {cell[:30]!r}"
        if _WITH_COMMA.fullmatch(cell):
            two = f"{cell.replace(',', '.')} or {cell.replace(',', '')}"
            message = f"{place} could be {two}: is the comma decimal? export with decimal points only"
            raise vocabulary.error("comma", message)
        if not is_number(cell):
            message = f"{place} is not a number (none has marks between thousands)"
            raise vocabulary.error("number", f"{message}; leave the cell empty where there is none")
        return np.nan

    @property
    def si(self) -> Floats:
        """(rows,) in SI. Raises InputError as `numbers` and `factor`."""
        return self.numbers * self.factor

    @property
    def factor(self) -> float:
        """From the unit of the column to SI. Raises InputError: the unit is missing or not known."""
        units, unit, vocabulary = self.term.units, self.unit, self.table.vocabulary
        if not units:
            return 1.0
        if unit is None or np.isnan(units.get(unit, 1.0)):
            hint = self.term.hint or f"write it into the title, as in {self.title.split()[0]} ({next(iter(units))})"
            raise vocabulary.error("no_unit", f"{self.title!r} has no unit: {hint}; {vocabulary.expected}")
        if unit not in units:
            first_units = ", ".join([name for name in units if name.isascii()][:4])
            unknown = f"{self.title!r} has the unknown unit {unit!r} ({first_units}); {vocabulary.expected}"
            raise vocabulary.error("unit", unknown)
        return units[unit]

    @property
    def assumed(self) -> list[str]:
        """A note where the vocabulary says the unit, and the title none."""
        message = f"{self.title!r} has no unit: taken to be in {self.term.unit}"
        return [message] if self.name.unit is None and self.term.unit else []


@dataclass(frozen=True, eq=False)
class Table:
    """A table below its titles; or all that is in a text or a sheet, without titles."""

    vocabulary: Vocabulary  # that it is read with
    rows: list[Row]  # of data
    notes: list[str]  # what was left out or recognised
    sheet: str = ""  # its name in a workbook
    titles: list[str] = field(default_factory=list)  # as they are written, with units from the row below
    line: int = 1  # number of that of the titles

    @cached_property
    def columns(self) -> list[Column]:
        """Those that the vocabulary knows."""
        name, term = self.vocabulary.name, self.vocabulary.term
        titles = [(at, title) for at, title in enumerate(self.titles) if name(title).kind]
        return [Column(self, at, title, name(title), term(title)) for at, title in titles]

    def all(self, kind: str) -> list[Column]:
        return [column for column in self.columns if column.name.kind == kind]

    def only(self, kind: str) -> Column | None:
        """The one column of a kind, if there is any. Raises InputError: there are two."""
        return self.single(self.all(kind))

    def single(self, columns: Sequence[Column]) -> Column | None:
        """The one of these columns of one kind, if there is any. Raises InputError: there are two."""
        if len(columns) > 1:
            two, term = " and ".join(repr(column.title) for column in columns[:2]), columns[0].term
            message = f"two columns for {term.label or columns[0].name.kind}: {two}; {term.twice}"
            raise self.vocabulary.error("twice", message)
        return columns[0] if columns else None

    def column(self, kind: str) -> Column:
        """The one column of a kind that the table must have. Raises InputError: there are two."""
        column = self.only(kind)
        assert column is not None
        return column

    def part(self, rows: list[Row]) -> Table:
        """The same with these rows alone."""
        return replace(self, rows=rows)


def read_columns(path: Path, vocabulary: Vocabulary) -> list[Table]:
    """The table of a text file or of a workbook's first sheet; with sections all tables of all sheets. There is at
    least one, and no row has more cells than there are titles.

    Raises:
        InputError: the file is larger than is read (limits.py), damaged, or neither text nor a workbook ("binary"); has
            no such titles ("columns") or nothing below them ("rows", where the vocabulary has that code), a row is
            wider than the titles ("width"), or a column has two units ("units"); with the codes of the vocabulary.
    """
    sheets = _read_sheets(path, vocabulary)
    tables = [table for sheet in sheets for table in _tables(sheet)]
    rows = [row.texts for sheet in sheets for row in sheet.rows]
    if not tables and vocabulary.bare and rows and all(map(is_number, rows[0])):
        return sheets
    if not tables:
        raise _no_titles(rows, vocabulary)
    if "rows" in vocabulary.codes and not any(table.rows for table in tables):
        raise vocabulary.error("rows", f"a header but no rows of data; {vocabulary.expected}")
    return tables


def _no_titles(rows: list[list[str]], vocabulary: Vocabulary) -> InputError:
    """That no row is a header: the row that is closest to one, and what it lacks."""
    if not rows:
        return vocabulary.error("empty", f"no rows of data; {vocabulary.expected}")
    closest = max(rows, key=lambda row: len({vocabulary.name(cell).kind for cell in row} - {""}))
    titles = ", ".join(repr(title[:30]) for title in closest[:_LISTED])
    missing = [kind.split("|")[0] for kind in vocabulary.missing(closest)]
    names = " and ".join(vocabulary.terms[kind].label or kind for kind in missing)
    lack = f"no column{'s' * (len(missing) > 1)} for {names} among {titles}"
    return vocabulary.error("columns", f"{lack}; {vocabulary.expected}")


def _tables(sheet: Table) -> Iterator[Table]:
    """The tables of a sheet: the first one, or with sections each one. Raises InputError as `read_columns`."""
    vocabulary = sheet.vocabulary
    headers = (k for k, row in enumerate(sheet.rows) if vocabulary.is_header(row.texts))
    starts = list(headers if vocabulary.sections else islice(headers, 1))
    for at, end in zip(starts, [*starts[1:], None], strict=False):
        rows, notes = sheet.rows[at + 1 : end], [*sheet.notes]
        notes += [f"{at} line{'s' * (at > 1)} above the titles left out"] if at and not vocabulary.sections else []
        titles, below = _with_units(sheet.rows[at].texts, rows, vocabulary)
        rows = rows[len(below) :]
        units = ", ".join(cell for row in below for cell in row.texts if cell)
        notes += [f"units from the row below the titles: {units}"] if units else []
        if vocabulary.sections:
            rows = list(takewhile(lambda row: not _begins_section(row), rows))
        if wide := next((row for row in rows if any(row.texts[len(titles) :])), None):
            message = f"row {wide.number} has {len(wide.texts)} cells, the header {len(titles)}"
            raise vocabulary.error("width", f"{message}: is a comma decimal, or part of a text that needs quotes?")
        widest = max((len(row.texts) for row in rows), default=len(titles))
        if not sheet.sheet and any(vocabulary.name(title).kind for title in titles[widest:]):
            message = f"row {sheet.rows[at].number} has {len(titles)} titles, the rows below at most {widest} cells: "
            message += "quote a title that holds a comma, or write the empty cells, too"
            raise vocabulary.error("width", message)
        last = rows[-1].texts if rows and any(vocabulary.term(title).units for title in titles) else []
        if word := next((cell for cell in last if plain_title(cell) in _SUMMARIES.split()), ""):
            message = f"row {rows[-1].number} is a {word} and no measurement: remove it, and others like it"
            raise vocabulary.error("summary", message)
        yield Table(vocabulary, rows, notes, sheet.sheet, titles, sheet.rows[at].number)


def _begins_section(row: Row) -> bool:
    """Whether a row ends a table: "[step]", "Result:", "Frequency sweep - 2"."""
    filled = [cell for cell in row.texts if cell]
    return filled[0].startswith("[") or filled[0].endswith(":") or not any(map(is_number, filled))


def _with_units(titles: list[str], rows: list[Row], vocabulary: Vocabulary) -> tuple[list[str], list[Row]]:
    """(the titles with the units of the rows of words below them, these rows). Raises InputError: they contradict."""
    titles, below = list(titles), list(takewhile(lambda row: _are_words(titles, row.texts, vocabulary), rows))
    for _, texts in below:
        for k, (title, cell) in enumerate(zip(titles, texts, strict=False)):
            kind, unit, _ = vocabulary.name(title)
            units, bare = vocabulary.term(title).units, cell.strip("[]() ")
            written = unit_of(bare, units)
            if not units or (written is None and is_number(bare)):
                continue
            if unit not in (None, written or bare):
                both = f"the column {title!r} has the unit {unit!r} in its title, and {cell!r} in the row below"
                raise vocabulary.error("units", both)
            if not unit:
                words = re.sub(r"[\s\[\]()]+", " ", bare)
                titles[k] = f"{title} ({words})"
                if vocabulary.name(titles[k]).kind != kind:
                    no_unit = f"{cell[:30]!r} in the row below the title {title!r} is no unit of it"
                    raise vocabulary.error("units", f"{no_unit}; {vocabulary.expected}")
    return titles, below


def _are_words(titles: list[str], texts: list[str], vocabulary: Vocabulary) -> bool:
    """Whether a row has words and units, not numbers, in the columns that have units."""
    measured = [(cell, vocabulary.term(title).units) for title, cell in zip(titles, texts, strict=False) if cell]
    measured = [(cell, units) for cell, units in measured if units]
    words = [cell for cell, units in measured if unit_of(cell.strip("[]() "), units) is None or not is_number(cell)]
    words = words or (texts if vocabulary.sections else [])
    return not all(map(is_number, words)) and not any(is_number(cell) and re.search(r"\d", cell) for cell in words)


def _read_sheets(path: Path, vocabulary: Vocabulary) -> list[Table]:
    """The table of a text file, or the sheets of a workbook, the first alone where there are no sections."""
    with path.open("rb") as file:
        kind = kind_of(file.read(1024))
    require(kind != "binary", "neither text nor a workbook", "tabular.binary")
    if kind == "text":
        limits.few(path.stat().st_size, limits.TEXT, "bytes of text")
        content = path.read_bytes()
        limits.few(content.count(b"\n") + 1, limits.ROWS, "lines")
        sheets = [_text_table(_decoded(content), vocabulary)]
    else:
        from cavirheo.io.workbook import read_workbook

        books = read_workbook(path, None if vocabulary.sections else 1)
        sheets = [Table(vocabulary, [Row(*row) for row in rows], [], name) for name, rows in books]
    for sheet in sheets:
        limits.few(max((len(row.texts) for row in sheet.rows), default=0), limits.COLUMNS, "columns")
        _replace_signs(sheet)
    return sheets


def kind_of(head: bytes) -> Literal["text", "workbook", "binary"]:
    """What a file is that begins with these bytes."""
    if head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")):
        return "workbook"
    return "text" if head.startswith(_UTF16) or b"\x00" not in head else "binary"


def _decoded(content: bytes) -> str:
    """UTF-16, UTF-8 or Latin-1, without its mark."""
    for encoding in ["utf-16"] if content.startswith(_UTF16) else ["utf-8-sig", "latin-1"]:
        with suppress(UnicodeDecodeError):
            return content.decode(encoding)
    raise InputError("begins as UTF-16 text and does not go on so", "tabular.encoding")


def _text_table(text: str, vocabulary: Vocabulary) -> Table:
    """The rows of a text, by the first separator with which one is a header, else that all of the first twenty lines
    hold. A comment is a row (without its mark) if it is a header over rows that are none."""
    text, invisible = without_unseen(text)
    lines = text.splitlines()
    limits.few(len(lines), limits.ROWS, "lines")
    limits.few(max(map(len, lines), default=0), limits.LINE, "characters in one line")
    data = ["" if line.lstrip().startswith(("#", "%")) else line for line in lines]
    rows = _rows_with_header(data, vocabulary)
    if rows is None and data != lines:
        rows = _rows_with_header([line.lstrip("#% ") for line in lines], vocabulary)
    if rows is None:
        sample = [line for line in data if line.strip()][:20]
        separator = next(s for s in _SEPARATORS if s is None or all(s in line for line in sample))
        rows = list(_split(data, separator))
    return Table(vocabulary, rows, [f"{invisible} control characters left out"] if invisible else [])


def _rows_with_header(lines: list[str], vocabulary: Vocabulary) -> list[Row] | None:
    """The rows by the first separator that makes a header of one of them, over rows as wide; None where none does."""
    with_words = [line for line in lines if re.search(r"[^\W\d]", line)]
    unclear = False
    for separator in _SEPARATORS:
        candidates = with_words if separator is None or any(separator in line for line in lines) else []
        if not any(vocabulary.is_header(row.texts) for row in _split(candidates, separator)):
            continue
        rows = list(_split(lines, separator))
        at = next(k for k, row in enumerate(rows) if vocabulary.is_header(row.texts))
        titles, below = rows[at].texts, rows[at + 1 : at + 2]
        if len(titles) == 1:  # nothing separates columns
            return [*rows[: at + 1], *(Row(row.number, [" ".join(row.texts)]) for row in rows[at + 1 :])]
        if not below or len(below[0].texts) >= (len(titles) if separator is None else 2):
            return rows
        unclear = separator is None
    message = "titles with spaces in them over columns separated by spaces; separate the columns by commas"
    require(not unclear, message, "tabular.width")
    return None


def _split(lines: list[str], separator: str | None) -> Iterator[Row]:
    if separator is None:
        lines = [re.sub(r"\s+", " ", line).strip() for line in lines]
        lines = [re.sub(r" (?=[\[(][^\s\[\]()]+[\])]( |$))", "_", line) for line in lines]  # "R (um)" is one title
    reader = csv.reader(lines, delimiter=separator or " ", skipinitialspace=True)
    total = 0
    try:
        for texts in reader:
            total += len(texts)
            limits.few(total, limits.SAMPLES, "cells")
            if any(texts := [from_cell(cell.strip()) for cell in texts]):
                yield Row(reader.line_num, texts)
    except csv.Error as error:
        raise InputError(f"line {reader.line_num}: {error}", "tabular.csv") from None


def _replace_signs(sheet: Table) -> None:
    """Give the numbers of a sheet decimal points and plain minus signs."""
    rows = [row.texts for row in sheet.rows]
    for texts in rows:
        texts[:] = [cell.replace("−", "-") if re.match(r"−\d", cell) else cell for cell in texts]
    data = [texts for texts in rows if all(map(is_number, texts))] or rows  # what stands above a table says nothing
    values = {cell for texts in data for cell in texts}
    commas = filter(_WITH_COMMA.fullmatch, values)
    # commas are decimal where no number has a point, and one of them is none between thousands
    if not any(map(_WITH_POINT.fullmatch, values)) and not all(map(_THOUSANDS.fullmatch, commas)):
        count = sum(bool(_WITH_COMMA.fullmatch(cell)) for texts in rows for cell in texts)
        sheet.notes.append(f"{count} decimal commas")
        for texts in rows:
            texts[:] = [cell.replace(",", ".") if _WITH_COMMA.fullmatch(cell) else cell for cell in texts]


def is_number(cell: str) -> bool:
    """A number, or what stands for a missing one: nothing, a word such as nan, signs such as ---."""
    missing = cell.strip().lower() in _MISSING or not re.search(r"\w", cell)
    return missing or is_float(cell) or bool(_WITH_COMMA.fullmatch(cell))


def _plain(text: str) -> str:
    """Without accents; every prime is ', every double one ''; the micro sign is the letter mu."""
    text = unicodedata.normalize("NFKD", text)
    text = "".join(c for c in text if not unicodedata.combining(c)).replace("−", "-")
    return re.sub("[′’‘´`]", "'", re.sub('["”“″]', "''", text))


def plain_title(text: str) -> str:
    """Small letters, digits and primes; no spaces, brackets or points."""
    return re.sub(r"[\s_\-.,:;=/^()\[\]{}]+", "", _plain(text).lower())


def unit_of(written: str, units: Mapping[str, float]) -> str | None:
    """The one of these units that is written so; None for another. `rad/s` is rads, `s^-1` s-1, `µm` um; capitals
    stay: mPa is not MPa."""
    unit = re.sub(r"[\s/·⋅.*^_()\[\]{}]+", "", _plain(written).replace("μ", "u"))
    spellings = (unit, unit.lower(), _UNITS_BY_WORD.get(unit), _UNITS_BY_WORD.get(unit.lower()))
    return next((spelling for spelling in spellings if spelling in units), None)

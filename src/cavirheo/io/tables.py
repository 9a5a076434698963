"""Read tables: a text of any dialect or a workbook becomes columns in SI, named by a vocabulary of quantities.

Layouts: docs/how-to/your-shots.md. Lines that begin with # or % are comments, except the titles above columns of
numbers (as numpy.savetxt writes them). Commas that do not separate cells may be decimal; the meaning of points and
commas is decided once for all rows of numbers in a sheet, and numbers with commas are refused if the sheet can be read
in both ways (`1,234` alone), or in none. The `notes` count what is left out or recognised.
"""

from __future__ import annotations

import csv
import json
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import chain, islice, pairwise, takewhile
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, is_float, without_invisible
from cavirheo.io import apart, files
from cavirheo.io.files import Source, check_limit
from cavirheo.parameters import plain_text, unit_of
from cavirheo.writing.digits import counted

_SEPARATORS = ("\t", ";", ",", None)  # None: spaces
# no number: the words of programs, "#DIV/0!" of spreadsheets in any language, "1.#QNAN" of compilers, signs such as ---
_MISSING = re.compile(r"-?nan|n\.?/?a\.?|null|none|#[a-zäöü]+(/[0a])?[!?]?|-?1\.#\w+|\W*", re.I)
_POINTED = re.compile(r"[+-]?(\d+|[1-9]\d{0,2}(,\d{3})+)?(\.\d*)?(?<=\d|\.)(e[+-]?\d+)?", re.I)  # 1,000.92
_COMMAED = re.compile(r"[+-]?(\d+|[1-9]\d{0,2}(\.\d{3})+)?(,\d*)?(?<=\d|,)(e[+-]?\d+)?", re.I)  # 1.000,92
_FORTRAN = re.compile(r"([+-]?\d*\.?\d+|[+-]?\d+\.)d([+-]?\d+)", re.I)  # 1.0D-04
_BEGINS_AS_NUMBER = re.compile(r"""\s*["']?[+−-]?[.,]?\d""")
_COMMENT = re.compile(r"\s*(%|//|!|#(?!div/0|n/a|nv\b|[a-z]+[!?]))", re.I)
_WORKBOOK = {"[Content_Types].xml", "mimetype", "content.xml", "xl/workbook.xml"}  # a zipped workbook has one of them
_LONGEST_TITLE = 120  # characters of a title; a longer text is a sentence, and slow to match
_LISTED = 8  # most titles in a message


class Row(NamedTuple):
    """One row that is not empty. number: of its line in the file, or of its row in the sheet, from 1."""

    number: int
    texts: list[str]


class Name(NamedTuple):
    """What a title names. kind: a key of the vocabulary's terms, or "". unit: as the vocabulary spells it, as written
    if it is unknown and in brackets, None if there is none. number: "2" for R2, else ""."""

    kind: str = ""
    unit: str | None = None
    number: str = ""


@dataclass(frozen=True)
class Term:
    """A quantity that a column may hold."""

    words: str  # its titles, separated by spaces, in the form of `plain_title`
    units: Mapping[str, float] = field(default_factory=dict)  # factor of each to SI; NaN: known, but not usable
    unit: str | None = None  # the unit of a title without one; None: the title must name a unit
    label: str = ""  # its name in messages
    hint: str = ""  # how to write a missing unit


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """The quantities that the columns of a table may hold, by kind. With `sections` a file holds several tables, each
    below its own titles."""

    terms: Mapping[str, Term]
    expected: str  # what a table should contain, for messages
    required: Sequence[str]  # kinds of column that a header must name, "time|frame" for one of two
    codes: Mapping[str, str] = field(default_factory=dict)  # error code by mistake, if not "tabular.<mistake>"
    fallback: Callable[[str], Name] | None = None  # interprets a title that no term names
    sections: bool = False
    of_shots: bool = False  # numbers without titles are a table, too; so is every sheet with the titles of the first

    @lru_cache(4096)  # noqa: B019  a vocabulary lives as long as the program
    def name(self, title: str) -> Name:
        """Return what a title such as `time_us`, `R [um]`, `Shear Strain (%)` or `omega in rad/s` names."""
        if is_number(title):
            return Name()
        name = self.name_by_words(title)
        return self.fallback(title) if self.fallback and not name.kind else name

    def name_by_words(self, title: str) -> Name:
        """Do what `name` does, but only by the words of the vocabulary, without `fallback`."""
        if len(title) > _LONGEST_TITLE:
            return Name()
        text, with_foreign_unit = plain_text(title).strip(), Name()
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
        """Whether a row has the titles of all columns that a table needs, and not only numbers."""
        enough = len(texts) >= len(self.required) and not all(map(is_number, texts))
        return enough and not self.missing(texts)

    def missing(self, texts: list[str]) -> list[str]:
        """Return the columns that a table needs but these titles do not name."""
        kinds = {self.name(cell).kind for cell in texts}
        return [kind for kind in self.required if kinds.isdisjoint(kind.split("|"))]

    def term(self, title: str) -> Term:
        """Return the term that a title names, or an empty term without units."""
        return self.terms.get(self.name(title).kind, Term(""))

    def error(self, mistake: str, message: str) -> InputError:
        """Return an InputError with the code that the vocabulary has for this mistake."""
        return InputError(message, self.codes.get(mistake, f"tabular.{mistake}"))

    @cached_property
    def _kinds(self) -> dict[str, str]:
        return {plain_title(word): kind for kind, term in self.terms.items() for word in term.words.split()}


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a table; its cells are interpreted only when they are used."""

    table: Table
    index: int  # its index, from 0
    title: str  # as it is written, with the unit from the row below, if any; the path of an array
    name: Name
    array: np.ndarray | str | None = None  # its numbers, if they are no cells of rows; or what it is instead

    @property
    def term(self) -> Term:
        """What it holds; an empty term if the vocabulary does not know it."""
        return self.table.vocabulary.terms.get(self.name.kind, Term(""))

    @property
    def unit(self) -> str | None:
        """The unit in the title, else the default unit of the term; None if there is neither."""
        return self.name.unit if self.name.unit is not None else self.term.unit

    @property
    def text(self) -> list[str]:
        """(rows,) cells; "" for a missing one."""
        if self.array is not None:
            return list(map(str, self.numbers.tolist()))
        return [texts[self.index] if self.index < len(texts) else "" for _, texts in self.table.rows]

    @cached_property
    def numbers(self) -> Floats:
        """(rows,) numbers in the unit of the column; NaN for a missing one. Raises InputError: a cell is no number, or
        has a comma of unknown meaning; or what is no array of numbers, or an empty one."""
        if isinstance(self.array, str):
            raise InputError(f"{self.title} is {self.array}", "matlab.variables")
        if self.array is not None:
            if not self.array.size:
                raise InputError(f"{self.title} is empty", "matlab.cells")
            return self.array.ravel(order="F").astype(np.float64)
        return np.array([self._number(*pair) for pair in zip(self.table.rows, self.text, strict=True)], dtype=float)

    def _number(self, row: Row, cell: str) -> float:
        if is_float(cell):
            return float(cell)
        if _MISSING.fullmatch(cell):
            return np.nan
        vocabulary = self.table.vocabulary
        place = f"row {row.number}, column {self.title!r}: {cell[:30]!r}"
        if is_number(cell):
            two = f"{cell.replace('.', '').replace(',', '.')} or {cell.replace(',', '')}"
            message = f"{place} could be {two}: is the comma decimal? export with decimal points only"
            raise vocabulary.error("comma", message)
        advice = "expected a plain number; leave the cell empty where there is none, or remove the row"
        raise vocabulary.error("number", f"{place} is not a number: {advice}")

    @property
    def si(self) -> Floats:
        """(rows,) numbers in SI. Raises InputError as `numbers` and `factor`."""
        return self.numbers * self.factor

    @property
    def factor(self) -> float:
        """Factor from the unit of the column to SI. Raises InputError: the unit is missing, unusable or unknown."""
        vocabulary = self.table.vocabulary
        units = self.term.units
        unit = self.unit
        if not units:
            return 1.0
        if unit is None or np.isnan(units.get(unit, 1.0)):
            hint = self.term.hint or f"write it into the title, as in {self.title.split()[0]} ({next(iter(units))})"
            raise vocabulary.error("no_unit", f"{self.title!r} has no unit: {hint}; {vocabulary.expected}")
        if unit not in units:
            known = ", ".join([name for name in units if name.isascii()][:4])
            message = f"{self.title!r} has the unknown unit {unit!r} ({known}); {vocabulary.expected}"
            raise vocabulary.error("unit", message)
        return units[unit]


@dataclass(frozen=True, eq=False)
class Table:
    """A table below its titles; all rows of a text or a sheet, without titles; or arrays with names."""

    vocabulary: Vocabulary  # used to read it
    rows: list[Row]  # of data
    notes: list[str]  # what was left out or recognised
    name: str = ""  # of its sheet in a workbook, or of the group of the arrays
    titles: list[str] = field(default_factory=list)  # as they are written, with units from the row below
    line: int = 1  # number of the line with the titles
    arrays: Sequence[tuple[Name, np.ndarray | str]] = ()  # of each title; then `rows` is empty
    remarks: Sequence[str] = ()  # comments, and lines above the titles
    hints: list[str] = field(default_factory=list)  # notes that an answer shows, too

    @cached_property
    def columns(self) -> list[Column]:
        """The columns whose titles the vocabulary knows."""
        if self.arrays:
            columns = [Column(self, k, self.titles[k], *array) for k, array in enumerate(self.arrays)]
        else:
            columns = [Column(self, k, title, self.vocabulary.name(title)) for k, title in enumerate(self.titles)]
        return [column for column in columns if column.name.kind]

    def all(self, kind: str) -> list[Column]:
        return [column for column in self.columns if column.name.kind == kind]

    def find(self, kind: str) -> Column | None:
        """Return the only column of a kind, or None. Raises InputError: there are several."""
        return self.at_most_one(self.all(kind))

    def at_most_one(self, columns: Sequence[Column]) -> Column | None:
        """Return the only one of these columns of one kind, or None. Raises InputError: there are several."""
        if len(columns) > 1:
            two, term = " and ".join(repr(column.title) for column in columns[:2]), columns[0].term
            message = f"two columns for {term.label or columns[0].name.kind}: {two}; keep the one that counts"
            raise self.vocabulary.error("twice", message)
        return columns[0] if columns else None

    def column(self, kind: str) -> Column:
        """Return the only column of a kind that the vocabulary requires. Raises InputError: there are several."""
        column = self.find(kind)
        assert column is not None
        return column


def read_columns(source: Source, vocabulary: Vocabulary) -> list[Table]:
    """Read the table of a text file, or of the first sheet with one in a workbook; with `sections`, all tables of all
    sheets. There is at least one table, and in a table with titles no row has more cells than titles.

    Raises InputError: the file exceeds a limit (files.py), is damaged, or is neither text nor a workbook. Or, with the
    codes of the vocabulary: no rows ("empty"), no header ("columns"), nothing below it ("rows"), cells without titles
    or the reverse ("width"), two units ("units")."""
    sheets = _read_sheets(source, vocabulary)
    tables = [table for sheet in sheets for table in _tables(sheet)]
    if not tables and vocabulary.of_shots:
        tables = [sheet for sheet in sheets if sheet.rows and all(map(is_number, sheet.rows[0].texts))]
    if tables and not vocabulary.sections:
        first = tables[0]
        others = ", ".join(repr(table.name) for table in tables if table.titles != first.titles)
        first.hints.extend([f"sheets not read, with other titles than {first.name!r}: {others}"] if others else [])
        tables = [table for table in tables if vocabulary.of_shots and table.titles == first.titles] or tables[:1]
        _note_sheets(tables, sheets)
    if not tables:
        raise _no_titles(sheets, vocabulary, source)
    if not any(table.rows for table in tables):
        message = f"a header in row {tables[0].line} but no rows of numbers below it; {vocabulary.expected}"
        raise vocabulary.error("rows", message)
    return tables


def _note_sheets(tables: list[Table], sheets: list[Table]) -> None:
    """Add a note to the tables of a workbook: which sheets are read, and which are not."""
    read = [table.name for table in tables]
    left = ", ".join(repr(sheet.name) for sheet in sheets if sheet.name not in read)
    if any(sheet.name for sheet in sheets):
        for table in tables:
            note = f"read from the workbook: {', '.join(map(repr, read))}"
            table.notes.insert(0, note + (f"; not read: {left}" if left else ""))


def _no_titles(sheets: list[Table], vocabulary: Vocabulary, source: Source) -> InputError:
    """Return the error that no row is a header, with the closest row of as many words as there are numbers below it, if
    there is one, and what is missing in it."""
    rows = [row.texts for sheet in sheets for row in sheet.rows]
    if not rows:
        return vocabulary.error("empty", f"no rows of data; {vocabulary.expected}")
    if re.match(rb'\s*[\[{]\s*["\[{]', source.head):
        return vocabulary.error("columns", f"JSON is not read: save a CSV; {vocabulary.expected}")
    width = max((len(row) for row in rows if all(map(is_number, row))), default=0)
    above = takewhile(lambda row: len(row) < width or not all(map(is_number, row)), rows)
    words = [row for row in above if len(row) >= width > 0 and not any(map(is_number, row))]
    closest = max(words[::-1] or rows, key=lambda row: len({vocabulary.name(cell).kind for cell in row} - {""}))
    titles = ", ".join(repr(title[:30]) for title in closest[:_LISTED])
    missing = [kind.split("|")[0] for kind in vocabulary.missing(closest)]
    names = " and ".join(vocabulary.terms[kind].label or kind for kind in missing)
    hidden = "".join(f"; not read: {sheet.name}" for sheet in sheets if not sheet.rows)
    as_latin_1 = source.kind == "text" and _decoded(source.content).encode("latin-1", "replace") == source.content
    if as_latin_1 and not titles.replace("µ", "u").isascii():
        hidden = "; the text is not UTF-8: save it as CSV UTF-8"
    return vocabulary.error("columns", f"no column for {names} among {titles}{hidden}; {vocabulary.expected}")


def _tables(sheet: Table) -> Iterator[Table]:
    """Yield the first table of a sheet, or with `sections` every table. Raises InputError as `read_columns`."""
    vocabulary = sheet.vocabulary
    headers = (k for k, row in enumerate(sheet.rows) if vocabulary.is_header(row.texts))
    starts = list(headers if vocabulary.sections else islice(headers, 1))
    for at, end in pairwise([*starts, len(sheet.rows)]):
        rows, notes = sheet.rows[at + 1 : end], [*sheet.notes]
        if at and not vocabulary.sections:
            words = ", ".join(next(filter(None, row.texts)) for row in sheet.rows[:at][:_LISTED])[:80]
            notes.append(f"{counted(at, 'line')} above the titles, of which only constants are used: {words}")
        titles, below = _titles_with_units(sheet.rows[at].texts, rows, vocabulary)
        words = ", ".join(cell for row in below for cell in row.texts if cell)
        notes += [f"row of words below the titles: {words}"] if words else []
        heads = [sheet.rows[at].texts, *(row.texts for row in below)]
        rows = [row for row in rows if row.texts not in heads]  # titles may stand above each shot
        if vocabulary.sections:
            rows = list(takewhile(lambda row: not _begins_section(row), rows))
        if wide := next((row for row in rows if any(row.texts[len(titles) :])), None):
            message = f"row {wide.number} has {len(wide.texts)} cells, the header {len(titles)}"
            raise vocabulary.error("width", f"{message}: is a comma decimal, or part of a text that needs quotes?")
        remarks = [*sheet.remarks, *(" ".join(row.texts) for row in sheet.rows[:at])]
        yield Table(vocabulary, rows, notes, sheet.name, titles, sheet.rows[at].number, remarks=remarks)


def _begins_section(row: Row) -> bool:
    """Whether a row begins another section, such as "[step]", "Result:" or "Frequency sweep - 2"."""
    filled = [cell for cell in row.texts if cell]
    return filled[0].startswith("[") or filled[0].endswith(":") or not any(map(is_number, filled))


def _titles_with_units(titles: list[str], rows: list[Row], vocabulary: Vocabulary) -> tuple[list[str], list[Row]]:
    """Return (titles with the units of the rows without numbers below them, these rows). Raises InputError: the units
    contradict."""
    titles = list(titles)
    below = list(takewhile(lambda row: not any(map(_has_digits, row.texts)), rows))
    cells = chain(*(row.texts for row in below))
    if all(map(is_number, cells)) or not any(vocabulary.term(title).units for title in titles):
        return titles, []
    for _, texts in below:
        for k, (title, cell) in enumerate(zip(titles, texts, strict=False)):
            unit = unit_beside(vocabulary, title, cell, "in the row below")
            titles[k] = f"{title} ({unit})" if unit and vocabulary.name(title).unit is None else title
    return titles, below


def unit_beside(vocabulary: Vocabulary, title: str, text: str, place: str) -> str | None:
    """Return the unit that a text at a place beside a title names, if any. Raises InputError: the title has another."""
    unit = unit_of(text.strip("[]() "), vocabulary.term(title).units)
    if unit and vocabulary.name(title).unit not in (None, unit):
        raise vocabulary.error("units", f"the column {title!r} has a unit in its title, and {text!r} {place}: mend one")
    return unit


def _read_sheets(source: Source, vocabulary: Vocabulary) -> list[Table]:
    if source.kind in ("text", "empty"):
        check_limit(source.size, files.LARGEST_TEXT, "bytes of text")
        check_limit(source.content.count(b"\n") + 1, files.MOST_ROWS, "lines")
        sheets = [_text_table(_decoded(source.content), vocabulary)]
    elif source.kind == "workbook":
        book = json.loads(apart.call(_sheets_of_workbook, str(source.path.absolute())))
        sheets = [Table(vocabulary, [Row(*row) for row in rows], [], name) for name, rows in book]
    else:
        raise InputError(f"neither text nor a workbook; {vocabulary.expected}", "tabular.binary")
    for sheet in sheets:
        check_limit(max((len(row.texts) for row in sheet.rows), default=0), files.MOST_COLUMNS, "columns")
        _replace_signs(sheet)
    return sheets


def _sheets_of_workbook(path: str) -> str:
    """Return, as JSON, the name and the numbered rows of each sheet of cells, in the order of their tabs, without empty
    rows; a hidden sheet has no rows and is named as hidden, unless all are. By calamine, in a process of its own
    (`apart.call`), since a workbook of a few kilobytes may unpack to gigabytes, or crash its reader.

    Raises InputError: another archive ("tabular.archive"), or too much ("limits.cells", "limits.characters").
    """
    from python_calamine import CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

    with suppress(zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        if _WORKBOOK.isdisjoint(names):
            advice = "unpack it, and give the files or the folder that holds them"
            held = f"{len(names)} files, {ascii(', '.join(names[:3])[:100])[1:-1]}"
            raise InputError(f"a zip archive of {held}; no workbook: {advice}", "tabular.archive")
    book = CalamineWorkbook.from_path(path)
    tabs = [tab for tab in book.sheets_metadata if tab.typ == SheetTypeEnum.WorkSheet]
    if not tabs:
        raise InputError("a workbook without a sheet of cells", "tabular.workbook")
    visible = [tab.name for tab in tabs if tab.visible == SheetVisibleEnum.Visible] or [tab.name for tab in tabs]
    sheets: list[tuple[str, list[tuple[int, list[str]]]]] = []
    cells = 0
    for tab in tabs:
        if tab.name not in visible:
            sheets.append((_text(f"{tab.name} (hidden)"), []))
            continue
        sheet = book.get_sheet_by_name(tab.name)
        cells += sheet.height * sheet.width
        if cells > files.MOST_CELLS:
            more = f"the workbook has {cells} cells: more than {files.MOST_CELLS} are not read"
            raise InputError(f"{more}; save the table alone as CSV", "limits.cells")
        first = (sheet.start or (0, 0))[0] + 1
        rows = [(number, list(map(_text, row))) for number, row in enumerate(sheet.iter_rows(), first)]
        sheets.append((_text(tab.name), [(number, texts) for number, texts in rows if any(texts)]))
    text = json.dumps(sheets)
    check_limit(len(text), files.LARGEST_TEXT, "characters in all cells")
    return text


def _text(cell: object) -> str:
    whole = isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15
    text = str(int(cell) if whole else cell)  # type: ignore[call-overload]
    return without_invisible(text)[0].strip()


def _decoded(content: bytes) -> str:
    """Decode UTF-16, UTF-8 or Latin-1, without the byte order mark. Raises InputError: damaged UTF-16."""
    for encoding in ("utf-16",) if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "latin-1"):
        with suppress(UnicodeDecodeError):
            return content.decode(encoding)
    raise InputError("begins as UTF-16 text and does not go on so", "tabular.encoding")


def _text_table(text: str, vocabulary: Vocabulary) -> Table:
    """Split a text into rows by the first separator that makes one row a header, else by the first one that all of the
    first twenty lines of numbers (or lines, without any) contain. Comments above the numbers are rows (without # or %)
    only if no other line is a header."""
    text, invisible = without_invisible(text)
    lines = text.splitlines()
    check_limit(len(lines), files.MOST_ROWS, "lines")
    check_limit(max(map(len, lines), default=0), files.LONGEST_LINE, "characters in one line")
    data = ["" if _COMMENT.match(line) else line for line in lines]
    rows = _rows_with_header(data, vocabulary)
    if rows is None:
        above = next((k for k, line in enumerate(data) if _BEGINS_AS_NUMBER.match(line)), len(data))
        with_titles = [line.lstrip("#%/! ") for line in lines[:above]] + data[above:]
        if rows := _rows_with_header(with_titles, vocabulary):
            data = with_titles
    if rows is None:
        sample = list(filter(_BEGINS_AS_NUMBER.match, data)) or list(filter(str.strip, data))
        separator = next(s for s in _SEPARATORS if s is None or all(s in line for line in sample[:20]))
        rows = list(_split(data, separator))
    notes = [f"{invisible} control characters left out"] if invisible else []
    if comments := [line.strip() for line, used in zip(lines, data, strict=True) if line.strip() and not used]:
        use = "only constants are used" if vocabulary.of_shots else "left out"
        notes.append(f"{counted(len(comments), 'comment')}, such as {comments[0][:40]!r}: {use}")
    return Table(vocabulary, rows, notes, remarks=comments)


def _rows_with_header(lines: list[str], vocabulary: Vocabulary) -> list[Row] | None:
    """Return the rows by the first separator that makes one a header above a row of as many numbers, else one above no
    numbers; None if no separator does."""
    with_words = [line for line in lines if re.search(r"[^\W\d]", line)]
    without_numbers = None
    for separator in _SEPARATORS:
        candidates = [line for line in with_words if separator is None or separator in line]
        if separator is None:  # what tabs or commas separate, as the rows below, are no titles between spaces
            marks = [mark for mark in "\t;," if mark in next(filter(str.strip, reversed(lines)), "")]
            candidates = [line for line in candidates if not any(mark in line for mark in marks)]
        if not any(vocabulary.is_header(row.texts) for row in _split(candidates, separator)):
            continue
        rows = list(_split(lines, separator))
        at = next(k for k, row in enumerate(rows) if vocabulary.is_header(row.texts))
        titles = rows[at].texts
        if len(titles) == 1:  # a single column, without separators
            return [*rows[: at + 1], *(Row(row.number, [" ".join(row.texts)]) for row in rows[at + 1 :])]
        below = next((row.texts for row in rows[at + 1 :] if any(map(_has_digits, row.texts))), None)
        if below is None:
            without_numbers = without_numbers or rows
        elif len(below) >= (len(titles) if separator is None else 2):
            return rows
    return without_numbers


def _has_digits(cell: str) -> bool:
    """Whether a cell is a number that is not missing."""
    return is_number(cell) and re.search(r"\d", cell) is not None


def _split(lines: list[str], separator: str | None) -> Iterator[Row]:
    if separator is None:
        lines = [re.sub(r"\s+", " ", line).strip() for line in lines]
        lines = [re.sub(r" (?=[\[(][^\s\[\]()]+[\])]( |$))", "_", line) for line in lines]  # "R (um)" is one title
    reader = csv.reader(lines, delimiter=separator or " ", skipinitialspace=True)
    total = 0
    try:
        for texts in reader:
            total += len(texts)
            check_limit(total, files.MOST_NUMBERS, "cells")
            if any(texts := [cell.strip() for cell in texts]):
                yield Row(reader.line_num, texts)
    except csv.Error as error:
        raise InputError(f"line {reader.line_num}: {error}", "tabular.csv") from None


def _replace_signs(sheet: Table) -> None:
    """Write the numbers of a sheet with decimal points, plain minus signs, and no marks between thousands."""
    rows = [row.texts for row in sheet.rows]
    for texts in rows:
        texts[:] = map(_plain_number, texts)
    if not any("," in cell for texts in rows for cell in texts):
        return
    data = [texts for texts in rows if all(map(is_number, texts))] or rows  # lines above a table do not count
    marked = {cell for texts in data for cell in texts if re.search(r"\d", cell) and re.search("[.,]", cell)}
    with_points, with_commas = (set(filter(form.fullmatch, marked)) for form in (_POINTED, _COMMAED))
    if with_points == with_commas or (with_points - with_commas and with_commas - with_points):
        return  # every number can be read in two ways, or each way is that of a number
    form, thousands = (_POINTED, ",") if with_points - with_commas else (_COMMAED, ".")
    numbers = [cell for texts in rows for cell in texts if form.fullmatch(cell)]
    for texts in rows:
        texts[:] = [cell.replace(thousands, "").replace(",", ".") if form.fullmatch(cell) else cell for cell in texts]
    if form is _COMMAED and any("," in cell for cell in numbers):
        sheet.notes.append("decimal commas")
    if any(thousands in cell for cell in numbers):
        sheet.notes.append("marks between thousands left out")


def _plain_number(cell: str) -> str:
    """Return a number with a plain minus sign and an exponent as in 1e-4; any other cell as it is."""
    if is_float(cell):
        return cell
    plain = re.sub(r"^−(?=[\d.])|(?<=[eEdD])−", "-", cell)
    return _FORTRAN.sub(r"\1e\2", plain) if _FORTRAN.fullmatch(plain) else plain


def is_number(cell: str) -> bool:
    """Whether a cell is a number or marks a missing one: it is empty, a word such as nan, or signs such as ---."""
    return is_float(cell) or bool(_MISSING.fullmatch(cell) or _POINTED.fullmatch(cell) or _COMMAED.fullmatch(cell))


def plain_title(text: str) -> str:
    """Return a title in lower case, without accents, spaces, brackets and most punctuation, and with u for µ."""
    return re.sub(r"[\s_\-.,:;=/^()\[\]{}]+", "", plain_text(text).lower().replace("μ", "u"))

"""Any table that a file holds -> rows of cells: text of every dialect, and the sheets of a workbook.

Text: tab, semicolon, comma or spaces separate the cells; a quoted cell may hold the separator; where commas do not
separate, they may be decimal. UTF-8, UTF-16 with its mark, else Latin-1. Lines that begin with # or % are comments,
except the titles over columns of numbers (numpy.savetxt writes them so).
Workbooks: .xlsx, .xls, .xlsb, .ods; the visible sheets in the order of their tabs.

What a comma means is decided once for all rows of numbers in a sheet: `1,5` and `0,123` have decimal commas. Where all
may be thousands (`1,234` alone), or numbers with a comma stand beside others with a point, the cells stay as they are
and `number` refuses them.

Units and titles as people write them (`[µm]`, `Zeit / s`), in several languages, are brought to one spelling.

What a row means is the caller's (tables.py): `is_header` says which rows name the columns it looks for.
"""

from __future__ import annotations

import csv
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

from cavirheo.errors import InputError, from_cell, is_float, require, without_unseen
from cavirheo.io import limits

CellTexts = list[str]
IsHeader = Callable[[CellTexts], bool]

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
ALIASES = {
    word: unit
    for unit, words in {
        "s": "sec second seconds sekunde sekunden seconde secondes segundo segundos 秒",
        "ms": "msec millisecond milliseconds millisekunden millisecondes milisegundos ミリ秒 毫秒",
        "us": "usec microsecond microseconds mikrosekunden microsecondes microsegundos マイクロ秒 微秒",
        "ns": "nsec nanosecond nanoseconds nanosekunden nanosecondes nanosegundos ナノ秒 纳秒",
        "m": "meter meters metre metres metros",
        "mm": "millimeter millimeters millimetre millimetres milimetros ミリメートル 毫米",
        "um": "micron microns micrometer micrometers micrometre micrometres mikrometer micrometros "
        "マイクロメートル 微米",
        "px": "pixel pixels pix pixeles ピクセル 像素",
    }.items()
    for word in words.split()
}
_SEPARATORS = ("\t", ";", ",", None)  # None: spaces
_UTF16 = (b"\xff\xfe", b"\xfe\xff")  # its marks
_MISSING = {"nan", "na", "n/a", "null", "none", "#n/a"}
_WITH_COMMA = re.compile(r"[+-]?\d+,\d*(e[+-]?\d+)?", re.I)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_WITH_POINT = re.compile(r"[+-]?(\d+\.\d*|\.\d+)(e[+-]?\d+)?", re.I)


class Row(NamedTuple):
    """One row that is not empty; `number`: of its line in the file or row in the sheet, from 1."""

    number: int
    texts: CellTexts


class Sheet(NamedTuple):
    """A table of text (its name is empty) or one sheet of a workbook; `rows` holds no empty ones.

    notes: what was done to the text.
    """

    name: str
    rows: list[Row]
    notes: tuple[str, ...] = ()


def read_sheets(path: Path, is_header: IsHeader, *, most: int | None = None) -> list[Sheet]:
    """The table of a text file, or the first `most` sheets of a workbook.

    `is_header` tells the dialect of a text: the first separator with which a row is a header, and no single cell below
    it. Without a header it is the separator that all of the first twenty lines hold. A comment is a row (without its
    mark) if it is a header over rows that are none.

    Raises InputError: larger than is read (limits.py), damaged, or neither text nor a workbook ("tabular.binary").
    """
    with path.open("rb") as file:
        kind = kind_of(file.read(1024))
    require(kind != "binary", "neither text nor a workbook", "tabular.binary")
    if kind == "text":
        limits.few(path.stat().st_size, limits.TEXT, "bytes of text")
        content = path.read_bytes()
        limits.few(content.count(b"\n") + 1, limits.ROWS, "lines")
        sheets = [_text_sheet(_decoded(content), is_header)]
    else:
        from cavirheo.io.workbook import read_workbook

        sheets = [Sheet(name, [Row(*row) for row in rows]) for name, rows in read_workbook(path, most)]
    for sheet in sheets:
        limits.few(max((len(row.texts) for row in sheet.rows), default=0), limits.COLUMNS, "columns")
    return list(map(_with_points, sheets))


def kind_of(head: bytes) -> Literal["text", "workbook", "binary"]:
    """What a file is that begins with these bytes."""
    if head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")):
        return "workbook"
    return "text" if head.startswith(_UTF16) or b"\x00" not in head else "binary"


def _decoded(content: bytes) -> str:
    """UTF-16, UTF-8 or Latin-1, without its mark."""
    encoding = "utf-16" if content.startswith(_UTF16) else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError:
        require(encoding != "utf-16", "begins as UTF-16 text and does not go on so", "tabular.encoding")
        return content.decode("latin-1")


def _text_sheet(text: str, is_header: IsHeader) -> Sheet:
    """The rows of a text; see `read_sheets`."""
    text, invisible = without_unseen(text)
    lines = text.splitlines()
    limits.few(len(lines), limits.ROWS, "lines")
    limits.few(max(map(len, lines), default=0), limits.LINE, "characters in one line")
    notes = (f"{invisible} control characters left out",) if invisible else ()
    comments = {k for k, line in enumerate(lines) if line.lstrip().startswith(("#", "%"))}
    data = ["" if k in comments else line for k, line in enumerate(lines)]
    rows = _rows_with_header(data, is_header)
    if rows is None and comments:
        rows = _rows_with_header([line.lstrip("#% ") for line in lines], is_header)
    if rows is None:
        sample = [line for line in data if line.strip()][:20]
        separator = next(s for s in _SEPARATORS if s is None or all(s in line for line in sample))
        rows = list(_split(data, separator))
    return Sheet("", rows, notes)


def _rows_with_header(lines: list[str], is_header: IsHeader) -> list[Row] | None:
    """The rows by the first separator that makes a header of one of them, over rows as wide; None where none does."""
    with_words = [line for line in lines if re.search(r"[^\W\d]", line)]
    unclear = False
    for separator in _SEPARATORS:
        candidates = with_words if separator is None or any(separator in line for line in lines) else []
        if not any(is_header(row.texts) for row in _split(candidates, separator)):
            continue
        rows = list(_split(lines, separator))
        at = next(k for k, row in enumerate(rows) if is_header(row.texts))
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


def _with_points(sheet: Sheet) -> Sheet:
    """The sheet, its numbers with decimal points and plain minus signs.

    Commas are decimal where no number has a point, and one of them is none between thousands.
    """
    rows = [[cell.replace("−", "-") if re.match(r"−\d", cell) else cell for cell in texts] for _, texts in sheet.rows]
    data = [texts for texts in rows if all(map(is_number, texts))] or rows  # what stands above a table says nothing
    values = {cell for texts in data for cell in texts}
    notes, commas = sheet.notes, filter(_WITH_COMMA.fullmatch, values)
    if not any(map(_WITH_POINT.fullmatch, values)) and not all(map(_THOUSANDS.fullmatch, commas)):
        count = sum(bool(_WITH_COMMA.fullmatch(cell)) for texts in rows for cell in texts)
        rows = [[cell.replace(",", ".") if _WITH_COMMA.fullmatch(cell) else cell for cell in texts] for texts in rows]
        notes = (*notes, f"{count} decimal commas")
    numbers = (number for number, _ in sheet.rows)
    return Sheet(sheet.name, list(map(Row, numbers, rows)), notes)


def is_number(cell: str) -> bool:
    """A number, or what stands for a missing one: nothing, a word such as nan, signs such as ---."""
    missing = cell.strip().lower() in _MISSING or not re.search(r"\w", cell)
    return missing or is_float(cell) or bool(_WITH_COMMA.fullmatch(cell))


def number(cell: str) -> float:
    """NaN where the cell is missing. Raises InputError: no number, or one with a comma of unknown meaning."""
    if is_float(cell):
        return float(cell)
    if _WITH_COMMA.fullmatch(cell):
        two = f"{cell.replace(',', '.')} or {cell.replace(',', '')}"
        message = f"{cell[:30]!r} could be {two}: is the comma decimal? export with decimal points only"
        raise InputError(message, "tabular.comma")
    if not is_number(cell):
        message = f"{cell[:30]!r} is not a number (none has marks between thousands)"
        raise InputError(f"{message}; leave the cell empty where there is none", "tabular.number")
    return float("nan")


def plain(text: str) -> str:
    """Without accents; every prime is ', every double one ''; the micro sign is the letter mu."""
    text = unicodedata.normalize("NFKD", text)
    text = "".join(c for c in text if not unicodedata.combining(c)).replace("−", "-")
    return re.sub("[′’‘´`]", "'", re.sub('["”“″]', "''", text))


def plain_title(text: str) -> str:
    """Small letters, digits and primes; no spaces, brackets or points."""
    return re.sub(r"[\s_\-.,:;=/^()\[\]{}]+", "", plain(text).lower())


def plain_unit(text: str) -> str:
    """`rad/s` -> rads, `s^-1` -> s-1, `µm` -> um; capitals stay: mPa is not MPa."""
    return re.sub(r"[\s/·⋅.*^_()\[\]{}]+", "", plain(text).replace("μ", "u"))


def unit_of(written: str, units: Mapping[str, float]) -> str | None:
    """The one of these units that is written so, in any spelling; None for another."""
    unit = plain_unit(written)
    spellings = (unit, unit.lower(), ALIASES.get(unit), ALIASES.get(unit.lower()))
    return next((spelling for spelling in spellings if spelling in units), None)

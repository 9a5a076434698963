"""Any table that a file holds -> rows of cells: text of every dialect, and the sheets of a workbook.

Text: tab, semicolon, comma or spaces separate the cells; a quoted cell may hold the separator; where commas do not
separate, they may be decimal. UTF-8 (with or without mark), UTF-16 (with or without), else Latin-1. Lines that begin
with # or % are comments, except the titles over columns of numbers (numpy.savetxt writes them so).
Workbooks: .xlsx, .xls, .xlsb, .ods; the visible sheets in the order of their tabs.

Numbers as people write them have decimal commas, and points, commas, spaces or apostrophes between thousands. What a
comma means is decided once for all rows of numbers in a sheet, by the one reading that all of them allow: `1,5` and
`0,123` have decimal commas, `1,234.5` and `1,234,567` have not. Where both readings are left (`1,234` alone), or
numbers with a comma stand beside others with a point, the cells stay as they are and `number` refuses them.

Units and titles as people write them (`[µm]`, `Zeit / s`), in several languages, are brought to one spelling.

What a row means is the caller's (tables.py): `is_header` says which rows name the columns it looks for.
"""

from __future__ import annotations

import csv
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from itertools import islice, pairwise
from pathlib import Path
from typing import Literal, NamedTuple

from cavirheo.errors import InputError, require, without_unseen
from cavirheo.files import from_cell
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
_SEPARATORS = ("\t", ";", ",", None, "  ")  # None: spaces; the last: two or more, where single ones are part of titles
_MISSING = {"nan", "na", "n/a", "null", "none", "#n/a"}
_SPACES = "' ’\u00a0\u202f"
_MARK = re.compile(rf"\d[,{_SPACES}]\d|\.\d+\.|−\d")  # what `float` does not read
_SPACED = re.compile(rf"(?<=\d)[{_SPACES}](?=\d{{3}}(?!\d))")
_NUMBER = re.compile(r"[+-]?\d[\d.,]*(e[+-]?\d+)?", re.I)
_BY_DECIMAL_MARK = {
    mark: re.compile(rf"[+-]?(\d+|[1-9]\d{{0,2}}(\{thousands}\d{{3}})+)(\{mark}\d*)?(e[+-]?\d+)?", re.I)
    for mark, thousands in (".,", ",.")
}


class Row(NamedTuple):
    """One row that is not empty; `number`: of its line in the file or row in the sheet, from 1."""

    number: int
    texts: CellTexts


class Sheet(NamedTuple):
    """A table of text (its name is empty) or one sheet of a workbook; `rows` holds no empty ones.

    notes: what was done to the text. comments: of a text, without their marks.
    """

    name: str
    rows: list[Row]
    notes: tuple[str, ...] = ()
    comments: tuple[str, ...] = ()


def read_sheets(path: Path, is_header: IsHeader, *, most: int | None = None, marks: str = "#%") -> list[Sheet]:
    """The table of a text file, or the first `most` sheets of a workbook.

    `is_header` tells the dialect of a text: the first separator with which a row is a header, and no single cell below
    it. Without a header it is the separator that all of the first twenty lines hold. `marks` begin a comment; a comment
    is a row (without its mark) if it is a header, or stands below one, over rows that are none.

    Raises:
        InputError: larger than is read (limits.py), damaged, or neither text nor a workbook ("tabular.binary").
    """
    with path.open("rb") as file:
        kind = kind_of(file.read(1024))
    require(kind != "binary", "neither text nor a workbook", "tabular.binary")
    if kind == "text":
        limits.few(path.stat().st_size, limits.TEXT, "bytes of text")
        content = path.read_bytes()
        limits.few(content.count(b"\n") + 1, limits.ROWS, "lines")
        sheets = [text_sheet(_decoded(content), is_header, marks=marks)]
    else:
        from cavirheo.io.workbook import read_workbook

        sheets = [_sheet(name, [Row(*row) for row in rows]) for name, rows in read_workbook(path, most)]
    for sheet in sheets:
        limits.few(max((len(row.texts) for row in sheet.rows), default=0), limits.COLUMNS, "columns")
    return sheets


def kind_of(head: bytes) -> Literal["text", "workbook", "binary"]:
    """What a file is that begins with these bytes."""
    if head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")):
        return "workbook"
    return "text" if _utf16(head) or b"\x00" not in head else "binary"


def _utf16(content: bytes) -> str:
    """The name of the encoding if it is UTF-16; a file may have lost its mark, but every other byte is zero."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    even, odd = content[:1024:2].count(0), content[1:1024:2].count(0)
    half = len(content[:1024]) / 4
    return "utf-16-le" if odd > half and not even else "utf-16-be" if even > half and not odd else ""


def _decoded(content: bytes) -> str:
    """UTF-16, UTF-8 or Latin-1, without its mark."""
    encoding = _utf16(content)
    try:
        return content.decode(encoding or "utf-8-sig")
    except UnicodeDecodeError:
        require(not encoding, "begins as UTF-16 text and does not go on so", "tabular.encoding")
        return content.decode("latin-1")


def text_sheet(text: str, is_header: IsHeader, *, marks: str = "#%") -> Sheet:
    """The rows of a text; see `read_sheets`."""
    text, invisible = without_unseen(text)
    lines = text.splitlines()
    limits.few(len(lines), limits.ROWS, "lines")
    limits.few(max(map(len, lines), default=0), limits.LINE, "characters in one line")
    rows = _rows_below_header(lines, is_header, marks)
    if rows is None:
        bare = (line.strip() for line in lines)
        sample = list(islice((line for line in bare if line and line[0] not in marks), 20))
        separator = next(s for s in _SEPARATORS if s is None or all(s in line for line in sample))
        rows = list(_rows(lines, separator, is_header, marks))
    notes = (f"{invisible} control characters left out",) if invisible else ()
    comments = (line.lstrip(marks + " ") for line in lines if line.lstrip().startswith(tuple(marks)))
    return _sheet("", rows, notes, tuple(islice(comments, 1000)))


def _rows_below_header(lines: list[str], is_header: IsHeader, marks: str) -> list[Row] | None:
    """The rows by the first separator that makes a header of one of them; None where none does."""

    def names_columns(texts: CellTexts) -> bool:
        return not all(map(is_number, texts)) and is_header(texts)

    unclear = False
    with_words = [line.lstrip(marks + " ") for line in lines if re.search(r"[^\W\d]", line)]
    for separator in _SEPARATORS:
        candidates = with_words if separator is None or any(separator in line for line in lines) else []
        if any(names_columns(texts) for _, texts in _split(candidates, separator)):
            rows = list(_rows(lines, separator, is_header, marks))
            spaced = separator in (None, "  ")
            below = ((row, after) for row, after in pairwise([*rows, *rows[-1:]]) if names_columns(row.texts))
            if any(row is after or len(after.texts) >= (len(row.texts) if spaced else 2) for row, after in below):
                return rows
            unclear |= spaced
    message = "titles with spaces in them over columns separated by spaces; separate the columns by commas"
    require(not unclear, message, "tabular.width")
    return None


def _sheet(name: str, rows: list[Row], notes: tuple[str, ...] = (), comments: tuple[str, ...] = ()) -> Sheet:
    texts, number_notes = with_points([row.texts for row in rows])
    rows = [row._replace(texts=changed) for row, changed in zip(rows, texts, strict=True)] if number_notes else rows
    return Sheet(name, rows, (*notes, *number_notes), comments)


def _rows(lines: list[str], separator: str | None, is_header: IsHeader, marks: str) -> Iterator[Row]:
    comments = {k for k, line in enumerate(lines, 1) if line.lstrip().startswith(tuple(marks))}
    data = ["" if k in comments else line for k, line in enumerate(lines, 1)]
    above: list[Row] = []  # the comments since the last row
    for number, texts in _split(data, separator):
        if number in comments:
            bare = lines[number - 1].lstrip().lstrip(marks + " ")
            above += [Row(number, texts) for _, texts in _split([bare], separator)]
        elif any(texts):
            if above and not is_header(texts):
                first = next((k for k, row in enumerate(above) if is_header(row.texts)), len(above))
                yield from (row for row in above[first:] if len(row.texts) == len(above[first].texts))
            above = []
            yield Row(number, texts)


def _split(lines: list[str], separator: str | None) -> Iterator[tuple[int, CellTexts]]:
    if separator is None:
        lines = [re.sub(r"\s+", " ", line).strip() for line in lines]
        lines = [re.sub(r" (?=[\[(][^\s\[\]()]+[\])]( |$))", "_", line) for line in lines]  # "R (um)" is one title
        separator = " "
    elif separator == "  ":
        lines = [re.sub(r"\s{2,}", "\t", line.strip()) for line in lines]
        separator = "\t"
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    total = 0
    try:
        for texts in reader:
            total += len(texts)
            limits.few(total, limits.SAMPLES, "cells")
            yield reader.line_num, [from_cell(cell.strip()) for cell in texts]
    except csv.Error as error:
        raise InputError(f"line {reader.line_num}: {error}", "tabular.csv") from None


def with_points(rows: list[CellTexts]) -> tuple[list[CellTexts], list[str]]:
    """(the rows, their numbers with decimal points and without marks between thousands; how many were changed)."""
    if not any(_MARK.search(cell) for texts in rows for cell in texts):
        return rows, []
    tidy = {cell: _SPACED.sub("", cell.replace("−", "-")) for texts in rows for cell in texts}
    tidy = {cell: text for cell, text in tidy.items() if _NUMBER.fullmatch(text)}
    data = [texts for texts in rows if all(map(is_number, texts))] or rows  # what stands above a table says nothing
    decimal = _decimal_mark([tidy[cell] for texts in data for cell in texts if cell in tidy])
    if decimal:
        thousands = "." if decimal == "," else ","
        tidy = {cell: text.replace(thousands, "").replace(",", ".") for cell, text in tidy.items()}
    new = {cell: text for cell, text in tidy.items() if text != cell and _is_float(text)}
    changed = [cell for texts in rows for cell in texts if cell in new]
    commas = sum(decimal == "," and "," in cell for cell in changed)
    groups = sum(len(re.findall(rf"[,.{_SPACES}]", cell)) > new[cell].count(".") for cell in changed)
    notes = {f"{commas} decimal commas": commas, f"marks between the thousands of {groups} numbers left out": groups}
    return [[new.get(cell, cell) for cell in row] for row in rows], [note for note, count in notes.items() if count]


def _decimal_mark(texts: list[str]) -> str:
    """The mark that is decimal in all of these numbers, or nothing where they do not say."""
    texts = [text for text in set(texts) if any(pattern.fullmatch(text) for pattern in _BY_DECIMAL_MARK.values())]
    possible = [mark for mark, pattern in _BY_DECIMAL_MARK.items() if all(map(pattern.fullmatch, texts))]
    marks = [(text.count(","), text.count(".")) for text in texts]
    if not any(commas for commas, _ in marks):
        return possible[0] if possible else ""
    proven = any(commas + points > 1 for commas, points in marks)
    return possible[0] if len(possible) == 1 and (proven or not any(points for _, points in marks)) else ""


def _is_float(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text  # Python's 1_000


def is_number(cell: str) -> bool:
    """A number, or what stands for a missing one: nothing, a word such as nan, signs such as ---."""
    return (
        _is_float(cell)
        or cell.strip().lower() in _MISSING
        or not re.search(r"\w", cell)
        or bool(_NUMBER.fullmatch(cell) and _MARK.search(cell))
    )


def number(cell: str) -> float:
    """NaN where the cell is missing.

    Raises:
        InputError: no number ("tabular.number"), or one with a comma of unknown meaning ("tabular.comma").
    """
    if _is_float(cell):
        return float(cell)
    if not is_number(cell):
        raise InputError(f"{cell[:30]!r} is not a number; leave the cell empty where there is none", "tabular.number")
    if "," in cell and _NUMBER.fullmatch(cell):
        two = f"{cell.replace(',', '.')} or {cell.replace(',', '')}"
        message = f"{cell[:30]!r} could be {two}: is the comma decimal? export with decimal points only"
        raise InputError(message, "tabular.comma")
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
    return next((spelling for spelling in (unit, ALIASES.get(unit)) if spelling in units), None)

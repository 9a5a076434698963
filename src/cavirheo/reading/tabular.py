"""Any table that a file holds -> rows of cells: text of every dialect, and the sheets of a workbook.

Text: tab, semicolon, comma or spaces separate the cells; a quoted cell may hold the separator; where commas do not
separate, they may be decimal. UTF-8 (with or without mark), UTF-16 (with or without), else Latin-1. Lines that begin
with # or % are comments, except the titles over columns of numbers (numpy.savetxt writes them so).
Workbooks: .xlsx, .xls, .xlsb, .ods; the visible sheets in the order of their tabs.

What a row means is the caller's (sheet.py): `is_header` says which rows name the columns it looks for.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator
from itertools import islice, pairwise
from pathlib import Path
from typing import Literal, NamedTuple

from cavirheo.errors import InputError, require, without_unseen
from cavirheo.files import from_cell
from cavirheo.reading import limits
from cavirheo.reading.number_format import Cells, is_number, with_points

IsHeader = Callable[[Cells], bool]

_SEPARATORS = ("\t", ";", ",", None, "  ")  # None: spaces; the last: two or more, where single ones are part of titles


class Row(NamedTuple):
    """One row that is not empty; `number`: of its line in the file or row in the sheet, from 1."""

    number: int
    cells: Cells


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
        from cavirheo.reading.workbook import read_workbook

        sheets = [_sheet(name, [Row(*row) for row in rows]) for name, rows in read_workbook(path, most)]
    for sheet in sheets:
        limits.few(max((len(row.cells) for row in sheet.rows), default=0), limits.COLUMNS, "columns")
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
    text, unseen = without_unseen(text)
    lines = text.splitlines()
    limits.few(len(lines), limits.ROWS, "lines")
    limits.few(max(map(len, lines), default=0), limits.LINE, "characters in one line")

    def names(cells: Cells) -> bool:
        return not all(map(is_number, cells)) and is_header(cells)

    unclear = False
    worded = [line.lstrip(marks + " ") for line in lines if re.search(r"[^\W\d]", line)]
    for separator in _SEPARATORS:
        here = worded if separator is None or separator in text else []
        if any(names(cells) for _, cells in _split(here, separator)):
            rows = list(_rows(lines, separator, is_header, marks))
            spaced = separator in (None, "  ")
            below = ((row, after) for row, after in pairwise([*rows, *rows[-1:]]) if names(row.cells))
            if any(row is after or len(after.cells) >= (len(row.cells) if spaced else 2) for row, after in below):
                break
            unclear |= spaced
    else:
        spaces = "titles with spaces in them over columns separated by spaces; separate the columns by commas"
        require(not unclear, spaces, "tabular.width")
        bare = (line.strip() for line in lines)
        sample = list(islice((line for line in bare if line and line[0] not in marks), 20))
        separator = next(s for s in _SEPARATORS if s is None or all(s in line for line in sample))
        rows = list(_rows(lines, separator, is_header, marks))
    messages = (f"{unseen} control characters left out",) if unseen else ()
    comments = (line.lstrip(marks + " ") for line in lines if line.lstrip().startswith(tuple(marks)))
    return _sheet("", rows, messages, tuple(islice(comments, 1000)))


def _sheet(name: str, rows: list[Row], notes: tuple[str, ...] = (), comments: tuple[str, ...] = ()) -> Sheet:
    cells, said = with_points([row.cells for row in rows])
    rows = [Row(row.number, mine) for row, mine in zip(rows, cells, strict=True)] if said else rows
    return Sheet(name, rows, (*notes, *said), comments)


def _rows(lines: list[str], separator: str | None, is_header: IsHeader, marks: str) -> Iterator[Row]:
    comments = {k for k, line in enumerate(lines, 1) if line.lstrip().startswith(tuple(marks))}
    data = ["" if k in comments else line for k, line in enumerate(lines, 1)]
    above: list[Row] = []  # the comments since the last row
    for number, cells in _split(data, separator):
        if number in comments:
            bare = lines[number - 1].lstrip().lstrip(marks + " ")
            above += [Row(number, cells) for _, cells in _split([bare], separator)]
        elif any(cells):
            if above and not is_header(cells):
                first = next((k for k, row in enumerate(above) if is_header(row.cells)), len(above))
                yield from (row for row in above[first:] if len(row.cells) == len(above[first].cells))
            above = []
            yield Row(number, cells)


def _split(lines: list[str], separator: str | None) -> Iterator[tuple[int, Cells]]:
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
        for cells in reader:
            total += len(cells)
            limits.few(total, limits.SAMPLES, "cells")
            yield reader.line_num, [from_cell(cell.strip()) for cell in cells]
    except csv.Error as error:
        raise InputError(f"line {reader.line_num}: {error}", "tabular.csv") from None

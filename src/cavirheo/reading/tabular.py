"""Any table that a file holds -> rows of cells: text of every dialect, and the sheets of a workbook.

Text: tab, semicolon, comma or spaces separate the cells; a quoted cell may hold the separator; where commas do not
separate, they may be decimal. UTF-8 (with or without mark), UTF-16 (with or without), else Latin-1. Lines that begin
with # or % are comments, except the titles over columns of numbers (numpy.savetxt writes them so).
Workbooks: .xlsx, .xls, .xlsb, .ods; the visible sheets in the order of their tabs.

What a row means is the caller's: `is_header` says which rows name the columns it looks for.
"""

from __future__ import annotations

import csv
import re
import unicodedata
from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.reading import limits

Cells = list[str]
IsHeader = Callable[[Cells], bool]
Kind = TypeVar("Kind")

_MISSING = {"nan", "na", "n/a", "null", "none", "#n/a"}
_SEPARATORS = ("\t", ";", ",", None)  # None: spaces


class Row(NamedTuple):
    """One row that is not empty; `number`: of its line in the file or row in the sheet, from 1."""

    number: int
    cells: Cells


class Sheet(NamedTuple):
    """A table of text (its name is empty) or one sheet of a workbook; `rows` holds no empty ones."""

    name: str
    rows: list[Row]


def read_sheets(path: Path, is_header: IsHeader, *, most: int | None = None, marks: str = "#%") -> list[Sheet]:
    """The table of a text file, or the first `most` sheets of a workbook.

    `is_header` tells the dialect of a text: the first separator with which a row is a header, and no single cell below
    it. Without a header it is the separator that all of the first twenty lines hold. `marks` begin a comment; a comment
    is a row (without its mark) if it is a header, or stands below one, over rows that are none.

    Raises:
        InputError: larger than is read (limits.py), damaged, decimal commas and points in one row, or neither text nor
            a workbook ("tabular.binary").
    """
    with path.open("rb") as file:
        kind = kind_of(file.read(1024))
    require(kind != "binary", "neither text nor a workbook", "tabular.binary")
    if kind == "workbook":
        from cavirheo.reading.workbook import read_workbook

        sheets = read_workbook(path, most)
    else:
        limits.few(path.stat().st_size, limits.TEXT, "bytes of text")
        content = path.read_bytes()
        limits.few(content.count(b"\n") + 1, limits.ROWS, "lines")
        sheets = [Sheet("", text_rows(_decoded(content), is_header, marks=marks))]
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


def text_rows(text: str, is_header: IsHeader, *, marks: str = "#%") -> list[Row]:
    """The rows of a text; see `read_sheets`."""
    lines = text.splitlines()
    limits.few(len(lines), limits.ROWS, "lines")
    limits.few(max(map(len, lines), default=0), limits.LINE, "characters in one line")

    def names(cells: Cells) -> bool:
        return not all(map(is_number, cells)) and is_header(cells)

    worded = [line.lstrip(marks + " ") for line in lines if re.search(r"[^\W\d]", line)]
    for separator in _SEPARATORS:
        here = worded if separator is None or separator in text else []
        if any(names(cells) for _, cells in _split(here, separator)):
            rows = list(_rows(lines, separator, is_header, marks))
            headers = (k for k, row in enumerate(rows) if names(row.cells))
            if any(k + 1 == len(rows) or len(rows[k + 1].cells) > 1 for k in headers):
                break
    else:
        bare = (line.strip() for line in lines)
        sample = list(islice((line for line in bare if line and line[0] not in marks), 20))
        separator = next((s for s in _SEPARATORS if s is None or all(s in line for line in sample)), None)
        rows = list(_rows(lines, separator, is_header, marks))
    return [Row(row.number, _with_points(row.cells)) for row in rows] if separator != "," and "," in text else rows


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
    reader = csv.reader(lines, delimiter=separator or " ", skipinitialspace=True)
    try:
        for cells in reader:
            yield reader.line_num, [cell.strip() for cell in cells]
    except csv.Error as error:
        raise InputError(f"line {reader.line_num}: {error}", "tabular.csv") from None


def _with_points(cells: Cells) -> Cells:
    """Decimal commas become points. Raises InputError ("tabular.comma"): both in one row; one separates thousands."""
    changed = [re.sub(r"^([+-]?\d+),(\d+(e[+-]?\d+)?)$", r"\1.\2", cell, flags=re.I) for cell in cells]
    commas = [old for old, new in zip(cells, changed, strict=True) if old != new]
    points = [cell for cell in cells if "." in cell and is_number(cell)] if commas else []
    both = " and ".join(repr(some[0]) for some in (commas, points) if some)
    require(not points, f"{both} in one row: is the comma decimal? export with points only", "tabular.comma")
    return changed


def is_number(cell: str) -> bool:
    """A number, or what stands for a missing one: nothing, a word such as nan, signs such as ---."""
    try:
        float(cell)
    except ValueError:
        return cell.strip().lower() in _MISSING or not re.search(r"\w", cell)
    return True


def numbers(rows: list[Row], at: int) -> Floats:
    """(rows,) the column `at`, counted from 0; NaN where a cell is missing.

    Raises:
        InputError: a cell that is no number ("tabular.number"); the message names its row.
    """
    values = np.full(len(rows), np.nan)
    for k, (number, cells) in enumerate(rows):
        cell = cells[at] if at < len(cells) else ""
        try:
            values[k] = float(cell)
        except ValueError:
            require(is_number(cell), f"row {number}: {cell[:30]!r} is not a number", "tabular.number")
    return values


def refuse_wider(rows: list[Row], header: Cells) -> None:
    """Raises InputError ("tabular.width"): a row with more cells than the header has titles."""
    for number, cells in rows:
        if any(cells[len(header) :]):
            why = f"row {number} has {len(cells)} cells, the header {len(header)} (a decimal comma?)"
            raise InputError(why, "tabular.width")


def column_of(
    title: str, titles: Mapping[str, Kind], units: Mapping[Any, Collection[str]]
) -> tuple[Kind | None, str | None]:
    """(kind, unit) that a column's title names: `time_us`, `R [um]`, `Shear Strain (%)`, `omega in rad/s`.

    titles: kinds by title as `_plain_title` writes them; units: known units by kind as `plain_unit` writes them, which
    count in small letters too. (None, None): no title that is known. The unit is None where there is none, and as
    written where it stands in brackets and is not known.
    """
    text = _plain(title).strip()
    named: tuple[Kind | None, str | None] = (None, None)
    for cut in re.finditer(r"\s*[\s_\[(/,.\-]\s*(in\s)?", text):
        kind = titles.get(_plain_title(text[: cut.start()]))
        if kind is None:
            continue
        written = text[cut.end() :].rstrip("]), ")
        unit, known = plain_unit(written), units.get(kind, ())
        if unit in known or unit.lower() in known:
            return kind, unit if unit in known else unit.lower()
        if re.fullmatch(r"\s*[\[(][^\[\]()]+[\])]\s*", text[cut.start() :]):
            named = kind, written
    kind = titles.get(_plain_title(text))
    return named if kind is None else (kind, None)


def _plain(text: str) -> str:
    """Without accents; every prime is ', every double one ''; the micro sign is the letter mu."""
    text = unicodedata.normalize("NFKD", text)
    text = "".join(c for c in text if not unicodedata.combining(c)).replace("−", "-")
    return re.sub("[′’‘´`]", "'", re.sub('["”“″]', "''", text))


def _plain_title(text: str) -> str:
    """Small letters, digits and primes; no spaces, brackets or points."""
    return re.sub(r"[\s_\-.,:;=/^()\[\]{}]+", "", _plain(text).lower())


def plain_unit(text: str) -> str:
    """`rad/s` -> rads, `s^-1` -> s-1, `µm` -> um; capitals stay: mPa is not MPa."""
    return re.sub(r"[\s/·⋅.*^_()\[\]{}]+", "", _plain(text).replace("μ", "u"))

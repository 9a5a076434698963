"""Excel: the sheets of an .xlsx as rows of text, read with the standard library (an .xlsx is zipped XML)."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading import limits
from cavirheo.reading.table import Rows, curves_of_rows

_SHEET, _STRINGS = "xl/worksheets/sheet{}.xml", "xl/sharedStrings.xml"


def read(path: Path, density: float, pressure: float) -> list[RadiusCurve]:
    """Curves of the first sheet; its first row must be the header as in a CSV."""
    curves = curves_of_rows(sheets(path, 1)[0], density, pressure)
    return [curve.with_notes("read from the first sheet of the workbook") for curve in curves]


def sheets(path: Path, most: int | None = None) -> list[Rows]:
    """Each worksheet (the first `most`) as its rows that are not empty."""
    with ZipFile(path) as archive:
        names = archive.namelist()
        numbers = sorted(int(found[1]) for name in names if (found := re.fullmatch(_SHEET.format(r"(\d+)"), name)))
        if 1 not in numbers:
            raise InputError("a zip archive without a first worksheet; expected an .xlsx, or save the table as CSV")
        shared = list(_parse(archive, _STRINGS)) if _STRINGS in names else []
        strings = ["".join(t.text or "" for t in item.iter() if _tag(t) == "t") for item in shared]
        pages = [_parse(archive, _SHEET.format(number)) for number in numbers[:most]]
    return [
        [cells for row in page.iter() if _tag(row) == "row" and any(cells := _cells(row, strings))] for page in pages
    ]


def _parse(archive: ZipFile, name: str) -> ElementTree.Element:
    if archive.getinfo(name).file_size > limits.SHEET:
        raise InputError(f"{name} unpacks to more than {limits.SHEET} bytes; save the sheet as CSV")
    text = archive.read(name)
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:  # never in a workbook; the way to exhaust an XML parser
        raise InputError(f"{name} declares XML entities; save the sheet as CSV")
    return ElementTree.fromstring(text)


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _cells(row: ElementTree.Element, strings: list[str]) -> list[str]:
    cells: list[str] = []
    for cell in (c for c in row if _tag(c) == "c"):
        letters = re.match(r"[A-Z]{1,3}", cell.get("r", ""))
        at = len(cells)
        if letters:
            at = 0
            for letter in letters.group():
                at = 26 * at + ord(letter) - 64
            at -= 1
            limits.few(at + 1, limits.COLUMNS, "columns")
        text = "".join(e.text or "" for e in cell.iter() if _tag(e) in ("v", "t"))
        cells += [""] * (at - len(cells))
        cells.append(strings[int(text)] if cell.get("t") == "s" else text)
    return cells

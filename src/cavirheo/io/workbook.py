"""Read the sheets of a workbook (.xlsx, .xls, .xlsb, .ods) as rows of text, by calamine in a process of its own.

A workbook of a few kilobytes may unpack to gigabytes, or contain a cell so far out that the grid up to it exceeds any
memory; the process that reads it then crashes.
"""

from __future__ import annotations

import json
import zipfile
from contextlib import suppress
from pathlib import Path

from cavirheo.errors import InputError, without_invisible
from cavirheo.io import apart, limits

_PARTS = {"[Content_Types].xml", "mimetype", "content.xml", "xl/workbook.xml"}  # a zipped workbook has one of them

Sheet = tuple[str, list[tuple[int, list[str]]]]  # its name, and (row number from 1, cells) of each row


def read_workbook(path: Path) -> list[Sheet]:
    """Return each sheet of cells, in the order of their tabs, without empty rows. A hidden sheet has no rows and is
    named as hidden, unless all are.

    Raises:
        InputError: another archive ("tabular.archive"), too much of them ("limits.cells", "limits.characters"), or as
            `apart.call`.
    """
    text = apart.call(_sheets, str(path.absolute()), memory=limits.MEMORY, seconds=limits.SECONDS)
    sheets: list[Sheet] = json.loads(text)
    return sheets


def _sheets(path: str) -> str:
    """Return the sheets as JSON; in the child."""
    from python_calamine import CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

    with suppress(zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        if _PARTS.isdisjoint(names):
            advice = "unpack it, and give the files or the folder that holds them"
            held = f"{len(names)} files, {ascii(', '.join(names[:3])[:100])[1:-1]}"
            raise InputError(f"a zip archive of {held}; no workbook: {advice}", "tabular.archive")
    book = CalamineWorkbook.from_path(path)
    tabs = [tab for tab in book.sheets_metadata if tab.typ == SheetTypeEnum.WorkSheet]
    if not tabs:
        raise InputError("a workbook without a sheet of cells", "tabular.workbook")
    visible = [tab.name for tab in tabs if tab.visible == SheetVisibleEnum.Visible] or [tab.name for tab in tabs]
    sheets: list[Sheet] = []
    cells = 0
    for name in (tab.name for tab in tabs):
        if name not in visible:
            sheets.append((_text(f"{name} (hidden)"), []))
            continue
        sheet = book.get_sheet_by_name(name)
        cells += sheet.height * sheet.width
        if cells > limits.WORKBOOK_CELLS:
            more = f"the workbook has {cells} cells: more than {limits.WORKBOOK_CELLS} are not read"
            raise InputError(f"{more}; save the table alone as CSV", "limits.cells")
        first = (sheet.start or (0, 0))[0] + 1
        rows = [(number, list(map(_text, row))) for number, row in enumerate(sheet.iter_rows(), first)]
        sheets.append((_text(name), [(number, texts) for number, texts in rows if any(texts)]))
    text = json.dumps(sheets)
    limits.check(len(text), limits.TEXT, "characters in all cells")
    return text


def _text(cell: object) -> str:
    whole = isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15
    text = str(int(cell) if whole else cell)  # type: ignore[call-overload]
    return without_invisible(text)[0].strip()

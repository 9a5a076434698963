"""Read the sheets of a workbook (.xlsx, .xls, .xlsb, .ods) as rows of text, by calamine in a child process.

A workbook of a few kilobytes may unpack to gigabytes, or contain a cell so far out that the grid up to it exceeds any
memory; the process that reads it then crashes. Therefore a child process with limits on memory and time reads it. This
file is also the program of the child, which imports no other module of the package.
"""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from contextlib import suppress
from typing import Any, BinaryIO

MEMORY = 400_000_000  # bytes of address space of the child
_SECONDS = 30.0
_PARTS = {"[Content_Types].xml", "mimetype", "content.xml", "xl/workbook.xml"}  # a zipped workbook has one of them

Sheet = tuple[str, list[tuple[int, list[str]]]]  # its name, and (row number from 1, cells) of each row


def read_workbook(file: BinaryIO) -> list[Sheet]:
    """Return each sheet of cells, in the order of their tabs, without empty rows. A hidden sheet has no rows and is
    named as hidden, unless all are.

    Raises:
        InputError: no workbook, or damaged ("tabular.workbook"); another archive ("tabular.archive"); beyond a limit
            ("limits.bytes", "limits.unpacked", "limits.cells", "limits.text", "limits.memory",
            "limits.time").
    """
    from cavirheo.errors import InputError, without_invisible
    from cavirheo.io import limits

    most = (MEMORY, limits.SHEET, limits.UNPACKED, limits.WORKBOOK_CELLS)
    command = [sys.executable, "-P", __file__, *map(str, most)]
    try:
        child = subprocess.run(command, stdin=file, capture_output=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"reading it takes more than {_SECONDS:.0f} s; save it as CSV", "limits.time") from None
    if child.returncode < 0 or b"emory" in child.stderr:  # "MemoryError" or "memory allocation ... failed"
        raise InputError("the workbook takes more memory than is given to it; save it as CSV", "limits.memory")
    if child.returncode > 0:
        answer = child.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise InputError(f"the workbook cannot be read, it may be damaged ({answer[:300]})", "tabular.workbook")
    answer = json.loads(child.stdout)
    if "problem" in answer:
        raise InputError(answer["problem"], answer["code"])
    return [
        (without_invisible(name)[0], [(k, [without_invisible(cell)[0] for cell in cells]) for k, cells in rows])
        for name, rows in answer["sheets"]
    ]


def _answer(file: BinaryIO, most_bytes: int, most_unpacked: int, most_cells: int) -> dict[str, Any]:
    """Return {"sheets": [Sheet]}, or {"problem": why there are none, "code": its code}; in the child."""
    from python_calamine import CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

    def too_large(what: str, count: int, limit: int, items: str, code: str) -> dict[str, Any]:
        more = f"{what} {count} {items}: more than {limit} are not read"
        return {"problem": f"the workbook {more}; save the table alone as CSV", "code": code}

    with suppress(zipfile.BadZipFile), zipfile.ZipFile(file) as archive:
        names = archive.namelist()
        if _PARTS.isdisjoint(names):
            advice = "unpack it, and give the files or the folder that holds them"
            if names and names[0].endswith(".npy"):
                advice = "save one array: numpy.save('shot.npy', numpy.stack([t, R]))"
            held = f"{len(names)} files, {ascii(', '.join(names[:3])[:100])[1:-1]}"
            return {"problem": f"a zip archive of {held}; no workbook: {advice}", "code": "tabular.archive"}
        unpacked = sum(part.file_size for part in archive.infolist())
        if unpacked > most_unpacked:
            return too_large("unpacks to", unpacked, most_unpacked, "bytes", "limits.unpacked")
    if (size := file.seek(0, 2)) > most_bytes:
        return too_large("has", size, most_bytes, "bytes", "limits.bytes")
    file.seek(0)
    book = CalamineWorkbook.from_filelike(file)
    tabs = [tab for tab in book.sheets_metadata if tab.typ == SheetTypeEnum.WorkSheet]
    if not tabs:
        raise ValueError("no sheet of cells")
    visible = [tab.name for tab in tabs if tab.visible == SheetVisibleEnum.Visible] or [tab.name for tab in tabs]
    sheets: list[Sheet] = []
    total = text = 0
    for name in (tab.name for tab in tabs):
        if name not in visible:
            sheets.append((f"{name} (hidden)", []))
            continue
        sheet = book.get_sheet_by_name(name)
        total += sheet.height * sheet.width
        if total > most_cells:
            return too_large("has", total, most_cells, "cells", "limits.cells")
        first = (sheet.start or (0, 0))[0] + 1
        rows: list[tuple[int, list[str]]] = []
        for number, row in enumerate(sheet.iter_rows(), first):
            cells = list(map(_text, row))
            if any(cells):
                rows.append((number, cells))
            text += sum(map(len, cells))
            if text > most_bytes:
                return too_large("holds", text, most_bytes, "characters", "limits.text")
        sheets.append((name, rows))
    return {"sheets": sheets}


def _text(cell: object) -> str:
    whole = isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15
    return str(int(cell) if whole else cell).strip()  # type: ignore[call-overload]


if __name__ == "__main__":
    _memory, *_limits = map(int, sys.argv[1:])
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: only the time limit holds
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (_memory, _memory))
    json.dump(_answer(sys.stdin.buffer, *_limits), sys.stdout)

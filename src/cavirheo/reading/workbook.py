"""The sheets of a workbook (.xlsx, .xls, .xlsb, .ods) as rows of text, read by calamine in a process of its own.

A workbook of a few kilobytes may unpack to gigabytes, or name a cell so far out that the grid up to it is larger than
any memory, which ends the process that reads it. So a child reads it, with a limit on its memory and its time. This
file is also the child's program, and then knows no other module of the package.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cavirheo.reading.tabular import Sheet

MEMORY = 1 << 30  # bytes
_SECONDS = 60.0


def read_workbook(path: Path, most: int | None = None) -> list[Sheet]:
    """The first `most` visible sheets, in the order of their tabs.

    Raises:
        InputError: no workbook, damaged, or larger than is read ("limits.memory", "limits.time").
    """
    from cavirheo.errors import InputError, require
    from cavirheo.reading import limits
    from cavirheo.reading.tabular import Row, Sheet

    limits.few(path.stat().st_size, limits.SHEET, "bytes of a workbook")
    command = [sys.executable, "-P", __file__, str(path), str(most or 0), str(MEMORY)]
    try:
        child = subprocess.run(command, capture_output=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        what = f"reading the workbook takes more than {_SECONDS:.0f} s; save it as CSV"
        raise InputError(what, "limits.time") from None
    full = child.returncode < 0 or b"emory" in child.stderr  # killed, or "MemoryError", "memory allocation ... failed"
    require(not full, "the workbook takes more memory than is given to it; save it as CSV", "limits.memory")
    said = child.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    damaged = f"the workbook cannot be read, it may be damaged ({said})"
    require(child.returncode == 0, damaged, "tabular.workbook")
    sheets = [Sheet(name, [Row(*row) for row in rows]) for name, rows in json.loads(child.stdout)]
    for sheet in sheets:
        limits.few(len(sheet.rows), limits.ROWS, "rows")
    return sheets


def _sheets(path: str, most: int) -> Iterator[tuple[str, list[tuple[int, list[str]]]]]:
    """What the child says: (name, [(number of the row from 1, its cells)]) of each sheet, without its empty rows."""
    from python_calamine import CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

    with open(path, "rb") as file:  # not by its path: then the ending would decide
        book = CalamineWorkbook.from_filelike(file)
    sheets = [one for one in book.sheets_metadata if one.typ == SheetTypeEnum.WorkSheet]
    if not sheets:
        raise ValueError("no sheet of cells")
    seen = [one for one in sheets if one.visible == SheetVisibleEnum.Visible] or sheets
    for about in seen[: most or None]:
        sheet = book.get_sheet_by_name(about.name)
        first = (sheet.start or (0, 0))[0] + 1
        rows = enumerate(([_text(cell) for cell in row] for row in sheet.iter_rows()), first)
        yield about.name, [(number, cells) for number, cells in rows if any(cells)]


def _text(cell: object) -> str:
    whole = isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15
    return str(int(cell) if whole else cell).strip()  # type: ignore[call-overload]


if __name__ == "__main__":
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: the time limit stays
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]),) * 2)
    json.dump(list(_sheets(sys.argv[1], int(sys.argv[2]))), sys.stdout)

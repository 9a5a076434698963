"""The sheets of a workbook (.xlsx, .xls, .xlsb, .ods) as rows of text, read by calamine in a process of its own.

A workbook of a few kilobytes may unpack to gigabytes, or name a cell so far out that the grid up to it is larger than
any memory, which ends the process that reads it. So a child reads it, with a limit on its memory and its time. This
file is also the child's program, and then knows no other module of the package.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cavirheo.reading.tabular import Row

MEMORY = 1 << 30  # bytes
_SECONDS = 60.0


def read_workbook(path: Path, most: int | None = None) -> list[tuple[str, list[Row]]]:
    """(name, rows that are not empty) of the first `most` visible sheets, in the order of their tabs.

    Raises:
        InputError: no workbook, damaged, or larger than is read ("limits.memory", "limits.time").
    """
    from cavirheo.errors import InputError
    from cavirheo.reading import limits
    from cavirheo.reading.tabular import Row

    limits.few(path.stat().st_size, limits.SHEET, "bytes of a workbook")
    numbers = most or 0, limits.ROWS, limits.COLUMNS, MEMORY
    command = [sys.executable, "-P", __file__, str(path), *map(str, numbers)]
    try:
        child = subprocess.run(command, capture_output=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(
            f"reading the workbook takes more than {_SECONDS:.0f} s; save it as CSV", "limits.time"
        ) from None
    if child.returncode < 0 or b"emory" in child.stderr:  # killed, or "MemoryError", "memory allocation ... failed"
        raise InputError("the workbook takes more memory than is given to it; save it as CSV", "limits.memory")
    if child.returncode:
        said = child.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise InputError(f"the workbook cannot be read, it may be damaged ({said})", "tabular.workbook")
    found = json.loads(child.stdout)
    if "error" in found:
        raise InputError(found["error"], found["code"])
    return [(name, [Row(number, cells) for number, cells in rows]) for name, rows in found["sheets"]]


def _sheets(path: str, most: int, rows: int, columns: int) -> dict[str, Any]:
    """What the child says."""
    from python_calamine import CalamineError, CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

    try:
        book = CalamineWorkbook.from_filelike(open(path, "rb"))  # noqa: SIM115 (by a path, the ending would decide)
        about = [one for one in book.sheets_metadata if one.typ == SheetTypeEnum.WorkSheet]
        names = [one.name for one in about if one.visible == SheetVisibleEnum.Visible] or [one.name for one in about]
        sheets = []
        for name in names[: most or None]:
            sheet = book.get_sheet_by_name(name)
            for count, limit, what in ((sheet.height, rows, "rows"), (sheet.width, columns, "columns")):
                if count > limit:
                    return {"error": f"{count} {what}: more than {limit} are not read", "code": f"limits.{what}"}
            first = (sheet.start or (0, 0))[0] + 1
            cells = enumerate(([_text(cell) for cell in row] for row in sheet.iter_rows()), first)
            sheets.append((name, [(number, row) for number, row in cells if any(row)]))
    except CalamineError as error:
        return {"error": f"the workbook cannot be read, it may be damaged ({error})", "code": "tabular.workbook"}
    if not sheets:
        return {"error": "a workbook without a sheet of cells", "code": "tabular.workbook"}
    return {"sheets": sheets}


def _text(cell: object) -> str:
    whole = isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15
    return str(int(cell) if whole else cell).strip()  # type: ignore[call-overload]


if __name__ == "__main__":
    most, rows, columns, memory = map(int, sys.argv[2:])
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    except (ImportError, ValueError, OSError):  # no such limit on this system: the time limit stays
        pass
    json.dump(_sheets(sys.argv[1], most, rows, columns), sys.stdout)

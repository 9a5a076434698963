"""Read the sheets of a workbook (.xlsx, .xls, .xlsb, .ods) as rows of text, by calamine in a child process.

A workbook of a few kilobytes may unpack to gigabytes, or contain a cell so far out that the grid up to it exceeds any
memory; the process that reads it then crashes. Therefore a child process with limits on memory and time reads it. The
declared sizes are checked before unpacking, and the rows are passed on in chunks. This file is also the program of the
child, which imports no other module of the package.
"""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import suppress
from itertools import chain, islice
from typing import BinaryIO

MEMORY = 400_000_000  # bytes of address space of the child
_SECONDS = 30.0
_TOO_LARGE, _NO_BOOK = 3, 4  # exit statuses of the child; after the first, its message begins with the limit's code
_PARTS = ("[Content_Types].xml", "mimetype", "content.xml", "xl/workbook.xml")  # a zipped workbook has one of them


def read_workbook(file: BinaryIO) -> list[tuple[str, list[tuple[int, list[str]]]]]:
    """Return (name, [(row number from 1, cells)]) for each sheet of cells, in the order of their tabs, without empty
    rows. A hidden sheet has no rows and is named as hidden, unless all are.

    Raises:
        InputError: no workbook, or damaged ("tabular.workbook"); another archive ("tabular.archive"); beyond a limit
            ("limits.bytes", "limits.unpacked", "limits.cells", "limits.text", "limits.memory", "limits.time").
    """
    from cavirheo.errors import InputError, without_invisible
    from cavirheo.io import limits

    arguments = (MEMORY, limits.SHEET, limits.UNPACKED, limits.WORKBOOK_CELLS, limits.TEXT)
    command = [sys.executable, "-P", __file__, *map(str, arguments)]
    try:
        child = subprocess.run(command, stdin=file, capture_output=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        raise InputError(f"reading it takes more than {_SECONDS:.0f} s; save it as CSV", "limits.time") from None
    if child.returncode != 0:
        raise InputError(*_problem(child))
    sheets: list[tuple[str, list[tuple[int, list[str]]]]] = []
    for number, texts in chain.from_iterable(map(json.loads, child.stdout.splitlines())):
        texts = [text if text.isprintable() else without_invisible(text)[0] for text in texts]
        if number:
            sheets[-1][1].append((number, texts))
        else:
            sheets.append((texts[0], []))
    return sheets


def _problem(child: subprocess.CompletedProcess[bytes]) -> tuple[str, str]:
    answer = child.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    if child.returncode == _NO_BOOK:
        advice = "unpack it, and give the files or the folder that holds them"
        if ".npy" in answer:
            advice = "save one array: numpy.save('shot.npy', numpy.stack([t, R]))"
        return f"a zip archive of {answer}; no workbook: {advice}", "tabular.archive"
    if child.returncode == _TOO_LARGE:
        code, _, message = answer.partition(" ")
        return f"the workbook {message} are not read; save the table alone as CSV", code
    if child.returncode < 0 or b"emory" in child.stderr:  # "MemoryError" or "memory allocation ... failed"
        return "the workbook takes more memory than is given to it; save it as CSV", "limits.memory"
    return f"the workbook cannot be read, it may be damaged ({answer[:300]})", "tabular.workbook"


def _write_rows(max_bytes: int, max_unpacked: int, max_cells: int, max_text: int) -> None:
    """Print the sheets, in the child: lines of JSON, each a list of (row number, cells); (0, [name]) begins a sheet."""
    import zipfile

    from python_calamine import CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

    file = sys.stdin.buffer
    file.seek(0)
    with suppress(zipfile.BadZipFile), zipfile.ZipFile(file) as archive:
        names = archive.namelist()
        if not set(names) & set(_PARTS):
            listed = ascii(", ".join(names[:3])[:100])[1:-1]
            print(f"{len(names)} files, {listed}", file=sys.stderr)
            sys.exit(_NO_BOOK)
        declared = sum(part.file_size for part in archive.infolist())
        _exit_above(declared, max_unpacked, "limits.unpacked unpacks to", "bytes")
    _exit_above(file.seek(0, 2), max_bytes, "limits.bytes has", "bytes")
    file.seek(0)
    book = CalamineWorkbook.from_filelike(file)
    sheets = [sheet for sheet in book.sheets_metadata if sheet.typ == SheetTypeEnum.WorkSheet]
    if not sheets:
        raise ValueError("no sheet of cells")
    hidden = [sheet.name for sheet in sheets if sheet.visible != SheetVisibleEnum.Visible]
    hidden = hidden if len(hidden) < len(sheets) else []
    written = total = 0
    for name in (sheet.name for sheet in sheets):
        print(json.dumps([(0, [f"{name} (hidden)" if name in hidden else name])]))
        if name in hidden:
            continue
        sheet = book.get_sheet_by_name(name)
        total += sheet.height * sheet.width
        _exit_above(total, max_cells, "limits.cells has", "cells")
        rows = enumerate(([_text(cell) for cell in row] for row in sheet.iter_rows()), (sheet.start or (0, 0))[0] + 1)
        while chunk := list(islice(rows, 100)):
            line = json.dumps([(number, filled) for number, filled in chunk if any(filled)])
            written += len(line)
            _exit_above(written, max_text, "limits.text holds", "characters")
            print(line)


def _exit_above(count: int, limit: int, beginning: str, unit: str) -> None:
    if count > limit:
        print(f"{beginning} {count} {unit}: more than {limit}", file=sys.stderr)
        sys.exit(_TOO_LARGE)


def _text(cell: object) -> str:
    whole = isinstance(cell, float) and cell.is_integer() and abs(cell) < 1e15
    return str(int(cell) if whole else cell).strip()  # type: ignore[call-overload]


if __name__ == "__main__":
    _memory, *_limits = map(int, sys.argv[1:])
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system: only the time limit holds
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (_memory, _memory))
    _write_rows(*_limits)

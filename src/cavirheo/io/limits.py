"""How much of a file is read: more than any recording holds, and little enough for seconds and a gigabyte.

A damaged or hostile file may declare any shape, unpack to anything, or point at other files. Each limit is checked
before the memory is taken.
"""

from __future__ import annotations

from cavirheo.errors import require

SAMPLES = 5_000_000  # numbers in all arrays of one file
CURVES = 5_000
ROWS = 1_000_000
COLUMNS = 1_000
LINE = 100_000  # characters
FILE = 4_000_000_000  # bytes of any file
TEXT = 100_000_000  # bytes of a text file
SHEET = 60_000_000  # bytes of a workbook
UNPACKED = 150_000_000  # bytes of all parts of a workbook
WORKBOOK_CELLS = 1_000_000  # of the sheets of a workbook that are read, empty ones included
INFLATED = 500_000_000  # bytes of all variables of a .mat, unpacked


def few(count: int, most: int, what: str) -> None:
    """Raises InputError where there are more of them than are read: "limits.lines" for lines, and so on."""
    split = f"more than {most} are not read; split the file"
    require(count <= most, f"{count} {what}: {split}", f"limits.{what.split()[0]}")

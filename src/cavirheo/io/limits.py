"""Limits on what is read from a file: above any real recording, and low enough for some seconds and a gigabyte.

A damaged or hostile file may declare any shape, unpack to any size, or point to other files. Each limit is checked
before the memory is allocated.
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
WORKBOOK_CELLS = 1_000_000  # cells of the sheets that are read of a workbook, empty cells included
MEMORY = 1_000_000_000  # bytes that reading a workbook or a file of MATLAB may take
SECONDS = 30.0  # for reading it


def check(count: int, limit: int, items: str) -> None:
    """Raise InputError if count > limit. Its code has the first word of `items`: "limits.lines" for lines."""
    split = f"more than {limit} are not read; split the file"
    require(count <= limit, f"{count} {items}: {split}", f"limits.{items.split()[0]}")

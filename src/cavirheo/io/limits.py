"""How much of a file is read: more than any recording holds, and little enough for seconds and a gigabyte.

A damaged or hostile file may declare any shape, unpack to anything, or point at other files. Each limit is checked
before the memory is taken.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import prod
from typing import Any

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


def arrays(items: Iterable[Any]) -> None:
    """HDF5 datasets that are about to be read. Raises InputError: they declare more samples than are read, chunks as
    large, or no shape at all, or take their numbers from other files."""
    total = 0
    for item in items:
        name = as_text(item.name)
        require(item.shape is not None, f"{name} has no shape: it holds nothing", "limits.no_shape")
        elsewhere = f"{name} takes its numbers from another file; copy them into this one"
        require(not (item.external or item.is_virtual), elsewhere, "limits.elsewhere")
        total += prod(item.shape)
        for what, size in (("chunks", prod(item.chunks or (0,))), ("shape", total)):
            declared = f"{name} declares the {what} {getattr(item, what)}"
            require(size <= SAMPLES, f"{declared}: more than {SAMPLES} samples are not read", f"limits.{what}")


def as_text(name: str | bytes) -> str:
    """The name of a group or dataset; h5py gives bytes where it is not UTF-8, and it is read as Latin-1."""
    return name.decode("latin-1") if isinstance(name, bytes) else name


def local_item(group: Any, name: str | bytes) -> Any:
    """group[name], None if there is nothing. Raises InputError: it would be read from another file."""
    import h5py

    links, key = group.id.links, name if isinstance(name, bytes) else name.encode()  # get(getlink=True) wants UTF-8
    link = links.exists(key) and links.get_info(key).type == h5py.h5l.TYPE_EXTERNAL
    elsewhere = f"{as_text(name)} is a link to another file; copy them into this one"
    require(not link, elsewhere, "limits.elsewhere")
    return group.get(name)

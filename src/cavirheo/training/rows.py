"""Rows of a training set in a file, read when they are asked for: a set may be larger than the memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

BLOCK = 10_000  # rows that are read at once


class StoredRows:
    """(n, width) numbers of one kind, appended block by block to a nameless file in `folder`, which ends with this
    object; an index gives an array, as it does of an array."""

    def __init__(self, folder: Path, width: int, kind: DTypeLike) -> None:
        self.kind: np.dtype[Any] = np.dtype(kind)
        self.width: int = width
        self.count: int = 0
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115  it is closed when nobody has these rows any more

    def append(self, rows: NDArray[Any]) -> None:
        """Rows (m, width) behind the others. Raises OSError: the disk is full."""
        self._file.write(np.ascontiguousarray(rows, self.kind).tobytes())
        self._file.flush()
        self.count += len(rows)

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: Any) -> NDArray[Any]:
        # mapped anew each time: what was read does not stay in this process
        return np.array(np.memmap(self._file, self.kind, "r", shape=(self.count, self.width))[index])


def blocks(rows: NDArray[Any] | StoredRows) -> Iterator[NDArray[Any]]:
    """All rows, a block after the other."""
    for start in range(0, len(rows), BLOCK):
        yield rows[start : start + BLOCK]

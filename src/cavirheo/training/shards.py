"""Files of a training set filled by an executor: each takes its name when all of its curves are there."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import h5py

from cavirheo.parallel import Executor
from cavirheo.writing.document import whole

Rows = TypeVar("Rows")


@dataclass(frozen=True)
class Survey:
    """What the files of a training set hold, read one after the other; `lacking`: files that are still to be made."""

    made_by: str  # version of cavirheo
    seed: int
    total: int  # curves when it is complete
    about: Sequence[str]  # lines: what it is of
    statuses: Mapping[str, int]  # curves that are there, by how their simulation ended
    files: int
    lacking: int
    size: int  # bytes
    sha256: str  # of the SHA-256 of all files in their order

    @property
    def curves(self) -> int:
        """How many are there, failed ones included."""
        return sum(self.statuses.values())


def size_and_sha256(paths: Sequence[Path]) -> tuple[int, str]:
    """(bytes, SHA-256 of the SHA-256) of files."""
    whole = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            whole.update(hashlib.file_digest(file, "sha256").digest())
    return sum(path.stat().st_size for path in paths), whole.hexdigest()


def fill(
    todo: Mapping[Path, range],
    chunk: int,
    simulate: Callable[[range], Rows],
    write: Callable[[Path, range, list[Rows]], None],
    executor: Executor,
    advance: Callable[[int], None],
) -> None:
    """`write(path, block, parts)` for each path, where parts are what `simulate` gave for the chunks of its block.

    No more is held than the files that are begun. `simulate` may be sent to another machine: a function of a module, or
    a `partial` of one.
    """
    units = [
        (path, block[k : k + chunk]) for path, block in todo.items() for k in range(0, len(block), chunk)
    ]  # fmt: skip
    begun: dict[Path, dict[int, Rows]] = {}
    with closing(executor.flow(simulate, [unit for _, unit in units])) as flow:
        for index, rows in flow:
            path, unit = units[index]
            parts = begun.setdefault(path, {})
            parts[unit.start] = rows
            advance(len(unit))
            block = todo[path]
            if len(parts) == -(-len(block) // chunk):
                write(path, block, [parts[start] for start in sorted(parts)])
                del begun[path]


def write_hdf5(path: Path, attributes: Mapping[str, Any], columns: Mapping[str, Mapping[str, Any]]) -> None:
    """A file of these attributes and datasets (by name, as `create_dataset` takes them), whole or not at all.

    It is made in memory: on a full disk HDF5 itself would end the process. Nothing in it depends on the date.
    """
    with h5py.File(path.name, "w", driver="core", backing_store=False, track_order=False) as file:
        file.attrs.update(attributes)
        for name, how in columns.items():
            file.create_dataset(name, track_times=False, **how)
        file.flush()
        content = file.id.get_file_image()
    with whole(path) as temporary:
        temporary.write_bytes(content)

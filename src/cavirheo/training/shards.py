"""Files of a training set: how curves lie in them, written whole or not at all, and read within limits."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from math import prod
from pathlib import Path
from reprlib import repr as short
from typing import Any, NamedTuple, TypeVar

import h5py
import numpy as np

from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.parallel import Executor
from cavirheo.training.recipe import difference
from cavirheo.writing.document import whole

Rows = Mapping[str, Any]  # columns (curves, ...) by name
Part = TypeVar("Part")
PACKING: Any = {"compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}  # with a checksum


@dataclass(frozen=True)
class Layout:
    """How the curves of a problem are simulated, and how they lie in files.

    Attributes:
        problem: as JSON.
        per_file: curves in a file.
        columns: kind of the numbers and shape of a row of each column; "status" (texts) may be one.
        simulate: columns of curves (seed, block of them); without a "status" failed ones are left out.
        summary: what the curves are of, in lines.
    """

    problem: str
    per_file: int
    columns: Mapping[str, tuple[Any, tuple[int, ...]]]
    simulate: Callable[[int, range], Rows]
    summary: Sequence[str]

    @property
    def curve_bytes(self) -> int:
        """Bytes of a curve that is not packed."""
        return sum(np.dtype(kind).itemsize * prod(shape) for kind, shape in self.columns.values()) + 8

    def write(self, head: Mapping[str, Any], path: Path, block: range, parts: Sequence[Rows]) -> None:
        """The file of the curves `block`, of what `simulate` gave for its parts."""
        datasets: dict[str, dict[str, Any]] = {}
        for name, (kind, _) in self.columns.items():
            values = np.concatenate([np.asarray(part[name], kind) for part in parts])
            how: dict[str, Any] = {"dtype": h5py.string_dtype()} if name == "status" else PACKING
            datasets[name] = {"data": values} | how
        failed = {} if "status" in datasets else {"failed": len(block) - len(values)}
        write_hdf5(path, {**head, "start": block.start, **failed}, datasets)


class FileKind(NamedTuple):
    """Beginning of the files' names, the attribute that holds the problem, and the layout of such a problem."""

    prefix: str
    attribute: str
    layout: Callable[[Any], Layout]

    def name(self, number: int) -> str:
        """Of a file, counted from 0."""
        return f"{self.prefix}-{number:05d}.h5"


@dataclass(frozen=True)
class Shard:
    """A file of a training set. head: its attributes. rows: its columns. failed: curves that it leaves out."""

    head: Mapping[str, Any]
    layout: Layout
    rows: Rows
    failed: int

    @cached_property
    def statuses(self) -> Counter[str]:
        """How many curves ended in which way."""
        if "status" in self.rows:
            return Counter(self.rows["status"].tolist())
        good = len(next(iter(self.rows.values())))
        return +Counter({"ok": good, "failed, left out": self.failed})


def read_shard(path: Path, kind: FileKind, expected: Mapping[str, Any] | None = None) -> Shard:
    """A file of a training set.

    Raises:
        InputError: not readable, attributes other than expected, or columns that are not what these say.
    """
    try:
        require(path.is_file(), "it is no file", "dataset.unreadable")  # a pipe would be waited for
        with h5py.File(path, "r") as file:
            types = {kind.attribute: str, "seed": int, "total": int, "made_by": str}
            head: dict[str, Any] = {key: np.asarray(file.attrs[key]).item() for key in (*types, "start")}
            for key, of in types.items():
                require(type(head[key]) is of, f"{key} is {short(head[key])}", "dataset.unreadable")
            for key, value in (expected or {}).items():
                if head[key] != value:
                    both = [json.loads(text) if key == kind.attribute else {key: text} for text in (head[key], value)]
                    message = f"made with another {key} ({difference(*both) or 'other keys'})"
                    raise InputError(f"{message}; use an empty folder or its settings", f"dataset.another_{key}")
            layout, start = kind.layout(json.loads(head[kind.attribute])), head["start"]
            failed = 0 if "status" in layout.columns else int(file.attrs["failed"])
            count = min(layout.per_file, head["total"] - start) - failed
            items = {name: limits.local_item(file, name) for name in layout.columns}
            limits.arrays(items.values())
            shapes = {name: (item.dtype, item.shape) for name, item in items.items()}
            needed = {name: (np.dtype(of), (count, *shape)) for name, (of, shape) in layout.columns.items()}
            fine = shapes == needed and path.name == kind.name(start // layout.per_file)
            require(fine, f"it holds {shapes} from curve {start}, not {needed}", "dataset.shape")
            rows = {name: np.array((item.asstr() if name == "status" else item)[:]) for name, item in items.items()}
        if "status" in rows:
            rows["status"] = rows["status"].astype(str)
            ok = rows["status"] == "ok"
            finite = np.isfinite(rows["radius"][ok]).all() and np.isfinite(rows["theta"][ok]).all()
            require(finite, "values of its good curves are not finite", "dataset.values")
        return Shard(head, layout, rows, failed)
    except InputError as error:
        hint = "" if error.code.startswith("dataset.another") else "; delete it and generate again"
        raise InputError(f"{path}: {error}{hint}", error.code) from error
    except Exception as error:  # libraries raise nearly anything of a damaged file
        message = f"{path} cannot be read as a training set ({error}); delete it and generate again"
        raise InputError(message, "dataset.unreadable") from error


def fill(
    todo: Mapping[Path, range],
    chunk: int,
    simulate: Callable[[range], Part],
    write: Callable[[Path, range, list[Part]], None],
    executor: Executor,
    advance: Callable[[int], None],
) -> None:
    """`write(path, block, parts)` for each path, where parts are what `simulate` gave for the chunks of its block.

    No more is held than the files that are begun. `simulate` may be sent to another machine: a function of a module, or
    a `partial` of one.
    """
    units = [(path, block[k : k + chunk]) for path, block in todo.items() for k in range(0, len(block), chunk)]
    unfinished: dict[Path, dict[int, Part]] = {}
    with closing(executor.flow(simulate, [unit for _, unit in units])) as flow:
        for index, rows in flow:
            path, unit = units[index]
            parts = unfinished.setdefault(path, {})
            parts[unit.start] = rows
            advance(len(unit))
            block = todo[path]
            if len(parts) == -(-len(block) // chunk):
                write(path, block, [parts[start] for start in sorted(parts)])
                del unfinished[path]


def write_hdf5(path: Path, attributes: Mapping[str, Any], datasets: Mapping[str, Mapping[str, Any]]) -> None:
    """A file of these attributes and datasets (by name, as `create_dataset` takes them), whole or not at all.

    It is made in memory: on a full disk HDF5 itself would end the process. Nothing in it depends on the date.
    """
    with h5py.File(path.name, "w", driver="core", backing_store=False, track_order=False) as file:
        file.attrs.update(attributes)
        for name, how in datasets.items():
            file.create_dataset(name, track_times=False, **how)
        file.flush()
        content = file.id.get_file_image()
    with whole(path) as temporary:
        temporary.write_bytes(content)

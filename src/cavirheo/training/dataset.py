"""Training sets: simulated curves of a problem in HDF5 files, whose bytes do not depend on how they were made.

Curve i depends on (problem, seed, i) alone and a file holds a fixed range of i: processes or machines can share the
work, and a killed run can be continued. A file gets its name when it is complete. Its size is checked before it is
read. In a set on a grid of times a failed simulation keeps its row (NaN where nothing was computed) with the solver's
message, because without these rows the distribution of the parameters would not be the prior.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from itertools import islice
from math import prod
from pathlib import Path
from reprlib import repr as short
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError, require, sha256
from cavirheo.io import hdf5
from cavirheo.parallel import Executor, Threads
from cavirheo.prior import TrainingProblem, uniforms
from cavirheo.training import trajectories
from cavirheo.training.recipe import difference
from cavirheo.writing.document import atomic_file, writable_folder
from cavirheo.writing.terminal import progress_bar

Indices = NDArray[np.int64]
Columns = Mapping[str, Any]  # arrays by name, a row per curve

SHARD, TRAJECTORIES = 500, 2000  # curves in a file of a set on a grid, and of a set for an emulator
UNIT_SIZE = 3 * trajectories.BLOCK  # curves of a unit of work, which takes about half a second
SPLIT_STREAM = 1  # not the stream of the prior: with equal seeds, a parameter would decide the split
FILTERS: Any = {"compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}  # with a checksum


@dataclass(frozen=True)
class Layout:
    """How the curves of a problem are simulated, and how they lie in files."""

    prefix: str  # beginning of the names of the files
    attribute: str  # name of the attribute of a file that holds the problem
    problem: str  # the problem as JSON
    per_file: int  # curves in a file
    columns: Mapping[str, tuple[Any, tuple[int, ...]]]  # dtype and shape of a row; texts in "status"
    simulate: Callable[[int, range], Columns]  # from (seed, block); without a column "status" failed curves have no row
    summary: Sequence[str]  # lines that describe what is simulated

    def name(self, number: int) -> str:
        """Name of a file; files are numbered from 0."""
        return f"{self.prefix}-{number:05d}.h5"

    def check_space(self, n: int, free: int, place: str) -> None:
        """Raises InputError: n uncompressed curves need more bytes than are free."""
        need = n * sum((np.dtype(kind).itemsize * prod(shape) for kind, shape in self.columns.values()), 8)
        message = f"the set ({n} curves) needs {need / 1e9:.3g} GB {place}, and there are {free / 1e9:.3g} GB"
        require(need <= free, f"{message}: ask for fewer curves or frames, or for a part with --shard", "dataset.size")

    def write(self, head: Mapping[str, Any], path: Path, block: range, parts: Sequence[Columns]) -> None:
        """Write the file of the curves `block`, completely or not at all; parts: outputs of `simulate` for its parts.

        The file is made in memory, because HDF5 would end the process on a full disk. It does not contain the date.
        """
        values = {
            name: np.concatenate([np.asarray(part[name], kind) for part in parts])
            for name, (kind, _) in self.columns.items()
        }
        failed = {} if "status" in values else {"failed": len(block) - len(values["inputs"])}
        with h5py.File(path.name, "w", driver="core", backing_store=False, track_order=False) as file:
            file.attrs.update({**head, "start": block.start, **failed})
            for name, column in values.items():
                options: Any = {"dtype": h5py.string_dtype()} if name == "status" else FILTERS
                file.create_dataset(name, data=column, track_times=False, **options)
            file.flush()
            content = file.id.get_file_image()
        with atomic_file(path) as temporary:
            temporary.write_bytes(content)


def layout_of(problem: TrainingProblem | Mapping[str, Any]) -> Layout:
    """Layout of curves on the problem's grid of times (theta: in the prior's scale, radius: over the reference R_max),
    or of the trajectories for an emulator, without failed ones, 2.2 kB each."""
    if isinstance(problem, TrainingProblem):
        prior, frames = problem.prior, problem.grid.frames
        ranges = zip(prior.names, prior.low, prior.high, strict=True)
        summary = [f"curves of {frames} frames: {problem.material_name} in {problem.medium.name}"]
        summary += [f"{name}: {low:g} to {high:g}" for name, low, high in ranges]
        radius = (np.float32, (frames,))
        columns = {"theta": (np.float64, (len(prior.names),)), "radius": radius, "status": (object, ())}
        text = json.dumps(problem.to_dict())
        return Layout("shard", "problem", text, SHARD, columns, partial(_simulated, problem), summary)
    summary = [f"trajectories for an emulator, at {problem['nodes']} nodes each"]
    for kind in ("elastic", "viscous"):
        shares = ", ".join(f"{law or 'none'} {share:.0%}" for law, share in problem[kind].items())
        summary.append(f"{kind} part: {shares}")
    text, simulate = json.dumps(problem, sort_keys=True), trajectories.simulated
    return Layout("trajectories", "domain", text, TRAJECTORIES, trajectories.COLUMNS, simulate, summary)


def _own_domain(domain: Mapping[str, Any]) -> Mapping[str, Any]:
    """The domain of a file. Raises InputError: it is not that of this version."""
    change = difference(domain, trajectories.DOMAIN)
    if change:
        raise InputError(f"made with another domain ({change}); use an empty folder", "dataset.another_domain")
    return trajectories.DOMAIN


def _simulated(problem: TrainingProblem, seed: int, block: range) -> Columns:
    theta = problem.prior.sample(block, seed)
    runs = problem.simulate_many(theta, workers=1)
    radius = np.array([run.radius for run in runs], dtype=float) / problem.reference_max_radius
    finite = np.isfinite(radius).all(axis=1)
    status = np.array([run.status for run in runs], dtype=object)
    status[(status == "ok") & ~finite] = "the simulation ended well but its radius is not finite"
    return {"theta": theta, "radius": radius.astype(np.float32), "status": status}


@dataclass(frozen=True)
class GenerateSummary:
    """Summary of a call of `generate`. failures: number of failed curves by status, in old and new files together."""

    curves: int
    written: int  # files that were written
    skipped: int  # files that were complete already
    failures: dict[str, int]
    seconds: float
    simulated: int  # curves that were simulated in this call


@dataclass(frozen=True)
class Survey:
    """Summary of the files of a training set, which are read one by one; missing_files: number still to be made."""

    made_by: str  # version of cavirheo
    seed: int
    total: int  # curves of the complete set
    summary: Sequence[str]  # lines that describe the set
    statuses: Mapping[str, int]  # number of curves by status of the simulation
    files: int
    missing_files: int
    size: int  # bytes
    sha256: str  # of the SHA-256 digests of all files in their order

    @property
    def curves(self) -> int:
        """Number of simulated curves, failed ones included."""
        return sum(self.statuses.values())


@dataclass(frozen=True, eq=False)
class Dataset:
    """A complete training set.

    Attributes:
        problem: prior and physics of the curves.
        seed: seed of the draws from the prior.
        made_by: version of cavirheo that made the set.
        theta: (curves, parameters) true values in the prior's scale.
        radius: (curves, frames) R/R_max at the reference R_max.
        status: (curves,) "ok" or the reason of the failure.
        sha256: of the SHA-256 digests of all files in their order.
    """

    problem: TrainingProblem
    seed: int
    made_by: str
    theta: Floats
    radius: NDArray[np.float32]
    status: NDArray[np.str_]
    sha256: str

    @property
    def ok(self) -> Bools:
        """Mask (curves,) of the simulations that succeeded."""
        return self.status == "ok"

    @property
    def failures(self) -> dict[str, int]:
        """Number of failed curves by status."""
        return dict(Counter(self.status[~self.ok].tolist()))

    def truth(self, names: Sequence[str]) -> Floats:
        """Columns of theta (curves, names) for the parameters `names`."""
        return self.theta[:, [self.problem.prior.names.index(name) for name in names]]

    def split(self, seed: int) -> dict[str, Indices]:
        """Indices of the usable curves of "train" (80 %), "validation" (10 %) and "test" (10 %).

        The part of curve i depends on (curves, seed, i), not on which curves failed.
        """
        n = len(self.theta)
        order = np.argsort([uniforms(seed, i, 1, SPLIT_STREAM)[0] for i in range(n)], kind="stable")
        parts = np.split(order, [round(0.8 * n), round(0.9 * n)])
        return {name: part[self.ok[part]] for name, part in zip(("train", "validation", "test"), parts, strict=True)}


def generate(
    problem: TrainingProblem | Mapping[str, Any],
    n: int,
    out_dir: str | Path,
    *,
    seed: int = 0,
    workers: int | None = None,
    executor: Executor | None = None,
    shard: tuple[int, int] = (1, 1),
    progress: bool = True,
) -> GenerateSummary:
    """Simulate curves 0..n-1 into `out_dir`; shard = (i, N) makes the i-th of N parts, i from 1.

    executor: where the curves are simulated; default: on `workers` threads of this machine.
    Complete files are kept. Nothing in a file depends on `workers`, `executor`, `shard` or the date.

    Raises InputError: the folder holds files of another problem, seed, number of curves or version.
    """
    layout, (part, parts) = layout_of(problem), shard
    message = f"need n >= 1 and a shard i/N with 1 <= i <= N, got n = {n} and {part}/{parts}"
    require(n >= 1 and 1 <= part <= parts, message, "dataset.shard")
    head = {layout.attribute: layout.problem, "seed": seed, "total": n, "made_by": version("cavirheo")}
    began = time.perf_counter()
    with writable_folder(out_dir) as folder:
        size, present = layout.per_file, sorted(folder.glob(f"{layout.prefix}-*.h5"))
        starts = [read_shard(path, head).head["start"] for path in present]
        missing = n // parts - size * sum(start // size % parts == part - 1 for start in starts)
        layout.check_space(missing, shutil.disk_usage(folder).free, f"on the disk of {folder}")
        blocks = range(0, n, size)[part - 1 :: parts]
        files = {folder / layout.name(start // size): range(n)[start : start + size] for start in blocks}
        todo = {path: block for path, block in files.items() if not path.exists()}
        simulated, write = sum(map(len, todo.values())), partial(layout.write, head)
        with progress_bar("simulating", simulated, visible=progress) as advance:
            fill_files(todo, partial(layout.simulate, seed), write, executor or Threads(workers), advance)
        statuses = sum((read_shard(path, head).statuses for path in files), Counter[str]())
    failures = {status: count for status, count in statuses.items() if status != "ok"}
    curves, seconds = sum(map(len, files.values())), time.perf_counter() - began
    return GenerateSummary(curves, len(todo), len(files) - len(todo), failures, seconds, simulated)


def load(data_dir: str | Path) -> Dataset:
    """Load the training set in a folder.

    Raises InputError: no files, a missing or damaged file, files of different sets, or too little memory.
    """
    head, columns = _load(data_dir, "shard", {})
    problem = TrainingProblem.from_dict(json.loads(head["problem"]))
    return Dataset(problem, head["seed"], head["made_by"], **columns, sha256=_digest(_paths(data_dir, "shard")))


def load_trajectories(data_dir: str | Path) -> tuple[Columns, dict[str, Any]]:
    """Load the trajectories for an emulator from a folder, and the origin of the set.

    Raises InputError: as `load`, or the set is of another domain or version.
    """
    head, columns = _load(data_dir, "trajectories", {"made_by": version("cavirheo")})
    digest = _digest(_paths(data_dir, "trajectories"))
    return columns, {"n": head["total"], "seed": head["seed"], "sha256": digest}


def survey(data_dir: str | Path) -> Survey:
    """Survey of a set that may be incomplete. Raises InputError: no files, damaged files, or files of several sets."""
    paths = _paths(data_dir, "trajectories" if any(Path(data_dir).glob("trajectories-*.h5")) else "shard")
    statuses = Counter[str]()
    for shard in _shards(paths, {}):
        statuses.update(shard.statuses)
    head, size = shard.head, sum(path.stat().st_size for path in paths)
    missing_files = -(-head["total"] // shard.layout.per_file) - len(paths)
    origin = head["made_by"], head["seed"], head["total"], shard.layout.summary
    return Survey(*origin, dict(statuses), len(paths), missing_files, size, _digest(paths))


def _load(data_dir: str | Path, prefix: str, expected: Mapping[str, Any]) -> tuple[Mapping[str, Any], dict[str, Any]]:
    """The attributes and all columns of a complete set."""
    paths = _paths(data_dir, prefix)
    first = read_shard(paths[0], expected)
    layout, total, present = first.layout, first.head["total"], {path.name for path in paths}
    count = len(range(0, total, layout.per_file))
    missing = list(islice((name for name in map(layout.name, range(count)) if name not in present), 3))
    lacking = f"{data_dir}: {count - len(paths)} of {count} files are missing ({', '.join(missing)}, ...)"
    require(not missing, f"{lacking}; run the same `cavirheo generate` again to add them", "dataset.incomplete")
    if hasattr(os, "sysconf"):  # all but Windows
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        layout.check_space(2 * total, memory, "of memory")  # the parts and the joined arrays
    shards = list(_shards(paths, expected))
    columns = {name: np.concatenate([shard.columns[name] for shard in shards]) for name in layout.columns}
    curves = len(next(iter(columns.values())))
    require(curves > 0, f"{data_dir}: every simulation of this set failed", "dataset.none")
    return first.head, columns


def _digest(paths: Sequence[Path]) -> str:
    """SHA-256 of the SHA-256 digests of files, in their order."""
    return hashlib.sha256(b"".join(bytes.fromhex(sha256(path)) for path in paths)).hexdigest()


def _paths(data_dir: str | Path, prefix: str) -> list[Path]:
    """The files of a set in their order. Raises InputError: there is none, or a name is not that of a file of a set."""
    paths = sorted(Path(data_dir).glob(f"{prefix}-*.h5"))
    message = f"{data_dir} holds no training set ({prefix}-*.h5); make one with `cavirheo generate`"
    require(bool(paths), message, "dataset.none")
    foreign = [path.name for path in paths if not re.fullmatch(r"\d{5,}", path.stem.removeprefix(f"{prefix}-"))]
    require(not foreign, f"{data_dir}: {', '.join(foreign[:3])} is no part of this set; remove it", "dataset.foreign")
    return paths


def _shards(paths: Sequence[Path], expected: Mapping[str, Any]) -> Iterator[Shard]:
    """Read the files of one set one by one. Raises InputError: a file belongs to another set."""
    for path in paths:
        shard = read_shard(path, expected)
        expected = {key: shard.head[key] for key in (shard.layout.attribute, "seed", "total", "made_by")}
        yield shard


class Shard(NamedTuple):
    """A file of a training set. head: its attributes. statuses: number of curves by status."""

    head: Mapping[str, Any]
    layout: Layout
    columns: Columns
    statuses: Counter[str]


def read_shard(path: Path, expected: Mapping[str, Any]) -> Shard:
    """Read a file of a set. Raises InputError: it is damaged, or its attributes or columns are not those expected."""
    try:
        require(path.is_file(), "it is no file", "dataset.unreadable")  # reading a pipe would wait for ever
        with h5py.File(path, "r") as file:
            attribute = "domain" if "domain" in file.attrs else "problem"
            types = {attribute: str, "seed": int, "total": int, "made_by": str}
            head: dict[str, Any] = {key: np.asarray(file.attrs[key]).item() for key in (*types, "start")}
            for key, kind in types.items():
                require(type(head[key]) is kind, f"{key} is {short(head[key])}", "dataset.unreadable")
            for key, value in expected.items():
                if head[key] != value:
                    both = [json.loads(text) if key == attribute else {key: text} for text in (head[key], value)]
                    message = f"made with another {key} ({difference(*both) or 'other keys'})"
                    raise InputError(f"{message}; use an empty folder or its settings", f"dataset.another_{key}")
            problem_of: Callable[[Any], Any] = _own_domain if attribute == "domain" else TrainingProblem.from_dict
            layout, start = layout_of(problem_of(json.loads(head[attribute]))), head["start"]
            failed = 0 if "status" in layout.columns else int(file.attrs["failed"])
            count = min(layout.per_file, head["total"] - start) - failed
            items = {name: hdf5.local_item(file, name) for name in layout.columns}
            hdf5.check_sizes(items.values())
            shapes = {name: (item.dtype, item.shape) for name, item in items.items()}
            needed = {name: (np.dtype(kind), (count, *shape)) for name, (kind, shape) in layout.columns.items()}
            fine = shapes == needed and path.name == layout.name(start // layout.per_file)
            require(fine, f"it holds {shapes} from curve {start}, not {needed}", "dataset.shape")
            columns = {name: np.array((item.asstr() if name == "status" else item)[:]) for name, item in items.items()}
        ok: Any = slice(None)
        statuses = Counter({"ok": count, "failed, left out": failed})
        if "status" in columns:
            columns["status"] = columns["status"].astype(str)
            ok, statuses = columns["status"] == "ok", Counter(columns["status"].tolist())
        finite = all(np.isfinite(column[ok]).all() for name, column in columns.items() if name != "status")
        require(finite, "values of its good curves are not finite", "dataset.values")
        return Shard(head, layout, columns, +statuses)
    except InputError as error:
        hint = "" if error.code.startswith("dataset.another") else "; delete it and generate again"
        raise InputError(f"{path}: {error}{hint}", error.code) from error
    except Exception as error:  # libraries raise nearly any error for a damaged file
        message = f"{path} cannot be read as a training set ({error}); delete it and generate again"
        raise InputError(message, "dataset.unreadable") from error


def fill_files(
    todo: Mapping[Path, range],
    simulate: Callable[[range], Columns],
    write: Callable[[Path, range, list[Columns]], None],
    executor: Executor,
    advance: Callable[[int], None],
) -> None:
    """Call `write(path, block, parts)` for each path; parts are the outputs of `simulate` for chunks of its block.

    Only the chunks of unfinished files are in memory. `simulate` must be a function of a module, or a `partial` of one,
    because it may be sent to another machine.
    """
    units = [(path, block[k : k + UNIT_SIZE]) for path, block in todo.items() for k in range(0, len(block), UNIT_SIZE)]
    unfinished: dict[Path, dict[int, Columns]] = {}
    with closing(executor.map_unordered(simulate, [unit for _, unit in units])) as flow:
        for index, rows in flow:
            path, unit = units[index]
            parts = unfinished.setdefault(path, {})
            parts[unit.start] = rows
            advance(len(unit))
            block = todo[path]
            if len(parts) == -(-len(block) // UNIT_SIZE):
                write(path, block, [parts[start] for start in sorted(parts)])
                del unfinished[path]

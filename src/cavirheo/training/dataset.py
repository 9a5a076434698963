"""Training sets: simulated curves of a problem in HDF5 files, whose bytes do not depend on how they were made.

Curve i depends on (problem, seed, i) alone and a file holds a fixed range of i: processes or machines can share the
work, and a killed run can be continued. A file gets its name when it is complete, and one that is too large is refused
before it is read. A failed simulation keeps its row (NaN where nothing was computed) with the reason, because without
these rows the distribution of the parameters would not be the prior.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
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
from cavirheo.errors import InputError, listed, sha256
from cavirheo.inference.network_files import TrainingProblem
from cavirheo.io.arrays import local_items, refusal
from cavirheo.parallel import Executor, on_threads
from cavirheo.prior import uniforms
from cavirheo.training import trajectories
from cavirheo.training.recipe import difference
from cavirheo.writing.document import atomic_file, writable_folder
from cavirheo.writing.terminal import progress_bar

Indices = NDArray[np.int64]
Columns = Mapping[str, Any]  # arrays by name, a row per curve
Problem = TrainingProblem | Mapping[str, Any]  # of a network of one value; or what the bubbles of an emulator are of

PER_FILE = 15 * trajectories.BLOCK  # curves in a file, which takes one thread a second or two
SPLIT_STREAM = 1  # not the stream of the prior: with equal seeds, a parameter would decide the split
FILTERS: Any = {"compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}  # with a checksum
ATTRIBUTES = {"problem": str, "seed": int, "total": int, "made_by": str}  # of every file of a set


@dataclass(frozen=True)
class Layout:
    """How the curves of a problem are simulated, and how they lie in files."""

    problem: str  # as JSON
    columns: Mapping[str, tuple[Any, tuple[int, ...]]]  # dtype and shape of a row; texts in "status"
    simulate: Callable[[int, range], Columns]  # from (seed, block)

    def write(self, path: Path, attributes: Mapping[str, Any], columns: Columns) -> None:
        """Write a file, completely or not at all.

        The file is made in memory, because HDF5 would end the process on a full disk. It does not contain the date.
        """
        with h5py.File(path.name, "w", driver="core", backing_store=False, track_order=False) as file:
            file.attrs.update(attributes)
            for name, (kind, _) in self.columns.items():
                options: Any = {"dtype": h5py.string_dtype()} if name == "status" else FILTERS
                file.create_dataset(name, data=np.asarray(columns[name], kind), track_times=False, **options)
            file.flush()
            content = file.id.get_file_image()
        with atomic_file(path) as temporary:
            temporary.write_bytes(content)


def layout_of(problem: Problem) -> Layout:
    """Layout of curves on the problem's grid of times (theta: in the prior's scale, radius: over the reference R_max),
    or of the trajectories for an emulator, 2.2 kB each."""
    if isinstance(problem, TrainingProblem):
        prior, frames = problem.prior, problem.frames
        radius = (np.float32, (frames,))
        columns = {"theta": (np.float64, (len(prior.names),)), "radius": radius, "status": (object, ())}
        return Layout(json.dumps(problem.to_dict()), columns, partial(_simulated, problem))
    return Layout(json.dumps(problem, sort_keys=True), trajectories.COLUMNS, trajectories.simulated)


def _problem_of(content: Any) -> Problem:
    """The problem of a file. Raises InputError: it is none, or not the domain of the emulator of this version."""
    if not (isinstance(content, dict) and "nodes" in content):
        return TrainingProblem.from_dict(content)
    if change := difference(content, trajectories.DOMAIN):
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


class GenerateSummary(NamedTuple):
    """Numbers of curves after a call of `generate`."""

    curves: int  # of the set
    failures: dict[str, int]  # failed ones by status, in old and new files together
    simulated: int  # in this call


@dataclass(frozen=True, eq=False)
class Dataset:
    """A complete training set.

    Attributes:
        problem: prior and physics of the curves; of an emulator, what the bubbles are drawn from.
        seed: seed of the draws.
        made_by: version of cavirheo that made the set.
        columns: arrays by name, a row per curve: "status" (curves,), "ok" or the reason of the failure, and "radius"
            (curves, frames), R/R_max at the reference R_max, beside "theta" (curves, parameters), true values in the
            prior's scale; of an emulator "radius", "time" (curves, nodes) and "inputs".
        sha256: of the SHA-256 digests of all files in their order.
    """

    problem: Problem
    seed: int
    made_by: str
    columns: Columns
    sha256: str

    def __len__(self) -> int:
        return len(self.columns["status"])

    @property
    def ok(self) -> Bools:
        """Mask (curves,) of the simulations that succeeded."""
        return np.asarray(self.columns["status"] == "ok")

    @property
    def origin(self) -> dict[str, Any]:
        """Size, seed, checksum, version and failures (number of curves by status), for the card of a network."""
        failures = dict(Counter(self.columns["status"][~self.ok].tolist()))
        about = {"n": len(self), "seed": self.seed, "sha256": self.sha256}
        return about | {"failures": failures, "made_by": self.made_by}

    def truth(self, names: Sequence[str]) -> Floats:
        """Columns of theta (curves, names) for the parameters `names`."""
        known = self.problem.prior.names if isinstance(self.problem, TrainingProblem) else ()
        return np.asarray(self.columns["theta"][:, [known.index(name) for name in names]])

    def split(self, seed: int) -> dict[str, Indices]:
        """Indices of the usable curves of "train" (80 %), "validation" (10 %) and "test" (10 %).

        The part of curve i depends on (curves, seed, i), not on which curves failed.
        """
        n = len(self)
        order = np.argsort([uniforms(seed, i, 1, SPLIT_STREAM)[0] for i in range(n)], kind="stable")
        parts = np.split(order, [round(0.8 * n), round(0.9 * n)])
        return {name: part[self.ok[part]] for name, part in zip(("train", "validation", "test"), parts, strict=True)}


def generate(
    problem: Problem,
    n: int,
    out_dir: str | Path,
    *,
    seed: int = 0,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool = True,
) -> GenerateSummary:
    """Simulate curves 0..n-1 into `out_dir`.

    executor: where the curves are simulated; default: on `workers` threads of this machine.
    Complete files are kept. Nothing in a file depends on `workers`, `executor` or the date.

    Raises InputError: the folder holds files of another problem, seed, number of curves or version.
    """
    if n < 1:
        raise InputError(f"at least one curve is needed, got {n}", "dataset.curves")
    layout = layout_of(problem)
    head = {"problem": layout.problem, "seed": seed, "total": n, "made_by": version("cavirheo")}
    with writable_folder(out_dir) as folder:
        complete = [read_shard(path, head) for path in sorted(folder.glob("shard-*.h5"))]
        row = 8 + sum(np.dtype(kind).itemsize * prod(shape) for kind, shape in layout.columns.values())  # bytes
        need, free = row * (n - PER_FILE * len(complete)), shutil.disk_usage(folder).free
        if need > free:
            message = f"the set needs {need / 1e9:.3g} GB more on the disk of {folder}, and there are "
            raise InputError(f"{message}{free / 1e9:.3g} GB: ask for fewer curves or frames", "dataset.size")
        blocks = [range(n)[start : start + PER_FILE] for start in range(0, n, PER_FILE)]
        todo = [block for block in blocks if not (folder / _name(block.start)).exists()]
        simulated = sum(map(len, todo))
        work = (executor or partial(on_threads, workers=workers))(partial(layout.simulate, seed), todo)
        with progress_bar("simulating", simulated, visible=progress) as advance, closing(work) as flow:
            for index, columns in flow:
                start = todo[index].start
                layout.write(folder / _name(start), head | {"start": start}, columns)
                advance(len(todo[index]))
        shards = (read_shard(folder / _name(block.start), head)[1] for block in blocks)
        statuses = Counter(status for columns in shards for status in columns["status"].tolist())
    del statuses["ok"]
    return GenerateSummary(n, dict(statuses), simulated)


def load(data_dir: str | Path) -> Dataset:
    """Load the training set in a folder.

    Raises InputError: no files, a missing or damaged file, or files of different sets.
    """
    paths = sorted(Path(data_dir).glob("shard-*.h5"))
    if not paths:
        message = f"{data_dir} holds no training set (shard-*.h5); make one with `cavirheo generate`"
        raise InputError(message, "dataset.none")
    if foreign := [path.name for path in paths if not re.fullmatch(r"shard-\d{5,}", path.stem)]:
        raise InputError(f"{data_dir}: {listed(foreign, 3)} is no part of this set; remove it", "dataset.foreign")
    head, first = read_shard(paths[0], {})
    present, count = {path.name for path in paths}, -(-head["total"] // PER_FILE)
    names = (_name(k * PER_FILE) for k in range(count))
    if missing := list(islice((name for name in names if name not in present), 3)):
        lacking = f"{data_dir}: {count - len(paths)} of {count} files are missing ({', '.join(missing)}, ...)"
        raise InputError(f"{lacking}; run the same `cavirheo generate` again to add them", "dataset.incomplete")
    shards = [first, *(read_shard(path, {key: head[key] for key in ATTRIBUTES})[1] for path in paths[1:])]
    columns = {name: np.concatenate([shard[name] for shard in shards]) for name in first}
    if not (columns["status"] == "ok").any():
        raise InputError(f"{data_dir}: every simulation of this set failed", "dataset.none")
    digest = hashlib.sha256(b"".join(bytes.fromhex(sha256(path)) for path in paths)).hexdigest()
    return Dataset(_problem_of(json.loads(head["problem"])), head["seed"], head["made_by"], columns, digest)


def _name(start: int) -> str:
    """Name of the file that begins with curve `start`."""
    return f"shard-{start // PER_FILE:05d}.h5"


def read_shard(path: Path, expected: Mapping[str, Any]) -> tuple[dict[str, Any], Columns]:
    """The attributes and the columns of a file of a set. Raises InputError: it is damaged, or its attributes or columns
    are not those expected."""
    try:
        if not path.is_file():  # reading a pipe would wait for ever
            raise OSError("it is no file")
        with h5py.File(path, "r") as file:
            head: dict[str, Any] = {key: np.asarray(file.attrs[key]).item() for key in (*ATTRIBUTES, "start")}
            for key, kind in ATTRIBUTES.items():
                if type(head[key]) is not kind:
                    raise ValueError(f"{key} is {short(head[key])}")
            for key, value in expected.items():
                if head[key] != value:
                    both = [json.loads(text) if key == "problem" else {key: text} for text in (head[key], value)]
                    message = f"made with another {key} ({difference(*both) or 'other keys'})"
                    raise InputError(f"{message}; use an empty folder or its settings", f"dataset.another_{key}")
            layout, start = layout_of(_problem_of(json.loads(head["problem"]))), head["start"]
            count = min(PER_FILE, head["total"] - start)
            items = {name: item for name, item in local_items(file).items() if name in layout.columns}
            if refused := next(filter(None, map(refusal, items.values())), ""):
                raise InputError(f"it holds {refused}", "limits.dataset")
            shapes = {name: (item.dtype, item.shape) for name, item in items.items()}
            needed = {name: (np.dtype(kind), (count, *shape)) for name, (kind, shape) in layout.columns.items()}
            if shapes != needed or path.name != _name(start):
                raise InputError(f"it holds {shapes} from curve {start}, not {needed}", "dataset.shape")
            columns = {name: np.array((item.asstr() if name == "status" else item)[:]) for name, item in items.items()}
        columns["status"] = columns["status"].astype(str)
        ok = columns["status"] == "ok"
        if not all(np.isfinite(column[ok]).all() for name, column in columns.items() if name != "status"):
            raise InputError("values of its good curves are not finite", "dataset.values")
        return head, columns
    except InputError as error:
        hint = "" if error.code.startswith("dataset.another") else "; delete it and generate again"
        raise InputError(f"{path}: {error}{hint}", error.code) from error
    except Exception as error:  # libraries raise nearly any error for a damaged file
        message = f"{path} cannot be read as a training set ({error}); delete it and generate again"
        raise InputError(message, "dataset.unreadable") from error

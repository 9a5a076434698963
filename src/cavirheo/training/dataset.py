"""Training sets: simulated curves of a problem in shards of HDF5, the same bytes however they were made.

Curve i depends on (problem, seed, i) alone and a shard holds a fixed range of i: processes or machines can share the
work, and a killed run goes on where it stopped. A shard gets its name when it is complete. In a set on a grid of times
a failed simulation keeps its row (NaN where nothing was computed) with the solver's message: leaving it out would
silently change the prior.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import require
from cavirheo.files import sha256
from cavirheo.parallel import Executor, Threads
from cavirheo.prior import uniforms
from cavirheo.problem import TrainingProblem
from cavirheo.training.curves import CurveStore, curves_layout
from cavirheo.training.recipe import PosteriorTable
from cavirheo.training.shards import FileKind, Layout, Rows, Shard, fill, read_shard
from cavirheo.writing.document import into
from cavirheo.writing.terminal import bar

Indices = NDArray[np.int64]

SHARD = 500  # curves in a file
CHUNK = 50  # curves of a unit of work: about half a second
SPLIT_STREAM = 1  # apart from the draws of the prior, so that equal seeds do not sort the split by a parameter


def grid_layout(problem: TrainingProblem) -> Layout:
    """Curves on the problem's grid of times. theta: in the prior's scale. radius: over the reference R_max."""
    prior, frames = problem.prior, problem.grid.frames
    ranges = zip(prior.names, prior.low, prior.high, strict=True)
    summary = [f"curves of {frames} frames: {problem.material_name} in {problem.medium.name}"]
    summary += [f"{name}: {low:g} to {high:g}" for name, low, high in ranges]
    columns = {"theta": (np.float64, (len(prior.names),)), "radius": (np.float32, (frames,)), "status": (object, ())}
    return Layout(json.dumps(problem.to_dict()), SHARD, columns, partial(_simulated, problem), summary)


def _simulated(problem: TrainingProblem, seed: int, block: range) -> Rows:
    theta = problem.prior.sample(block, seed)
    runs = problem.simulate_many(theta, workers=1)
    radius = np.array([run.radius for run in runs], dtype=float) / problem.reference_max_radius
    finite = np.isfinite(radius).all(axis=1)
    status = np.array([run.status for run in runs], dtype=object)
    status[(status == "ok") & ~finite] = "the simulation ended well but its radius is not finite"
    return {"theta": theta, "radius": radius.astype(np.float32), "status": status}


GRID = FileKind("shard", "problem", lambda problem: grid_layout(TrainingProblem.from_dict(problem)))
CURVES = FileKind("curves", "posterior", lambda table: curves_layout(PosteriorTable.model_validate(table)))


@dataclass(frozen=True)
class Generated:
    """What a call of `generate` did; failures count the curves of all its shards, old and new, by status."""

    curves: int
    written: int  # shards
    skipped: int  # shards that were complete already
    failures: dict[str, int]
    seconds: float
    simulated: int  # curves that were simulated in this call


@dataclass(frozen=True)
class Survey:
    """What the files of a training set hold, read one after the other; `lacking`: files that are still to be made."""

    made_by: str  # version of cavirheo
    seed: int
    total: int  # curves when it is complete
    summary: Sequence[str]  # lines: what it is of
    statuses: Mapping[str, int]  # curves that are there, by how their simulation ended
    files: int
    lacking: int
    size: int  # bytes
    sha256: str  # of the SHA-256 of all files in their order

    @property
    def curves(self) -> int:
        """How many are there, failed ones included."""
        return sum(self.statuses.values())


@dataclass(frozen=True, eq=False)
class Dataset:
    """A whole training set; its radii may be on the disk.

    Attributes:
        problem: what its curves are drawn from and simulated with.
        seed: of the draws.
        made_by: version of cavirheo.
        theta: (curves, parameters) in the prior's scale.
        radius: (curves, frames) R/R_max at the reference R_max.
        status: (curves,) "ok" or the reason of the failure.
    """

    problem: TrainingProblem
    seed: int
    made_by: str
    theta: Floats
    radius: NDArray[np.float32]
    status: NDArray[np.str_]

    @property
    def ok(self) -> Bools:
        """(curves,) whether the simulation reached its end."""
        return self.status == "ok"

    @property
    def failures(self) -> dict[str, int]:
        """How many curves failed, by status."""
        return dict(Counter(self.status[~self.ok].tolist()))

    @cached_property
    def sha256(self) -> str:
        """Identity of the content, whatever the shards."""
        digest = hashlib.sha256(f"{self.problem.id} {self.seed} {' '.join(self.status)}".encode())
        for values in (self.theta, self.radius):
            digest.update(np.ascontiguousarray(values).data)
        return digest.hexdigest()

    def truth(self, names: Sequence[str]) -> Floats:
        """(curves, names) of theta."""
        return self.theta[:, [self.problem.prior.names.index(name) for name in names]]

    def split(self, seed: int) -> dict[str, Indices]:
        """80/10/10: indices of the usable curves of "train", "validation" and "test".

        The part of curve i depends on (curves, seed, i), not on which curves failed.
        """
        n = len(self.theta)
        order = np.argsort([uniforms(seed, i, 1, SPLIT_STREAM)[0] for i in range(n)], kind="stable")
        parts = np.split(order, [round(0.8 * n), round(0.9 * n)])
        return {name: part[self.ok[part]] for name, part in zip(("train", "validation", "test"), parts, strict=True)}


def generate(
    problem: TrainingProblem | PosteriorTable,
    n: int,
    out_dir: str | Path,
    *,
    seed: int = 0,
    workers: int | None = None,
    executor: Executor | None = None,
    shard: tuple[int, int] = (1, 1),
    progress: bool = True,
) -> Generated:
    """Simulate curves 0..n-1 into `out_dir`; shard = (i, N) makes the i-th of N parts, i from 1.

    executor: where they are simulated; default: on so many threads (`workers`) of this machine.
    Complete files are kept. Nothing in a file depends on `workers`, `executor`, `shard` or the date.

    Raises:
        InputError: the folder holds files of another problem, seed, number of curves or version.
    """
    if isinstance(problem, TrainingProblem):
        kind, layout = GRID, grid_layout(problem)
    else:
        kind, layout = CURVES, curves_layout(problem)
    part, parts = shard
    message = f"need n >= 1 and a shard i/N with 1 <= i <= N, got n = {n} and {part}/{parts}"
    require(n >= 1 and 1 <= part <= parts, message, "dataset.shard")
    head = {kind.attribute: layout.problem, "seed": seed, "total": n, "made_by": version("cavirheo")}
    began = time.perf_counter()
    with into(out_dir) as folder:
        _check_space(layout, n // parts, shutil.disk_usage(folder).free, f"on the disk of {folder}")
        for path in sorted(folder.glob(f"{kind.prefix}-*.h5")):
            read_shard(path, kind, head)
        size = layout.per_file
        starts = range(0, n, size)[part - 1 :: parts]
        files = {folder / kind.name(start // size): range(n)[start : start + size] for start in starts}
        todo = {path: block for path, block in files.items() if not path.exists()}
        simulated, write = sum(map(len, todo.values())), partial(layout.write, head)
        with bar("simulating", simulated, visible=progress) as advance:
            fill(todo, CHUNK, partial(layout.simulate, seed), write, executor or Threads(workers), advance)
        statuses = sum((read_shard(path, kind).statuses for path in files), Counter[str]())
    failures = {status: count for status, count in statuses.items() if status != "ok"}
    curves, seconds = sum(map(len, files.values())), time.perf_counter() - began
    return Generated(curves, len(todo), len(files) - len(todo), failures, seconds, simulated)


def load(data_dir: str | Path, scratch: Path | None = None) -> Dataset:
    """The training set in a folder; with the folder `scratch` its radii are in a nameless file there, else in memory.

    Raises:
        InputError: no shards, a missing or damaged shard, files of different sets, or more than fits there.
    """
    first, columns = _load(data_dir, GRID, {}, scratch, ("radius",))
    problem = TrainingProblem.from_dict(json.loads(first.layout.problem))
    return Dataset(problem, first.head["seed"], first.head["made_by"], **columns)


def load_curves(problem: PosteriorTable, data_dir: str | Path, scratch: Path) -> CurveStore:
    """The curves of a posterior network in a folder, unpacked in a nameless file in the folder `scratch`, 2 kB each.

    Raises:
        InputError: none, some missing or damaged, or made with another recipe.
    """
    expected = {"posterior": curves_layout(problem).problem, "made_by": version("cavirheo")}
    return CurveStore(**_load(data_dir, CURVES, expected, scratch, ("time", "radius"))[1])


def survey(data_dir: str | Path) -> Survey:
    """What is there of a set that may still grow. Raises InputError: nothing, or damaged files, or of several sets."""
    kind = CURVES if any(Path(data_dir).glob(f"{CURVES.prefix}-*.h5")) else GRID
    paths, statuses, whole = _paths(data_dir, kind), Counter[str](), hashlib.sha256()
    for shard in _shards(paths, kind, {}):
        statuses.update(shard.statuses)
    for path in paths:
        whole.update(bytes.fromhex(sha256(path)))
    head, size = shard.head, sum(path.stat().st_size for path in paths)
    lacking = -(-head["total"] // shard.layout.per_file) - len(paths)
    origin = head["made_by"], head["seed"], head["total"], shard.layout.summary
    return Survey(*origin, dict(statuses), len(paths), lacking, size, whole.hexdigest())


def _load(
    data_dir: str | Path, kind: FileKind, expected: Mapping[str, Any], scratch: Path | None, wide: Sequence[str]
) -> tuple[Shard, dict[str, Any]]:
    """The first file of a complete set, and all columns; with the folder `scratch` those that are wide are there."""
    paths = _paths(data_dir, kind)
    first = read_shard(paths[0], kind, expected)
    layout, total, names = first.layout, first.head["total"], {path.name for path in paths}
    starts = range(0, total, layout.per_file)
    missing = list(islice((name for name in map(kind.name, range(len(starts))) if name not in names), 3))
    lacking = f"{data_dir}: {len(starts) - len(paths)} of {len(starts)} files are missing ({', '.join(missing)}, ...)"
    require(not missing, f"{lacking}; run the same `cavirheo generate` again to add them", "dataset.incomplete")
    foreign = sorted(names - {*map(kind.name, range(len(starts)))})
    require(not foreign, f"{data_dir}: {', '.join(foreign[:3])} is no part of this set; remove it", "dataset.foreign")
    files: dict[str, Any] = {}
    if scratch is not None:
        _check_space(layout, total, shutil.disk_usage(scratch).free, f"on the disk of {scratch}")
        files = {name: TemporaryFile(dir=scratch) for name in wide}  # noqa: SIM115  gone with the arrays mapped to it
    elif hasattr(os, "sysconf"):  # all but Windows
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        _check_space(layout, 2 * total, memory, "of memory")  # read, and joined
    parts: dict[str, list[Any]] = {name: [] for name in layout.columns if name not in files}
    count = 0
    for shard in _shards(paths, kind, expected):
        count += len(next(iter(shard.rows.values())))
        for name, file in files.items():
            file.write(shard.rows[name].tobytes())
        for name, values in parts.items():
            values.append(shard.rows[name])
    require(count > 0, f"{data_dir}: every simulation of this set failed", "dataset.none")
    columns = {name: np.concatenate(values) for name, values in parts.items()}
    for name, file in files.items():
        file.flush()
        number, shape = layout.columns[name]
        columns[name] = np.asarray(np.memmap(file, number, "r", shape=(count, *shape)))
    return first, columns


def _paths(data_dir: str | Path, kind: FileKind) -> list[Path]:
    paths = sorted(Path(data_dir).glob(f"{kind.prefix}-*.h5"))
    message = f"{data_dir} holds no training set ({kind.prefix}-*.h5); make one with `cavirheo generate`"
    require(bool(paths), message, "dataset.none")
    return paths


def _shards(paths: Sequence[Path], kind: FileKind, expected: Mapping[str, Any]) -> Iterator[Shard]:
    """The files of one set. Raises InputError: one is of another."""
    for path in paths:
        shard = read_shard(path, kind, expected)
        expected = {key: shard.head[key] for key in (kind.attribute, "seed", "total", "made_by")}
        yield shard


def _check_space(layout: Layout, n: int, free: int, place: str) -> None:
    """Raises InputError: n curves need more bytes than are free."""
    need = n * layout.curve_bytes
    message = f"the set ({n} curves) needs {need / 1e9:.3g} GB {place}, and there are {free / 1e9:.3g} GB"
    require(need <= free, f"{message}: ask for fewer curves or frames, or for a part with --shard", "dataset.size")

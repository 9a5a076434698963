"""Training sets: simulated curves of a problem in shards of HDF5, the same bytes however they were made.

Curve i depends on (problem, seed, i) alone and a shard holds a fixed range of i: processes or machines can share the
work, and a killed run goes on where it stopped. A shard gets its name when it is complete. A failed simulation keeps
its row (NaN where nothing was computed) with the solver's message: leaving it out would silently change the prior.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from reprlib import repr as short
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError, require
from cavirheo.parallel import Executor, Threads
from cavirheo.prior import uniforms
from cavirheo.problem import TrainingProblem
from cavirheo.reading import limits
from cavirheo.training.rows import StoredRows, blocks
from cavirheo.training.shards import Survey, fill, size_and_sha256, write_hdf5
from cavirheo.writing.document import into
from cavirheo.writing.terminal import bar

Indices = NDArray[np.int64]
Rows = tuple[Floats, NDArray[np.float32], list[str]]  # theta, radius over the reference R_max, statuses

SHARD = 500  # curves in a file
CHUNK = 50  # curves of a unit of work: about half a second
SPLIT_STREAM = 1  # apart from the draws of the prior, so that equal seeds do not sort the split by a parameter
_HEAD = {"problem": str, "seed": int, "total": int, "made_by": str}  # attributes that all shards of a set share
_COLUMNS = ("theta", "radius", "status")


@dataclass(frozen=True)
class Generated:
    """What a call of `generate` did; failures count the curves of all its shards, old and new, by status."""

    curves: int
    written: int  # shards
    skipped: int  # shards that were complete already
    failures: dict[str, int]
    seconds: float
    simulated: int  # curves that were simulated now


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
    radius: NDArray[np.float32] | StoredRows
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
            for block in blocks(values):
                digest.update(np.ascontiguousarray(block).tobytes())
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
    problem: TrainingProblem,
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
    part, parts = shard
    given = f"need n >= 1 and a shard i/N with 1 <= i <= N, got n = {n} and {part}/{parts}"
    require(n >= 1 and 1 <= part <= parts, given, "dataset.shard")
    head = {"problem": json.dumps(problem.to_dict()), "seed": seed, "total": n, "made_by": version("cavirheo")}
    began = time.perf_counter()
    with into(out_dir) as folder:
        _afford(problem, n // parts, shutil.disk_usage(folder).free, f"on the disk of {folder}")
        for path in sorted(folder.glob("shard-*.h5")):
            _read(path, head)
        starts = range(0, n, SHARD)[part - 1 :: parts]
        blocks = {folder / _name(start): range(n)[start : start + SHARD] for start in starts}
        todo = {path: block for path, block in blocks.items() if not path.exists()}
        simulated = sum(map(len, todo.values()))
        simulate = partial(_simulated, problem, seed)

        def write(path: Path, block: range, parts: list[Rows]) -> None:
            write_hdf5(path, head | {"start": block.start}, columns(parts))

        with bar("simulating", simulated, shown=progress) as advance:
            fill(todo, CHUNK, simulate, write, executor or Threads(workers), advance)
        failures = Counter(status for path in blocks for status in _read(path)["status"].tolist() if status != "ok")
    curves, seconds = sum(map(len, blocks.values())), time.perf_counter() - began
    return Generated(curves, len(todo), len(blocks) - len(todo), dict(failures), seconds, simulated)


def _simulated(problem: TrainingProblem, seed: int, block: range) -> Rows:
    """These curves."""
    theta = problem.prior.sample(block, seed)
    runs = problem.simulate_many(theta, workers=1)
    radius = np.array([run.radius for run in runs], dtype=float) / problem.reference_max_radius
    unsaid = "the simulation ended well but its radius is not finite"
    finite: Bools = np.asarray(np.isfinite(radius).all(axis=1))
    said = zip((run.status for run in runs), finite.tolist(), strict=True)
    return (
        theta,
        radius.astype(np.float32),
        [unsaid if status == "ok" and not known else status for status, known in said],
    )


def columns(parts: Sequence[Rows]) -> dict[str, dict[str, Any]]:
    """The datasets of a file; numbers have a checksum, by which HDF5 refuses those that were damaged."""
    theta, radius, statuses = zip(*parts, strict=True)
    status = np.array([one for part in statuses for one in part], dtype=object)
    numbers = {"theta": np.concatenate(theta), "radius": np.concatenate(radius)}
    checked = {name: {"data": one, "chunks": one.shape, "fletcher32": True} for name, one in numbers.items()}
    return checked | {"status": {"data": status, "dtype": h5py.string_dtype()}}


def load(data_dir: str | Path, scratch: Path | None = None) -> Dataset:
    """The training set in a folder; with the folder `scratch` its radii are in a nameless file there, else in memory.

    Raises:
        InputError: no shards, a missing or damaged shard, files of different sets, or more than fits there.
    """
    paths = sorted(Path(data_dir).glob("shard-*.h5"))
    none = f"{data_dir} holds no training set (shard-*.h5); make one with `cavirheo generate`"
    require(bool(paths), none, "dataset.none")
    first, names = _read(paths[0]), {path.name for path in paths}
    total, problem = first["total"], TrainingProblem.from_dict(json.loads(first["problem"]))
    missing = list(islice((name for name in map(_name, range(0, total, SHARD)) if name not in names), 3))
    count = -(-total // SHARD)
    lacking = f"{data_dir}: {count - len(paths)} of {count} files are missing ({', '.join(missing)}, ...)"
    require(not missing, f"{lacking}; run the same `cavirheo generate` again to add them", "dataset.incomplete")
    foreign = sorted(names - {_name(start) for start in range(0, total, SHARD)})
    require(not foreign, f"{data_dir}: {', '.join(foreign[:3])} is no part of this set; remove it", "dataset.foreign")
    head = {key: first[key] for key in _HEAD}
    if scratch is not None:
        _afford(problem, total, shutil.disk_usage(scratch).free, f"on the disk of {scratch}")
        radius, rest = StoredRows(scratch, problem.grid.frames, np.float32), []
        for path in paths:
            shard = _read(path, head)
            radius.append(shard["radius"])
            rest.append((shard["theta"], shard["status"]))
        theta, status = (np.concatenate(column) for column in zip(*rest, strict=True))
        return Dataset(problem, first["seed"], first["made_by"], theta, radius, status)
    if hasattr(os, "sysconf"):  # all but Windows
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        _afford(problem, 2 * total, memory, "of memory")  # read, and joined
    shards = [_read(path, head) for path in paths]
    columns = (np.concatenate([shard[name] for shard in shards]) for name in _COLUMNS)
    return Dataset(problem, first["seed"], first["made_by"], *columns)


def survey(data_dir: str | Path) -> Survey:
    """What is there of a set that may still grow. Raises InputError: nothing, or damaged files, or of several sets."""
    paths = sorted(Path(data_dir).glob("shard-*.h5"))
    require(bool(paths), f"{data_dir} holds no training set (shard-*.h5)", "dataset.none")
    first, statuses = _read(paths[0]), Counter[str]()
    for path in paths:
        statuses.update(_read(path, {key: first[key] for key in _HEAD})["status"].tolist())
    problem, total = TrainingProblem.from_dict(json.loads(first["problem"])), first["total"]
    about = [f"curves of {problem.grid.frames} frames: {problem.material_name} in {problem.medium.name}"]
    prior, lacking = problem.prior, -(-total // SHARD) - len(paths)
    about += [
        f"{name}: {low:g} to {high:g}" for name, low, high in zip(prior.names, prior.low, prior.high, strict=True)
    ]
    told = first["made_by"], first["seed"], total, about
    return Survey(*told, dict(statuses), len(paths), lacking, *size_and_sha256(paths))


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """The first entry in which two nested settings differ, in words; empty if none does."""
    for key in new:
        before, after = old.get(key), new[key]
        if isinstance(before, dict) and isinstance(after, dict):
            if inner := difference(before, after):
                return f"{key}.{inner}"
        elif before != after:
            return f"{key} = {short(before)}, where {short(after)} is asked now"
    return ""


def _afford(problem: TrainingProblem, n: int, there: int, where: str) -> None:
    """Raises InputError: n curves need more bytes than there are."""
    need, frames = n * (4 * problem.grid.frames + 8 * len(problem.prior.names) + 16), problem.grid.frames
    message = (
        f"the set (curves of {frames} frames) needs {need / 1e9:.3g} GB {where}, and there are {there / 1e9:.3g} GB"
    )
    require(need <= there, f"{message}: ask for fewer curves or frames, or for a part with --shard", "dataset.size")


def _read(path: Path, expected: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Attributes and columns of a shard.

    Raises InputError: not readable, other attributes than expected, or columns that are not what these say.
    """
    try:
        require(path.is_file(), "it is no file", "dataset.unreadable")  # a pipe would be waited for
        with h5py.File(path, "r") as file:
            found: dict[str, Any] = {key: np.asarray(file.attrs[key]).item() for key in (*_HEAD, "start")}
            for key, kind in _HEAD.items():
                require(type(found[key]) is kind, f"{key} is {short(found[key])}", "dataset.unreadable")
            for key, value in (expected or {}).items():
                if found[key] != value:
                    both = [json.loads(one) if key == "problem" else {key: one} for one in (found[key], value)]
                    message = f"made with another {key} ({difference(*both) or 'other keys'})"
                    raise InputError(f"{message}; use an empty folder or its settings", f"dataset.another_{key}")
            problem, start = TrainingProblem.from_dict(json.loads(found["problem"])), found["start"]
            rows, columns = min(SHARD, found["total"] - start), len(problem.prior.names)
            items = {name: limits.own(file, name) for name in _COLUMNS}
            limits.arrays(items.values())
            shapes = {name: item.shape for name, item in items.items()}
            needed = {"theta": (rows, columns), "radius": (rows, problem.grid.frames), "status": (rows,)}
            fine = shapes == needed and path.name == _name(start) and items["theta"].dtype == float
            require(fine, f"it holds {shapes} from curve {start}, not {needed}", "dataset.shape")
            found |= {"theta": items["theta"][:], "radius": items["radius"][:].astype(np.float32, casting="same_kind")}
            found["status"] = np.array(items["status"].asstr()[:], dtype=str)
        known = np.isfinite(found["radius"]).all(axis=1) & np.isfinite(found["theta"]).all(axis=1)
        require(known[found["status"] == "ok"].all(), "values of its good curves are not finite", "dataset.values")
    except InputError as error:
        mend = "" if error.code.startswith("dataset.another") else "; delete it and generate again"
        raise InputError(f"{path}: {error}{mend}", error.code) from error
    except Exception as error:  # libraries raise nearly anything of a damaged file
        message = f"{path} cannot be read as a training set ({error}); delete it and generate again"
        raise InputError(message, "dataset.unreadable") from error
    return found


def _name(start: int) -> str:
    return f"shard-{start // SHARD:05d}.h5"

"""Training sets: simulated curves of a problem in shards of HDF5, the same bytes however they were made.

Curve i depends on (problem, seed, i) alone, and a shard holds a fixed range of i, so that several processes
or machines can share the work, and a killed run goes on where it stopped. A shard appears under its name only
when it is complete. A failed simulation keeps its row, with what was computed (NaN beyond) and the solver's
message as status: leaving it out would silently change the prior.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError
from cavirheo.prior import uniforms
from cavirheo.problem import TrainingProblem
from cavirheo.writing.document import into, whole
from cavirheo.writing.terminal import bar

SHARD = 500  # curves in a file
SPLIT_STREAM = 1  # apart from the draws of the prior, so that equal seeds do not sort the split by a parameter
CHUNK = 50  # curves between two steps of the progress bar

# theta (curves, parameters), radius (curves, frames), status (curves,)
Columns = tuple[Floats, NDArray[np.float32], NDArray[np.str_]]


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
    """A whole training set in memory."""

    problem: TrainingProblem
    seed: int
    theta: Floats  # (curves, parameters) in the prior's scale
    radius: NDArray[np.float32]  # (curves, frames) R/R_max at the reference R_max
    status: NDArray[np.str_]  # (curves,) "ok" or the reason of the failure
    made_by: str  # version of cavirheo

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
        digest.update(np.ascontiguousarray(self.theta).tobytes())
        digest.update(np.ascontiguousarray(self.radius).tobytes())
        return digest.hexdigest()

    def split(self, seed: int) -> dict[str, NDArray[np.int64]]:
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
    shard: tuple[int, int] = (1, 1),
    progress: bool = True,
) -> Generated:
    """Simulate curves 0..n-1 into `out_dir`; shard = (i, N) makes the i-th of N parts, i from 1.

    Files that are complete already are kept. Nothing in a file depends on `workers`, `shard` or the date.

    Raises:
        InputError: the folder holds files of another problem, seed, number of curves or version.
    """
    part, parts = shard
    if n < 1 or not 1 <= part <= parts:
        message = f"need n >= 1 and a shard i/N with 1 <= i <= N, got n = {n} and {part}/{parts}"
        raise InputError(message, "dataset.shard")
    expected = {"problem": json.dumps(problem.to_dict()), "seed": seed, "total": n, "made_by": version("cavirheo")}
    began = time.perf_counter()
    with into(out_dir) as folder:
        for path in sorted(folder.glob("shard-*.h5")):
            _check(path, expected)
        starts = range(0, n, SHARD)[part - 1 :: parts]
        blocks = {folder / _name(start): range(n)[start : start + SHARD] for start in starts}
        todo = {path: block for path, block in blocks.items() if not path.exists()}
        simulated = sum(map(len, todo.values()))
        with bar("simulating", simulated, shown=progress) as advance:
            for path, block in todo.items():
                done = []
                for chunk in (block[at : at + CHUNK] for at in range(0, len(block), CHUNK)):
                    done.append(_simulate(problem, chunk, seed, workers))
                    advance(len(chunk))
                _write(path, expected | {"start": block.start}, *_joined(done))
        failures = Counter(status for path in blocks for status in _read(path)[2].tolist() if status != "ok")
    curves, seconds = sum(map(len, blocks.values())), time.perf_counter() - began
    return Generated(curves, len(todo), len(blocks) - len(todo), dict(failures), seconds, simulated)


def load(data_dir: str | Path) -> Dataset:
    """The training set in a folder.

    Raises:
        InputError: no shards, a missing shard, or shards of different sets.
    """
    folder = Path(data_dir)
    paths = sorted(folder.glob("shard-*.h5"))
    if not paths:
        message = f"{folder} holds no training set (shard-*.h5); make one with `cavirheo generate`"
        raise InputError(message, "dataset.none")
    head = _attributes(paths[0])
    for path in paths:
        _check(path, {key: head[key] for key in ("problem", "seed", "total", "made_by")})
    wanted = {_name(start) for start in range(0, int(head["total"]), SHARD)}
    if missing := sorted(wanted - {path.name for path in paths}):
        raise InputError(
            f"{folder}: {len(missing)} of {len(wanted)} files are missing ({', '.join(missing[:3])}"
            f"{', ...' if len(missing) > 3 else ''}); run the same `cavirheo generate` again to add them",
            "dataset.incomplete",
        )
    problem = TrainingProblem.from_dict(json.loads(head["problem"]))
    return Dataset(problem, int(head["seed"]), *_joined([_read(path) for path in paths]), str(head["made_by"]))


def _simulate(problem: TrainingProblem, indices: range, seed: int, workers: int | None) -> Columns:
    theta = problem.prior.sample(indices, seed)
    simulations = problem.simulate_many(theta, workers=workers)
    radius = np.array([s.radius for s in simulations], dtype=float) / problem.reference_max_radius
    status = [s.status for s in simulations]
    for row in np.flatnonzero(~np.isfinite(radius).all(axis=1)):
        if status[row] == "ok":
            status[row] = "the simulation ended well but its radius is not finite"
    return theta, radius.astype(np.float32), np.array(status)


def _joined(parts: list[Columns]) -> Columns:
    theta, radius, status = (np.concatenate(column) for column in zip(*parts, strict=True))
    return theta, radius, status


def _write(path: Path, attributes: dict[str, Any], theta: Any, radius: Any, status: Any) -> None:
    with whole(path) as temporary, h5py.File(temporary, "w", track_order=False) as file:
        file.attrs.update(attributes)
        for name, values in (("theta", theta), ("radius", radius)):
            file.create_dataset(name, data=values, track_times=False)
        text = np.array(status, dtype=object)
        file.create_dataset("status", data=text, dtype=h5py.string_dtype(), track_times=False)


def _read(path: Path) -> Columns:
    with h5py.File(path, "r") as file:
        return file["theta"][:], file["radius"][:], np.array(file["status"].asstr()[:], dtype=str)


def _check(path: Path, expected: dict[str, Any]) -> None:
    found = _attributes(path)
    for key, value in expected.items():
        if found.get(key) != value:
            raise InputError(
                f"{path} was made with another {key} ({str(found.get(key))[:400]}; here {str(value)[:400]}): "
                f"use an empty folder, or the settings that it was made with",
                f"dataset.another_{key}",
            )


def _attributes(path: Path) -> dict[str, Any]:
    try:
        with h5py.File(path, "r") as file:
            return dict(file.attrs)
    except OSError as error:
        message = f"{path} cannot be read as HDF5 ({error}); delete it and generate again"
        raise InputError(message, "dataset.unreadable") from error


def _name(start: int) -> str:
    return f"shard-{start // SHARD:05d}.h5"

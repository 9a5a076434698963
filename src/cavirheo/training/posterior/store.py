"""Curves that a posterior network is trained on: simulated once, filmed anew each time that they are shown.

A curve is kept as R/R_max at 512 of 2,401 regular times to t* = 6, most of them where it bends.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.inference.bins import END
from cavirheo.inference.latent import SLOTS, damping, slot, to_slots
from cavirheo.inference.law import Family
from cavirheo.parallel import Executor, Threads
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.accuracy import ROUGH
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.media import WATER
from cavirheo.physics.simulate import simulate
from cavirheo.prior import uniforms
from cavirheo.reading import limits
from cavirheo.training.dataset import Generated
from cavirheo.training.posterior.recipe import More, PosteriorRecipe, searched
from cavirheo.training.rows import StoredRows
from cavirheo.training.shards import Survey, fill, size_and_sha256, write_hdf5
from cavirheo.writing.document import into
from cavirheo.writing.terminal import bar

SHARD = 1000  # curves in a file
CHUNK = 50  # curves of a unit of work
NODES = 512
STEPS = 2400  # regular times
PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}  # 1.2 kB a curve, from 2.1
TOP = 1.1  # R/R_max of the largest number that is kept


_COLUMNS = {"time": np.uint16, "radius": np.uint16, "z": np.float32, "kind": np.uint8, "max_radius": np.float32}


@dataclass(frozen=True)
class CurveStore:
    """Many curves. time, radius: (n, NODES) as whole numbers, perhaps on the disk; z: (n, 9) slots; kind: (n,) index of
    law and bubble; max_radius: (n,) m."""

    time: NDArray[np.uint16] | StoredRows
    radius: NDArray[np.uint16] | StoredRows
    z: NDArray[np.float32]
    kind: NDArray[np.uint8]
    max_radius: NDArray[np.float32]


def _curves(
    kinds: Sequence[tuple[str, str, float]], radii: tuple[float, float], seed: int, often: More | None, block: range
) -> list[tuple[Any, ...]]:
    """Those of these curves whose simulations did not fail."""
    return [one for one in (_curve(kinds, radii, seed, index, often) for index in block) if one is not None]


def _curve(
    kinds: Sequence[tuple[str, str, float]],
    radii: tuple[float, float],
    seed: int,
    index: int,
    often: More | None = None,
) -> tuple[Any, ...] | None:
    """Curve `index`: (time, radius, z, kind, max_radius), or None if its simulation failed."""
    draws = uniforms(seed, index, 9)
    shares = np.cumsum([share for *_, share in kinds])
    kind = int(np.searchsorted(shares, draws[0] * shares[-1], side="right"))
    law, bubble, _ = kinds[kind]
    family, names = Family(law), searched(law, bubble)
    bounds = np.array([PARAMETERS[name].searched for name in names])
    if often is not None and draws[7] < often.share:
        radii = often.ranges.get("max_radius", radii)
        for i, name in enumerate(names):
            bounds[i] = np.log10(often.ranges[name]) if name in often.ranges else bounds[i]
    log10 = bounds[:, 0] + draws[2 : 2 + len(names)] * (bounds[:, 1] - bounds[:, 0])
    max_radius = float(radii[0] * (radii[1] / radii[0]) ** draws[1])
    z = to_slots(names, log10[None])[0]
    simulated = FIELD
    if bubble == "real":
        z[slot("confinement_damping")] = ndtri(draws[8])
        damped = float(damping(z[slot("confinement_damping")]))
        simulated = Bubble("kinetic", float(10.0 ** log10[-1]), confinement_damping=damped)
    law_size = len(family.parameters)
    times = np.linspace(0.0, END, STEPS + 1) * WATER.time_scale(max_radius)
    try:
        run = simulate(
            family.material(log10[:law_size]), max_radius=max_radius, stretch=float(10.0 ** log10[law_size]),
            time=times, bubble=simulated, accuracy=ROUGH, throw=False,
        )  # fmt: skip
    except InputError:
        return None
    if not run.ok or not np.isfinite(run.radius).all():
        return None
    radius = run.radius / max_radius
    chosen = nodes(radius)
    kept = np.round(np.clip(radius[chosen] / TOP, 0.0, 1.0) * 65535).astype(np.uint16)
    return chosen.astype(np.uint16), kept, z, kind, max_radius


def nodes(radius: Floats) -> NDArray[np.int64]:
    """(NODES,) indices, ascending and different, of a curve (STEPS + 1,) between which straight lines follow it."""
    bend = np.zeros(STEPS + 1)
    bend[1:-1] = np.abs(np.diff(radius, 2))
    bend = np.maximum(bend, np.maximum(np.roll(bend, 1), np.roll(bend, -1)))
    density = np.sqrt(bend)
    density /= np.sum(density) + 1e-12
    # never more than one of a time: what is above is given to the others
    share = 0.3 / (STEPS + 1) + 0.7 * density
    for _ in range(6):
        share = np.minimum(share, 1.0 / NODES)
        share /= np.sum(share)
    filled = np.cumsum(share) * (NODES - 1)
    chosen = np.unique(np.concatenate([[0, STEPS], np.searchsorted(filled, np.arange(1, NODES - 1))]))
    chosen = chosen[chosen <= STEPS]
    if len(chosen) < NODES:
        rest = np.setdiff1d(np.arange(STEPS + 1), chosen)
        more = rest[np.argsort(-share[rest], kind="stable")[: NODES - len(chosen)]]
        chosen = np.sort(np.concatenate([chosen, more]))
    return chosen


def generate(
    recipe: PosteriorRecipe, n: int, out_dir: str | Path, *, seed: int, workers: int | None = None,
    executor: Executor | None = None, shard: tuple[int, int] = (1, 1), progress: bool = True,
) -> Generated:  # fmt: skip
    """Simulate curves 0..n-1 into `out_dir`, as `dataset.generate` does: resumable, the same bytes for any workers.

    A curve that cannot be simulated is left out and counted.

    Raises:
        InputError: the folder holds files of another recipe, seed, number of curves or version.
    """
    part, parts = shard
    given = f"need n >= 1 and a shard i/N with 1 <= i <= N, got n = {n} and {part}/{parts}"
    require(n >= 1 and 1 <= part <= parts, given, "dataset.shard")
    kinds, radii = recipe.posterior.kinds, tuple(1e-6 * radius for radius in recipe.posterior.max_radius_um)
    head = _head(recipe, n, seed)
    began, failed = time.perf_counter(), 0
    with into(out_dir) as folder:
        for path in sorted(folder.glob("curves-*.h5")):
            _read(path, head)
        blocks = {
            folder / _name(start): range(n)[start : start + SHARD] for start in range(0, n, SHARD)[part - 1 :: parts]
        }
        todo = {path: block for path, block in blocks.items() if not path.exists()}
        simulate = partial(_curves, kinds, (radii[0], radii[1]), seed, recipe.posterior.more)

        def write(path: Path, block: range, parts: list[list[tuple[Any, ...]]]) -> None:
            good = [one for part in parts for one in part]
            given = zip(_COLUMNS.items(), zip(*good, strict=True), strict=True)
            columns = {name: {"data": np.array(column).astype(kind), **PACKED} for (name, kind), column in given}
            write_hdf5(path, head | {"start": block.start, "failed": len(block) - len(good)}, columns)

        with bar("simulating", sum(map(len, todo.values())), shown=progress) as advance:
            fill(todo, CHUNK, simulate, write, executor or Threads(workers), advance)
        failed = sum(int(_read(path, head)[1]) for path in blocks)
    failures = {"the simulation failed": failed} if failed else {}
    curves, simulated = sum(map(len, blocks.values())), sum(map(len, todo.values()))
    seconds = time.perf_counter() - began
    return Generated(curves, len(todo), len(blocks) - len(todo), failures, seconds, simulated)


def load(recipe: PosteriorRecipe, data_dir: str | Path, scratch: Path) -> CurveStore:
    """The curves in a folder; unpacked in a nameless file in the folder `scratch`, 2 kB each, and read from there.

    Raises:
        InputError: none, some missing, or made with another recipe.
    """
    paths = sorted(Path(data_dir).glob("curves-*.h5"))
    none = f"{data_dir} holds no curves of a posterior network (curves-*.h5); make them with `cavirheo generate`"
    require(bool(paths), none, "dataset.none")
    with h5py.File(paths[0], "r") as file:
        total, seed = int(file.attrs["total"]), int(file.attrs["seed"])
    head = _head(recipe, total, seed)
    lacking = -(-total // SHARD) - len(paths)
    message = f"{data_dir}: {lacking} files are missing; run the same `cavirheo generate` again to add them"
    require(lacking == 0, message, "dataset.incomplete")
    time, radius = (StoredRows(scratch, NODES, _COLUMNS[name]) for name in ("time", "radius"))
    rest: dict[str, list[Any]] = {"z": [], "kind": [], "max_radius": []}
    for path in paths:
        part = _read(path, head)[0]
        time.append(part.time[:])
        radius.append(part.radius[:])
        for name, columns in rest.items():
            columns.append(getattr(part, name))
    return CurveStore(time, radius, **{name: np.concatenate(columns) for name, columns in rest.items()})


def survey(data_dir: str | Path) -> Survey:
    """As `dataset.survey`, of such curves."""
    paths = sorted(Path(data_dir).glob("curves-*.h5"))
    require(bool(paths), f"{data_dir} holds no curves of a posterior network (curves-*.h5)", "dataset.none")
    _read(paths[0], {})  # whatever is wrong with it is said there
    with h5py.File(paths[0], "r") as file:
        head = {key: file.attrs[key] for key in ("posterior", "seed", "total", "made_by")}
    good = failed = 0
    for path in paths:
        store, lost = _read(path, head)
        good, failed = good + len(store.kind), failed + lost
    settings, total = json.loads(head["posterior"]), int(head["total"])
    low, high = settings["max_radius_um"]
    about = [f"{law}: {share:.0%} of the curves" for law, share in settings["laws"].items()]
    about += [f"bubble {name}: {share:.0%}" for name, share in settings["bubbles"].items()]
    about.append(f"R_max {low:g} to {high:g} um")
    statuses = {"ok": good} | ({"failed, left out": failed} if failed else {})
    told = str(head["made_by"]), int(head["seed"]), total, about, statuses
    return Survey(*told, len(paths), -(-total // SHARD) - len(paths), *size_and_sha256(paths))


def _head(recipe: PosteriorRecipe, n: int, seed: int) -> dict[str, Any]:
    settings = json.dumps(recipe.settings(), sort_keys=True)
    return {"posterior": settings, "seed": seed, "total": n, "made_by": version("cavirheo")}


def _name(start: int) -> str:
    return f"curves-{start // SHARD:05d}.h5"


def _read(path: Path, expected: Mapping[str, Any]) -> tuple[CurveStore, int]:
    """The curves of a file, and how many failed. Raises InputError: damaged, or of another set."""
    try:
        with h5py.File(path, "r") as file:
            for key, value in expected.items():
                found = file.attrs[key]
                message = f"{path}: made with another {key} ({found}, where {value} is asked now); use an empty folder"
                require(found == value, message, f"dataset.another_{key}")
            items = {name: limits.own(file, name) for name in _COLUMNS}
            limits.arrays(items.values())
            fine = all(item.dtype == kind for item, kind in zip(items.values(), _COLUMNS.values(), strict=True))
            sizes = {len(item) for item in items.values()}
            fine = fine and len(sizes) == 1 and items["time"].shape[1:] == items["radius"].shape[1:] == (NODES,)
            require(
                fine and items["z"].shape[1:] == (len(SLOTS),), f"{path}: its arrays have other shapes", "dataset.shape"
            )
            return CurveStore(*(item[:] for item in items.values())), int(file.attrs["failed"])
    except InputError:
        raise
    except Exception as error:  # libraries raise nearly anything of a damaged file
        message = f"{path} cannot be read as curves of a posterior network ({error}); delete it and generate again"
        raise InputError(message, "dataset.unreadable") from error

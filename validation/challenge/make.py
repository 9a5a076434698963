"""Makes the recordings of the open challenge from a seed.

    python -m validation.challenge.make OUT [--seed 1] [-n 60]

OUT/recordings/ is what a program gets: a table of radii for each recording, and known.csv.
OUT/truth.csv is for score.py alone. The page README.md beside this file explains both.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from validation.challenge import camera, truth

STREAM = 39  # of the random numbers
TRIES = 5  # of a truth that cannot be simulated


def cells(seed: int, n: int) -> list[tuple[str, str, str]]:
    """(half, law, difficulty) of each recording in a random order: 60 have each of both halves, the laws (two of five
    nhkv) and the three difficulties equally often."""
    every = list(product(truth.HALVES, truth.LAWS, camera.LEVELS, range(2)))
    order = np.random.default_rng([STREAM, seed]).permutation(len(every) * -(-n // len(every)))
    return [every[i % len(every)][:3] for i in order[:n]]


def one(job: tuple[int, tuple[str, str, str]], seed: int) -> tuple[truth.Truth, camera.Recording, int]:
    """Truth and recording number i, which depend on the seed and on i alone; and the failed tries before."""
    number, (half, law, difficulty) = job
    rng = np.random.default_rng([STREAM, seed, number])
    for failed in range(TRIES):
        drawn = truth.draw(rng, half, law)
        try:
            ratio = truth.solve(drawn, camera.LONGEST)
        except RuntimeError:
            continue
        return drawn, camera.film(rng, camera.LEVELS[difficulty], ratio, drawn.R_max, drawn.t_c), failed
    raise RuntimeError(f"recording {number} of seed {seed} cannot be simulated in {TRIES} tries")


def write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    rows = list(rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def write_recording(folder: Path, name: str, time: camera.Floats, radius: camera.Floats) -> None:
    """folder/name.csv, us and um."""
    lines = [f"{1e6 * t:.4f},{1e6 * r:.4f}" for t, r in zip(time, radius, strict=True)]
    (folder / f"{name}.csv").write_text("time_us,radius_um\n" + "\n".join(lines) + "\n", encoding="utf-8")


def known(name: str, shown: camera.Recording, density: float, rng: np.random.Generator) -> dict[str, str]:
    """What a laboratory knows of a recording; it weighs its density to about 2 kg/m3."""
    return {
        "name": name,
        "R_max_um": f"{1e6 * camera.read_maximum(shown.time, shown.radius)[1]:.3f}",
        "frame_rate_Hz": f"{shown.frame_rate:.0f}",
        "exposure_us": f"{1e6 * shown.exposure:.4f}",
        "density_kg_m3": f"{density + 2.0 * rng.standard_normal():.0f}",
    }


def make(out: Path, seed: int, n: int, workers: int | None = None) -> int:
    """Writes OUT and returns how many truths could not be simulated and were drawn anew."""
    folder = out / "recordings"
    folder.mkdir(parents=True, exist_ok=True)
    design = cells(seed, n)
    with ProcessPoolExecutor(workers or os.cpu_count()) as pool:
        made = list(pool.map(partial(one, seed=seed), enumerate(design)))
    rng = np.random.default_rng([STREAM, seed, n, 1])
    public, secret = [], []
    for number, ((*_, difficulty), (drawn, shown, _)) in enumerate(zip(design, made, strict=True), 1):
        name = f"shot{number:03d}"
        write_recording(folder, name, shown.time, shown.radius)
        public.append(known(name, shown, drawn.density, rng))
        camera_of = {"scale": shown.scale, "noise": shown.noise, "origin_us": 1e6 * shown.origin}
        secret.append({"name": name, "difficulty": difficulty, **asdict(drawn), **camera_of})
    write_table(folder / "known.csv", public)
    write_table(out / "truth.csv", secret)
    return sum(failed for *_, failed in made)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-n", type=int, default=60)
    given = parser.parse_args()
    failed = make(given.out, given.seed, given.n)
    print(f"{given.n} recordings of seed {given.seed} in {given.out}; {failed} truths could not be simulated")


if __name__ == "__main__":
    main()

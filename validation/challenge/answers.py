"""Recordings read, and answers written as score.py reads them; what the runners of this folder share."""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from validation.challenge.camera import read_maximum

COLUMNS = ("name", "G", "G_low", "G_high", "mu", "mu_low", "mu_high", "seconds")
Answer = dict[str, Any]
"""Some of these columns, and others that score.py passes over; "predict" is none: a function of times of the recording,
s (n,), that gives radii, m (n,), or these with the two ends of their 90 % intervals (3, n)."""


@dataclass(frozen=True)
class Recording:
    """SI. time: s since the first frame with a radius."""

    name: str
    path: Path
    time: np.ndarray
    radius: np.ndarray
    max_radius: float
    exposure: float
    density: float

    def from_maximum(self) -> tuple[np.ndarray, np.ndarray]:
        """Time since R_max, as a parabola tells it, and radius; of the frames from there on."""
        since = self.time - read_maximum(self.time, self.radius)[0]
        return since[since >= 0], self.radius[since >= 0]


def read(folder: Path) -> Iterator[Recording]:
    with (folder / "known.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        path = folder / f"{row['name']}.csv"
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        yield Recording(
            name=row["name"],
            path=path,
            time=1e-6 * table[:, 0],
            radius=1e-6 * table[:, 1],
            max_radius=1e-6 * float(row["R_max_um"]),
            exposure=1e-6 * float(row["exposure_us"]),
            density=float(row["density_kg_m3"]),
        )


def append(path: Path, row: Answer) -> None:
    """Adds a row to a table, which begins with the names of its columns."""
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*COLUMNS, *(name for name in row if name not in COLUMNS)])
        if new:
            writer.writeheader()
        writer.writerow(row)


def run(description: str | None, answer: Callable[[Recording, list[str]], Answer]) -> None:
    """The command line of a runner: answers every recording of a folder, adds a line for each to the file, and goes on
    where it was stopped. What stands after -- is handed to `answer`."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("options", nargs="*", help="after --: options of the program")
    given = parser.parse_args()
    answered = set()
    if given.answers.exists():
        with given.answers.open(newline="", encoding="utf-8") as file:
            answered = {row["name"] for row in csv.DictReader(file)}
    for recording in read(given.recordings):
        if recording.name in answered:
            continue
        began = time.perf_counter()
        row = {"name": recording.name, **answer(recording, given.options)}
        row.setdefault("seconds", round(time.perf_counter() - began, 3))
        row.pop("predict", None)
        append(given.answers, row)
        print(" ".join(f"{name} {value}" for name, value in row.items()), flush=True)

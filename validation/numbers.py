"""What a claim measures: numbers with their standard errors, and the run that asks for them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SEED = 1
RESAMPLES = 1000


@dataclass(frozen=True)
class Number:
    """One number. standard_error: of the value over the n cases."""

    name: str
    value: float
    unit: str
    n: int
    standard_error: float
    seed: int = SEED


@dataclass(frozen=True)
class Run:
    """How claims are measured. kept: folder of the rows of single cases, so that a run goes on; data: the open sets;
    part: one setting of a claim that has several, all without it; pictures: folder of the pictures of claims."""

    full: bool = False
    workers: int = 1
    kept: Path | None = None
    data: Path | None = None
    part: str = ""
    pictures: Path | None = None

    def picture(self, name: str) -> Path:
        """Where a picture goes, by its path in the repository."""
        path = Path(self.pictures or ".") / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def count(self, quick: int, full: int) -> int:
        return full if self.full else quick

    def rows(self, name: str, one: Callable[[Any], dict], jobs: Iterable[Sequence]) -> list[dict]:
        """one(job) of every job, on all workers; those that an earlier call has kept are read."""
        jobs = [tuple(job) for job in jobs]
        path = self.kept / f"{name}.jsonl" if self.kept else None
        lines = path.read_text("utf-8").splitlines() if path and path.exists() else []
        known = {json.dumps(line["job"]): line["row"] for line in map(json.loads, lines)}
        missing = [job for job in jobs if json.dumps(job) not in known]
        with ProcessPoolExecutor(self.workers) as pool:
            for job, row in zip(missing, pool.map(one, missing), strict=True):
                known[json.dumps(job)] = row
                if path:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    with path.open("a", encoding="utf-8") as file:
                        file.write(json.dumps({"job": job, "row": row}) + "\n")
        return [known[json.dumps(job)] for job in jobs]


def statistic(name: str, values: Iterable[float], unit: str, of: Callable = np.median, seed: int = SEED) -> Number:
    """The median (or another statistic), with the standard error of 1,000 resamples; NaN where values are too few."""
    known = np.array([value for value in values if np.isfinite(value)])
    if not len(known):
        return Number(name, np.nan, unit, 0, np.nan, seed)
    again = np.random.default_rng(SEED).choice(known, (RESAMPLES, len(known)))
    error = float(np.std(of(again, axis=1))) if len(known) > 1 else np.nan
    return Number(name, float(of(known)), unit, len(known), error, seed)


def coverage(name: str, hits: Iterable[bool], level: float, n: int | None = None, seed: int = SEED) -> Number:
    """Share of intervals that hold the truth; the standard error is that of right intervals.

    n: of independent cases, where that is not the number of hits.
    """
    hits = np.array(list(hits), float)
    n = len(hits) if n is None else n
    if not n:
        return Number(name, np.nan, "1", 0, np.nan, seed)
    return Number(name, float(np.mean(hits)), "1", n, float(np.sqrt(level * (1 - level) / n)), seed)


def share(name: str, hits: Iterable[bool], seed: int = SEED) -> Number:
    """Share of cases; the standard error is that of Jeffreys' estimate, which is not 0 where all or no cases agree."""
    hits = np.array(list(hits), float)
    if not len(hits):
        return Number(name, np.nan, "1", 0, np.nan, seed)
    p = (np.sum(hits) + 0.5) / (len(hits) + 1.0)
    return Number(name, float(np.mean(hits)), "1", len(hits), float(np.sqrt(p * (1 - p) / (len(hits) + 2.0))), seed)

"""One material from many shots: do the intervals of centre and spread hold the truth, and are outliers found?

Groups are those of benchmarks/population.py: 3 to 20 shots, spread 0 to 0.2 decades, an outlier in a fifth of them. The
two parameters of a group are not independent, so n counts groups.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks import population as benchmark
from validation.numbers import SEED, Number, Run, coverage, share

SPREADS = (0.03, 0.1, 0.2)  # decades; of groups of 8 to 20 shots with an outlier in G and mu


def one(job: tuple[str, float, int]) -> dict:
    what, spread, number = job
    if what == "intervals":
        return {name: np.array(hits).tolist() for name, hits in benchmark.covered(number, SEED).items()}
    return benchmark.found_outlier(number, SEED, spread, (1.0, 1.0), (8, 20))._asdict()


def measure(run: Run) -> Iterator[Number]:
    n = run.count(60, 200)
    rows = run.rows("population", one, [("intervals", 0.0, number) for number in range(n)])
    for part in ("centre", "spread"):
        for level in benchmark.LEVELS:
            hits = [hit for row in rows for hit in row[f"{part} {level:.0%}"]]
            yield coverage(f"{part}.{100 * level:.0f}", hits, level, n)
    named, others = 0, 0
    for spread in SPREADS:
        jobs = [("outlier", spread, number) for number in range(1, run.count(40, 200), 2)]
        rows = run.rows("population", one, jobs)
        yield share(f"outlier.{spread:g}", [row["found"] for row in rows])
        named, others = named + sum(row["wrong"] for row in rows), others + sum(row["shots"] for row in rows)
    yield share("false_alarms", [True] * named + [False] * (others - named))

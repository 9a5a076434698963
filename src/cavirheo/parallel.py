"""Work on all cores, with threads: the solver lets go of the interpreter while it computes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from cavirheo.errors import expect_whole

Job = TypeVar("Job")
Done = TypeVar("Done")


def cores(workers: int | None = None) -> int:
    """`workers`, or as many as the machine has."""
    if workers is not None:
        expect_whole(workers, "workers", 1)
    return workers or os.cpu_count() or 1


def each(
    work: Callable[[Job], Done], jobs: Iterable[Job], workers: int | None = None, done: Callable[[], None] | None = None
) -> list[Done]:
    """work(job) of each job, in their order, on so many threads (all cores by default); `done` is called after each."""

    def one(job: Job) -> Done:
        found = work(job)
        if done:
            done()
        return found

    jobs = list(jobs)
    threads = min(cores(workers), len(jobs))
    if threads < 2:
        return [one(job) for job in jobs]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(one, jobs))

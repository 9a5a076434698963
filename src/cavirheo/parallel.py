"""Work on all cores, with threads: the solver lets go of the interpreter while it computes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeVar

from cavirheo.errors import expect_whole

Job = TypeVar("Job")
Done = TypeVar("Done")


def cores(workers: int | None = None) -> int:
    """`workers`, or as many as the machine has."""
    if workers is not None:
        expect_whole(workers, "workers", 1)
    return workers or os.cpu_count() or 1


def each(
    work: Callable[[Job], Done],
    jobs: Iterable[Job],
    workers: int | None = None,
    done: Callable[[int, Done], None] | None = None,
) -> list[Done]:
    """work(job) of each job, in their order, on so many threads (all cores by default).

    `done` is called in this thread with the index of each and what came of it, in the order in which they end. An
    exception, Ctrl-C too, is not kept waiting: what has not begun is dropped, what has begun ends by itself.
    """
    jobs = list(jobs)
    found: dict[int, Done] = {}

    def take(index: int, result: Done) -> None:
        found[index] = result
        if done:
            done(index, result)

    threads = min(cores(workers), len(jobs))
    if threads < 2:
        for index, job in enumerate(jobs):
            take(index, work(job))
        return list(found.values())
    pool, waiting, ended = ThreadPoolExecutor(threads), deque(enumerate(jobs)), SimpleQueue[Any]()

    def labour() -> None:  # a future for each job would cost a tenth of a simulation
        with suppress(IndexError):
            while True:
                index, job = waiting.popleft()
                try:
                    ended.put((index, work(job), None))
                except BaseException as error:  # raised again in the thread that waits
                    ended.put((index, None, error))

    try:
        for _ in range(threads):
            pool.submit(labour)
        for _ in jobs:
            index, result, error = ended.get()
            if error:
                raise error
            take(index, result)
    finally:
        waiting.clear()
        pool.shutdown(wait=False)
    return [found[index] for index in range(len(jobs))]


def aside(work: Callable[[], Done]) -> Done:
    """work() in a thread of its own: this one only waits, so that Ctrl-C is obeyed during a long compilation, too."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(work).result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)

"""Work in processes of their own, so that a crash or a hang is an outcome like others and ends nothing else."""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from queue import Empty
from typing import Any

MEMORY = 8 << 30  # bytes of address space of one process, of which the compiled libraries take two


@dataclass(frozen=True)
class Ended:
    """Instead of an answer: "hang" or "crash", and how the process ended."""

    outcome: str
    why: str


@dataclass
class _Worker:
    process: multiprocessing.Process
    now: Any  # the job that it works on
    left: list[int]
    since: float = field(default_factory=time.monotonic)

    def answered(self, job: int) -> None:
        if job in self.left:
            self.left.remove(job)
            self.since = time.monotonic()


def each_apart(
    work: Callable[[int], Any], jobs: Sequence[int], seconds: float, workers: int | None = None
) -> Iterator[tuple[int, Any]]:
    """(job, work(job) or Ended) as they come; no job takes more than so many seconds. `work` raises nothing."""
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    cores = workers or os.cpu_count() or 1

    def start(mine: list[int]) -> _Worker | None:
        if not mine:
            return None
        now = context.Value("q", -1)
        process = context.Process(target=_work, args=(work, list(mine), now, queue), daemon=False)
        process.start()
        return _Worker(process, now, list(mine))

    slots = [start(list(jobs[k::cores])) for k in range(cores)]
    try:
        while any(slots):
            try:
                job, answer = queue.get(timeout=0.2)
            except Empty:
                for k, worker in enumerate(slots):
                    if worker is None:
                        continue
                    hangs = time.monotonic() - worker.since > seconds
                    if worker.process.is_alive() and not hangs:
                        continue
                    worker.process.kill()
                    worker.process.join()
                    if worker.left:
                        job = worker.now.value if worker.now.value in worker.left else worker.left[0]
                        why = f"no answer in {seconds:.0f} s" if hangs else f"exit status {worker.process.exitcode}"
                        worker.left.remove(job)
                        yield job, Ended("hang" if hangs else "crash", why)
                    slots[k] = start(worker.left)
                continue
            for worker in filter(None, slots):
                worker.answered(job)
            yield job, answer
    finally:
        for worker in filter(None, slots):
            worker.process.kill()


def _work(work: Callable[[int], Any], jobs: list[int], now: Any, queue: Any) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for job in jobs:
        now.value = job
        queue.put((job, work(job)))

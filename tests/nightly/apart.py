"""Work in processes of their own, so that a crash or a hang is an outcome like others and ends nothing else."""

import multiprocessing
import os
import resource
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

MEMORY = 8 << 30  # bytes of address space of one process, of which the compiled libraries take two


@dataclass(frozen=True)
class Ended:
    """Instead of an answer: "hang" or "crash", and how the process ended."""

    outcome: str
    why: str


def each_apart(
    work: Callable[[int], Any], jobs: Iterable[int], seconds: float, workers: int | None = None
) -> Iterator[tuple[int, Any]]:
    """(job, work(job) or Ended) as they come; no job takes more than so many seconds. `work` raises nothing."""
    fork = multiprocessing.get_context("fork")
    waiting, idle = list(jobs)[::-1], []
    busy: dict[Connection, tuple[Any, int, float]] = {}  # process, job and when it began
    try:
        while waiting or busy:
            while waiting and len(busy) < (workers or os.cpu_count() or 1):
                if not idle:
                    pipe, end = fork.Pipe()
                    process = fork.Process(target=_serve, args=(work, end))
                    process.start()
                    end.close()
                    idle.append((pipe, process))
                pipe, process = idle.pop()
                busy[pipe] = process, waiting.pop(), time.monotonic()
                pipe.send(busy[pipe][1])
            for pipe in wait(list(busy), 0.2):
                process, job, _ = busy.pop(pipe)
                try:
                    yield job, pipe.recv()
                    idle.append((pipe, process))
                except EOFError:
                    process.join()
                    yield job, Ended("crash", f"exit status {process.exitcode}")
            for pipe, (process, job, began) in list(busy.items()):
                if time.monotonic() - began > seconds:
                    process.kill()
                    del busy[pipe]
                    yield job, Ended("hang", f"no answer in {seconds:.0f} s")
    finally:
        for process in [*(process for _, process in idle), *(process for process, _, _ in busy.values())]:
            process.kill()


def _serve(work: Callable[[int], Any], pipe: Connection) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    while True:
        pipe.send(work(pipe.recv()))

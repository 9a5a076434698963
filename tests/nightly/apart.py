"""Work in processes of their own, so that a crash or a hang is an outcome like others and ends nothing else."""

import multiprocessing
import os
import resource
import signal
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

MEMORY = 8 << 30  # bytes of address space of one process, of which the compiled libraries take two


class Ended(NamedTuple):
    """Instead of an answer: "hang" or "crash", and how the process ended."""

    outcome: str
    why: str


def each_apart(work: Callable[[int], Any], jobs: Iterable[int], seconds: float) -> Iterator[tuple[int, Any]]:
    """(job, work(job) or Ended) as they come; no job takes more than so many seconds. `work` raises nothing."""
    fork, every, workers = multiprocessing.get_context("fork"), list(jobs), os.cpu_count() or 1
    parts = [every[k::workers] for k in range(workers)]
    busy: dict[Connection, tuple[Any, list[int]]] = {}  # process, and its jobs that have no answer yet
    try:
        while any(parts) or busy:
            for part in filter(None, parts):
                pipe, end = fork.Pipe(duplex=False)
                busy[pipe] = fork.Process(target=_serve, args=(work, part, seconds, end)), part
                busy[pipe][0].start()
                end.close()
            parts = []
            for pipe in wait(list(busy)):
                process, left = busy[pipe]
                try:
                    answer = pipe.recv()
                except EOFError:
                    process.join()
                    del busy[pipe]
                    kind = "hang" if process.exitcode == -signal.SIGALRM else "crash"
                    answer = Ended(kind, f"exit status {process.exitcode}")
                    parts.append(left[1:])
                if left:
                    yield left.pop(0), answer
    finally:
        for process, _ in busy.values():
            process.kill()


def _serve(work: Callable[[int], Any], jobs: list[int], seconds: float, pipe: Connection) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for job in jobs:
        signal.setitimer(signal.ITIMER_REAL, seconds)
        answer = work(job)
        signal.setitimer(signal.ITIMER_REAL, 0)
        pipe.send(answer)

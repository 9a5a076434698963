"""Units of work on the workers of a dask cluster: batches of a second or two, few enough at once to be held here."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from cavirheo.errors import InputError, SolverError
from cavirheo.workflow.cluster.check import Identity, identity

if TYPE_CHECKING:
    from distributed import Client

Job = TypeVar("Job")
Output = TypeVar("Output")

SECONDS = 2.0  # of a batch, at least
SECONDS_PER_THREAD = 0.016  # more for many: a batch costs the driver a quarter of it (benchmarks/scale.py)
LONGEST = 60.0  # s: what a lost worker costs
AHEAD = 2  # batches for each thread: one that runs and one that waits there
MOST = 1000  # jobs of a batch
LOOK = 1.0  # s between two counts of the workers


def seconds_for(threads: int) -> float:
    """s that a batch is to take, so that batches cost the driver of so many threads a quarter of its time."""
    return min(max(SECONDS, SECONDS_PER_THREAD * threads), LONGEST)


@dataclass(frozen=True)
class Workers:
    """All workers of a cluster, also those that come later; each must be as `required`."""

    client: Client
    required: Identity

    def flow(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Generator[tuple[int, Output], None, None]:
        """As `Executor.flow`. A worker that is lost costs only time: its batches are done by another.

        Raises:
            InputError: a worker came that would answer otherwise, or the scheduler is gone. What `function` raises is
                raised here.
        """
        from distributed import as_completed

        waiting = deque(range(len(jobs)))
        sent: dict[object, Sequence[int]] = {}
        running = as_completed(with_results=True, raise_errors=False, loop=self.client.loop)
        size, looked, threads, places = 1.0, 0.0, 1, AHEAD
        try:
            while waiting or sent:
                if time.monotonic() > looked + LOOK:
                    threads, looked = max(sum(self.client.nthreads().values()), 1), time.monotonic()
                    places = AHEAD * threads
                while waiting and len(sent) < places:
                    count = min(round(size), max(len(waiting) // places, 1))
                    batch = [waiting.popleft() for _ in range(min(count, len(waiting)))]
                    content = [jobs[index] for index in batch]
                    future = self.client.submit(_batch, self.required, function, content, pure=False)
                    sent[future] = batch
                    running.add(future)
                future, outcome = next(running)
                indices = sent.pop(future)
                if future.status != "finished":
                    raise _error_of(future.status, outcome)
                seconds, results = outcome
                future.release()
                ideal = seconds_for(threads) * len(results) / max(seconds, 1e-6)
                size = 0.5 * size + 0.5 * min(max(ideal, 1.0), MOST)
                yield from zip(indices, results, strict=True)
        finally:
            running.clear()
            self.client.cancel(list(sent), force=True)


def _batch(required: Identity, function: Callable[[Job], Output], jobs: Sequence[Job]) -> tuple[float, list[Output]]:
    """(s that it took, what came of each job), by a worker."""
    mine = identity()
    if mine != required:
        from distributed import get_worker

        message = f"the worker {get_worker().address} has cavirheo {mine.version} with other code or other last bits"
        raise InputError(f"{message}: stop it, and the same command goes on", "cluster.refused")
    began = time.perf_counter()
    results = [function(job) for job in jobs]
    return time.perf_counter() - began, results


def _error_of(status: str, outcome: object) -> BaseException:
    """What to raise for a batch that did not end: our own errors as they are."""
    error = outcome[1] if isinstance(outcome, tuple) and len(outcome) == 3 else outcome
    if isinstance(error, InputError | SolverError):
        return error
    if type(error).__name__ == "KilledWorker":
        message = f"one unit of work ended several workers, so it is given up: is their memory too small? {error}"
        return InputError(message, "cluster.killed")
    if status in ("cancelled", "lost"):
        return InputError("the scheduler is gone or was restarted: the same command goes on", "cluster.lost")
    return error if isinstance(error, BaseException) else InputError(f"a unit of work was {status}", "cluster.lost")

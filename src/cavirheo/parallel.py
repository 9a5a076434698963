"""Work on all cores, with threads: the solver lets go of the interpreter while it computes. What an executor is."""

from __future__ import annotations

import ctypes
import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from cavirheo.errors import expect_whole, require

Job = TypeVar("Job")
Output = TypeVar("Output")


def cores(workers: int | None = None) -> int:
    """`workers`, or as many as the machine has."""
    if workers is not None:
        expect_whole(workers, "workers", 1)
    return workers or os.cpu_count() or 1


class _OneBlasThread:
    """While any thread is in this block, BLAS computes in the thread that calls it: its own threads would only wait for
    each other beside ours, and with them the last bits differ. threadpoolctl lets one thread set the number, and does
    nothing for others: a thread of ours does it for all."""

    _setter: ThreadPoolExecutor
    _limits: Any

    def __init__(self) -> None:
        self._lock, self._inside = threading.Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._setter = ThreadPoolExecutor(1)
                self._limits = self._setter.submit(threadpool_limits, 1, "blas").result()
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._setter.submit(self._limits.restore_original_limits)
                self._setter.shutdown()


one_blas_thread = _OneBlasThread()


class Executor(Protocol):
    """Where units of work run: `Threads` here, or the workers of a cluster. The outputs are the same."""

    def flow(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Generator[tuple[int, Output], None, None]:
        """(index, function(job)) of each job, in the order in which they end. Close it to drop what has not begun.

        A job is asked for when its turn comes, so that not all need be in memory.
        """


@dataclass(frozen=True)
class Threads:
    """So many threads of this machine, all cores by default."""

    workers: int | None = None

    def flow(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Generator[tuple[int, Output], None, None]:
        """As `Executor.flow`. An exception, Ctrl-C too, is not kept waiting: what has not begun is dropped, what has
        begun ends by itself. BLAS has one thread meanwhile."""
        waiting, ended = deque(range(len(jobs))), SimpleQueue[Any]()
        threads = min(cores(self.workers), len(jobs))

        def labour() -> None:  # a future for each job would cost a tenth of a simulation
            with suppress(IndexError):
                while True:
                    index = waiting.popleft()
                    try:
                        ended.put((index, function(jobs[index]), None))
                    except BaseException as error:  # raised again in the thread that waits
                        ended.put((index, None, error))

        with one_blas_thread:
            if threads < 2:
                for index in waiting:
                    yield index, function(jobs[index])
                return
            pool = ThreadPoolExecutor(threads)
            try:
                for _ in range(threads):
                    pool.submit(labour)
                for _ in range(len(jobs)):
                    index, result, error = ended.get()
                    if error:
                        raise error
                    yield index, result
            finally:
                waiting.clear()
                pool.shutdown(wait=False)


def each(
    function: Callable[[Job], Output],
    jobs: Iterable[Job],
    workers: int | None = None,
    on_output: Callable[[int, Output], None] | None = None,
) -> list[Output]:
    """function(job) of each job, in their order, on so many threads (all cores by default). `on_output` is called in
    this thread with the index and the output of each job, in the order in which they end."""
    outputs: dict[int, Output] = {}
    with closing(Threads(workers).flow(function, list(jobs))) as flow:
        for index, result in flow:
            outputs[index] = result
            if on_output:
                on_output(index, result)
    return [outputs[index] for index in range(len(outputs))]


def run_in_thread(function: Callable[[], Output]) -> Output:
    """function() in a thread of its own: this one only waits, so that Ctrl-C ends a long compilation, too."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(function).result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class Stoppable:
    """Work on one list of jobs at a time, on all cores, which another thread ends by setting `stopped`; `busy`: locked
    while it goes on."""

    def __init__(self) -> None:
        self.busy, self.stopped = threading.Lock(), threading.Event()
        self._left: set[Future[Any]] = set()  # jobs that ran when it was stopped: they end by themselves

    def ready(self) -> bool:
        """Whether nothing goes on; a stop of before is forgotten then."""
        if free := not self.busy.locked():
            self.stopped.clear()
        return free

    def each(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> list[Output | None]:
        """function(job) of each, in their order; None for those that had not ended when it was stopped.

        Raises InputError: stopped before the first ended, or the list before still runs.
        """
        free = self.busy.acquire(blocking=False)
        require(free, "the run before goes on: stop it, or wait for its end", "parallel.busy")
        try:
            wait(self._left)  # one who stops and starts in turns takes no more cores than others
            pool = ThreadPoolExecutor(cores())
            tasks = [pool.submit(function, job) for job in jobs]
            left = set(tasks)
            while left and not self.stopped.is_set():
                left = wait(left, timeout=0.1, return_when=FIRST_COMPLETED).not_done
            pool.shutdown(wait=False, cancel_futures=True)
            self._left = {task for task in left if not task.cancelled()}
        finally:
            self.busy.release()
        require(len(left) < len(tasks), "stopped before a shot was done: nothing has changed", "parallel.stopped")
        return [None if task in left else task.result() for task in tasks]


def call_glibc(name: str, *arguments: int) -> None:
    """Call a function of the C library on memory, where it is glibc."""
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None)[name](*arguments)

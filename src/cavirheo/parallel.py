"""Work on all cores, with threads: the solver lets go of the interpreter while it computes. What an executor is."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.pool import Pool
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from cavirheo.errors import expect_whole, require

Job = TypeVar("Job")
Done = TypeVar("Done")


def cores(workers: int | None = None) -> int:
    """`workers`, or as many as the machine has."""
    if workers is not None:
        expect_whole(workers, "workers", 1)
    return workers or os.cpu_count() or 1


class _OneBlasThread:
    """While any thread is in this block, BLAS computes in the thread that calls it: its own threads would only wait for
    each other beside ours, and with them the last bits differ.

    threadpoolctl lets one thread set the number, and does nothing for others: a thread of ours does it for all.
    """

    def __init__(self) -> None:
        self._lock, self._inside = threading.Lock(), 0
        self._setter: Any = None
        self._limits: Any = None

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
    """Where units of work are done: `Threads` here, or the workers of a cluster. What is found is the same."""

    def flow(self, work: Callable[[Job], Done], jobs: Sequence[Job]) -> Generator[tuple[int, Done], None, None]:
        """(index, work(job)) of each job, in the order in which they end. Close it to drop what has not begun.

        A job is asked for when its turn comes, so that not all need be in memory.
        """


@dataclass(frozen=True)
class Threads:
    """So many threads of this machine, all cores by default."""

    workers: int | None = None

    def flow(self, work: Callable[[Job], Done], jobs: Sequence[Job]) -> Generator[tuple[int, Done], None, None]:
        """As `Executor.flow`. An exception, Ctrl-C too, is not kept waiting: what has not begun is dropped, what has
        begun ends by itself. BLAS has one thread meanwhile."""
        with one_blas_thread:
            yield from self._flow(work, jobs)

    def _flow(self, work: Callable[[Job], Done], jobs: Sequence[Job]) -> Generator[tuple[int, Done], None, None]:
        waiting, ended = deque(range(len(jobs))), SimpleQueue[Any]()
        count = len(waiting)
        threads = min(cores(self.workers), count)
        if threads < 2:
            for index in waiting:
                yield index, work(jobs[index])
            return
        pool = ThreadPoolExecutor(threads)

        def labour() -> None:  # a future for each job would cost a tenth of a simulation
            with suppress(IndexError):
                while True:
                    index = waiting.popleft()
                    try:
                        ended.put((index, work(jobs[index]), None))
                    except BaseException as error:  # raised again in the thread that waits
                        ended.put((index, None, error))

        try:
            for _ in range(threads):
                pool.submit(labour)
            for _ in range(count):
                index, result, error = ended.get()
                if error:
                    raise error
                yield index, result
        finally:
            waiting.clear()
            pool.shutdown(wait=False)


def each(
    work: Callable[[Job], Done],
    jobs: Iterable[Job],
    workers: int | None = None,
    done: Callable[[int, Done], None] | None = None,
) -> list[Done]:
    """work(job) of each job, in their order, on so many threads (all cores by default).

    `done` is called in this thread with the index of each and what came of it, in the order in which they end.
    """
    found: dict[int, Done] = {}
    with closing(Threads(workers).flow(work, list(jobs))) as flow:
        for index, result in flow:
            found[index] = result
            if done:
                done(index, result)
    return [found[index] for index in range(len(found))]


def aside(work: Callable[[], Done]) -> Done:
    """work() in a thread of its own: this one only waits, so that Ctrl-C is obeyed during a long compilation, too."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(work).result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class Stoppable:
    """Work on one list of jobs at a time, on all cores, which another thread ends by setting `stopped`; `busy`: locked
    while it goes on."""

    def __init__(self) -> None:
        self.busy, self.stopped = threading.Lock(), threading.Event()
        self._left: set[Future[Any]] = set()  # jobs that were in work when it was stopped: they end by themselves

    def ready(self) -> bool:
        """Whether nothing goes on; a stop of before is forgotten then."""
        if free := not self.busy.locked():
            self.stopped.clear()
        return free

    def each(self, work: Callable[[Job], Done], jobs: Sequence[Job]) -> list[Done | None]:
        """work(job) of each, in their order; None for those that were not done when it was stopped.

        Raises InputError: stopped before the first was done, or the list before is in work.
        """
        free = self.busy.acquire(blocking=False)
        require(free, "the run before goes on: stop it, or wait for its end", "parallel.busy")
        try:
            wait(self._left)  # one who stops and starts in turns takes no more cores than others
            pool = ThreadPoolExecutor(cores())
            tasks = [pool.submit(work, job) for job in jobs]
            left = set(tasks)
            while left and not self.stopped.is_set():
                left = wait(left, timeout=0.1, return_when=FIRST_COMPLETED).not_done
            pool.shutdown(wait=False, cancel_futures=True)
            self._left = {task for task in left if not task.cancelled()}
        finally:
            self.busy.release()
        require(len(left) < len(tasks), "stopped before a shot was done: nothing has changed", "parallel.stopped")
        return [None if task in left else task.result() for task in tasks]


@contextmanager
def processes(workers: int) -> Iterator[Pool]:
    """So many, which leave Ctrl+C to this one and end at once when the block is left; for Python that keeps its
    interpreter busy. The main module of the program must be safe to import."""
    ours = threading.current_thread() is threading.main_thread()  # others may not change signals
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if ours else None  # which is inherited
    try:
        pool = multiprocessing.get_context("spawn").Pool(workers, _follow)
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)
    with pool:
        yield pool


def _follow() -> None:
    """Such a process ends with the one that asked, however that ends."""

    def wait() -> None:
        if asking := multiprocessing.parent_process():
            asking.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def of_memory(name: str, *given: int) -> None:
    """Call a function of the C library on memory, where it is glibc."""
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None)[name](*given)

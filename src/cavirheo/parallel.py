"""Work on all cores, with threads: the solver lets go of the interpreter while it computes. What an executor is."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing.pool import Pool
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

from cavirheo.errors import expect_whole, require

Job = TypeVar("Job")
Done = TypeVar("Done")


def cores(workers: int | None = None) -> int:
    """`workers`, or as many as the machine has."""
    if workers is not None:
        expect_whole(workers, "workers", 1)
    return workers or os.cpu_count() or 1


class _OneBlasThread:
    """While threads of ours work, BLAS computes in the thread that calls it: its own would only wait for each other
    beside these. The limit is of the whole process: the first to work sets it, and the last takes it back."""

    def __init__(self) -> None:
        self._lock, self._working, self._limit = threading.Lock(), 0, ExitStack()

    def __enter__(self) -> None:
        from threadpoolctl import threadpool_limits

        with self._lock:
            if not self._working:
                self._limit.enter_context(threadpool_limits(1, "blas"))
            self._working += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._working -= 1
            if not self._working:
                self._limit.close()


_one_blas_thread = _OneBlasThread()


class Executor(Protocol):
    """Where units of work are done: `Threads` here, or the workers of a cluster. What is found is the same."""

    def flow(self, work: Callable[[Job], Done], jobs: Sequence[Job]) -> Generator[tuple[int, Done], None, None]:
        """(index, work(job)) of each job, in the order in which they end. Close it to drop what has not begun.

        A job is asked for when its turn comes, so that not all need be in memory.
        """


@dataclass(frozen=True)
class Step:
    """`verb(curves, done=..., **settings)`, or of a later step `verb(curves, answers, done=..., **settings)`.

    doing: as the bar says it. made_with: what an answer depends on besides the settings: a model's SHA-256. No
    answer depends on other curves, so that each can be kept.
    """

    doing: str
    verb: Callable[..., list[Any]]
    settings: Mapping[str, Any]
    made_with: str = ""

    @property
    def identity(self) -> list[Any]:
        """What its answers depend on besides the curves."""
        return [version("cavirheo"), self.verb.__name__, self.made_with, sorted(self.settings.items())]


@dataclass(frozen=True)
class Threads:
    """So many threads of this machine, all cores by default."""

    workers: int | None = None

    def flow(self, work: Callable[[Job], Done], jobs: Sequence[Job]) -> Generator[tuple[int, Done], None, None]:
        """As `Executor.flow`. An exception, Ctrl-C too, is not kept waiting: what has not begun is dropped, what has
        begun ends by itself. BLAS has one thread meanwhile."""
        with _one_blas_thread:
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


def one_of(verb: Callable[..., list[Done]], settings: Mapping[str, Any], job: Sequence[Any]) -> Done:
    """What `verb`, which takes lists and gives a list, finds for the items (item, of a further list, ...) of a job: a
    unit of work for an executor, in one thread."""
    return verb(*([item] for item in job), workers=1, **settings)[0]


def aside(work: Callable[[], Done]) -> Done:
    """work() in a thread of its own: this one only waits, so that Ctrl-C is obeyed during a long compilation, too."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(work).result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


class Once:
    """What several threads ask for with equal arguments is worked out by the first, and the others wait; the last
    `most` are kept. A failure is told to all who wait, and is not kept."""

    def __init__(self, most: int) -> None:
        self._most, self._lock, self._kept = most, threading.Lock(), OrderedDict[bytes, Future[Any]]()

    def __call__(self, work: Callable[[], Done], *asked: Any) -> Done:
        """work(), where nobody has `asked` for the same before."""
        key = pickle.dumps(asked)  # bytes to compare: nobody reads them
        with self._lock:
            mine = key not in self._kept
            task: Future[Done] = self._kept.setdefault(key, Future())
            self._kept.move_to_end(key)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        if mine:
            try:
                task.set_result(work())
            except BaseException as error:  # raised again in every thread that waits
                with self._lock:
                    self._kept.pop(key, None)
                task.set_exception(error)
        return task.result()


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

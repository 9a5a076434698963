"""Work on all cores: what an executor is, and those of this machine, with threads and with processes."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ThreadPoolExecutor, wait
from contextlib import ContextDecorator, closing, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import resource_tracker
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from cavirheo.errors import InputError, expect_whole, require

Job = TypeVar("Job")
Output = TypeVar("Output")
FEWEST = 2  # jobs of some seconds for which processes are started, which takes a second or two
AHEAD = 2  # jobs sent to each process: one that runs and one that waits there
SAFE_PATH = {"PYTHONSAFEPATH": "1"}  # of a Python that does not look for modules in the current folder
IDLE = 30.0  # s after which a process without work ends
_pools: dict[tuple[int, int], Any] = {}  # the latest, by (this process, how many): the next flow uses it again
_in_use = threading.Lock()  # by a flow
_here = threading.Lock()  # held by the thread that does a job of `run_on_any_core`
_starting = threading.Lock()  # of processes, by threads


def cores(workers: int | None = None) -> int:
    """`workers`, or as many as this process may use: those of the machine, of its container or of its job, and at most
    LOKY_MAX_CPU_COUNT of the environment."""
    if workers is None:
        try:
            return int(_loky().cpu_count())
        except ValueError:
            given = os.environ.get("LOKY_MAX_CPU_COUNT")
            raise InputError(f"LOKY_MAX_CPU_COUNT must be a whole number, got {given!r}", "parallel.cores") from None
    expect_whole(workers, "workers", 1)
    return workers


class _OneBlasThread(ContextDecorator):
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
    """Where units of work run: `Threads` or `Processes` here, or the workers of a cluster. The outputs are the same."""

    def flow(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Generator[tuple[int, Output], None, None]:
        """(index, function(job)) of each job, in the order in which they end. Close it to drop what has not begun.

        A job is asked for when its turn comes, so that not all need be in memory.
        """


@dataclass(frozen=True)
class Threads:
    """So many threads of this machine, all cores by default: for what the solver, which lets go of the interpreter,
    does most of."""

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


@dataclass(frozen=True)
class Processes:
    """So many processes of this machine, all cores by default: for jobs of seconds that are mostly Python's, of which
    threads do one at a time."""

    workers: int | None = None

    def flow(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Generator[tuple[int, Output], None, None]:
        """As `Executor.flow`. What has begun when it is closed, or by an exception, ends at once. Threads do the work
        while another flow of this process has the processes, or where there cannot be any; this thread does a job that
        cannot be sent. Raises InputError: a process was ended from outside; and what `function` raises."""
        count, waiting = min(cores(self.workers), len(jobs)), deque(range(len(jobs)))
        mine = bool(jobs) and _in_use.acquire(blocking=False)
        sent: dict[Future[Output], int] = {}
        try:
            pool = _pool_of(count) if mine else None
            if pool is None:
                yield from Threads(self.workers).flow(function, jobs)
                return
            while waiting or sent:
                while waiting and len(sent) < AHEAD * count:
                    index = waiting.popleft()
                    sent[pool.submit(function, jobs[index])] = index
                for future in wait(sent, return_when=FIRST_COMPLETED).done:
                    try:
                        result = future.result()
                    except _loky().process_executor.PicklingError:
                        result = function(jobs[sent[future]])
                    yield sent.pop(future), result
        except BrokenExecutor as error:
            message = f"one of {count} processes was ended from outside, for want of memory perhaps"
            mending = "the same command goes on; LOKY_MAX_CPU_COUNT=1 before it asks for one process alone"
            raise InputError(f"{message}: {mending}", "parallel.ended") from error
        finally:
            if sent:
                end_processes()
            if mine:
                _in_use.release()


def _loky() -> Any:
    """The library of processes, imported where Ctrl-C cannot stop it halfway, after which no import would mend it."""
    return run_in_thread(lambda: import_module("loky"))


@contextmanager
def _protected_start() -> Iterator[None]:
    """Processes that are started here run nothing that lies in the current folder, and neither Ctrl-C nor the end of
    the terminal reaches them: this process ends them."""
    before, mask = os.environ.get("PYTHONSAFEPATH"), None
    os.environ |= SAFE_PATH
    try:
        if hasattr(signal, "pthread_sigmask"):
            resource_tracker.ensure_running()  # whose start takes the mask off
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
        yield
    finally:
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


def _pool_of(count: int) -> Any:
    """So many processes, those of before if there are as many; None where there cannot be any: a sandbox without the
    means by which they wait for each other, or no room for more."""
    key, loky = (os.getpid(), count), _loky()
    if any(process != os.getpid() for process, _ in _pools):
        _pools.clear()  # of the process that this one is a fork of
    if key not in _pools:
        end_processes()
    for _ in range(2):  # those of before may have been ended from outside meanwhile
        with suppress(OSError, RuntimeError, NameError), _protected_start():  # NameError: of loky, where files run out
            if key not in _pools:
                how = {"timeout": IDLE, "initializer": _depend_on, "initargs": (os.getpid(),), "env": SAFE_PATH}
                _pools[key] = loky.ProcessPoolExecutor(count, **how)
            _pools[key].submit(int)  # starts them, or those anew that have ended for want of work
            return _pools[key]
        end_processes()
    return None


def end_processes() -> None:
    """End those that `Processes` has started, whatever they do. A process that leaves without its exit handlers calls
    it first."""
    while _pools:
        _pools.popitem()[1].shutdown(kill_workers=True)
        gc.collect()  # gives their semaphores back, which are in cycles: else a line on stderr says that they leaked


def _depend_on(parent: int) -> None:
    """Ctrl-C is for the parent of this process, which ends it; if the parent is killed, so is this."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where it was not blocked

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def of_this_machine(jobs: int, workers: int | None = None) -> Executor:
    """That for so many jobs of some seconds: processes, but for few jobs or in one of several processes of somebody
    else, which would wait for ours at its end."""
    several = jobs >= FEWEST and cores(workers) > 1 and multiprocessing.parent_process() is None
    return Processes(workers) if several else Threads(workers)


def each(
    function: Callable[[Job], Output],
    jobs: Iterable[Job],
    executor: Executor | int | None = None,
    on_output: Callable[[int, Output], None] | None = None,
) -> list[Output]:
    """function(job) of each job, in their order, by an executor or on so many threads (all cores by default).
    `on_output` is called in this thread with the index and the output of each job, in the order in which they end."""
    outputs: dict[int, Output] = {}
    chosen = Threads(executor) if executor is None or isinstance(executor, int) else executor
    with closing(chosen.flow(function, list(jobs))) as flow:
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


def run_on_any_core(function: Callable[..., Output], *arguments: Any) -> Output:
    """function(*arguments), mostly Python's, for one of several threads: in this thread, or by a process while another
    thread of this process is in here, which would only take turns with it. The output is the same."""
    if _here.acquire(blocking=False):
        try:
            return function(*arguments)
        finally:
            _here.release()
    if cores() > 1 and multiprocessing.parent_process() is None:
        with _starting:
            pool = _pool_of(cores())
        with suppress(BrokenExecutor, _loky().process_executor.PicklingError):  # ended from outside, or cannot be sent
            if pool:
                return pool.submit(function, *arguments).result()
    return function(*arguments)


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

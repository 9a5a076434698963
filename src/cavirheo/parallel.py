"""Work on all cores: the interface of executors, and those of this machine, with threads and with processes."""

from __future__ import annotations

import ctypes
import multiprocessing
import multiprocessing.util
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
FEWEST_FOR_PROCESSES = 2  # jobs of some seconds for which processes are started: their start takes a second or two
JOBS_PER_PROCESS = 2  # jobs sent to each process: one that runs and one that waits
SAFE_PATH = {"PYTHONSAFEPATH": "1"}  # environment of a Python that imports no modules from the current folder
# loky restarts a process that has so many bytes more than after its first job; here the first job loads nothing
_PROCESS_ENVIRONMENT = SAFE_PATH | {"LOKY_MAX_MEMORY_LEAK_SIZE": "2e9"}
IDLE = 30.0  # s after which a process without work ends
_pools: dict[tuple[int, int], Any] = {}  # the latest pool, by (process id, size): it is used again
_processes_lock = threading.Lock()  # held by the call of `map_unordered` that uses the processes
_calling_thread_lock = threading.Lock()  # held by the thread that itself runs a job of `run_on_any_core`
_start_lock = threading.Lock()  # held by the thread that starts processes


def cores(workers: int | None = None) -> int:
    """`workers`, or the number of cores that this process may use: those of the machine, its container or its cluster
    job, and at most LOKY_MAX_CPU_COUNT of the environment. Raises InputError: not a whole number from 1 up."""
    if workers is None:
        try:
            return int(_loky().cpu_count())
        except ValueError:
            given = os.environ.get("LOKY_MAX_CPU_COUNT")
            raise InputError(f"LOKY_MAX_CPU_COUNT must be a whole number, got {given!r}", "parallel.cores") from None
    expect_whole(workers, "workers", 1)
    return workers


class _OneBlasThread(ContextDecorator):
    """While any thread is in this block, BLAS computes in the calling thread: BLAS threads beside those of an executor
    would only wait for each other, and they change the last bits of results. threadpoolctl accepts the number of
    threads from one thread only, so `_setter` sets and restores it for all threads."""

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
    """Runs jobs: `Threads` or `Processes` of this module, or the workers of a cluster. The outputs are the same."""

    def map_unordered(
        self, function: Callable[[Job], Output], jobs: Sequence[Job]
    ) -> Generator[tuple[int, Output], None, None]:
        """(index, function(job)) of each job, in the order in which they end. Closing it drops jobs not yet begun.

        An element of `jobs` is read when its turn comes, so that not all jobs need to be in memory.
        """


@dataclass(frozen=True)
class Threads:
    """`workers` threads of this machine, by default one per core: for jobs that mostly run the compiled solver, which
    releases Python's global lock."""

    workers: int | None = None

    def map_unordered(
        self, function: Callable[[Job], Output], jobs: Sequence[Job]
    ) -> Generator[tuple[int, Output], None, None]:
        """As `Executor.map_unordered`. An exception, also Ctrl-C, is raised at once: jobs not yet begun are dropped,
        jobs that have begun end by themselves. BLAS has one thread meanwhile. The main thread only waits: compiled code
        that Ctrl-C interrupts raises a SystemError."""
        waiting, ended = deque(range(len(jobs))), SimpleQueue[Any]()
        threads = max(min(cores(self.workers), len(jobs)), 1)
        may_work = threading.current_thread() is not threading.main_thread()

        def work() -> None:  # a future for each job would cost a tenth of a simulation
            with suppress(IndexError):
                while True:
                    index = waiting.popleft()
                    try:
                        ended.put((index, function(jobs[index]), None))
                    except BaseException as error:  # raised again in the thread that waits
                        waiting.clear()
                        ended.put((index, None, error))

        with one_blas_thread:
            if threads < 2 and may_work:
                for index in waiting:
                    yield index, function(jobs[index])
                return
            pool = ThreadPoolExecutor(threads)
            try:
                for _ in range(threads):
                    pool.submit(work)
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
    """`workers` processes of this machine, by default one per core: for jobs of some seconds that mostly run Python
    code, which threads would run one at a time."""

    workers: int | None = None

    def map_unordered(
        self, function: Callable[[Job], Output], jobs: Sequence[Job]
    ) -> Generator[tuple[int, Output], None, None]:
        """As `Executor.map_unordered`. After its close or an exception, running jobs end at once. Threads do the work
        while another call in this process uses the processes, or where none can be started; the calling thread runs a
        job that cannot be pickled. Raises InputError: a process was ended from outside; and what `function` raises."""
        count, waiting = min(cores(self.workers), len(jobs)), deque(range(len(jobs)))
        locked = bool(jobs) and _processes_lock.acquire(blocking=False)
        sent: dict[Future[Output], int] = {}
        try:
            pool = _pool_of(count) if locked else None
            if pool is None:
                yield from Threads(self.workers).map_unordered(function, jobs)
                return
            while waiting or sent:
                while waiting and len(sent) < JOBS_PER_PROCESS * count:
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
            if locked:
                _processes_lock.release()


def _loky() -> Any:
    """The library loky, imported in a thread: if Ctrl-C interrupted the import, it could not be imported again."""
    return run_in_thread(lambda: import_module("loky"))


@contextmanager
def _protected_start() -> Iterator[None]:
    """Processes that are started in this block import no modules from the current folder, and receive neither Ctrl-C
    nor the hang-up of the terminal: this process ends them."""
    before, mask = os.environ.get("PYTHONSAFEPATH"), None
    os.environ |= SAFE_PATH
    try:
        if hasattr(signal, "pthread_sigmask"):
            resource_tracker.ensure_running()  # its start would remove the mask
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
    """A pool of `count` processes, the latest one if it has this size; None if none can be started, as in a sandbox
    without semaphores, or without enough memory or files."""
    key, loky = (os.getpid(), count), _loky()
    if any(process != os.getpid() for process, _ in _pools):
        _pools.clear()  # pools of the process that this one was forked from
    if key not in _pools:
        end_processes()
    for _ in range(2):  # the processes of the latest pool may have been ended from outside
        with suppress(OSError, RuntimeError, NameError), _protected_start():  # NameError: of loky, too many open files
            if key not in _pools:
                options = {"timeout": IDLE, "initializer": _tie_to_parent, "initargs": (os.getpid(),)}
                _pools[key] = loky.ProcessPoolExecutor(count, **options, env=_PROCESS_ENVIRONMENT)
            _pools[key].submit(int)  # starts the processes, also again after they ended for lack of work
            return _pools[key]
        end_processes()
    return None


def end_processes() -> None:
    """End all processes that `Processes` has started, even running ones."""
    while _pools:
        _pools.popitem()[1].shutdown(kill_workers=True)


def prepare_exit() -> None:
    """End all processes, and release what they shared. To be called before an exit that skips the exit handlers."""
    end_processes()
    for thread in threading.enumerate():  # of loky: an exit while one of them releases a semaphore shows it as leaked
        if thread.name in ("ExecutorManagerThread", "QueueFeederThread"):
            thread.join(1.0)
    multiprocessing.util._run_finalizers(0)  # type: ignore[attr-defined]  # otherwise stderr shows leaked semaphores


def _tie_to_parent(parent: int) -> None:
    """Make this process ignore Ctrl-C, because its parent ends it, and exit if the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # in case it is not blocked

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def default_executor(jobs: int, workers: int | None = None) -> Executor:
    """The executor for this number of jobs of some seconds: processes, or threads for few jobs and in a child process
    of another program, which would wait for our processes at its end."""
    use_processes = jobs >= FEWEST_FOR_PROCESSES and cores(workers) > 1 and multiprocessing.parent_process() is None
    return Processes(workers) if use_processes else Threads(workers)


def run_jobs(
    function: Callable[[Job], Output],
    jobs: Iterable[Job],
    executor: Executor | int | None = None,
    on_output: Callable[[int, Output], None] | None = None,
) -> list[Output]:
    """function(job) of each job, in their order, by an executor or on this number of threads (default: all cores).
    `on_output` is called in this thread with the index and the output of each job, in the order in which they end."""
    outputs: dict[int, Output] = {}
    chosen = Threads(executor) if executor is None or isinstance(executor, int) else executor
    with closing(chosen.map_unordered(function, list(jobs))) as pairs:
        for index, result in pairs:
            outputs[index] = result
            if on_output:
                on_output(index, result)
    return [outputs[index] for index in range(len(outputs))]


def run_in_thread(function: Callable[[], Output]) -> Output:
    """function() in a new thread: the calling thread only waits, so that Ctrl-C ends even a long compilation."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(function).result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def run_on_any_core(function: Callable[..., Output], *arguments: Any) -> Output:
    """function(*arguments), mostly Python code, for one of several threads: runs in the calling thread, or in a process
    while another thread runs such a function, because two threads would take turns. The output is the same."""
    if _calling_thread_lock.acquire(blocking=False):
        try:
            return function(*arguments)
        finally:
            _calling_thread_lock.release()
    if cores() > 1 and multiprocessing.parent_process() is None:
        with _start_lock:
            pool = None if _processes_lock.locked() else _pool_of(cores())
        errors = _loky().process_executor
        # the processes were ended, from outside or for a `map_unordered`, or the job cannot be sent
        with suppress(BrokenExecutor, errors.ShutdownExecutorError, errors.PicklingError):
            if pool:
                return pool.submit(function, *arguments).result()
    return function(*arguments)


class Stoppable:
    """Runs one list of jobs at a time, on all cores, until another thread sets `stopped`; `busy` is locked while a list
    runs."""

    def __init__(self) -> None:
        self.busy, self.stopped = threading.Lock(), threading.Event()
        self._left: set[Future[Any]] = set()  # jobs that were running at the stop: they end by themselves

    def ready(self) -> bool:
        """Whether no list runs; if so, an earlier stop is cleared."""
        if free := not self.busy.locked():
            self.stopped.clear()
        return free

    def run_jobs(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> list[Output | None]:
        """function(job) of each job, in their order; None for jobs that had not ended at the stop.

        Raises InputError: stopped before the first job ended, or the previous list still runs.
        """
        free = self.busy.acquire(blocking=False)
        require(free, "the run before goes on: stop it, or wait for its end", "parallel.busy")
        try:
            wait(self._left)  # so a user who stops and starts repeatedly gets no more cores
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
    """Call a memory function of glibc, such as malloc_trim; no effect with another C library."""
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None)[name](*arguments)

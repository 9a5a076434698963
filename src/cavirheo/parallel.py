"""Work on all cores: executors of this machine, with threads and with processes."""

from __future__ import annotations

import multiprocessing
import multiprocessing.util
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from cavirheo.errors import InputError, expect_whole

Job = TypeVar("Job")
Output = TypeVar("Output")
Flow = Generator[tuple[int, Output], None, None]  # (index of a job, its output), in the order in which jobs end
Executor = Callable[[Callable[[Any], Any], Sequence[Any]], Flow[Any]]
"""Runs function(job) for each job: on threads or processes of this machine, or on a cluster. The outputs are the same.
Closing the flow drops jobs that have not begun."""
# no modules from the current folder; loky restarts a process with so many bytes more than after its first job
_ENVIRONMENT = {"PYTHONSAFEPATH": "1", "LOKY_MAX_MEMORY_LEAK_SIZE": "2e9"}
IDLE = 30.0  # s after which a process without work ends
_pools: dict[Any, str] = {}  # the living pools of this process, each "idle", "lent", or "shared" by threads
_pool_lock = threading.RLock()  # a thread that holds it may have to close a flow that nobody uses any more
_calling_thread_lock = threading.Lock()  # held by the thread that itself runs a job of `run_on_any_core`
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)  # a pool is of the process that started it


def cores(workers: int | None = None) -> int:
    """`workers`, or the number of cores that this process may use: those of the machine, its container or its cluster
    job, and at most LOKY_MAX_CPU_COUNT of the environment. Raises InputError: not a whole number from 1 up."""
    if workers is None:
        from loky import cpu_count  # the import takes a third of a second

        try:
            return int(cpu_count())
        except ValueError:
            text = os.environ.get("LOKY_MAX_CPU_COUNT")
            raise InputError(f"LOKY_MAX_CPU_COUNT must be a whole number, got {text!r}", "parallel.cores") from None
    expect_whole(workers, "workers", 1)
    return workers


class _OneBlasThread:
    """While any thread is in this block, BLAS computes in the calling thread: BLAS threads beside those of an executor
    would only wait for each other, and they change the last bits of results. threadpoolctl accepts the number of
    threads from one thread only, so `_setter` sets and restores it for all threads."""

    _setter: ThreadPoolExecutor
    _limits: Any

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0

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


def on_threads(function: Callable[[Job], Output], jobs: Sequence[Job], workers: int | None = None) -> Flow[Output]:
    """An `Executor` with `workers` threads of this machine, by default one per core: for jobs that mostly run the
    compiled solver, which releases Python's global lock. An exception, also Ctrl-C, is raised at once, and jobs that
    have begun end by themselves. BLAS has one thread meanwhile. The main thread only waits: compiled code that Ctrl-C
    interrupts raises a SystemError."""
    with one_blas_thread:
        pool = ThreadPoolExecutor(max(min(cores(workers), len(jobs)), 1))
        try:
            indices = {pool.submit(function, job): index for index, job in enumerate(jobs)}
            for future in as_completed(indices):
                yield indices.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def on_processes(function: Callable[[Job], Output], jobs: Sequence[Job], workers: int | None = None) -> Flow[Output]:
    """An `Executor` with `workers` processes of this machine, by default one per core: for jobs of some seconds that
    mostly run Python code, which threads would run one at a time. After its close or an exception, running jobs end at
    once. Threads do the work where no process can be started. Raises InputError: a process was ended from outside; and
    what `function` raises."""
    pool = _pool("lent", max(min(cores(workers), len(jobs)), 1))
    if pool is None:
        yield from on_threads(function, jobs, workers)
        return
    complete = not jobs
    try:
        indices = {pool.submit(function, job): index for index, job in enumerate(jobs)}
        for future in as_completed(list(indices)):
            index, output = indices.pop(future), future.result()
            complete = not indices
            yield index, output
    except BrokenExecutor as error:
        message = "a process of this machine was ended from outside, for want of memory perhaps"
        mending = "the same command goes on; LOKY_MAX_CPU_COUNT=1 before it asks for one process alone"
        raise InputError(f"{message}: {mending}", "parallel.ended") from error
    finally:
        with _pool_lock:
            kept = complete and pool in _pools
            if kept:
                _pools[pool] = "idle"
        if not kept:
            _end(pool)


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Processes that are started in this block receive neither Ctrl-C nor the hang-up of the terminal."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start would remove the mask
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _pool(use: str, count: int) -> Any:
    """A pool of `count` processes or more for this use, an idle or a new one; None if none can be started, as in a
    sandbox without semaphores, or without enough memory or files. Its processes end themselves when they have had no
    work for IDLE, or this one is killed, and leave Ctrl-C to this one."""
    from loky import ProcessPoolExecutor

    tied = {"initializer": tie_to_parent, "initargs": (os.getpid(),)}
    with _pool_lock, suppress(OSError, RuntimeError, NameError), _signals_blocked():  # NameError: of loky, many files
        for pool in [pool for pool, its_use in _pools.items() if its_use == "idle"]:
            if pool._max_workers >= count and _lives(pool):
                _pools[pool] = use
                return pool
            _end(pool, wait=False)
        pool = ProcessPoolExecutor(count, timeout=IDLE, env=_ENVIRONMENT, **tied)
        pool.submit(int)  # starts the processes
        _pools[pool] = use
        return pool
    return None


def _lives(pool: Any) -> bool:
    """Whether no process of an idle pool was ended from outside. Those that ended for want of work are started."""
    alive = all(process.is_alive() for process in [*pool._processes.values()])
    with suppress(BrokenExecutor):
        pool.submit(int)
        return alive
    return False


def _end(pool: Any, *, wait: bool = True) -> None:
    """End a pool and its processes, even running ones, once."""
    with _pool_lock:
        living = _pools.pop(pool, None)
    if living:
        pool.shutdown(wait=wait, kill_workers=True)


def tie_to_parent(parent: int) -> None:
    """Make this process leave Ctrl-C to its parent, and end if the parent is killed: it would wait for ever for someone
    to read its output."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def prepare_exit() -> None:
    """End all processes that this one has started, even running ones, and release what they shared. To be called before
    an exit that skips the exit handlers."""
    with _pool_lock:
        pools = [*_pools]
    for pool in pools:
        _end(pool)
    for thread in threading.enumerate():  # of loky: an exit while one of them releases a semaphore shows it as leaked
        if thread.name in ("ExecutorManagerThread", "QueueFeederThread"):
            thread.join(1.0)
    multiprocessing.util._run_finalizers(0)  # type: ignore[attr-defined]  # otherwise stderr shows leaked semaphores


def default_executor(jobs: int, workers: int | None = None) -> Executor:
    """The executor for this number of jobs of some seconds: processes, or threads for one job and in a child process of
    another program, which would wait for our processes at its end."""
    use_processes = jobs > 1 and cores(workers) > 1 and multiprocessing.parent_process() is None
    return partial(on_processes if use_processes else on_threads, workers=workers)


def run_jobs(
    function: Callable[[Job], Output],
    jobs: Iterable[Job],
    workers: int | None = None,
    on_output: Callable[[int, Output], None] | None = None,
) -> list[Output]:
    """function(job) of each job, in their order, on this number of threads (default: all cores). `on_output` is called
    in this thread with the index and the output of each job, in the order in which they end."""
    outputs: dict[int, Output] = {}
    with closing(on_threads(function, list(jobs), workers)) as pairs:
        for index, result in pairs:
            outputs[index] = result
            if on_output:
                on_output(index, result)
    return [outputs[index] for index in range(len(outputs))]


def run_on_any_core(function: Callable[..., Output], *arguments: Any) -> Output:
    """function(*arguments), mostly Python code, for one of several threads: runs in the calling thread, or in a process
    while another thread runs such a function, because two threads would take turns. The output is the same."""
    if _calling_thread_lock.acquire(blocking=False):
        try:
            return function(*arguments)
        finally:
            _calling_thread_lock.release()
    with _pool_lock:
        pool = next((pool for pool, use in _pools.items() if use == "shared"), None)
        if not pool and cores() > 1:
            pool = _pool("shared", cores())
    if pool:
        try:
            output: Output = pool.submit(function, *arguments).result()
            return output
        except BrokenExecutor:  # ended from outside: the next call starts others
            _end(pool)
    return function(*arguments)

"""Verbs on many machines: an executor with the workers of a dask cluster (the extra [cluster]), which is found by its
address, or whose workers are jobs of SLURM (dask-jobqueue).

Every worker must have this machine's version and code, and all must simulate some bubbles with the same bits. Workers
get units of work in batches of some seconds, and only so many at once that the batches fit into memory here.
"""

from __future__ import annotations

import hashlib
import re
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cavirheo.errors import InputError, SolverError, require
from cavirheo.parallel import Job, Output

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster
    from distributed import Client

BATCH_SECONDS = 8.0  # duration of a batch, which is lost with a worker: one driver keeps 500 threads at work with it
BATCHES_PER_THREAD = 2  # batches for each thread: one that runs and one that waits
COUNT_INTERVAL = 1.0  # s between two counts of workers
MOST_JOBS = 1000  # largest number of jobs in a batch
SCHEDULER_TIMEOUT = 20  # s for a scheduler to answer, and for a first worker
QUEUE_TIMEOUT = 7 * 86400  # s for the first job of a queue
_ADDRESS = re.compile(r"(tcp|tls|ucx)://[\w.\[\]:-]+:\d{1,5}")
# dask's profiler asks Python for the stack frames of all threads a hundred times a second. Python 3.11 can hang at this
# call, and then the worker never returns its batch
_NO_PROFILE = "export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False"


class Identity(NamedTuple):
    """What decides the answers of a process. code, bits: SHA-256 of modules and networks, and of simulated curves."""

    version: str
    code: str
    bits: str


@cache
def identity() -> Identity:
    """Identity of this process. The first call loads the compiled solver and simulates four bubbles: in a liquid and in
    a viscoelastic solid, each with both kinds of contents."""
    from cavirheo.physics.bubble import ACCOMMODATION, FIELD, Bubble
    from cavirheo.physics.materials import LAWS
    from cavirheo.physics.simulate import simulate

    materials = (LAWS["newtonian"](viscosity=0.03), LAWS["nhkv"](shear_modulus=6e3, viscosity=0.05))
    time_s, digest = np.linspace(0.0, 1e-4, 200), hashlib.sha256()
    for material in materials:
        for bubble in (FIELD, Bubble("kinetic", ACCOMMODATION)):
            run = simulate(material, max_radius=2.45e-4, stretch=6.0, time=time_s, bubble=bubble)
            digest.update(run.radius.tobytes())
    return Identity(version("cavirheo"), code_hash(Path(__file__).parents[1]), digest.hexdigest())


def code_hash(package: Path) -> str:
    """SHA-256 of the modules and networks in a folder, without the app, on which no answer depends."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        if path.suffix in (".py", ".npz") and name.parts[0] != "app":
            digest.update(name.as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def required_identity(client: Client, notify: Callable[[str], None], wait: float) -> Identity:
    """The identity that every worker must have, also later ones. Raises InputError: no worker came within `wait` s, or
    one is refused; the message names it."""

    def probe() -> Any:  # sent with its code, so that a worker without cavirheo can answer, too
        from cavirheo.workflow.cluster import identity

        return tuple(identity())

    try:
        client.wait_for_workers(1, timeout=wait)
    except TimeoutError:
        address = client.scheduler_info()["address"]
        message = f"no worker came to {address} within {wait:.0f} s: start some, and try again"
        raise InputError(message, "cluster.no_worker") from None
    mine, workers = identity(), client.run(probe, on_error="return")
    ((usual, _),) = Counter(each[2] for each in workers.values() if isinstance(each, tuple)).most_common(1) or [("", 0)]
    refusals = []
    for address, worker in sorted(workers.items()):
        if isinstance(worker, BaseException):
            refusals.append(f"{address}: it cannot import what is needed ({worker})")
        elif worker[:2] != mine[:2]:
            refusals.append(f"{address}: it has cavirheo {worker[0]} ({worker[1][:8]}), and this is {_name(mine)}")
        elif worker[2] != usual:
            refusals.append(f"{address}: its simulations differ from the other workers' in their last bits")
    more = f"; and {len(refusals) - 3} more" if len(refusals) > 3 else ""
    message = f"refused {'; '.join(refusals[:3])}{more}: install the same cavirheo there, or stop them"
    require(not refusals, message, "cluster.refused")
    if usual != mine.bits:
        notify(
            "note: simulations of the workers differ from this machine's in their last bits: let them make all of it"
        )
    threads = sum(client.nthreads().values())
    notify(f"{len(workers)} workers with {threads} threads, all with cavirheo {mine.version} and the same bits")
    return mine._replace(bits=usual)


def _name(process: Identity) -> str:
    return f"{process.version} ({process.code[:8]})"


@dataclass(frozen=True)
class Workers:
    """All workers of a cluster, also those that come later; each must have the identity `required`."""

    client: Client
    required: Identity

    def map_unordered(
        self, function: Callable[[Job], Output], jobs: Sequence[Job]
    ) -> Generator[tuple[int, Output], None, None]:
        """As `Executor.map_unordered`. Another worker does the batches of a lost one. Raises InputError: a worker has
        another identity, a job ended several workers, or the scheduler is gone. Also raises errors of `function`."""
        from distributed import as_completed

        waiting = deque(range(len(jobs)))
        sent: dict[object, Sequence[int]] = {}
        running = as_completed(with_results=True, raise_errors=False, loop=self.client.loop)
        size, counted_at, most = 1.0, 0.0, BATCHES_PER_THREAD
        try:
            while waiting or sent:
                if time.monotonic() > counted_at + COUNT_INTERVAL:
                    counted_at = time.monotonic()
                    most = BATCHES_PER_THREAD * max(sum(self.client.nthreads().values()), 1)
                while waiting and len(sent) < most:
                    count = min(round(size), max(len(waiting) // most, 1))
                    batch = [waiting.popleft() for _ in range(count)]
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
                ideal = BATCH_SECONDS * len(results) / max(seconds, 1e-6)
                size = 0.5 * size + 0.5 * min(max(ideal, 1.0), MOST_JOBS)
                yield from zip(indices, results, strict=True)
        finally:
            running.clear()
            self.client.cancel(list(sent), force=True)


def _batch(required: Identity, function: Callable[[Job], Output], jobs: Sequence[Job]) -> tuple[float, list[Output]]:
    """(duration in s, outputs of the jobs); runs on a worker. Raises InputError: it has another identity."""
    if identity() != required:
        from distributed import get_worker

        message = f"the worker {get_worker().address} has cavirheo {_name(identity())} with other code or last bits"
        raise InputError(f"{message}: stop it, and the same command goes on", "cluster.refused")
    started = time.perf_counter()
    results = [function(job) for job in jobs]
    return time.perf_counter() - started, results


def _error_of(status: str, outcome: object) -> BaseException:
    """The error to raise for a batch that failed; InputError and SolverError are returned unchanged."""
    error = outcome[1] if isinstance(outcome, tuple) and len(outcome) == 3 else outcome
    if isinstance(error, InputError | SolverError):
        return error
    if type(error).__name__ == "KilledWorker":
        message = f"one unit of work ended several workers, so it is given up: is their memory too small? {error}"
        return InputError(message, "cluster.killed")
    if status in ("cancelled", "lost"):
        return InputError("the scheduler is gone or was restarted: the same command goes on", "cluster.lost")
    return error if isinstance(error, BaseException) else InputError(f"a unit of work was {status}", "cluster.lost")


@contextmanager
def connected(scheduler: str | None, slurm: int | None, notify: Callable[[str], None]) -> Iterator[Workers | None]:
    """The executor of `--scheduler` ("tcp://HOST:PORT" or "tls://HOST:PORT" of a dask scheduler) or of `--slurm`, a
    number of jobs; without both None, which stands for this machine. Workers are checked before they get work. Raises
    InputError: no such scheduler, no workers, or workers that are refused (the message names them)."""
    if scheduler is None and slurm is None:
        yield None
        return
    both = "--scheduler names a cluster, and --slurm asks for another: leave out one of them"
    require(scheduler is None or slurm is None, both, "cluster.scheduler")
    expected = "--scheduler must be tcp://HOST:PORT (or tls://) of a dask scheduler"
    fine = scheduler is None or bool(_ADDRESS.fullmatch(scheduler))
    require(fine, f"{expected}, got {scheduler!r}", "cluster.scheduler")
    for library in ("distributed", *(["dask_jobqueue"] if slurm else [])):
        message = f'clusters need {library}: pip install "cavirheo[cluster]" here and on the workers'
        require(_installed(library), f"{message}; without it all runs here", "cluster.extra")
    with _client_of(scheduler) if scheduler else _client_of_jobs(slurm or 1, notify) as client:
        yield Workers(client, required_identity(client, notify, SCHEDULER_TIMEOUT if scheduler else QUEUE_TIMEOUT))


def _installed(library: str) -> bool:
    try:
        return bool(find_spec(library))
    except ValueError:  # None in sys.modules
        return False


def _client_of(scheduler: str) -> Client:
    from distributed import Client

    try:
        return Client(scheduler, timeout=SCHEDULER_TIMEOUT)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = str(error).partition("\n")[0] or "time out"
        message = f"no dask scheduler answers at {scheduler} ({reason}); start one with `dask scheduler`"
        raise InputError(message, "cluster.unreachable") from None


@contextmanager
def _client_of_jobs(count: int, notify: Callable[[str], None]) -> Iterator[Client]:
    from distributed import Client

    message = "there is no command sbatch: give --slurm on a machine of the cluster, such as its login node"
    require(which("sbatch") is not None, message, "cluster.slurm")
    with slurm_cluster() as cluster, Client(cluster) as client:
        cluster.scale(jobs=count)
        notify(f"{count} jobs asked of SLURM; the work begins when the first is there")
        yield client


def slurm_cluster() -> SLURMCluster:
    """A scheduler in this process, without jobs yet; its jobs end with it. A job is as dask-jobqueue's own settings
    state it (jobqueue.slurm in ~/.config/dask/*.yaml), with one thread in each process. Raises InputError: they do not,
    or it cannot be started."""
    import dask

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    from dask_jobqueue import SLURMCluster  # its import replaces the handler of Ctrl-C

    if threading.current_thread() is threading.main_thread():
        for number, handler in handlers.items():
            signal.signal(number, handler)
    from distributed.security import Security

    dask.config.set({"distributed.scheduler.allowed-failures": 10})  # workers are also lost at a walltime
    settings = dask.config.get("jobqueue.slurm")
    place = "under jobqueue: slurm: in ~/.config/dask/jobqueue.yaml"
    missing = " and ".join(name for name in ("cores", "memory") if not settings[name])
    require(not missing, f"--slurm needs {missing} of a job: state them {place}", "cluster.slurm")
    try:
        return SLURMCluster(
            processes=settings["processes"] or settings["cores"],
            job_script_prologue=[_NO_PROFILE, *settings["job-script-prologue"]],
            shared_temp_directory=settings["shared-temp-directory"] or str(Path.home()),
            scheduler_options={"dashboard_address": "127.0.0.1:0"},
            security=Security.temporary(),
            protocol="tls://",
        )
    except (ImportError, OSError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(f"no jobs of SLURM can be asked for ({error}): see {place}", "cluster.slurm") from None

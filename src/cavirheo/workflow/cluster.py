"""Verbs on many machines: an executor with the workers of a dask cluster (the extra [cluster]). The cluster is found by
its address, or its workers are jobs of SLURM, as a small TOML file states.

Every worker must have this machine's version and code, and all must simulate some bubbles with the same bits. Workers
get units of work in batches of 2 to 60 s, and only so many at once that the batches fit into memory here.
"""

from __future__ import annotations

import hashlib
import platform
import re
import signal
import sys
import threading
import time
import tomllib
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cavirheo.errors import InputError, SolverError, read_bytes, require, validation_message
from cavirheo.parallel import Job, Output

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster
    from distributed import Client

COUNT_INTERVAL = 1.0  # s between two counts of workers
SHORTEST_BATCH = 2.0  # shortest duration of a batch, s
SECONDS_PER_THREAD = 0.016  # s of a batch for each thread; the driver needs a quarter of this
LONGEST_BATCH = 60.0  # longest duration of a batch, s, which is lost with a worker
BATCHES_PER_THREAD = 2  # batches for each thread: one that runs and one that waits
MOST_JOBS = 1000  # largest number of jobs in a batch
SCHEDULER_TIMEOUT = 20  # s for a scheduler to answer
_ADDRESS = re.compile(r"(tcp|tls|ucx)://[\w.\[\]:-]+:\d{1,5}")
_LARGEST = 100_000  # bytes of a file of settings
# dask's profiler asks Python for the stack frames of all threads a hundred times a second. Python 3.11 can hang at this
# call, and then the worker never returns its batch
_NO_PROFILE = "export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False"


@dataclass(frozen=True)
class Identity:
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

    liquid, solid, kinetic = LAWS["newtonian"], LAWS["nhkv"], Bubble("kinetic", ACCOMMODATION)
    shots = (
        (liquid(viscosity=0.03), FIELD),
        (solid(shear_modulus=6e3, viscosity=0.05), FIELD),
        (liquid(viscosity=0.05), kinetic),
        (solid(shear_modulus=8e3, viscosity=0.05), kinetic),
    )
    time_s, digest = np.linspace(0.0, 1e-4, 200), hashlib.sha256()
    for material, bubble in shots:
        digest.update(simulate(material, max_radius=2.45e-4, stretch=6.0, time=time_s, bubble=bubble).radius.tobytes())
    return Identity(version("cavirheo"), code_hash(Path(__file__).parents[1]), digest.hexdigest())


def code_hash(package: Path) -> str:
    """SHA-256 of the modules and networks in a folder, without the app, on which no answer depends."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        if path.suffix in (".py", ".npz") and name.parts[0] != "app":
            digest.update(name.as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


@dataclass
class WorkerReport:
    """One worker, as `cavirheo cluster check` shows it."""

    address: str
    host: str
    threads: int
    identity: Identity | None
    versions: str = ""  # of Python and the libraries on which its answers depend
    refusal: str = ""  # why it is refused


def self_description() -> dict[str, Any]:
    """Fields of the `WorkerReport` of this process."""
    libraries = [f"{name} {version(name)}" for name in ("cavirheo", "numpy", "scipy", "numba")]
    versions = ", ".join([*libraries, f"Python {platform.python_version()}"])
    return {"host": platform.node(), "identity": identity(), "versions": versions}


def reports(client: Client, wait: float) -> list[WorkerReport]:
    """Reports on all workers by address, with reasons of refusal. Raises InputError: no worker came within `wait` s."""

    def probe() -> dict[str, Any]:  # sent with its code, so that a worker without cavirheo can answer, too
        import platform

        try:
            from cavirheo.workflow.cluster import self_description

            return self_description()
        except ImportError as error:
            return {"host": platform.node(), "identity": None, "refusal": f"cannot import what is needed: {error}"}

    end = time.monotonic() + wait
    while not (threads := client.nthreads()):
        message = f"no worker came to {client.scheduler_info()['address']} within {wait:.0f} s"
        require(time.monotonic() < end, f"{message}: start some, and try again", "cluster.no_worker")
        time.sleep(0.5 * COUNT_INTERVAL)
    workers, mine = [], identity()
    for address, answer in sorted(client.run(probe, on_error="return").items()):
        if isinstance(answer, BaseException):
            answer = {"host": "?", "identity": None, "refusal": f"{type(answer).__name__}: {answer}"}
        worker = WorkerReport(address, threads=threads.get(address, 0), **answer)
        if peer := worker.identity:
            if peer.version != mine.version:
                worker.refusal = f"it has cavirheo {peer.version}, and this is {mine.version}"
            elif peer.code != mine.code:
                worker.refusal = f"its cavirheo {peer.version} has other code ({peer.code[:8]}, here {mine.code[:8]})"
        workers.append(worker)
    bits_of = {worker.address: worker.identity.bits for worker in workers if worker.identity and not worker.refusal}
    ((usual, _),) = Counter(bits_of.values()).most_common(1) or [("", 0)]
    for worker in workers:
        if (bits := bits_of.get(worker.address, usual)) != usual:
            worker.refusal = f"its simulations differ in their last bits ({bits[:8]}, the others {usual[:8]})"
    return workers


def required_identity(client: Client, notify: Callable[[str], None], wait: float) -> Identity:
    """The identity that every worker must have, also later ones. Raises InputError: no worker, or one is refused."""
    workers = reports(client, wait)
    refusals = [f"{worker.address} on {worker.host}: {worker.refusal}" for worker in workers if worker.refusal]
    more = f"; and {len(refusals) - 3} more" if len(refusals) > 3 else ""
    remedy = "install the same cavirheo there, or stop them (`cavirheo cluster check` lists all)"
    require(not refusals, f"refused {'; '.join(refusals[:3])}{more}; {remedy}", "cluster.refused")
    required = workers[0].identity
    assert required
    if required.bits != identity().bits:
        differ = "note: simulations of the workers differ from this machine's in their last bits"
        notify(f"{differ}: let a data set be made by one kind of machine")
    threads = sum(worker.threads for worker in workers)
    notify(f"{len(workers)} workers with {threads} threads, all with cavirheo {required.version} and the same bits")
    return required


def batch_duration(threads: int) -> float:
    """Duration of a batch, s, for which the driver of `threads` threads spends a quarter of its time on batches."""
    return min(max(SHORTEST_BATCH, SECONDS_PER_THREAD * threads), LONGEST_BATCH)


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
        size, counted_at, threads, most_batches = 1.0, 0.0, 1, BATCHES_PER_THREAD
        try:
            while waiting or sent:
                if time.monotonic() > counted_at + COUNT_INTERVAL:
                    threads, counted_at = max(sum(self.client.nthreads().values()), 1), time.monotonic()
                    most_batches = BATCHES_PER_THREAD * threads
                while waiting and len(sent) < most_batches:
                    count = min(round(size), max(len(waiting) // most_batches, 1), len(waiting))
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
                ideal = batch_duration(threads) * len(results) / max(seconds, 1e-6)
                size = 0.5 * size + 0.5 * min(max(ideal, 1.0), MOST_JOBS)
                yield from zip(indices, results, strict=True)
        finally:
            running.clear()
            self.client.cancel(list(sent), force=True)


def _batch(required: Identity, function: Callable[[Job], Output], jobs: Sequence[Job]) -> tuple[float, list[Output]]:
    """(duration in s, outputs of the jobs); runs on a worker. Raises InputError: it has another identity."""
    mine = identity()
    if mine != required:
        from distributed import get_worker

        message = f"the worker {get_worker().address} has cavirheo {mine.version} with other code or other last bits"
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
def connected(scheduler: str | None, notify: Callable[[str], None]) -> Iterator[Workers | None]:
    """The executor of `--scheduler`: "tcp://HOST:PORT" or "tls://HOST:PORT" of a dask scheduler, or "slurm:FILE.toml".
    Without a scheduler None, which stands for this machine. Workers are checked before they get work. Raises
    InputError: no such scheduler, no workers, or workers that are refused (the message names them)."""
    if scheduler is None:
        yield None
        return
    with client_of(scheduler, notify) as (client, wait):
        yield Workers(client, required_identity(client, notify, wait))


@contextmanager
def client_of(scheduler: str, notify: Callable[[str], None]) -> Iterator[tuple[Client, float]]:
    """A client of the scheduler, and the time in s to wait for a first worker. Raises InputError: no such scheduler."""
    expected = "--scheduler must be tcp://HOST:PORT (or tls://) of a dask scheduler, or slurm:FILE.toml"
    slurm = scheduler.startswith("slurm:")
    require(slurm or bool(_ADDRESS.fullmatch(scheduler)), f"{expected}, got {scheduler!r}", "cluster.scheduler")
    try:
        from distributed import Client

        if slurm and not find_spec("dask_jobqueue"):
            raise ModuleNotFoundError(name="dask_jobqueue")
    except ModuleNotFoundError as error:
        message = f'--scheduler needs {error.name}: pip install "cavirheo[cluster]" here and on the workers'
        raise InputError(f"{message}; without it all runs here", "cluster.extra") from None
    if slurm:
        settings = read_settings(Path(scheduler.removeprefix("slurm:")))
        with jobs_of(settings) as cluster, Client(cluster) as client:
            cluster.scale(jobs=settings.jobs)
            notify(f"{settings.jobs} jobs asked of the queue {settings.queue}; the work begins when the first is there")
            yield client, settings.wait_hours * 3600
        return
    try:
        client = Client(scheduler, timeout=SCHEDULER_TIMEOUT)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = str(error).partition("\n")[0] or "time out"
        message = f"no dask scheduler answers at {scheduler} ({reason}); start one with `dask scheduler`"
        raise InputError(message, "cluster.unreachable") from None
    with client:
        yield client, SCHEDULER_TIMEOUT


class SlurmSettings(BaseModel):
    """The file of settings. A job has `cores` processes with one thread each, which share `memory`."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    queue: Annotated[str, Field(min_length=1)]
    jobs: Annotated[int, Field(ge=1, le=10_000)] = 1
    cores: Annotated[int, Field(ge=1, le=1024)]
    memory: Annotated[str, Field(pattern=r"^\d+(\.\d+)? ?(MB|GB|MiB|GiB)$")]  # of a job
    walltime: Annotated[str, Field(pattern=r"^(\d+-)?\d+:\d\d:\d\d$")]
    account: str | None = None
    environment: list[str] = []  # lines of the job's script before the worker starts: module load ...
    options: list[str] = []  # further options of #SBATCH: "--constraint=icelake"
    python: str = sys.executable  # interpreter on the nodes
    interface: str | None = None  # network interface between the nodes and this machine: "ib0"
    folder: str | None = None  # shared by all nodes, for logs of the jobs and keys of the encryption
    tls: bool = True  # whether scheduler and workers encrypt
    wait_hours: Annotated[float, Field(gt=0)] = 24.0  # to wait for the first worker


def read_settings(path: Path) -> SlurmSettings:
    """Read the settings of SLURM. Raises InputError: no such file, not TOML, or values that are not accepted."""
    try:
        return SlurmSettings(**tomllib.loads(read_bytes(path, _LARGEST).decode()))
    except ValidationError as error:
        raise InputError(f"{path}: {validation_message(error, SlurmSettings)}", "cluster.settings") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no TOML: {error}", "cluster.settings") from None


@contextmanager
def jobs_of(settings: SlurmSettings) -> Iterator[SLURMCluster]:
    """A scheduler in this process, without jobs yet; its jobs end with it. Raises InputError: it cannot be started."""
    import dask

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    from dask_jobqueue import SLURMCluster  # its import replaces the handler of Ctrl-C

    if threading.current_thread() is threading.main_thread():
        for number, handler in handlers.items():
            signal.signal(number, handler)
    from distributed.security import Security

    dask.config.set({"distributed.scheduler.allowed-failures": 10})  # workers are also lost at a walltime
    secure = {}
    try:
        if settings.tls:
            secure = {"security": Security.temporary(), "protocol": "tls://", "shared_temp_directory": settings.folder}
        cluster = SLURMCluster(
            **settings.model_dump(include={"queue", "account", "cores", "memory", "walltime", "python", "interface"}),
            processes=settings.cores,
            job_script_prologue=[_NO_PROFILE, *settings.environment],
            job_extra_directives=settings.options,
            log_directory=settings.folder,
            scheduler_options={"dashboard_address": "127.0.0.1:0"},
            **secure,
        )
    except (ImportError, OSError, RuntimeError, ValueError) as error:
        raise InputError(f"no jobs of SLURM can be asked for: {error}", "cluster.slurm") from None
    with cluster:
        yield cluster

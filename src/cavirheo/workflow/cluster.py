"""Verbs on many machines: an executor with the workers of a dask cluster (the extra [cluster]), which is found by its
address, or whose workers are jobs of SLURM (dask-jobqueue).

Every worker must have this machine's version and code. The options are declared in verbs/options.py.
"""

from __future__ import annotations

import hashlib
import re
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING

from cavirheo.errors import InputError, listed
from cavirheo.parallel import Flow, Job, Output

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster
    from distributed import Client

SCHEDULER_TIMEOUT = 20  # s for a scheduler to answer, and for a first worker
QUEUE_TIMEOUT = 7 * 86400  # s for the first job of a queue
_ADDRESS = re.compile(r"(tcp|tls|ucx)://[\w.\[\]:-]+:\d{1,5}")
# dask's profiler asks Python for the stack frames of all threads a hundred times a second. Python 3.11 can hang at this
# call, and then the worker never returns its job
_NO_PROFILE = "export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False"


@cache
def identity() -> str:
    """What decides the answers of this process: its version, and a hash of its code and networks."""
    code = hashlib.sha256()
    package = Path(__file__).parents[1]
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        if path.suffix in (".py", ".npz") and name.parts[0] != "app":  # no answer depends on the app
            code.update(name.as_posix().encode() + path.read_bytes())
    return f"cavirheo {version('cavirheo')}, code {code.hexdigest()[:8]}"


def check_workers(client: Client, notify: Callable[[str], None], wait: float) -> None:
    """Raise InputError: no worker came within `wait` s, or one has another identity; the message names it."""

    def probe() -> str:  # sent with its code, so that a worker without cavirheo can answer, too
        from cavirheo.workflow.cluster import identity

        return identity()

    try:
        client.wait_for_workers(1, timeout=wait)
    except TimeoutError:
        address = client.scheduler_info()["address"]
        late = f"no worker came to {address} within {wait:.0f} s"
        raise InputError(f"{late}: start some, and try again", "cluster.no_worker") from None
    workers = {address: str(answer) for address, answer in client.run(probe, on_error="return").items()}
    if refused := [f"{address} ({worker})" for address, worker in sorted(workers.items()) if worker != identity()]:
        message = f"refused {listed(refused, 3)}: install what is here ({identity()}) there, or stop them"
        raise InputError(message, "cluster.refused")
    notify(f"{len(workers)} workers with {sum(client.nthreads().values())} threads, all with {identity()}")


@dataclass(frozen=True)
class Workers:
    """All workers of a cluster, also those that come later; each must have the identity of this process."""

    client: Client

    def map_unordered(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Flow[Output]:
        """As `Executor.map_unordered`. Another worker does the jobs of a lost one. Raises InputError: a worker has
        another identity, a job ended several workers, or the scheduler is gone. Also raises errors of `function`."""
        from distributed import KilledWorker, as_completed

        run = partial(_run, identity(), function)
        indices = {self.client.submit(run, job, pure=False): index for index, job in enumerate(jobs)}
        try:
            for future in as_completed(list(indices), loop=self.client.loop):
                yield indices.pop(future), future.result()
        except KilledWorker as error:
            message = f"one job ended several workers, so it is given up: is their memory too small? {error}"
            raise InputError(message, "cluster.killed") from None
        except CancelledError:
            raise InputError("the scheduler is gone or restarted: the same command goes on", "cluster.lost") from None
        finally:
            self.client.cancel(list(indices), force=True)


def _run(required: str, function: Callable[[Job], Output], job: Job) -> Output:
    """function(job), on a worker. Raises InputError: the worker has another identity."""
    if identity() != required:
        from distributed import get_worker

        message = f"the worker {get_worker().address} is {identity()}, not {required}"
        raise InputError(f"{message}: stop it, and the same command goes on", "cluster.refused")
    return function(job)


@contextmanager
def connected(scheduler: str | None, slurm: int | None, notify: Callable[[str], None]) -> Iterator[Workers | None]:
    """The executor of `--scheduler` ("tcp://HOST:PORT" or "tls://HOST:PORT" of a dask scheduler) or of `--slurm`, a
    number of jobs; without both None, which stands for this machine. Workers are checked before they get work. Raises
    InputError: no such scheduler, no workers, or workers that are refused (the message names them)."""
    if scheduler is None and slurm is None:
        yield None
        return
    if scheduler and slurm:
        raise InputError("--scheduler and --slurm are two clusters: leave out one of them", "cluster.scheduler")
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        message = f"--scheduler must be tcp://HOST:PORT (or tls://) of a dask scheduler, got {scheduler!r}"
        raise InputError(message, "cluster.scheduler")
    with _client_of(scheduler) if scheduler else _client_of_jobs(slurm or 1, notify) as client:
        check_workers(client, notify, SCHEDULER_TIMEOUT if scheduler else QUEUE_TIMEOUT)
        yield Workers(client)


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

    if which("sbatch") is None:
        message = "there is no command sbatch: give --slurm on a machine of the cluster, such as its login node"
        raise InputError(message, "cluster.slurm")
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

    for number, handler in handlers.items():
        signal.signal(number, handler)
    from distributed.security import Security

    dask.config.set({"distributed.scheduler.allowed-failures": 10})  # workers are also lost at a walltime
    settings = dask.config.get("jobqueue.slurm")
    try:
        return SLURMCluster(
            processes=settings["processes"] or settings["cores"] or 1,
            job_script_prologue=[_NO_PROFILE, *settings["job-script-prologue"]],
            shared_temp_directory=settings["shared-temp-directory"] or str(Path.home()),
            scheduler_options={"dashboard_address": "127.0.0.1:0"},
            security=Security.temporary(),
            protocol="tls://",
        )
    except (ImportError, OSError, RuntimeError, TypeError, ValueError) as error:
        message = f"no jobs of SLURM can be asked for: {error}; state it under jobqueue: slurm: in "
        raise InputError(f"{message}~/.config/dask/jobqueue.yaml", "cluster.slurm") from None

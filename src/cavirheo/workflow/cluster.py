"""Verbs on many machines: an executor with the workers of a dask cluster (the extra [cluster]), which is found by its
address. Every worker must have this machine's version and code."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.errors import InputError, listed
from cavirheo.parallel import Flow, Job, Output

if TYPE_CHECKING:
    from distributed import Client

TIMEOUT = 20  # s for a scheduler to answer, and for a first worker
_ADDRESS = re.compile(r"(tcp|tls|ucx)://[\w.\[\]:-]+:\d{1,5}")


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


def check_workers(client: Client, notify: Callable[[str], None]) -> None:
    """Raise InputError: no worker came within TIMEOUT, or one has another identity; the message names it."""

    def probe() -> str:  # sent with its code, so that a worker without cavirheo can answer, too
        from cavirheo.workflow.cluster import identity

        return identity()

    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except TimeoutError:
        address = client.scheduler_info()["address"]
        late = f"no worker came to {address} within {TIMEOUT} s"
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
def connected(scheduler: str | None, notify: Callable[[str], None]) -> Iterator[Workers | None]:
    """The executor of `--scheduler` ("tcp://HOST:PORT" or "tls://HOST:PORT" of a dask scheduler); None stands for this
    machine. Workers are checked before they get work. Raises InputError: no such scheduler, no workers, or workers that
    are refused (the message names them)."""
    if scheduler is None:
        yield None
        return
    if not _ADDRESS.fullmatch(scheduler):
        message = f"--scheduler must be tcp://HOST:PORT (or tls://) of a dask scheduler, got {scheduler!r}"
        raise InputError(message, "cluster.scheduler")
    from distributed import Client

    try:
        client = Client(scheduler, timeout=TIMEOUT)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = str(error).partition("\n")[0] or "time out"
        message = f"no dask scheduler answers at {scheduler} ({reason}); start one with `dask scheduler`"
        raise InputError(message, "cluster.unreachable") from None
    with client:
        check_workers(client, notify)
        yield Workers(client)

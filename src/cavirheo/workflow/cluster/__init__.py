"""The same verbs on many machines: an executor whose workers are those of a dask cluster (the extra [cluster])."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.errors import InputError, require

if TYPE_CHECKING:
    from distributed import Client

    from cavirheo.workflow.cluster.executor import Workers

WAIT = 20  # s for a scheduler to answer
_ADDRESS = re.compile(r"(tcp|tls|ucx)://[\w.\[\]:-]+:\d{1,5}")


@contextmanager
def connected(scheduler: str | None, say: Callable[[str], None]) -> Iterator[Workers | None]:
    """The executor of `--scheduler`: "tcp://HOST:PORT" or "tls://HOST:PORT" of a dask scheduler, or "slurm:FILE.toml";
    None, this machine, where nothing was asked. Its workers are checked before anything is sent to them.

    Raises:
        InputError: no such scheduler, no workers, or workers that would answer otherwise (by name).
    """
    if scheduler is None:
        yield None
        return
    from cavirheo.workflow.cluster.check import admitted

    with client_of(scheduler, say) as (client, worker):
        from cavirheo.workflow.cluster.executor import Workers

        yield Workers(client, admitted(client, say, worker))


@contextmanager
def client_of(scheduler: str, say: Callable[[str], None]) -> Iterator[tuple[Client, float]]:
    """A client of the scheduler, and s in which a first worker must come. Raises InputError."""
    expected = "--scheduler must be tcp://HOST:PORT (or tls://) of a dask scheduler, or slurm:FILE.toml"
    slurm = scheduler.startswith("slurm:")
    require(slurm or bool(_ADDRESS.fullmatch(scheduler)), f"{expected}, got {scheduler!r}", "cluster.scheduler")
    try:
        from distributed import Client

        if slurm and not find_spec("dask_jobqueue"):
            raise ModuleNotFoundError(name="dask_jobqueue")
    except ModuleNotFoundError as error:
        message = f"--scheduler needs {error.name}: pip install 'cavirheo[cluster]' here and on the workers"
        raise InputError(f"{message}; without it all runs here", "cluster.extra") from None
    if slurm:
        from cavirheo.workflow.cluster.slurm import jobs_of, read_settings

        settings = read_settings(Path(scheduler.removeprefix("slurm:")))
        with jobs_of(settings) as cluster, Client(cluster) as client:
            cluster.scale(jobs=settings.jobs)
            say(f"{settings.jobs} jobs asked of the queue {settings.queue}; the work begins when the first is there")
            yield client, settings.wait_hours * 3600
        return
    try:
        client = Client(scheduler, timeout=WAIT)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = str(error).partition("\n")[0] or "time out"
        message = f"no dask scheduler answers at {scheduler} ({reason}); start one with `dask scheduler`"
        raise InputError(message, "cluster.unreachable") from None
    with client:
        yield client, WAIT

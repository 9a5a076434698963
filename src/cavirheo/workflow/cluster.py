"""The same verbs on many machines: an executor whose workers are those of a dask cluster (the extra [cluster]), found
by its address, or asked of SLURM as jobs, as a small TOML says."""

from __future__ import annotations

import re
import signal
import sys
import threading
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cavirheo.errors import InputError, require, validation_message
from cavirheo.files import read_bytes

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster
    from distributed import Client

    from cavirheo.workflow.workers import Workers

WAIT = 20  # s for a scheduler to answer
_ADDRESS = re.compile(r"(tcp|tls|ucx)://[\w.\[\]:-]+:\d{1,5}")
_LARGEST = 100_000  # bytes of a file of settings
# dask's profiler asks Python for the frames of all threads a hundred times a second, and Python 3.11 can come to a stop
# over that: a worker then holds its batch for ever
_NO_PROFILE = "export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False"


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
    from cavirheo.workflow.workers import Workers, admitted

    with client_of(scheduler, say) as (client, wait):
        yield Workers(client, admitted(client, say, wait))


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


class SlurmSettings(BaseModel):
    """The file. A job has `cores` processes with one thread each, which share `memory`."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    queue: Annotated[str, Field(min_length=1)]
    jobs: Annotated[int, Field(ge=1, le=10_000)] = 1
    cores: Annotated[int, Field(ge=1, le=1024)]
    memory: Annotated[str, Field(pattern=r"^\d+(\.\d+)? ?(MB|GB|MiB|GiB)$")]  # of a job
    walltime: Annotated[str, Field(pattern=r"^(\d+-)?\d+:\d\d:\d\d$")]
    account: str | None = None
    environment: list[str] = []  # lines of the job's script before its worker: module load, source .venv/bin/activate
    options: list[str] = []  # further lines of #SBATCH: "--constraint=icelake"
    python: str = sys.executable  # on the nodes
    interface: str | None = None  # of the network between nodes and this machine: "ib0"
    folder: str | None = None  # shared by all nodes: logs of the jobs, and the keys of the encryption
    tls: bool = True  # between scheduler and workers
    wait_hours: Annotated[float, Field(gt=0)] = 24.0  # for the first worker


def read_settings(path: Path) -> SlurmSettings:
    """Raises InputError: no such file, no TOML, or another content."""
    try:
        return SlurmSettings(**tomllib.loads(read_bytes(path, _LARGEST).decode()))
    except ValidationError as error:
        raise InputError(f"{path}: {validation_message(error, SlurmSettings)}", "cluster.settings") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no TOML: {error}", "cluster.settings") from None


@contextmanager
def jobs_of(settings: SlurmSettings) -> Iterator[SLURMCluster]:
    """A scheduler in this process, whose jobs, when they are asked for, end with it. Raises InputError."""
    import dask

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    from dask_jobqueue import SLURMCluster  # which takes Ctrl-C for itself when it is imported

    if threading.current_thread() is threading.main_thread():
        for number, handler in handlers.items():
            signal.signal(number, handler)
    from distributed.security import Security

    dask.config.set({"distributed.scheduler.allowed-failures": 10})  # a walltime is nobody's fault
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

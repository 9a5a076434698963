"""Answers of many curves: kept by their keys in a folder, each at once, so that they remain whatever ends the run; and
computed by the workers of a dask cluster (the extra [cluster]), which is found by its address, or whose workers are
jobs of SLURM (dask-jobqueue). Every worker must have this machine's version and code.
"""

from __future__ import annotations

import hashlib
import re
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, listed
from cavirheo.inference.analysis import Analysis
from cavirheo.messages import Message
from cavirheo.parallel import Executor, Flow, Job, Output
from cavirheo.physics.bubble import Bubble
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Diagnostics, Evidence, Posterior
from cavirheo.writing.document import atomic_file, part_of, writable_folder
from cavirheo.writing.export import decode, encode
from cavirheo.writing.terminal import progress_bar, say

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster
    from distributed import Client

UNFINISHED = "unfinished"  # subfolder with the answers of a command until its documents are complete
_TYPES = (Posterior, Checks, Message, Evidence, Diagnostics, Bubble, RadiusCurve)
_KINDS: dict[str, Any] = {kind.__name__: kind for kind in _TYPES} | {"Medium": partial(Medium, unusual=True)}
SCHEDULER_TIMEOUT = 20  # s for a scheduler to answer, and for a first worker
QUEUE_TIMEOUT = 7 * 86400  # s for the first job of a queue
_ADDRESS = re.compile(r"(tcp|tls|ucx)://[\w.\[\]:-]+:\d{1,5}")
# dask's profiler asks Python for the stack frames of all threads a hundred times a second. Python 3.11 can hang at this
# call, and then the worker never returns its job
_NO_PROFILE = "export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False"


class Store:
    """Answers by their keys. `folder` has a file for each, written completely or not at all; those that were used are
    in memory, too (an answer takes about 50 kB).

    Raises InputError: `folder` is a link or no folder.
    """

    def __init__(self, folder: Path) -> None:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            message = f"{folder} must be a folder and no link, for answers are kept there: give another place with -o"
            raise InputError(message, "document.folder")
        self.folder = folder
        self._used: dict[str, Posterior] = {}

    def get(self, key: str) -> Posterior | None:
        """The answer of a key; None if there is none that can be read."""
        if key not in self._used:
            with suppress(EOFError, OSError):  # a missing or damaged file: the answer is computed again
                self._used[key] = decode(self._file(key).read_bytes(), _KINDS)
        return self._used.get(key)

    def put(self, key: str, answer: Posterior, *, file: bool = True) -> None:
        """Store an answer; in a file, too, unless `file` is False. Raises InputError: the folder cannot be written."""
        if file:
            with writable_folder(self.folder), atomic_file(self._file(key)) as temporary:
                temporary.write_bytes(encode(answer, default=str))
        self._used[key] = answer

    def remove_used(self) -> None:
        """Remove the answers that were used, and the folder if it is then empty. Those of other runs stay."""
        for file in map(self._file, self._used):
            file.unlink(missing_ok=True)
            part_of(file).unlink(missing_ok=True)
        self._used.clear()
        with suppress(OSError):  # there is no folder, or it is not empty
            self.folder.rmdir()

    def _file(self, key: str) -> Path:
        return self.folder / f"{key}.npz"


def analyse(
    curves: Sequence[RadiusCurve],
    analysis: Analysis,
    store: Store,
    executor: Executor | None = None,
    *,
    visible: bool = False,
) -> Iterator[tuple[int, Posterior]]:
    """(index of the curve, its answer): first the answers that the store has, then the others as they are computed.

    executor: where they are computed; by default on all cores of this machine. visible: show a bar on stderr. A failed
    answer is held in memory alone, because another run may have more memory; the answer of an unusable curve has a
    file. Closing the iterator drops curves not yet begun.
    """
    missing = list[int]()
    for index, curve in enumerate(curves):
        if answer := store.get(analysis.key(curve)):
            yield index, with_source_of(answer, curve)
        else:
            missing.append(index)
    if not missing:
        return
    queue = [curves[index] for index in missing]
    progress = progress_bar(analysis.activity, len(queue), visible=visible)
    with progress as advance, closing(analysis.flow(queue, executor)) as flow:
        for place, answer in flow:
            to_file = answer.checks.verdict != "failed" or bool(queue[place].unusable)
            store.put(analysis.key(queue[place]), answer, file=to_file)
            advance()
            yield missing[place], answer


def analyse_all(
    curves: Sequence[RadiusCurve],
    analyses: Mapping[str, Analysis],
    store: Store,
    executor: Executor | None = None,
    *,
    visible: bool = True,
) -> dict[str, dict[int, Posterior]]:
    """The answers of each analysis by the indices of their curves, ascending. After Ctrl-C they are not complete: no
    further curve is begun."""
    answers = {name: dict[int, Posterior]() for name in analyses}
    kept = sum(store.get(analysis.key(curve)) is not None for analysis in analyses.values() for curve in curves)
    if kept and visible:
        total = len(curves) * len(analyses)
        say(f"{kept} of {total} answers are taken from {store.folder}, where an unfinished run left them")
    with suppress(KeyboardInterrupt):
        for name, analysis in analyses.items():
            for index, answer in analyse(curves, analysis, store, executor, visible=visible):
                answers[name][index] = answer
    return {name: dict(sorted(found.items())) for name, found in answers.items()}


def with_source_of(answer: Posterior, curve: RadiusCurve) -> Posterior:
    """The answer with the SHA-256 of this curve's file; the recording may have been answered from another file."""
    return replace(answer, provenance={**answer.provenance, "source_sha256": curve.source_sha256})


@cache
def identity() -> str:
    """What decides the answers of this process: its version, and a hash of its code and networks."""
    code, package = hashlib.sha256(), Path(__file__).parent
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        if path.suffix in (".py", ".npz") and name.parts[0] != "app":  # no answer depends on the app
            code.update(name.as_posix().encode() + path.read_bytes())
    return f"cavirheo {version('cavirheo')}, code {code.hexdigest()[:8]}"


def check_workers(client: Client, notify: Callable[[str], None], wait: float) -> None:
    """Raise InputError: no worker came within `wait` s, or one has another identity; the message names it."""

    def probe() -> str:  # sent with its code, so that a worker without cavirheo can answer, too
        from cavirheo.workflow import identity

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


def on_workers(client: Client, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Flow[Output]:
    """An `Executor` with all workers of a cluster, also those that come later. Another worker does the jobs of a lost
    one. Raises InputError: a worker has another identity than this process, a job ended several workers, or the
    scheduler is gone. Also raises errors of `function`."""
    from distributed import KilledWorker, as_completed

    run = partial(_run, identity(), function)
    indices = {client.submit(run, job, pure=False): index for index, job in enumerate(jobs)}
    try:
        for future in as_completed(list(indices), loop=client.loop):
            yield indices.pop(future), future.result()
    except KilledWorker as error:
        message = f"one job ended several workers, so it is given up: is their memory too small? {error}"
        raise InputError(message, "cluster.killed") from None
    except CancelledError:
        raise InputError("the scheduler is gone or restarted: the same command goes on", "cluster.lost") from None
    finally:
        client.cancel(list(indices), force=True)


def _run(required: str, function: Callable[[Job], Output], job: Job) -> Output:
    """function(job), on a worker. Raises InputError: the worker has another identity."""
    if identity() != required:
        from distributed import get_worker

        message = f"the worker {get_worker().address} is {identity()}, not {required}"
        raise InputError(f"{message}: stop it, and the same command goes on", "cluster.refused")
    return function(job)


@contextmanager
def connected(scheduler: str | None, slurm: int | None, notify: Callable[[str], None]) -> Iterator[Executor | None]:
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
    if slurm is not None and which("sbatch") is None:
        message = "there is no command sbatch: give --slurm on a machine of the cluster, such as its login node"
        raise InputError(message, "cluster.slurm")
    from distributed import Client

    with ExitStack() as held:
        cluster = held.enter_context(slurm_cluster()) if slurm is not None else None
        try:
            client = held.enter_context(Client(cluster or scheduler, timeout=SCHEDULER_TIMEOUT))
        except (OSError, TimeoutError, ValueError, TypeError) as error:
            reason = str(error).partition("\n")[0] or "time out"
            advice = "start one with `dask scheduler`" if scheduler else "ask for fewer jobs, or look at their log"
            message = f"no dask scheduler answers at {scheduler or 'the jobs of SLURM'} ({reason}); {advice}"
            raise InputError(message, "cluster.unreachable") from None
        if cluster is not None:
            cluster.scale(jobs=slurm)
            notify(f"{slurm} jobs asked of SLURM; the work begins when the first is there")
        check_workers(client, notify, SCHEDULER_TIMEOUT if scheduler else QUEUE_TIMEOUT)
        yield partial(on_workers, client)


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

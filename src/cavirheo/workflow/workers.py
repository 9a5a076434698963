"""The workers of a dask cluster: whether they would answer as this machine does (version, code, and the bits of some
simulations), and units of work on them, in batches of a second or two, few enough at once to be held here."""

from __future__ import annotations

import hashlib
import platform
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cavirheo.errors import InputError, SolverError, require

if TYPE_CHECKING:
    from distributed import Client

Job = TypeVar("Job")
Output = TypeVar("Output")

LOOK = 1.0  # s between two counts of the workers
SECONDS = 2.0  # of a batch, at least
SECONDS_PER_THREAD = 0.016  # more for many: a batch costs the driver a quarter of it (benchmarks/scale.py)
LONGEST = 60.0  # s: what a lost worker costs
AHEAD = 2  # batches for each thread: one that runs and one that waits there
MOST = 1000  # jobs of a batch


@dataclass(frozen=True)
class Identity:
    """What decides the answers of a process. code: SHA-256 of our modules and networks; bits: of simulated curves."""

    version: str
    code: str
    bits: str


@dataclass
class WorkerReport:
    """One worker, as `cavirheo cluster check` shows it; `wrong`: why it is refused, or ""."""

    address: str
    host: str
    threads: int
    identity: Identity | None
    versions: str = ""  # of what its answers depend on besides our code
    wrong: str = ""


@cache
def identity() -> Identity:
    """Of this process; the first call loads the compiled solver and simulates four different bubbles: a liquid and a
    solid with memory, both contents."""
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
    return Identity(version("cavirheo"), code_of(Path(__file__).parents[1]), digest.hexdigest())


def code_of(package: Path) -> str:
    """SHA-256 of the modules and networks in a folder; those of the app decide no answer."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        if path.suffix in (".py", ".onnx") and name.parts[0] != "app":
            digest.update(name.as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def self_description() -> dict[str, Any]:
    """Of this process, for `WorkerReport`."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("cavirheo", "numpy", "scipy", "numba", "onnxruntime"))
    versions += f", Python {platform.python_version()}"
    return {"host": platform.node(), "identity": identity(), "versions": versions}


def reports(client: Client, wait: float) -> list[WorkerReport]:
    """Of all workers that are there, each judged; by address. Raises InputError: none came within so many s."""

    def probe() -> dict[str, Any]:  # is sent whole, so that a worker without cavirheo can answer, too
        import platform

        try:
            from cavirheo.workflow.workers import self_description

            return self_description()
        except ImportError as error:
            return {"host": platform.node(), "identity": None, "wrong": f"cannot import what is needed: {error}"}

    end = time.monotonic() + wait
    while not (threads := client.nthreads()):
        message = f"no worker came to {client.scheduler_info()['address']} within {wait:.0f} s"
        require(time.monotonic() < end, f"{message}: start some, and try again", "cluster.no_worker")
        time.sleep(0.5 * LOOK)
    workers, mine = [], identity()
    for address, answer in sorted(client.run(probe, on_error="return").items()):
        if isinstance(answer, BaseException):
            answer = {"host": "?", "identity": None, "wrong": f"{type(answer).__name__}: {answer}"}
        worker = WorkerReport(address, threads=threads.get(address, 0), **answer)
        if theirs := worker.identity:
            if theirs.version != mine.version:
                worker.wrong = f"it has cavirheo {theirs.version}, and this is {mine.version}"
            elif theirs.code != mine.code:
                codes = f"{theirs.code[:8]}, here {mine.code[:8]}"
                worker.wrong = f"its cavirheo {theirs.version} has other code ({codes})"
        workers.append(worker)
    alike = {worker.address: worker.identity.bits for worker in workers if worker.identity and not worker.wrong}
    ((usual, _),) = Counter(alike.values()).most_common(1) or [("", 0)]
    for worker in workers:
        if (bits := alike.get(worker.address, usual)) != usual:
            worker.wrong = f"its simulations differ in their last bits ({bits[:8]}, the others {usual[:8]})"
    return workers


def admitted(client: Client, say: Callable[[str], None], wait: float) -> Identity:
    """What each worker must be, now and when it comes later. Raises InputError: there is none, or some are another."""
    workers = reports(client, wait)
    wrong = [f"{worker.address} on {worker.host}: {worker.wrong}" for worker in workers if worker.wrong]
    if wrong:
        more = f"; and {len(wrong) - 3} more" if len(wrong) > 3 else ""
        remedy = "install the same cavirheo there, or stop them (`cavirheo cluster check` lists all)"
        raise InputError(f"refused {'; '.join(wrong[:3])}{more}; {remedy}", "cluster.refused")
    (first, *_) = workers
    assert first.identity
    if first.identity.bits != identity().bits:
        differ = "note: simulations of the workers differ from this machine's in their last bits"
        say(f"{differ}: let a data set be made by one kind of machine")
    threads = sum(worker.threads for worker in workers)
    say(f"{len(workers)} workers with {threads} threads, all with cavirheo {first.identity.version} and the same bits")
    return first.identity


def seconds_for(threads: int) -> float:
    """s that a batch is to take, so that batches cost the driver of so many threads a quarter of its time."""
    return min(max(SECONDS, SECONDS_PER_THREAD * threads), LONGEST)


@dataclass(frozen=True)
class Workers:
    """All workers of a cluster, also those that come later; each must be as `required`."""

    client: Client
    required: Identity

    def flow(self, function: Callable[[Job], Output], jobs: Sequence[Job]) -> Generator[tuple[int, Output], None, None]:
        """As `Executor.flow`. A worker that is lost costs only time: its batches are done by another.

        Raises:
            InputError: a worker came that would answer otherwise, or the scheduler is gone. What `function` raises is
                raised here.
        """
        from distributed import as_completed

        waiting = deque(range(len(jobs)))
        sent: dict[object, Sequence[int]] = {}
        running = as_completed(with_results=True, raise_errors=False, loop=self.client.loop)
        size, looked, threads, places = 1.0, 0.0, 1, AHEAD
        try:
            while waiting or sent:
                if time.monotonic() > looked + LOOK:
                    threads, looked = max(sum(self.client.nthreads().values()), 1), time.monotonic()
                    places = AHEAD * threads
                while waiting and len(sent) < places:
                    count = min(round(size), max(len(waiting) // places, 1))
                    batch = [waiting.popleft() for _ in range(min(count, len(waiting)))]
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
                ideal = seconds_for(threads) * len(results) / max(seconds, 1e-6)
                size = 0.5 * size + 0.5 * min(max(ideal, 1.0), MOST)
                yield from zip(indices, results, strict=True)
        finally:
            running.clear()
            self.client.cancel(list(sent), force=True)


def _batch(required: Identity, function: Callable[[Job], Output], jobs: Sequence[Job]) -> tuple[float, list[Output]]:
    """(s that it took, what came of each job), by a worker."""
    mine = identity()
    if mine != required:
        from distributed import get_worker

        message = f"the worker {get_worker().address} has cavirheo {mine.version} with other code or other last bits"
        raise InputError(f"{message}: stop it, and the same command goes on", "cluster.refused")
    began = time.perf_counter()
    results = [function(job) for job in jobs]
    return time.perf_counter() - began, results


def _error_of(status: str, outcome: object) -> BaseException:
    """What to raise for a batch that did not end: our own errors as they are."""
    error = outcome[1] if isinstance(outcome, tuple) and len(outcome) == 3 else outcome
    if isinstance(error, InputError | SolverError):
        return error
    if type(error).__name__ == "KilledWorker":
        message = f"one unit of work ended several workers, so it is given up: is their memory too small? {error}"
        return InputError(message, "cluster.killed")
    if status in ("cancelled", "lost"):
        return InputError("the scheduler is gone or was restarted: the same command goes on", "cluster.lost")
    return error if isinstance(error, BaseException) else InputError(f"a unit of work was {status}", "cluster.lost")

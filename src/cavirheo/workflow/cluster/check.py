"""Whether the workers of a cluster would answer as this machine does: version, code, and the bits of one simulation."""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.errors import InputError, require

if TYPE_CHECKING:
    from distributed import Client

LOOK = 0.5  # s between two looks for workers


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
    """Of this process; the first call loads the compiled solver and simulates four curves."""
    return Identity(version("cavirheo"), code_of(Path(__file__).parents[2]), _simulated())


def code_of(package: Path) -> str:
    """SHA-256 of the modules and networks in a folder; those of the app decide no answer."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package)
        if path.suffix in (".py", ".onnx") and name.parts[0] != "app":
            digest.update(name.as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _simulated(count: int = 4) -> str:
    """SHA-256 of the radii of so many different bubbles: a solid with memory and a liquid, both contents."""
    from cavirheo.physics.bubble import ACCOMMODATION, FIELD, Bubble
    from cavirheo.physics.materials import LAWS
    from cavirheo.physics.simulate import simulate

    time_s = np.linspace(0.0, 1e-4, 200)
    digest = hashlib.sha256()
    for k in range(count):
        material = LAWS["newtonian"](viscosity=0.03 + 0.01 * k)
        if k % 2:
            material = LAWS["nhkv"](shear_modulus=5e3 + 1e3 * k, viscosity=0.05)
        bubble = Bubble("kinetic", ACCOMMODATION) if k % 4 > 1 else FIELD
        run = simulate(material, max_radius=2.45e-4, stretch=6.0, time=time_s, bubble=bubble)
        digest.update(run.radius.tobytes())
    return digest.hexdigest()


def self_description() -> dict[str, Any]:
    """Of this process, for `WorkerReport`."""
    import platform

    versions = ", ".join(f"{name} {version(name)}" for name in ("cavirheo", "numpy", "scipy", "numba", "onnxruntime"))
    versions += f", Python {platform.python_version()}"
    return {"host": platform.node(), "identity": identity(), "versions": versions}


def _probe() -> Callable[[], dict[str, Any]]:
    """`self_description` as a function that is sent whole, so that a worker without cavirheo can answer, too."""

    def probe() -> dict[str, Any]:
        import platform

        try:
            from cavirheo.workflow.cluster.check import self_description

            return self_description()
        except ImportError as error:
            return {"host": platform.node(), "identity": None, "wrong": f"cannot import what is needed: {error}"}

    return probe


def reports(client: Client, wait: float) -> list[WorkerReport]:
    """Of all workers that are there, each judged; by address. Raises InputError: none came within so many s."""
    end = time.monotonic() + wait
    while not (threads := client.nthreads()):
        message = f"no worker came to {client.scheduler_info()['address']} within {wait:.0f} s"
        require(time.monotonic() < end, f"{message}: start some, and try again", "cluster.no_worker")
        time.sleep(LOOK)
    workers = []
    for address, answer in sorted(client.run(_probe(), on_error="return").items()):
        if isinstance(answer, BaseException):
            answer = {"host": "?", "identity": None, "wrong": f"{type(answer).__name__}: {answer}"}
        worker = WorkerReport(address, threads=threads.get(address, 0), **answer)
        if worker.identity:
            worker.wrong = _difference(worker.identity, identity())
        workers.append(worker)
    alike = {worker.address: worker.identity.bits for worker in workers if worker.identity and not worker.wrong}
    ((usual, _),) = Counter(alike.values()).most_common(1) or [("", 0)]
    for worker in workers:
        if (bits := alike.get(worker.address, usual)) != usual:
            worker.wrong = f"its simulations differ in their last bits ({bits[:8]}, the others {usual[:8]})"
    return workers


def _difference(theirs: Identity, mine: Identity) -> str:
    if theirs.version != mine.version:
        return f"it has cavirheo {theirs.version}, and this is {mine.version}"
    message = f"its cavirheo {theirs.version} has other code ({theirs.code[:8]}, here {mine.code[:8]})"
    return message if theirs.code != mine.code else ""


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

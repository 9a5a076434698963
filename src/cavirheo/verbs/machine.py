"""`cavirheo app` and `cluster`, and what a bug report needs to say (`cavirheo --version --verbose`)."""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Annotated, Literal

from typer import Exit

from cavirheo.errors import InputError, require
from cavirheo.parallel import cores
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run
from cavirheo.writing import terminal
from cavirheo.writing.digits import MISSING

_HOST = "address to listen on; 0.0.0.0 is open to the network, without a password"
_LIVE = "folder of results of `cavirheo watch`, whose page is served at /live"
_VARIABLES = ("NUMBA_", "CAVIRHEO_", "OMP_", "OPENBLAS_")  # beginnings of those that change speed or answers


def app(
    host: Annotated[str, option(_HOST)] = "127.0.0.1",
    port: Annotated[int, option("port; 0: any free one", min=0, max=65535)] = 7860,
    live: Annotated[Path | None, option(_LIVE, readable=False)] = None,
    browser: Annotated[bool, option("open the page in the browser", None, "--browser/--no-browser")] = True,
    max_file_mb: Annotated[float, option("largest file that may be uploaded, MB", min=0.001)] = 50.0,
    max_files: Annotated[int, option("largest number of files of one visitor", min=1)] = 50,
) -> None:
    """The same in the browser: upload files, look, infer, compare with the simulation, download everything as a zip."""
    message = f"--live must be the folder into which `cavirheo watch` writes (its -o), got {live}: start `watch` first"
    require(live is None or live.is_dir(), message, "option.live")
    try:
        from cavirheo.app.server import serve
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "gradio":
            raise
        raise InputError(f'the browser app needs {error.name}: pip install "cavirheo[app]"') from None
    from cavirheo.app.session import VisitorLimits

    serve(host, port, browser=browser, limits=VisitorLimits(file_mb=max_file_mb, files=max_files), folder=live)


def cluster(
    action: Annotated[Literal["check"], argument("check", "whether its workers answer as this machine does")],
    scheduler: Annotated[str, option("dask: tcp://HOST:PORT, or slurm:FILE.toml")],
    quiet: options.Quiet = False,
) -> None:
    """Whether the workers of a dask cluster have the same version, compiled solver and bits as this machine."""
    from cavirheo.workflow.cluster import client_of, identity, reports

    run = Run(quiet=quiet)
    with client_of(scheduler, run.say) as (client, wait):
        workers = reports(client, wait)
    table = terminal.table("worker", ["on", "threads", "code", "bits"], left=["on"])
    for worker in workers:
        sums = [worker.identity.code[:8], worker.identity.bits[:8]] if worker.identity else [MISSING] * 2
        table.add_row(worker.address, worker.host, str(worker.threads), *sums)
    if not run.quiet:
        terminal.console().print(table)
    for versions in sorted({worker.versions for worker in workers if worker.versions}):
        run.say(f"{sum(worker.versions == versions for worker in workers)} workers with {versions}")
    for worker in workers:
        if worker.wrong:
            terminal.say(f"refused: {worker.address} on {worker.host}: {worker.wrong}")
    usable, mine = [worker for worker in workers if not worker.wrong], identity()
    bits = {worker.identity.bits for worker in usable if worker.identity}
    same = "the bits of this machine" if bits == {mine.bits} else "other last bits than this machine"
    run.say(f"{len(usable)} of {len(workers)} workers can be used, with {same} ({mine.bits[:8]})")
    if len(usable) < len(workers):
        raise Exit(1)


def report() -> str:
    """Versions, extras, the compiled solver and the shipped models of this installation, a line for each."""
    return "\n".join(f"{name:<10}{text}" for name, text in _lines())


def _lines() -> Iterator[tuple[str, str]]:
    import cavirheo
    from cavirheo.inference.model import shipped
    from cavirheo.physics import cache, solver

    yield "cavirheo", f"{cavirheo.__version__} in {Path(cavirheo.__file__).parent}"
    yield "python", f"{platform.python_version()} ({platform.python_implementation()}), {sys.executable}"
    yield "machine", f"{platform.platform()}, {cores()} cores"
    libraries = required()
    yield "needs", _installed(libraries.pop(""))
    for extra, names in libraries.items():
        yield f"[{extra}]", _installed(names)
    folders = {str(file.parent) for file in cache.stored_files(solver.integrate)}  # it is not compiled for that
    compiled = f"compiled, kept in {', '.join(sorted(folders))}"
    yield "solver", compiled if folders else "not compiled yet: the first simulation takes 10 to 30 s longer"
    for name, path in shipped().items():
        yield "model", f"{name}, sha256 {checksum(path)}"
    variables = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith(_VARIABLES)]
    yield "variables", ", ".join(variables) or "none that matter"


def required() -> dict[str, list[str]]:
    """Names of the libraries that the package needs (under "") and that each extra brings, of users' extras alone."""
    names: dict[str, list[str]] = {"": []}
    for line in requires("cavirheo") or ():
        extra = re.search(r"""extra == ["'](\w+)["']""", line)
        name = re.match(r"[\w.-]+", line)
        if name and not (extra and extra[1] in ("dev", "docs")):
            names.setdefault(extra[1] if extra else "", []).append(name[0])
    return names


def _installed(names: list[str]) -> str:
    installed = []
    for name in names:
        try:
            installed.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            installed.append(f"no {name}")
    return ", ".join(installed)


def checksum(path: Path) -> str:
    """Of a model, and a word if it is not the file that its card describes. Raises InputError: it is too large."""
    import hashlib

    from cavirheo.errors import read_bytes
    from cavirheo.inference.model import LARGEST, card

    digest: str = hashlib.sha256(read_bytes(path, LARGEST)).hexdigest()
    same = card(path)["onnx"]["sha256"] == digest
    return digest + ("" if same else ", which is NOT the file that its card describes")

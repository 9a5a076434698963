"""`cavirheo app`, `generate` and `train`: long work, on this machine or on others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cavirheo.errors import InputError
from cavirheo.settings import argument, option
from cavirheo.verbs import options
from cavirheo.verbs.run import Run
from cavirheo.writing import terminal

_HOST = "address to listen on; 0.0.0.0 is open to the network, without a password"


def app(
    host: Annotated[str, option(_HOST)] = "127.0.0.1",
    port: Annotated[int, option("port; 0: any free one", min=0, max=65535)] = 7860,
    browser: Annotated[bool, option("open the page in the browser", None, "--browser/--no-browser")] = True,
) -> None:
    """The same in the browser: upload files, look, infer, compare with the simulation, download everything as a zip."""
    terminal.say("cavirheo app: starting, a few seconds ...")
    from cavirheo.app.server import serve

    serve(host, port, browser=browser)


def generate(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    out: options.ResumableOut,
    n: Annotated[int | None, option("curves; default: as in the recipe", None, "-n", min=1)] = None,
    seed: Annotated[int | None, option("default: as in the recipe", min=0)] = None,
    workers: Annotated[int | None, option("threads; default: all cores", min=1)] = None,
    scheduler: options.Scheduler = None,
    slurm: options.Slurm = None,
    quiet: options.Quiet = False,
) -> None:
    """A training set of simulated curves; resumable, and the same bytes for any number of workers."""
    from cavirheo.physics.simulate import load_solver
    from cavirheo.training import dataset
    from cavirheo.training.recipe import read_recipe
    from cavirheo.workflow.cluster import connected

    content = read_recipe(recipe)
    if workers is not None and (scheduler or slurm):
        message = "--workers are threads of this machine, and a cluster has its own: leave out one of them"
        raise InputError(message, "option.workers")
    load_solver()
    run = Run(quiet=quiet)
    count = n or content.data.n
    seed = content.data.seed if seed is None else seed
    with connected(scheduler, slurm, run.say) as executor:
        written = dataset.generate(
            content.problem, count, out, seed=seed, workers=workers, progress=not quiet, executor=executor
        )
    for status, count in written.failures.items():
        run.say(f"{count} failed: {status}")
    run.end(f"{written.curves} curves in {out}, {written.simulated} of them simulated now")


def train(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")],
    out: options.ResumableOut,
    threads: Annotated[int | None, option("threads; default: torch's choice", min=1, max=1024)] = None,
    device: Annotated[str | None, option("cpu or cuda; default: cuda if there is one")] = None,
    quiet: options.Quiet = False,
) -> None:
    """Train a recipe's network (the same call resumes) and write it as NAME.npz with its card NAME.json."""
    from cavirheo.inference.cards import card
    from cavirheo.training import train as training
    from cavirheo.training.recipe import read_recipe
    from cavirheo.verbs.documents import summary

    content = read_recipe(recipe)
    try:
        path = training.train(content, data, out, device=device, threads=threads, progress=not quiet)
    except RuntimeError as error:  # torch's: no memory left, ...
        raise InputError(f"training stopped: {str(error).partition(chr(10))[0]}", "training.torch") from error
    if not quiet:
        terminal.write("\n".join(summary(path.stem, card(path))))
        terminal.say(f"model: {path}")

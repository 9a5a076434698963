"""`cavirheo models`, `generate` and `train`: the shipped models, and networks of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cavirheo.errors import InputError
from cavirheo.settings import argument, number, option
from cavirheo.verbs.run import Quiet, ResumableOut, Run, Scheduler, Slurm
from cavirheo.writing import terminal


def models() -> None:
    """The shipped models: what they answer, for which materials and ranges, and how well."""
    from cavirheo.inference.network_files import card, shipped

    for name, path in shipped().items():
        terminal.write("\n".join(about_network(name, card(path))))


def about_network(name: str, content: dict[str, Any]) -> list[str]:
    """Return lines on what a model answers, for which recordings, and how well, from its card."""
    training, data = content["training"], content["data"]
    if content["kind"] == "emulator":
        lines = [f"{name}: R(t) of a bubble, from which `infer` draws"]
        errors = ", ".join(f"{quantile} {error:.2%}" for quantile, error in content["errors"].items())
        lines.append(f"  error of the frames over R_max: {errors}")
    else:
        lines = [f"{name}: {content['material']}, one value each without an interval"]
        for output in content["outputs"]:
            score = content["metrics"][output["name"]]
            low, high = content["problem"]["prior"][output["name"]]
            if output["scale"] == "log10":
                low, high = 10**low, 10**high
            values = f"{output['name'].removeprefix('log10_')} {low:g} to {high:g} {output['unit']}"
            error = f"R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f}"
            lines.append(f"  {values:31s} {error} ({output['scale']} scale)")
    minutes = f"{training['seconds'] / 60:.0f} min on {training['device']}"
    return [*lines, f"  trained on {data['train']} simulated curves, tested on {data['test']}; {minutes}"]


def generate(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    out: ResumableOut,
    n: Annotated[int | None, number("curves; default: as in the recipe", None, "-n", kind=int, above=0)] = None,
    seed: Annotated[int | None, number("default: as in the recipe", kind=int, least=0)] = None,
    workers: Annotated[int | None, number("threads; default: all cores", kind=int, above=0)] = None,
    scheduler: Scheduler = None,
    slurm: Slurm = None,
    quiet: Quiet = False,
) -> None:
    """A training set of simulated curves; resumable, and the same bytes for any number of workers."""
    from cavirheo.physics.simulate import load_solver
    from cavirheo.training import dataset
    from cavirheo.training.recipe import read_recipe
    from cavirheo.workflow import connected

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
    for status, failed in written.failures.items():
        run.say(f"{failed} failed: {status}")
    run.end(f"{written.curves} curves in {out}, {written.simulated} of them simulated now")


def train(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")],
    out: ResumableOut,
    threads: Annotated[int | None, number("threads; default: torch's choice", kind=int, least=1, most=1024)] = None,
    device: Annotated[str | None, option("cpu or cuda; default: cuda if there is one")] = None,
    quiet: Quiet = False,
) -> None:
    """Train a recipe's network (the same call resumes) and write it as NAME.npz with its card NAME.json."""
    from cavirheo.inference.network_files import card
    from cavirheo.training import train as training
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    try:
        path = training.train(content, data, out, device=device, threads=threads, progress=not quiet)
    except RuntimeError as error:  # torch's: no memory left, ...
        raise InputError(f"training stopped: {str(error).partition(chr(10))[0]}", "training.torch") from error
    if not quiet:
        terminal.write("\n".join(about_network(path.stem, card(path))))
        terminal.say(f"model: {path}")

"""`cavirheo generate`: a recipe in, a training set out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cavirheo.errors import InputError, require
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option
from cavirheo.writing.terminal import say


def generate(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    out: options.Growing,
    n: Annotated[int | None, option("curves; default: as in the recipe", None, "-n", min=1)] = None,
    seed: Annotated[int | None, option("default: as in the recipe", min=0)] = None,
    workers: Annotated[int | None, option("threads; default: all cores", min=1)] = None,
    shard: Annotated[str, option("i/N: make the i-th of N parts only")] = "1/1",
    scheduler: options.Scheduler = None,
    quiet: options.Quiet = False,
) -> None:
    """A training set of simulated curves; resumable, and the same bytes for any number of workers."""
    from cavirheo.physics.simulate import load_solver
    from cavirheo.training import dataset
    from cavirheo.training.recipe import read_recipe
    from cavirheo.workflow.cluster import connected

    content = read_recipe(recipe)
    try:
        part, parts = (int(number) for number in shard.split("/"))
    except ValueError:
        raise InputError(f"--shard must read i/N, e.g. 2/8; got {shard!r}", "option.shard") from None
    message = "--workers are threads of this machine, and --scheduler has its own: leave out one of them"
    require(workers is None or scheduler is None, message, "option.workers")
    load_solver()
    n, seed = content.data.n if n is None else n, content.data.seed if seed is None else seed
    how: dict[str, Any] = {"workers": workers, "shard": (part, parts), "progress": not quiet}
    with connected(scheduler, lambda text: None if quiet else say(text)) as executor:
        made = dataset.generate(content.problem, n, out, seed=seed, executor=executor, **how)
    messages = [f"{made.curves} curves in {out}: {made.written} files written, {made.skipped} already there"]
    if made.simulated:
        rate = made.simulated / made.seconds
        messages.append(f"{made.simulated} simulated in {made.seconds:.0f} s ({rate:.0f} per s)")
    messages += [f"{count} failed: {status}" for status, count in made.failures.items()]
    if not quiet:
        print(*messages, sep="\n", file=sys.stderr)

"""`cavirheo generate`: a recipe in, a training set out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from cavirheo.errors import InputError
from cavirheo.verbs.options import Out


def generate(
    recipe: Annotated[Path, typer.Argument(help="TOML file, see recipes/")],
    out: Out,
    n: Annotated[int | None, typer.Option("-n", help="curves; default: as in the recipe", min=1)] = None,
    seed: Annotated[int | None, typer.Option(help="default: as in the recipe", min=0)] = None,
    workers: Annotated[int | None, typer.Option(help="threads; default: all cores", min=1)] = None,
    shard: Annotated[str, typer.Option(help="i/N: make the i-th of N parts only")] = "1/1",
) -> None:
    """A training set of simulated curves; resumable, and the same bytes for any number of workers."""
    from cavirheo.training import dataset
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    try:
        part, parts = (int(number) for number in shard.split("/"))
    except ValueError:
        raise InputError(f"--shard must read i/N, e.g. 2/8; got {shard!r}", "option.shard") from None
    from cavirheo.physics.simulate import load_solver

    load_solver()
    n, seed = content.data.n if n is None else n, content.data.seed if seed is None else seed
    made = dataset.generate(content.problem, n, out, seed=seed, workers=workers, shard=(part, parts))
    print(f"{made.curves} curves in {out}: {made.written} files written, {made.skipped} already there", file=sys.stderr)
    if made.simulated:
        rate = made.simulated / made.seconds
        print(f"{made.simulated} simulated in {made.seconds:.0f} s ({rate:.0f} per s)", file=sys.stderr)
    for status, count in made.failures.items():
        print(f"{count} failed and are kept with their status: {status}", file=sys.stderr)

"""`cavirheo train`: a recipe and its training set in, a model with its card out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cavirheo.errors import InputError, require
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option

if TYPE_CHECKING:
    from cavirheo.training.posterior.recipe import PosteriorRecipe


def train(
    recipe: Annotated[Path, argument("RECIPE", "TOML file, see recipes/")],
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")],
    out: options.Growing,
    threads: Annotated[int | None, option("threads; default: torch's choice", min=1, max=1024)] = None,
    device: Annotated[str | None, option("cpu or cuda; default: cuda if there is one")] = None,
    quiet: options.Quiet = False,
) -> None:
    """Train a recipe's network (the same call resumes) and export it as NAME.onnx with its card NAME.json."""
    try:
        from cavirheo.training import export
        from cavirheo.training.train import train as run
    except ModuleNotFoundError as error:
        raise InputError(f"training needs {error.name}: install cavirheo with the extra [train]") from error
    from cavirheo.training.posterior.recipe import posterior_recipe
    from cavirheo.training.recipe import read_recipe

    if wanted := posterior_recipe(recipe):
        _train_posterior(wanted, data, out, threads, device, quiet)
        return
    content = read_recipe(recipe)
    try:
        result = run(content, data, out, device=device, threads=threads, progress=not quiet)
        path = export.export(content, out, out)
    except RuntimeError as error:  # torch's: no memory left, ...
        raise InputError(f"training stopped: {str(error).partition(chr(10))[0]}", "training.torch") from error
    if quiet:
        return
    for name, score in result["metrics"].items():
        print(f"{name}: R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f} (test curves)")
    print(f"model: {path}; use it with: cavirheo infer --model {path} FILE", file=sys.stderr)


def _train_posterior(
    recipe: PosteriorRecipe, data: Path, out: Path, threads: int | None, device: str | None, quiet: bool
) -> None:
    from cavirheo.training.posterior.export import made

    message = f"a posterior network is trained on the processor: leave out --device {device}"
    require(device in (None, "cpu"), message, "training.device")
    path, loss = made(recipe, data, out, threads=threads, progress=not quiet)
    if not quiet:
        print(f"loss {loss:.3f} on curves that were never shown")
        print(f"model: {path}; use it with: cavirheo infer --model {path} FILE", file=sys.stderr)

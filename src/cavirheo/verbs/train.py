"""`cavirheo train`: a recipe and its training set in, a model with its card out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cavirheo.errors import InputError
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option


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
    from cavirheo.training.recipe import read_recipe

    content = read_recipe(recipe)
    try:
        result = run(content, data, out, device=device, threads=threads, progress=not quiet)
        path = export.export(content, out, out)
    except RuntimeError as error:  # torch's: no memory left, ...
        raise InputError(f"training stopped: {str(error).partition(chr(10))[0]}", "training.torch") from error
    if quiet:
        return
    for name, score in result.get("metrics", {}).items():
        print(f"{name}: R2 {score['r2']:.4f}, median error {score['median_absolute_error']:.3f} (test curves)")
    if "coverage" in result:
        print(f"loss {result['best_validation_loss']:.3f} on curves that were never shown")
    print(f"model: {path}; use it with: cavirheo infer --model {path} FILE", file=sys.stderr)

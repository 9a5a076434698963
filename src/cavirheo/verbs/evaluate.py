"""`cavirheo evaluate`: a model and simulated curves in, how good it is out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from cavirheo.verbs import options


def evaluate(
    model: Annotated[str, Argument(help="a shipped model or an .onnx file")],
    data: Annotated[Path, Argument(help="folder written by `cavirheo generate`")],
    out: options.Out = Path("cavirheo-evaluation"),
    robustness: Annotated[
        bool, Option("--robustness", help="also with noise, other frame rates, a first frame off, gaps: minutes")
    ] = False,
    quiet: options.Quiet = False,
) -> None:
    """How good a model is on simulated curves: metrics.json, tables (evaluation.md) and figures."""
    from cavirheo.inference.model import path_of
    from cavirheo.training.evaluate import evaluate as judge
    from cavirheo.training.evaluate import markdown

    if robustness:
        from cavirheo.physics.simulate import load_solver

        load_solver()
    found = judge(path_of(model), data, out, robust=robustness, progress=not quiet)
    if not quiet:
        print(markdown(found))
        print(f"written to {out}", file=sys.stderr)

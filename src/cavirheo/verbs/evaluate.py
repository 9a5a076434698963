"""`cavirheo evaluate`: a model and simulated curves in, how good it is out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from cavirheo.errors import require
from cavirheo.verbs import options
from cavirheo.writing.terminal import say


def evaluate(
    model: Annotated[str, Argument(help="a shipped model or an .onnx file", autocompletion=options.model_names)],
    data: Annotated[Path, Argument(help="folder written by `cavirheo generate`")],
    out: options.Out = Path("cavirheo-evaluation"),
    robustness: Annotated[
        bool,
        Option("--robustness", help="also noise, other frame rates, a wrong first frame, gaps (minutes)"),
    ] = False,
    scheduler: options.Scheduler = None,
    quiet: options.Quiet = False,
) -> None:
    """How good a model is on simulated curves: metrics.json, tables (evaluation.md) and figures."""
    from cavirheo.inference.model import path_of
    from cavirheo.training.evaluate import evaluate as judge
    from cavirheo.training.evaluate import markdown
    from cavirheo.workflow.cluster import connected

    idle = scheduler is not None and not robustness
    require(not idle, "--scheduler would change nothing without --robustness: give that too", "option.scheduler")
    if robustness:
        from cavirheo.physics.simulate import load_solver

        load_solver()
    with connected(scheduler, lambda text: None if quiet else say(text)) as executor:
        found = judge(path_of(model), data, out, robust=robustness, progress=not quiet, executor=executor)
    if not quiet:
        print(markdown(found))
        print(f"written to {out}", file=sys.stderr)

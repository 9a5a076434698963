"""`cavirheo evaluate`: a model and simulated curves in, how good it is out."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cavirheo.errors import require
from cavirheo.verbs import completion, options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run
from cavirheo.writing.terminal import say


@dataclass(kw_only=True)
class Evaluate(options.Cluster, options.Documents):
    """How good a model is on simulated curves: metrics.json, tables (evaluation.md) and figures."""

    model: Annotated[str, argument("MODEL", "a shipped model or an .onnx file", autocompletion=completion.model_names)]
    data: Annotated[Path, argument("DATA", "folder written by `cavirheo generate`")]
    robustness: Annotated[
        bool, option("also noise, other frame rates, a wrong first frame, gaps (minutes)", None, "--robustness")
    ] = False
    quiet: options.Quiet = False
    out: options.Out = Path("cavirheo-evaluation")

    def __call__(self, run: Run) -> None:
        from cavirheo.inference.model import path_of
        from cavirheo.training.evaluate import evaluate as judge
        from cavirheo.training.evaluate import markdown
        from cavirheo.workflow.cluster import connected

        idle = self.scheduler is not None and not self.robustness
        require(not idle, "--scheduler would change nothing without --robustness: give that too", "option.scheduler")
        if self.robustness:
            from cavirheo.physics.simulate import load_solver

            load_solver()
        with connected(self.scheduler, lambda text: None if self.quiet else say(text)) as executor:
            found = judge(
                path_of(self.model),
                self.data,
                self.out,
                robust=self.robustness,
                progress=not self.quiet,
                executor=executor,
                command=run.command,
                date=run.date,
            )
        if not self.quiet:
            print(markdown(found))
            print(f"written to {self.out}", file=sys.stderr)

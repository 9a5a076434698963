"""`cavirheo infer`: curves in, a network's answers, table, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from cavirheo.verbs import options
from cavirheo.verbs.run import Run


def infer(
    files: options.Curves,
    model: options.ModelName = "bdt-viscoelastic",
    rmax_um: options.TrueRadius = None,
    stretch: Annotated[float | None, Option(help="R_max/R_0 if known; fitted otherwise")] = None,
    window: Annotated[int | None, Option(help="collapses over which answer and measurement are compared", min=1)] = (
        None
    ),
    verify: options.Verify = "none",
    exact_law: options.ExactLaw = False,
    exposure_us: options.ExposureUs = None,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-result"),
) -> None:
    """Shear modulus and viscosity from measured radius histories, with pictures that show whether to believe them."""
    from cavirheo.inference import infer_many
    from cavirheo.writing.terminal import bar

    run = Run()
    options.check_verify(verify, exposure_us, exact_law)
    curves = run.read(files, liquid, rmax_um, exposure_us)
    with bar("inferring", len(curves)) as advance:
        answers = infer_many(curves, model=model, medium=liquid, stretch=stretch, window=window, done=advance)
    run.report(curves, answers, out, verify, medium=liquid, stretch=stretch, discrepancy=not exact_law)

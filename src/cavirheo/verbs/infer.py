"""`cavirheo infer`: curves in, a network's answers, table, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cavirheo.verbs.options import (
    FROM_OPTIONS,
    Curves,
    ExactLaw,
    ExposureUs,
    ModelName,
    Out,
    TrueRadius,
    Verify,
    check_verify,
    with_surroundings,
)
from cavirheo.verbs.run import Run, verified
from cavirheo.writing.terminal import bar

if TYPE_CHECKING:
    from cavirheo.physics.media import Medium


@with_surroundings
def infer(
    files: Curves,
    model: ModelName = "bdt-viscoelastic",
    rmax_um: TrueRadius = None,
    stretch: Annotated[float | None, typer.Option(help="R_max/R_0 if known; fitted otherwise")] = None,
    window: Annotated[
        int | None, typer.Option(help="collapses over which answer and measurement are compared", min=1)
    ] = None,
    verify: Verify = "none",
    exact_law: ExactLaw = False,
    exposure_us: ExposureUs = None,
    liquid: Medium = FROM_OPTIONS,
    out: Out = Path("cavirheo-result"),
) -> None:
    """Shear modulus and viscosity from measured radius histories, with pictures that show whether to believe them."""
    from cavirheo.inference import infer_many

    run = Run()
    check_verify(verify, exposure_us, exact_law)
    curves = run.read(files, liquid, rmax_um, exposure_us)
    with bar("inferring", len(curves)) as advance:
        answers = infer_many(curves, model=model, medium=liquid, stretch=stretch, window=window, done=advance)
    answers = verified(curves, answers, verify, medium=liquid, stretch=stretch, discrepancy=not exact_law)
    run.report(curves, answers, out)

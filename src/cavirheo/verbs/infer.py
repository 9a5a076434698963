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
    from cavirheo.inference.model import load
    from cavirheo.inference.reconstruct import check_stretch
    from cavirheo.reporting import DOCUMENTS
    from cavirheo.unfinished import Step
    from cavirheo.writing.document import Outputs

    run = Run()
    options.check_verify(verify, exposure_us, exact_law)
    check_stretch(stretch)
    network = load(model)
    Outputs(out, *DOCUMENTS, inputs=files)
    curves = run.read(files, liquid, rmax_um, exposure_us)
    settings = {"model": model, "medium": liquid, "stretch": stretch, "window": window}
    first = Step("inferring", infer_many, settings, made_with=network.sha256)
    run.report(curves, first, out, verify, medium=liquid, stretch=stretch, discrepancy=not exact_law)

"""`cavirheo infer`: curves in, a network's answers, table, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Option

from cavirheo.verbs import options
from cavirheo.verbs.run import Reading, Run


def infer(
    files: options.Curves,
    model: options.ModelName = "bdt-viscoelastic",
    stretch: Annotated[float | None, Option(help="R_max/R_0 if known; fitted otherwise")] = None,
    window: Annotated[int | None, Option(help="collapses over which answer and measurement are compared", min=1)] = (
        None
    ),
    contents: options.EitherContents = "equilibrium",
    verify: options.Verify = "none",
    exact_law: options.ExactLaw = False,
    seed: options.Seed = 0,
    reading: Reading = options.FROM_OPTIONS,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-result"),
    pictures: options.Pictures = True,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Shear modulus and viscosity from measured radius histories, with pictures that show whether to believe them."""
    from cavirheo.inference import check_contents, infer_many
    from cavirheo.inference.model import load
    from cavirheo.inference.reconstruct import check_stretch
    from cavirheo.reporting import DOCUMENTS
    from cavirheo.unfinished import Step
    from cavirheo.writing.document import Outputs

    files = run.files(files)
    options.check_verify(verify, reading.exposure_us, exact_law, files)
    check_stretch(stretch)
    check_contents(contents, verify)
    network = load(model)
    Outputs(out, *DOCUMENTS, inputs=files)
    curves = run.read(files, liquid, reading)
    shared: dict[str, Any] = {"medium": liquid, "stretch": stretch}
    settings = {"model": model, "window": window, "trust_input": reading.trust_input, **shared}
    first = Step("inferring", infer_many, settings, made_with=network.sha256)
    checked = {"seed": seed, "discrepancy": not exact_law, "contents": contents, **shared}
    run.report(curves, first, out, pictures=pictures, verify=verify, **checked)

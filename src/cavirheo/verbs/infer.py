"""`cavirheo infer`: curves in, a network's answers, table, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cavirheo.verbs import options
from cavirheo.verbs.run import Reading, Run


def infer(
    files: options.Curves,
    model: options.ModelName = "posterior",
    material: options.Material = None,
    stretch: options.KnownStretch = None,
    window: options.ReadWindow = None,
    bubbles: options.Bubbles = options.FROM_OPTIONS,
    verify: options.VerifyAuto = "auto",
    exact_law: options.ExactLaw = False,
    seed: options.Seed = 0,
    column: options.Column = None,
    reading: Reading = options.FROM_OPTIONS,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-result"),
    pictures: options.Pictures = True,
    figures: options.Figures = None,
    scheduler: options.Scheduler = None,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Shear modulus and viscosity from measured radius histories, with intervals and pictures that show whether to
    believe them."""
    from cavirheo.inference.analysis import Analysis
    from cavirheo.reporting import DOCUMENTS
    from cavirheo.workflow.cluster import connected
    from cavirheo.writing.document import Outputs

    files = run.files(files)
    drawn = options.figures_of(figures)
    options.check_verify(verify, reading.exposure_us, exact_law, files)
    known, trusted = options.known_stretch(stretch), reading.trust_input
    asked: Any = {"model": model, "material": material, "bubble": bubbles, "medium": liquid, "stretch": known}
    analysis = Analysis(
        **asked, window=window, trust_input=trusted, verify=verify, discrepancy=not exact_law, seed=seed
    )
    Outputs(out, *DOCUMENTS, inputs=files)
    with connected(scheduler, run.say) as executor:
        curves = run.read(files, liquid, reading, column)
        run.report(curves, analysis, out, pictures=pictures, figures=drawn, executor=executor)

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
    from cavirheo.cluster import connected
    from cavirheo.inference import check_models, infer_many
    from cavirheo.inference.model import Network
    from cavirheo.inference.options import check_wall
    from cavirheo.inference.posterior_model import network_of
    from cavirheo.parallel import Step
    from cavirheo.reporting import DOCUMENTS
    from cavirheo.writing.document import Outputs

    files = run.files(files)
    drawn, known = options.figures_of(figures), options.known_stretch(stretch)
    options.check_verify(verify, reading.exposure_us, exact_law, files)
    check_models(model, material, bubbles, verify, known)
    network = network_of(model)
    single = isinstance(network, Network)
    Outputs(out, *DOCUMENTS, inputs=files)
    shared: dict[str, Any] = {"medium": liquid, "stretch": known}
    settings = {"model": model, "window": window, "trust_input": reading.trust_input, **shared}
    checked: dict[str, Any] = {"seed": seed, "discrepancy": not exact_law}
    if not single:
        settings |= {"material": material, "verify": verify, "bubble": bubbles, **checked}
    else:
        checked["bubble"] = bubbles
    first = Step("inferring", infer_many, settings, made_with=network.sha256)
    after = verify if single and verify != "auto" else "none"
    with connected(scheduler, run.say) as executor:
        curves = run.read(files, liquid, reading, column)
        for bubble in bubbles or ():
            check_wall(bubble, curves)
        run.report(
            curves, first, out, pictures=pictures, figures=drawn, verify=after, executor=executor, **checked, **shared
        )

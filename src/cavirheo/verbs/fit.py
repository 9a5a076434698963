"""`cavirheo fit`: curves in, least-squares answers, table, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Option

from cavirheo.verbs import options
from cavirheo.verbs.run import Reading, Run


def fit(
    files: options.Curves,
    material: Annotated[
        str,
        Option(
            help="nhkv, newtonian, power-law, ...; auto: the evidence chooses",
            autocompletion=options.law_names,
        ),
    ] = "nhkv",
    window: Annotated[
        str | None, Option(help="number of collapses to fit, or 'all'  [default: 3, or all if there are fewer]")
    ] = None,
    window_us: Annotated[float | None, Option(help="end of the window, us after R_max")] = None,
    free: Annotated[
        str | None,
        Option(help="also fitted: t0 (clock), scale (of the radius), rmax; or none  [default: t0,rmax]"),
    ] = None,
    t0_us: Annotated[float | None, Option(help="largest |t0|, us  [default: half a frame]")] = None,
    scale_percent: Annotated[float, Option(help="limit of the change of scale and rmax, %")] = 1.5,
    stretch: Annotated[
        str | None,
        Option(help="R_max/R_0; 'plateau': prior from the late radius; 'free'  [default: prior from the file]"),
    ] = None,
    weights: Annotated[
        str, Option(help="learnt (the residuals tell how much less frames beside collapses count) or equal")
    ] = "learnt",
    bubbles: options.Bubbles = options.FROM_OPTIONS,
    others: Annotated[
        bool,
        Option("--others/--no-others", help="look at the field's bubble beside the real one, or the other way round"),
    ] = True,
    seed: options.Seed = 0,
    column: options.Column = None,
    reading: Reading = options.FROM_OPTIONS,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-fit"),
    pictures: options.Pictures = True,
    figures: options.Figures = None,
    scheduler: options.Scheduler = None,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """The field's conventional fit: least squares of simulated on measured radius histories, with intervals."""
    from cavirheo.inference.analysis import Analysis
    from cavirheo.reporting import DOCUMENTS
    from cavirheo.workflow.cluster import connected
    from cavirheo.writing.document import Outputs

    files = run.files(files)
    drawn = options.figures_of(figures)
    camera: dict[str, Any] = {"free": free, "scale_bound": scale_percent / 100}
    camera["t0_bound"] = None if t0_us is None else t0_us * 1e-6
    cut: dict[str, Any] = {"window": options.window_of(window), "end": None if window_us is None else window_us * 1e-6}
    cut |= {"stretch": options.stretch_of(stretch), "weights": weights}
    how: dict[str, Any] = {"medium": liquid, "others": others, "trust_input": reading.trust_input, "seed": seed}
    analysis = Analysis("fit", material=material, bubble=bubbles, **camera, **cut, **how)
    Outputs(out, *DOCUMENTS, inputs=files)
    with connected(scheduler, run.say) as executor:
        curves = run.read(files, liquid, reading, column)
        run.report(curves, analysis, out, pictures=pictures, figures=drawn, executor=executor)

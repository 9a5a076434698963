"""`cavirheo fit`: curves in, least-squares answers, table, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Option

from cavirheo.errors import require
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
        str, Option(help="equal, motion (frames beside collapses count less), or learnt from the residuals")
    ] = "learnt",
    bubbles: options.Bubbles = options.FROM_OPTIONS,
    others: Annotated[
        bool,
        Option("--others/--no-others", help="fit the field's bubble beside the real one, or the other way round"),
    ] = True,
    joint: Annotated[bool, Option("--joint", help="the shots of a group share one material")] = False,
    verify: options.Verify = "none",
    exact_law: options.ExactLaw = False,
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
    from cavirheo.cluster import connected
    from cavirheo.inference.fit import fit_many
    from cavirheo.inference.law import Family
    from cavirheo.inference.options import Options
    from cavirheo.parallel import Step
    from cavirheo.physics.bubble import REAL
    from cavirheo.reporting import DOCUMENTS
    from cavirheo.writing.document import Outputs

    files = run.files(files)
    drawn = options.figures_of(figures)
    options.check_verify(verify, reading.exposure_us, exact_law, files)
    require(not joint or verify == "none", "--verify looks at each shot by itself: leave out --joint, or --verify")
    one_work = "--joint is one fit of all shots, which is not spread: leave out --scheduler, or --joint"
    require(not (joint and scheduler), one_work, "option.joint")
    collapses, known = options.window_of(window), options.stretch_of(stretch)
    law = None if material == "auto" else Family(material)
    solid = f"--damage needs a law with an elastic part, {material} has none"
    bubbles = bubbles or (REAL,)
    undamaged = all(one.damage == "none" for one in bubbles)
    require(undamaged or law is None or law.elastic, solid, "physics.damage_without_elasticity")
    camera: dict[str, Any] = {} if free is None else {"free": free}
    camera["scale_bound"] = scale_percent / 100
    camera["t0_bound"] = None if t0_us is None else t0_us * 1e-6
    end = None if window_us is None else window_us * 1e-6
    cut: dict[str, Any] = {"window": collapses, "end": end, "weights": weights}
    for one in bubbles:
        Options(stretch=known, **camera, **cut, bubble=one)
    Outputs(out, *DOCUMENTS, inputs=files)
    shared: dict[str, Any] = {"medium": liquid, "stretch": known, "seed": seed}
    settings = {"material": material, "others": others, "joint": joint, "trust_input": reading.trust_input}
    settings |= {**cut, **shared, **camera, "bubble": bubbles}
    first = Step("fitting", fit_many, settings, apart=not joint)
    after: dict[str, Any] = {"verify": verify, "discrepancy": not exact_law, **shared, **camera}
    with connected(scheduler, run.say) as executor:
        curves = run.read(files, liquid, reading, column)
        run.report(curves, first, out, pictures=pictures, figures=drawn, executor=executor, **after)

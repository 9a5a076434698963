"""`cavirheo fit`: curves in, least-squares answers, table, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cavirheo.errors import InputError
from cavirheo.verbs.options import (
    FROM_OPTIONS,
    Curves,
    ExactLaw,
    ExposureUs,
    Out,
    TrueRadius,
    Verify,
    check_verify,
    number_or,
    with_surroundings,
)
from cavirheo.verbs.run import Run, verified
from cavirheo.writing.terminal import bar

if TYPE_CHECKING:
    from cavirheo.physics.media import Medium


@with_surroundings
def fit(
    files: Curves,
    material: Annotated[str, typer.Option(help="law: nhkv, newtonian, qkv, zener, ...; all its parameters")] = "nhkv",
    window: Annotated[
        str | None, typer.Option(help="collapses that are fitted, or 'all'  [default: 3, or as many as there are]")
    ] = None,
    window_us: Annotated[float | None, typer.Option(help="end of the window, us after R_max")] = None,
    free: Annotated[
        str, typer.Option(help="of t0 (clock), scale (radius calibration), rmax: several with commas")
    ] = "",
    t0_us: Annotated[float | None, typer.Option(help="largest |t0|, us  [default: half a frame]")] = None,
    scale_percent: Annotated[float, typer.Option(help="largest change of scale and rmax, %")] = 1.5,
    stretch: Annotated[
        str | None, typer.Option(help="R_max/R_0, or 'plateau': late radius as prior; fitted otherwise")
    ] = None,
    weights: Annotated[str, typer.Option(help="motion: frames beside collapses count less; or equal")] = "motion",
    joint: Annotated[bool, typer.Option("--joint", help="the shots of a group share one material")] = False,
    verify: Verify = "none",
    exact_law: ExactLaw = False,
    exposure_us: ExposureUs = None,
    rmax_um: TrueRadius = None,
    liquid: Medium = FROM_OPTIONS,
    seed: Annotated[int, typer.Option(help="of the draws behind the intervals", min=0)] = 0,
    out: Out = Path("cavirheo-fit"),
) -> None:
    """The field's conventional fit: least squares of simulated on measured radius histories, with intervals."""
    from cavirheo.inference.fit import fit_many

    run = Run()
    check_verify(verify, exposure_us, exact_law)
    if joint and verify != "none":
        raise InputError("--verify looks at each shot by itself: leave out --joint, or --verify")
    collapses, known = number_or(window, "all", "--window", int), number_or(stretch, "plateau", "--stretch", float)
    curves = run.read(files, liquid, rmax_um, exposure_us)
    freed = [name.strip() for name in free.split(",") if name.strip()]
    bounds: dict[str, Any] = {"t0_bound": None if t0_us is None else t0_us * 1e-6, "scale_bound": scale_percent / 100}
    with bar("fitting", len(curves)) as advance:
        answers = fit_many(
            curves, material, medium=liquid,
            window=collapses,
            end=None if window_us is None else window_us * 1e-6,
            stretch=known,
            free=freed, weights=weights, joint=joint, seed=seed, done=advance, **bounds,
        )  # fmt: skip
    camera = bounds | ({"free": tuple(freed)} if freed else {})
    answers = verified(
        curves, answers, verify, medium=liquid, stretch=known, seed=seed, discrepancy=not exact_law, **camera
    )
    run.report(curves, answers, out)

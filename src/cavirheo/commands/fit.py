"""`cavirheo fit`: curves in, least-squares answers, table, documents and pictures out."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from cavirheo.commands.shared import (
    Density,
    ExactLaw,
    ExposureUs,
    MediumName,
    Out,
    Pressure,
    SoundSpeed,
    SurfaceTension,
    Temperature,
    Verify,
    check_level,
    liquid_of,
    load_solver,
    number_or,
    progress,
    read_files,
    report,
    verified,
)
from cavirheo.errors import InputError


def fit(
    files: Annotated[list[Path], typer.Argument(help="measured R(t): .mat, .csv, .h5, .xlsx; one or many curves each")],
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
    rmax_um: Annotated[float | None, typer.Option(help="true R_max of the shots, um: rescales the radii")] = None,
    medium: MediumName = "water",
    density: Density = None,
    sound_speed: SoundSpeed = None,
    surface_tension: SurfaceTension = None,
    pressure: Pressure = None,
    temperature: Temperature = None,
    seed: Annotated[int, typer.Option(help="of the draws behind the intervals", min=0)] = 0,
    out: Out = Path("cavirheo-fit"),
) -> None:
    """The field's conventional fit: least squares of simulated on measured radius histories, with intervals."""
    from cavirheo.inference.fit import fit_many

    began = time.perf_counter()
    check_level(verify, exposure_us)
    if joint and verify != "none":
        raise InputError("--verify looks at each shot by itself: leave out --joint, or --verify")
    collapses, known = number_or(window, "all", "--window", int), number_or(stretch, "plateau", "--stretch", float)
    liquid = liquid_of(medium, density, sound_speed, surface_tension, pressure, temperature)
    curves, unreadable = read_files(files, liquid, rmax_um, exposure_us)
    load_solver()
    freed = [name.strip() for name in free.split(",") if name.strip()]
    bounds: dict[str, Any] = {"t0_bound": None if t0_us is None else t0_us * 1e-6, "scale_bound": scale_percent / 100}
    with progress("fitting") as bar:
        task = bar.add_task("", total=len(curves))
        answers = fit_many(
            curves, material, medium=liquid,
            window=collapses,
            end=None if window_us is None else window_us * 1e-6,
            stretch=known,
            free=freed, weights=weights, joint=joint, seed=seed, done=lambda: bar.advance(task), **bounds,
        )  # fmt: skip
    camera = bounds | ({"free": tuple(freed)} if freed else {})
    answers = verified(
        curves, answers, verify, medium=liquid, stretch=known, seed=seed, discrepancy=not exact_law, **camera
    )
    report(curves, answers, out, began, unreadable)

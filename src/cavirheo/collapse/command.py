"""`cavirheo collapse-time`: tables of collapse times or curves in; a table, a document and pictures out."""

from __future__ import annotations

import shlex
import sys
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cavirheo.commands.shared import (
    Density,
    MediumName,
    Out,
    Pressure,
    SoundSpeed,
    SurfaceTension,
    Temperature,
    liquid_of,
)
from cavirheo.errors import InputError, SolverError

if TYPE_CHECKING:
    from cavirheo.collapse.record import Answers, CollapseTimes
    from cavirheo.physics.media import Medium


def collapse_time(
    files: Annotated[
        list[Path],
        typer.Argument(help="tables (rmax_um,stretch,t1_us as .csv or .xlsx; pIMR_array in a .mat) or measured R(t)"),
    ],
    material: Annotated[str, typer.Option(help="nhkv, nh (no viscosity) or newtonian (no elasticity)")] = "nhkv",
    exact: Annotated[bool, typer.Option("--exact", help="fit with simulated collapse times, too: seconds")] = False,
    shear_modulus: Annotated[float | None, typer.Option(help="Pa, if it is known: only µ is fitted")] = None,
    viscosity: Annotated[float | None, typer.Option(help="Pa s, if it is known: only G is fitted")] = None,
    stretch: Annotated[
        float | None, typer.Option(help="R_max/R_0 of curves (default: their late plateau) and of tables without it")
    ] = None,
    medium: MediumName = "water",
    density: Density = None,
    sound_speed: SoundSpeed = None,
    surface_tension: SurfaceTension = None,
    pressure: Pressure = None,
    temperature: Temperature = None,
    out: Out = Path("cavirheo-collapse-time"),
) -> None:
    """G and µ from the times of the first collapse alone: one answer per table, or per file or folder of curves."""
    from cavirheo.collapse.read import read_groups
    from cavirheo.collapse.record import collapse_times
    from cavirheo.collapse.table import print_table
    from cavirheo.inference.collapse_time import fit
    from cavirheo.reporting import NO_PICTURES, style

    liquid = liquid_of(medium, density, sound_speed, surface_tension, pressure, temperature)
    if stretch is not None and not 1 < stretch < 1e3:
        raise InputError(f"--stretch must be R_max/R_0 above 1, got {stretch!r}")
    groups, problems = read_groups(files, liquid, stretch)
    for problem in problems:
        print(f"error: {problem}", file=sys.stderr)
    if not groups:
        raise InputError("no collapse time could be read")
    if exact:
        print("simulating (the solver is compiled once per machine, 10 to 30 s) ...", file=sys.stderr)
    answers: list[Answers] = []
    failed = False
    for group in groups:
        shots = group.shots()
        if shots is None:
            answers.append((None, None))
            continue
        answer = partial(fit, shots, material, medium=liquid, shear_modulus=shear_modulus, viscosity=viscosity)
        simulated = None
        try:
            simulated = answer(exact=True) if exact else None
        except SolverError as error:
            group.notes.append(f"no exact answer: {error}")
            failed = True
        answers.append((answer(), simulated))
    document = collapse_times(
        groups, answers, material=material, medium=liquid,
        command=shlex.join(["cavirheo", *sys.argv[1:]]),
        date=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        notes=() if style.available() else (NO_PICTURES,),
    )  # fmt: skip
    _write(out, document, answers, liquid)
    print_table(document)
    print(f"written to {out}", file=sys.stderr)
    if problems:
        raise typer.Exit(2)
    if failed or any(group.unusable or not group.answered for group in document.groups):
        raise typer.Exit(1)


def _write(folder: Path, document: CollapseTimes, answers: list[Answers], medium: Medium) -> None:
    from cavirheo.collapse import picture, record
    from cavirheo.reporting import style, write_json

    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "collapse-time.json", document)
        record.write_csv(folder / "shots.csv", document)
        if style.available():
            picture.write_pictures(folder, document, [analytic for analytic, _ in answers], medium)
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror or error}") from None

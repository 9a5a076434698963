"""`cavirheo collapse-time`: tables of collapse times or curves in; a table, a document and pictures out."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cavirheo.errors import InputError, SolverError
from cavirheo.verbs.options import FROM_OPTIONS, Out, with_surroundings
from cavirheo.verbs.run import Run
from cavirheo.writing.document import into, write_json

if TYPE_CHECKING:
    from cavirheo.beside.collapse_times.record import Answers, CollapseTimes
    from cavirheo.physics.media import Medium


@with_surroundings
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
    liquid: Medium = FROM_OPTIONS,
    out: Out = Path("cavirheo-collapse-time"),
) -> None:
    """G and µ from the times of the first collapse alone: one answer per table, or per file or folder of curves."""
    from cavirheo.beside.collapse_times.read import read_groups
    from cavirheo.beside.collapse_times.record import collapse_times
    from cavirheo.beside.collapse_times.table import print_table
    from cavirheo.inference.collapse_time import fit
    from cavirheo.writing import style

    run = Run()
    if stretch is not None and not 1 < stretch < 1e3:
        raise InputError(f"--stretch must be R_max/R_0 above 1, got {stretch!r}")
    groups, problems = read_groups(files, liquid, stretch)
    run.refuse(problems)
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
        command=run.command, date=run.date, notes=() if style.available() else (style.NO_PICTURES,),
    )  # fmt: skip
    _write(out, document, answers, liquid)
    print_table(document)
    unanswered = any(group.unusable or not group.answered for group in document.groups)
    run.end(f"written to {out}", failed or unanswered)


def _write(out: Path, document: CollapseTimes, answers: list[Answers], medium: Medium) -> None:
    from cavirheo.beside.collapse_times import picture, record
    from cavirheo.writing import style

    with into(out) as folder:
        write_json(folder / "collapse-time.json", document)
        record.write_csv(folder / "shots.csv", document)
        if style.available():
            picture.write_pictures(folder, document, [analytic for analytic, _ in answers], medium)

"""`cavirheo collapse-time`: tables of collapse times or curves in; a table, a document and pictures out."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from cavirheo.errors import require
from cavirheo.verbs.options import FROM_OPTIONS, Liquid, Out
from cavirheo.verbs.run import Run


def collapse_time(
    files: Annotated[
        list[Path],
        typer.Argument(
            readable=False,
            help="tables (rmax_um,stretch,t1_us as .csv or .xlsx; pIMR_array in a .mat) or measured R(t)",
        ),
    ],
    material: Annotated[str, typer.Option(help="nhkv, nh (no viscosity) or newtonian (no elasticity)")] = "nhkv",
    exact: Annotated[bool, typer.Option("--exact", help="fit with simulated collapse times, too: seconds")] = False,
    shear_modulus: Annotated[float | None, typer.Option(help="Pa, if it is known: only µ is fitted")] = None,
    viscosity: Annotated[float | None, typer.Option(help="Pa s, if it is known: only G is fitted")] = None,
    stretch: Annotated[
        float | None, typer.Option(help="R_max/R_0 of curves (default: their late plateau) and of tables without it")
    ] = None,
    liquid: Liquid = FROM_OPTIONS,
    out: Out = Path("cavirheo-collapse-time"),
) -> None:
    """G and µ from the times of the first collapse alone: one answer per table, or per file or folder of curves."""
    from cavirheo.beside import collapse_times
    from cavirheo.writing import style
    from cavirheo.writing.document import Outputs, write_json

    run = Run()
    fine = stretch is None or 1 < stretch < 1e3
    require(fine, f"--stretch must be R_max/R_0 above 1, got {stretch!r}", "collapse_time.stretch")
    outputs = Outputs(out, "collapse-time.json", "shots.csv", inputs=files)
    groups, problems, remarks = collapse_times.read_groups(files, liquid, stretch)
    run.refuse(problems)
    run.notes += remarks
    require(bool(groups), "no collapse time could be read", "collapse_time.nothing")
    if exact:
        print("simulating (the solver is compiled once per machine, 10 to 30 s) ...", file=sys.stderr)
    for group in groups:
        group.answer(material, exact=exact, medium=liquid, shear_modulus=shear_modulus, viscosity=viscosity)
    document = collapse_times.CollapseTimes(
        command=run.command, date=run.date, notes=run.notes + ([] if style.available() else [style.NO_PICTURES]),
        material=material, medium=asdict(liquid), groups=groups,
    )  # fmt: skip
    outputs.write("shots.csv", collapse_times.write_csv, document)
    if style.available():
        document.notes += collapse_times.write_pictures(outputs, document)
    outputs.write("collapse-time.json", write_json, document)
    outputs.finish()
    collapse_times.print_table(document)
    unanswered = any(
        group.unusable or group.doubts or group.best is None or not group.best.answered for group in groups
    )
    run.end(f"written to {out}", unanswered or (exact and any(group.exact is None for group in groups)))

"""`cavirheo collapse-time`: tables of collapse times or curves in; a table, a document and pictures out."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from cavirheo.errors import require
from cavirheo.verbs import options
from cavirheo.verbs.run import Run


def collapse_time(
    files: Annotated[
        list[Path],
        typer.Argument(
            readable=False,
            help="tables (rmax_um,stretch,t1_us as .csv or .xlsx; pIMR_array in a .mat) or R(t); a folder; - for stdin",
        ),
    ],
    material: Annotated[
        str,
        typer.Option(
            help="nhkv, nh (no viscosity) or newtonian (no elasticity)",
            autocompletion=options.values("nhkv", "nh", "newtonian"),
        ),
    ] = "nhkv",
    exact: Annotated[bool, typer.Option("--exact", help="fit with simulated collapse times, too: seconds")] = False,
    shear_modulus: Annotated[float | None, typer.Option(help="Pa, if it is known: only µ is fitted")] = None,
    viscosity: Annotated[float | None, typer.Option(help="Pa s, if it is known: only G is fitted")] = None,
    stretch: Annotated[
        float | None, typer.Option(help="R_max/R_0 of curves (default: their late plateau) and of tables without it")
    ] = None,
    shots: options.Shots = None,
    group: options.Group = "auto",
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-collapse-time"),
    pictures: options.Pictures = True,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """G and µ from the times of the first collapse alone: one answer per table, or per file or folder of curves."""
    from cavirheo.companions import collapse_times
    from cavirheo.reading.shots import shot_numbers
    from cavirheo.reporting import file_names
    from cavirheo.writing import style
    from cavirheo.writing.document import Outputs, write_json

    shot_numbers(shots)
    files = run.files(files)
    drawing = pictures and style.available()
    fine = stretch is None or 1 < stretch < 1e3
    require(fine, f"--stretch must be R_max/R_0 above 1, got {stretch!r}", "collapse_time.stretch")
    outputs = Outputs(out, "collapse-time.json", "shots.csv", inputs=files)
    groups, problems, remarks = collapse_times.read_groups(files, liquid, stretch, group, shots)
    run.refuse(problems)
    run.notes += remarks
    run.need(groups, "collapse time")
    if exact:
        run.say("simulating (the solver is compiled once per machine, 10 to 30 s) ...")
    for one in groups:
        one.answer(material, exact=exact, medium=liquid, shear_modulus=shear_modulus, viscosity=viscosity)
    document = collapse_times.CollapseTimes(
        command=run.command, date=run.date, material=material, medium=asdict(liquid), groups=groups,
        notes=run.notes + ([] if drawing or not pictures else [style.NO_PICTURES]),
    )  # fmt: skip
    outputs.write("shots.csv", collapse_times.write_csv, document)
    answered = [one for one in groups if one.best] if drawing else []
    for one, stem in zip(answered, file_names([one.name for one in answered]), strict=True):
        document.notes += outputs.picture(f"{stem}.png", style.save_png, collapse_times.figure, one, document)
    outputs.write("collapse-time.json", write_json, document)
    outputs.finish()
    run.show(document, collapse_times.print_table)
    unanswered = any(one.unusable or one.doubts or one.best is None or not one.best.answered for one in groups)
    run.end(f"written to {out}", unanswered or (exact and any(one.exact is None for one in groups)))

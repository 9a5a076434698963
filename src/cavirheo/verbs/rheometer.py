"""`cavirheo rheometer`: files in, tables, documents and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cavirheo.errors import InputError, require
from cavirheo.verbs import options
from cavirheo.verbs.run import Run


def rheometer(
    files: Annotated[
        list[Path],
        typer.Argument(readable=False, help="sweeps of one material: .csv, .txt, .xlsx; a folder; - for stdin"),
    ],
    at: Annotated[float, typer.Option(help="angular frequency of the viscosity G''/omega, rad/s")] = 1.0,
    tolerance: Annotated[float, typer.Option(help="allowed change of G' within the linear range, %")] = 5.0,
    beside: Annotated[
        Path | None, typer.Option(help="result.json of `cavirheo infer`: one table with its bubbles")
    ] = None,
    name: Annotated[str | None, typer.Option(help="of the material  [default: from the file names]")] = None,
    out: options.Out = Path("cavirheo-rheometer"),
    pictures: options.Pictures = True,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Linear range, plateau modulus and viscosity from the oscillatory sweeps of a rheometer, beside bubbles."""
    from cavirheo.companions.published_values import set_beside
    from cavirheo.companions.rheometer import document, read
    from cavirheo.reporting import comparison, read_json
    from cavirheo.writing import style
    from cavirheo.writing.document import Outputs, write_json

    require(at > 0, f"--at must be an angular frequency in rad/s, got {at!r}")
    require(0 < tolerance < 50, f"--tolerance must be between 0 and 50 %, got {tolerance!r}")
    files = run.files(files)
    drawing = pictures and style.available()
    tables = ("rheometer.json", "rheometer.csv", "table.csv", "strain-sweep.png", "frequency-sweep.png")
    outputs = Outputs(out, *tables, inputs=[*files, *([beside] if beside else [])])
    result = read_json(beside) if beside else None
    found = []
    for path in files:
        try:
            found += read.read_sweeps(path)
        except InputError as error:
            run.refuse([str(error)])
    run.need(found, "sweep")
    made = document.rheometry(
        found, name or document.shared_name(files), tolerance / 100, at,
        command=run.command, date=run.date, notes=[] if drawing or not pictures else [style.NO_PICTURES],
    )  # fmt: skip
    outputs.write("rheometer.csv", document.write_csv, made)
    if result:
        set_beside(result.groups, {made.material: made.published})
        outputs.write("table.csv", comparison.write_csv, result)
    for kind in ("strain", "frequency") if drawing else ():
        from cavirheo.companions.rheometer.picture import figure

        if made.of(kind):
            made.notes += outputs.picture(f"{kind}-sweep.png", style.save_png, figure, made, kind)
    outputs.write("rheometer.json", write_json, made)
    outputs.finish()
    run.show(made, document.print_rheometry)
    if result and not run.quiet:
        comparison.print_beside(result, document.regimes(made, result))
    run.end(f"written to {out}", any(sweep.message for sweep in made.sweeps))

"""`cavirheo rheometer`: files in, tables, documents and pictures out."""

from __future__ import annotations

import re
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cavirheo.errors import InputError
from cavirheo.verbs.run import Run

if TYPE_CHECKING:
    from cavirheo.beside.rheometer.document import BesideRow, Rheometry
    from cavirheo.beside.rheometer.read import Sweep


def rheometer(
    files: Annotated[list[Path], typer.Argument(help="strain and frequency sweeps of one material: .csv, .txt, .xlsx")],
    at: Annotated[float, typer.Option(help="angular frequency of the viscosity G''/omega, rad/s")] = 1.0,
    tolerance: Annotated[float, typer.Option(help="by which G' may leave its plateau in the linear range, %")] = 5.0,
    beside: Annotated[
        Path | None, typer.Option(help="result.json of `cavirheo infer`: one table with its bubbles")
    ] = None,
    name: Annotated[str | None, typer.Option(help="of the material; default: what the file names share")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="folder for the results")] = Path("cavirheo-rheometer"),
) -> None:
    """Linear range, plateau modulus and viscosity from the oscillatory sweeps of a rheometer, beside bubbles."""
    from cavirheo.beside.rheometer.document import beside as rows_beside
    from cavirheo.beside.rheometer.document import print_rheometry, rheometry
    from cavirheo.beside.rheometer.sweeps import frequency_sweep, strain_sweep
    from cavirheo.reporting import read_json
    from cavirheo.writing import style

    if not 0 < at < float("inf"):
        raise InputError(f"--at must be an angular frequency in rad/s, got {at!r}")
    if not 0 < tolerance < 50:
        raise InputError(f"--tolerance must be between 0 and 50 %, got {tolerance!r}")
    run = Run()
    result = read_json(beside) if beside else None
    sweeps = _read(files, run)
    document = rheometry(
        [strain_sweep(sweep, tolerance / 100) for sweep in sweeps if sweep.kind == "strain"],
        [frequency_sweep(sweep, at) for sweep in sweeps if sweep.kind == "frequency"],
        material=name or _shared_name(files), tolerance=tolerance / 100, at_rad_per_s=at,
        command=run.command, date=run.date, notes=[] if style.available() else [style.NO_PICTURES],
    )  # fmt: skip
    rows = rows_beside(document, result) if result else []
    _write(out, document, rows)
    print_rheometry(document, rows)
    run.end(f"written to {out}", any(sweep.message for sweep in document.sweeps))


def _read(files: list[Path], run: Run) -> list[Sweep]:
    """All sweeps of all files. Raises InputError: there is none."""
    from cavirheo.beside.rheometer.read import read_sweeps

    sweeps: list[Sweep] = []
    for path in files:
        try:
            sweeps += read_sweeps(path)
        except InputError as error:
            run.refuse([str(error)])
    if not sweeps:
        raise InputError("no sweep could be read")
    return sweeps


def _shared_name(files: list[Path]) -> str:
    """'gel' of gel_strain.csv and gel_frequency.csv: the words with which all names begin, or the first name."""
    words = [re.split(r"[\W_]+", path.stem) for path in files]
    shared = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
    return ("_".join(column[0] for column in shared) if len(files) > 1 else "") or files[0].stem


def _write(out: Path, document: Rheometry, rows: list[BesideRow]) -> None:
    from cavirheo.beside.rheometer.document import write_csv, write_table
    from cavirheo.beside.rheometer.picture import write_pictures
    from cavirheo.writing import style
    from cavirheo.writing.document import into, write_json

    with into(out) as folder:
        write_json(folder / "rheometer.json", document)
        write_csv(folder / "rheometer.csv", document)
        if rows:
            write_table(folder / "table.csv", rows)
        if style.available():
            write_pictures(folder, document)

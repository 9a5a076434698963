"""`cavirheo which-law`: the evidence of several laws for the same curves, as a table and laws.json."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    liquid_of,
    load_solver,
    number_or,
    progress,
    read_files,
)
from cavirheo.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.verify.evidence import Ranking


def which_law(
    files: Annotated[list[Path], typer.Argument(help="measured R(t): .mat, .csv, .h5, .xlsx; one or many curves each")],
    laws: Annotated[str, typer.Option(help="two or more, with commas")] = "nhkv,newtonian,qkv,zener",
    window: Annotated[
        str | None, typer.Option(help="collapses that are looked at, or 'all'  [default: 3, or as many as there are]")
    ] = None,
    stretch: Annotated[
        str | None, typer.Option(help="R_max/R_0, or 'plateau': late radius as prior; inferred otherwise")
    ] = None,
    exact_law: ExactLaw = False,
    exposure_us: ExposureUs = None,
    rmax_um: Annotated[float | None, typer.Option(help="true R_max of the shots, um: rescales the radii")] = None,
    medium: MediumName = "water",
    density: Density = None,
    sound_speed: SoundSpeed = None,
    surface_tension: SurfaceTension = None,
    pressure: Pressure = None,
    temperature: Temperature = None,
    seed: Annotated[int, typer.Option(help="of the draws", min=0)] = 0,
    out: Out = Path("cavirheo-laws"),
) -> None:
    """Which of several laws do the curves speak for? Evidence by importance sampling, some 10 s a curve and law."""
    from rich.console import Console

    from cavirheo.inference.verify.evidence import rank_laws

    began = time.perf_counter()
    names = [name.strip() for name in laws.split(",") if name.strip()]
    collapses, known = number_or(window, "all", "--window", int), number_or(stretch, "plateau", "--stretch", float)
    liquid = liquid_of(medium, density, sound_speed, surface_tension, pressure, temperature)
    curves, unreadable = read_files(files, liquid, rmax_um, exposure_us)
    load_solver()
    with progress("weighing") as bar:
        task = bar.add_task("", total=len(curves) * len(names))
        singles, groups = rank_laws(
            curves, names, medium=liquid, window=collapses, stretch=known, seed=seed, discrepancy=not exact_law,
            done=lambda: bar.advance(task),
        )  # fmt: skip
    command = shlex.join(["cavirheo", *sys.argv[1:]])
    path = _write(out, curves, singles, groups, command)
    Console().print(_table(singles, groups))
    print(f"{len(curves)} curves in {time.perf_counter() - began:.1f} s; {path}", file=sys.stderr)
    if unreadable:
        raise typer.Exit(2)
    if any(one.chosen is None for one in singles):
        raise typer.Exit(1)


def _table(singles: list[Ranking], groups: list[Ranking]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from cavirheo.reporting import wording

    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, title_justify="left", title_style="dim")
    table.title = "log evidence below the best; *: cannot be told from it; →: the simplest of these"
    for head in ("curve", "law", "log evidence", "probability", "G Pa", "µ Pa s", "RMSE %", "verdict"):
        table.add_column(head, justify="left" if head in ("curve", "law", "verdict") else "right")
    for one in [*singles, *groups]:
        near, probability = one.contenders, one.probability
        best = max((v for v in one.log_evidence.values() if v is not None), default=0.0)
        name = one.name if one.answers else f"{one.name}: {one.shots} shots"
        for law, value in one.log_evidence.items():
            mark = ("→ " if law == one.chosen else "") + law + ("*" if law in near else "")
            error = one.error[law]
            cells = [wording.MISSING if value is None else f"{value - best:.1f} ± {error:.1f}"]
            cells += [f"{probability[law]:.3f}" if law in probability else wording.MISSING]
            if law in one.answers:
                answer = one.answers[law]
                medians = [answer.median(name) for name in ("shear_modulus", "viscosity")]
                cells += [wording.MISSING if m is None else wording.digits(m) for m in medians]
                cells += [wording.percent(answer.checks.rmse_over_rmax), wording.VERDICTS[answer.checks.verdict]]
            table.add_row(wording.elide(name, 24), mark, *cells, style=None if one.answers else "bold")
            name = ""
        table.add_section()
    return table


def _write(out: Path, curves: list[RadiusCurve], singles: list[Ranking], groups: list[Ranking], command: str) -> Path:
    """laws.json: by curve and group the evidence of each law, and for a curve the row that result.json would have."""
    from cavirheo.reporting.document import Document, write_json
    from cavirheo.reporting.record import curve_record

    def about(one: Ranking, curve: RadiusCurve | None) -> dict[str, Any]:
        probability = one.probability
        rows: dict[str, dict[str, Any]] = {}
        for law, value in one.log_evidence.items():
            row = {"log_evidence": value, "standard_error": one.error[law], "probability": probability.get(law)}
            rows[law] = row | ({"answer": curve_record(curve, one.answers[law])} if curve else {})
        return {"name": one.name, "shots": one.shots, "chosen": one.chosen, "contenders": one.contenders, "laws": rows}

    document = Document(
        command=command,
        curves=[about(one, curve) for one, curve in zip(singles, curves, strict=True)],  # type: ignore[call-arg]
        groups=[about(one, None) for one in groups],
    )
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "laws.json", document)
    except OSError as error:
        raise InputError(f"cannot write {out / 'laws.json'}: {error.strerror or error}") from None
    return out / "laws.json"

"""`cavirheo which-law`: the evidence of several laws for the same curves, as a table and laws.json."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cavirheo.verbs.options import (
    FROM_OPTIONS,
    Curves,
    ExactLaw,
    ExposureUs,
    Out,
    TrueRadius,
    number_or,
    with_surroundings,
)
from cavirheo.verbs.run import Run
from cavirheo.writing.terminal import bar, console, table

if TYPE_CHECKING:
    from rich.table import Table

    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.verify.evidence import Ranking
    from cavirheo.physics.media import Medium


@with_surroundings
def which_law(
    files: Curves,
    laws: Annotated[str, typer.Option(help="two or more, with commas")] = "nhkv,newtonian,qkv,zener",
    window: Annotated[
        str | None, typer.Option(help="collapses that are looked at, or 'all'  [default: 3, or as many as there are]")
    ] = None,
    stretch: Annotated[
        str | None, typer.Option(help="R_max/R_0, or 'plateau': late radius as prior; inferred otherwise")
    ] = None,
    exact_law: ExactLaw = False,
    exposure_us: ExposureUs = None,
    rmax_um: TrueRadius = None,
    liquid: Medium = FROM_OPTIONS,
    seed: Annotated[int, typer.Option(help="of the draws", min=0)] = 0,
    out: Out = Path("cavirheo-laws"),
) -> None:
    """Which of several laws do the curves speak for? Evidence by importance sampling, some 10 s a curve and law."""
    from cavirheo.inference.verify.evidence import rank_laws

    run = Run()
    names = [name.strip() for name in laws.split(",") if name.strip()]
    collapses, known = number_or(window, "all", "--window", int), number_or(stretch, "plateau", "--stretch", float)
    curves = run.read(files, liquid, rmax_um, exposure_us)
    with bar("weighing", len(curves) * len(names)) as advance:
        singles, groups = rank_laws(
            curves, names, medium=liquid, window=collapses, stretch=known, seed=seed, discrepancy=not exact_law,
            done=advance,
        )  # fmt: skip
    path = _write(out, curves, singles, groups, run.command)
    console().print(_table(singles, groups))
    run.end(f"{len(curves)} curves in {{seconds}}; {path}", any(one.chosen is None for one in singles))


def _table(singles: list[Ranking], groups: list[Ranking]) -> Table:
    from cavirheo.writing import digits

    heads = ("law", "log evidence", "probability", "G Pa", "µ Pa s", "RMSE %", "verdict")
    made = table(
        "curve",
        heads,
        left=("law", "verdict"),
        title="log evidence below the best; *: cannot be told from it; →: the simplest of these",
    )
    for one in [*singles, *groups]:
        near, probability = one.contenders, one.probability
        best = max((v for v in one.log_evidence.values() if v is not None), default=0.0)
        name = one.name if one.answers else f"{one.name}: {one.shots} shots"
        for law, value in one.log_evidence.items():
            mark = ("→ " if law == one.chosen else "") + law + ("*" if law in near else "")
            error = one.error[law]
            cells = [digits.MISSING if value is None else f"{value - best:.1f} ± {error:.1f}"]
            cells += [f"{probability[law]:.3f}" if law in probability else digits.MISSING]
            if law in one.answers:
                answer = one.answers[law]
                medians = [answer.median(name) for name in ("shear_modulus", "viscosity")]
                cells += [digits.MISSING if m is None else digits.significant(m) for m in medians]
                cells += [digits.percent(answer.checks.rmse_over_rmax), digits.VERDICTS[answer.checks.verdict]]
            made.add_row(digits.elide(name, 24), mark, *cells, style=None if one.answers else "bold")
            name = ""
        made.add_section()
    return made


def _write(out: Path, curves: list[RadiusCurve], singles: list[Ranking], groups: list[Ranking], command: str) -> Path:
    """laws.json: by curve and group the evidence of each law, and for a curve the row that result.json would have."""
    from cavirheo.reporting.record import curve_record
    from cavirheo.writing.document import Document, into, write_json

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
    with into(out) as folder:
        write_json(folder / "laws.json", document)
    return out / "laws.json"

"""`cavirheo which-law`: the evidence of several laws for the same curves, as a table and laws.json."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from cavirheo.writing.terminal import bar, console

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.verify.evidence import Ranking
    from cavirheo.physics.media import Medium
    from cavirheo.reporting.laws import WeighedLaws


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
    from cavirheo.reporting.laws import Laws, laws_table
    from cavirheo.writing.document import into, write_json

    run = Run()
    names = [name.strip() for name in laws.split(",") if name.strip()]
    collapses, known = number_or(window, "all", "--window", int), number_or(stretch, "plateau", "--stretch", float)
    curves = run.read(files, liquid, rmax_um, exposure_us)
    with bar("weighing", len(curves) * len(names)) as advance:
        singles, groups = rank_laws(
            curves, names, medium=liquid, window=collapses, stretch=known, seed=seed, discrepancy=not exact_law,
            done=advance,
        )  # fmt: skip
    document = Laws(
        command=run.command,
        curves=[_weighed(one, curve) for one, curve in zip(singles, curves, strict=True)],
        groups=[_weighed(one) for one in groups],
    )
    with into(out) as folder:
        write_json(folder / "laws.json", document)
    console().print(laws_table(document))
    run.end(f"{len(curves)} curves in {{seconds}}; {out / 'laws.json'}", any(one.chosen is None for one in singles))


def _weighed(one: Ranking, curve: RadiusCurve | None = None) -> WeighedLaws:
    from cavirheo.reporting.laws import WeighedLaw, WeighedLaws
    from cavirheo.reporting.record import curve_record

    probability = one.probability
    laws = {
        law: WeighedLaw(
            log_evidence=value,
            standard_error=one.error[law],
            probability=probability.get(law),
            answer=curve_record(curve, one.answers[law]) if curve else None,
        )
        for law, value in one.log_evidence.items()
    }
    return WeighedLaws(name=one.name, shots=one.shots, chosen=one.chosen, contenders=one.contenders, laws=laws)

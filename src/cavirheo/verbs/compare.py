"""`cavirheo compare`: many sets of measurements and published values in, tables and a picture out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cavirheo.verbs import options
from cavirheo.verbs.run import Run


def compare(
    folder: Annotated[Path, typer.Argument(help="holds the measurements: a file, subfolder or glob per set")],
    references: Annotated[Path, typer.Option(help="CSV of sets and published values, see docs/how-to/compare.md")],
    reference_method: Annotated[
        list[str] | None, typer.Option(help="errors are relative to it; may be repeated  [default: IMR, rheometer]")
    ] = None,
    model: options.ModelName = "bdt-viscoelastic",
    fit_law: Annotated[
        str | None,
        typer.Option(
            "--fit",
            help="least squares with this law (nhkv, ...) instead of networks",
            autocompletion=options.sum_names,
        ),
    ] = None,
    trust_input: options.TrustInput = False,
    out: options.Out = Path("cavirheo-comparison"),
    pictures: options.Pictures = True,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Published values of many sets beside ours, with relative errors: tables, a picture and a report per set."""
    from cavirheo.companions.published import compare as compare_sets
    from cavirheo.companions.published.comparison import print_table

    result = compare_sets(
        folder, references, out, model=model, fit=fit_law, reference_methods=reference_method or [],
        trust_input=trust_input, pictures=pictures, command=run.command, progress=not run.quiet,
    )  # fmt: skip
    if result.interrupted:
        run.stop(result.notes[0], out / "comparison.md")
    run.show(result, print_table)
    run.unreadable = sum(len(about.problems) for about in result.sets)
    shots = sum(about.n_shots for about in result.sets)
    failed = any(about.n_answered < about.n_shots or about.verdicts.get("check_input") for about in result.sets)
    run.end(f"{len(result.sets)} sets, {shots} shots in {{seconds}}; table: {out / 'comparison.md'}", failed)

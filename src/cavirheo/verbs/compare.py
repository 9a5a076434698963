"""`cavirheo compare`: many sets of measurements and published values in, tables and a picture out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cavirheo.verbs import options
from cavirheo.verbs.run import Run


def compare(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", help="holds the measurements, a file, subfolder or glob per set; or a result.json"
        ),
    ],
    references: Annotated[Path, typer.Option(help="CSV of sets and published values, see docs/how-to/compare.md")],
    reference_method: Annotated[
        list[str] | None, typer.Option(help="errors are relative to it; may be repeated  [default: IMR, rheometer]")
    ] = None,
    model: options.ModelName = "posterior",
    material: options.Material = None,
    bubbles: options.Bubbles = options.FROM_OPTIONS,
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
    """Your answers beside published values, with relative errors: those of `infer`, with the field's bubble."""
    from cavirheo.companions.comparison import Answering, compare
    from cavirheo.reporting.comparison import print_comparison
    from cavirheo.writing import digits

    how = Answering(model, material, fit_law, bubbles or "field", trust_input)
    result, run.unreadable, interrupted = compare(
        source,
        references,
        out,
        how=how,
        reference_methods=reference_method or [],
        pictures=pictures,
        command=run.command,
        progress=not run.quiet,
    )
    if interrupted:
        run.stop(result.notes[0], out / "comparison.md")
    run.show(result, print_comparison)
    failed = any(record.verdict in ("failed", "check_input") for record in result.curves)
    said = f"{digits.counted(len(result.groups), 'set')}, {digits.counted(len(result.curves), 'shot')} in {{seconds}}"
    run.end(f"{said}; table: {out / 'comparison.md'}", failed)

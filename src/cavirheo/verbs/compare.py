"""`cavirheo compare`: many sets of measurements and published values in, tables and a picture out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cavirheo.verbs import completion, options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run

_REFERENCE = "errors are relative to it; may be repeated  [default: IMR, rheometer]"
_FIT = "least squares with this law (nhkv, ...) instead of networks"


@dataclass(kw_only=True)
class Compare(options.Printing, options.Documents, options.Pictures, options.Trust):
    """Published values of many sets beside ours, with relative errors: tables, a picture and a report per set."""

    folder: Annotated[Path, argument("FOLDER", "holds the measurements: a file, subfolder or glob per set")]
    references: Annotated[Path, option("CSV of sets and published values, see docs/how-to/compare.md")]
    reference_method: Annotated[list[str] | None, option(_REFERENCE, metavar="METHOD")] = None
    model: options.ModelName = "bdt-viscoelastic"
    fit_law: Annotated[str | None, option(_FIT, None, "--fit", autocompletion=completion.sum_names)] = None
    out: options.Out = Path("cavirheo-comparison")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.published import compare as compare_sets
        from cavirheo.companions.published.comparison import print_table

        out = self.out
        result = compare_sets(
            self.folder, self.references, out, model=self.model, fit=self.fit_law,
                reference_methods=self.reference_method or [],
            trust_input=self.trust_input, pictures=self.pictures, command=run.command, progress=not run.quiet,
        )  # fmt: skip
        if result.notes and result.notes[0].startswith("interrupted"):
            run.stop(result.notes[0], out / "comparison.md")
        run.show(result, print_table)
        run.unreadable = sum(len(about.problems) for about in result.sets)
        shots = sum(about.n_shots for about in result.sets)
        failed = any(about.n_answered < about.n_shots or about.verdicts.get("check_input") for about in result.sets)
        run.end(f"{len(result.sets)} sets, {shots} shots in {{seconds}}; table: {out / 'comparison.md'}", failed)

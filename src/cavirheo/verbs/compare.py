"""`cavirheo compare`: many sets of measurements and published values in, tables and a picture out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cavirheo.verbs import completion, options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run

_SOURCE = "holds the measurements, a file, subfolder or glob per set; or a result.json"
_REFERENCE = "errors are relative to it; may be repeated  [default: IMR, rheometer]"
_FIT = "least squares with this law (nhkv, ...) instead of networks"


@dataclass(kw_only=True)
class Compare(options.Printing, options.Documents, options.Pictures, options.Trust, options.OneBubble):
    """Your answers beside published values, with relative errors: those of `infer`, with the field's bubble."""

    source: Annotated[Path, argument("FOLDER", _SOURCE)]
    references: Annotated[Path, option("CSV of sets and published values, see docs/how-to/compare.md")]
    reference_method: Annotated[list[str] | None, option(_REFERENCE, metavar="METHOD")] = None
    model: options.ModelName = "posterior"
    material: options.Material = None
    fit_law: Annotated[str | None, option(_FIT, None, "--fit", autocompletion=completion.sum_names)] = None
    out: options.Out = Path("cavirheo-comparison")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.comparison import Answering, compare
        from cavirheo.reporting.comparison import print_comparison
        from cavirheo.writing import digits

        how = Answering(self.model, self.material, self.fit_law, self.bubbles or "field", self.trust_input)
        result, run.unreadable, interrupted = compare(
            self.source,
            self.references,
            self.out,
            how=how,
            reference_methods=self.reference_method or [],
            pictures=self.pictures,
            command=run.command,
            progress=not run.quiet,
        )
        table = self.out / "comparison.md"
        if interrupted:
            run.stop(result.notes[0], table)
        run.show(result, print_comparison)
        failed = any(record.verdict in ("failed", "check_input") for record in result.curves)
        counted = f"{digits.counted(len(result.groups), 'set')}, {digits.counted(len(result.curves), 'shot')}"
        run.end(f"{counted} in {{seconds}}; table: {table}", failed)

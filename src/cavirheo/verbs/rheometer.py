"""`cavirheo rheometer`: files in, tables, documents and pictures out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cavirheo.errors import InputError, require
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run

_FILES = "sweeps of one material: .csv, .txt, .xlsx; a folder; - for stdin"


@dataclass(kw_only=True)
class Rheometer(options.Printing, options.Documents, options.Pictures):
    """Linear range, plateau modulus and viscosity from the oscillatory sweeps of a rheometer, beside bubbles."""

    files: Annotated[list[Path], argument("FILE...", _FILES, readable=False)]
    at: Annotated[float, option("angular frequency of the viscosity G''/omega, rad/s")] = 1.0
    tolerance: Annotated[float, option("allowed change of G' within the linear range, %")] = 5.0
    beside: Annotated[Path | None, option("result.json of `cavirheo infer`: one table with its bubbles")] = None
    name: Annotated[str | None, option("of the material  [default: from the file names]")] = None
    out: options.Out = Path("cavirheo-rheometer")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.published_values import set_beside
        from cavirheo.companions.rheometer import document, read
        from cavirheo.reporting import comparison, read_json
        from cavirheo.writing import style
        from cavirheo.writing.document import Outputs, write_json

        require(self.at > 0, f"--at must be an angular frequency in rad/s, got {self.at!r}")
        require(0 < self.tolerance < 50, f"--tolerance must be between 0 and 50 %, got {self.tolerance!r}")
        files = run.files(self.files)
        drawing = self.pictures and style.available()
        tables = ("rheometer.json", "rheometer.csv", "table.csv", "strain-sweep.png", "frequency-sweep.png")
        outputs = Outputs(self.out, *tables, inputs=[*files, *([self.beside] if self.beside else [])])
        result = read_json(self.beside) if self.beside else None
        found = []
        for path in files:
            try:
                found += read.read_sweeps(path)
            except InputError as error:
                run.refuse([str(error)])
        run.need(found, "sweep")
        made = document.rheometry(
            found, self.name or document.shared_name(files), self.tolerance / 100, self.at,
            command=run.command, date=run.date, notes=[] if drawing or not self.pictures else [style.NO_PICTURES],
        )  # fmt: skip
        outputs.write("rheometer.csv", document.write_csv, made)
        if result:
            set_beside(result.groups, {made.material: made.published})
            outputs.write("table.csv", comparison.write_csv, result)
        for kind in ("strain", "frequency") if drawing else ():
            from cavirheo.companions.rheometer.picture import figure

            if made.of(kind):
                made.notes += outputs.picture(f"{kind}-sweep.png", style.save, figure, made, kind)
        outputs.write("rheometer.json", write_json, made)
        outputs.finish()
        run.show(made, document.print_rheometry)
        if result and not run.quiet:
            comparison.print_beside(result, document.regimes(made, result))
        run.end(f"written to {self.out}", any(sweep.message for sweep in made.sweeps))

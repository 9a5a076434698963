"""`cavirheo collapse-time`: tables of collapse times or curves in; a table, a document and pictures out."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cavirheo.errors import require
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run

_FILES = "tables (rmax_um,stretch,t1_us as .csv or .xlsx; pIMR_array in a .mat) or R(t); a folder; - for stdin"
_STRETCH = "R_max/R_0 of curves  [default: their late plateau] and of tables without it"


@dataclass(kw_only=True)
class CollapseTime(options.Printing, options.Documents, options.Pictures, options.Liquid):
    """G and µ from the times of the first collapse alone: one answer per table, or per file or folder of curves."""

    files: Annotated[list[Path], argument("FILE...", _FILES, readable=False)]
    material: Annotated[Literal["nhkv", "nh", "newtonian"], option("nh has no viscosity, newtonian no elasticity")] = (
        "nhkv"
    )
    exact: Annotated[bool, option("fit with simulated collapse times, too: seconds", None, "--exact")] = False
    shear_modulus: Annotated[float | None, option("Pa, if it is known: only µ is fitted")] = None
    viscosity: Annotated[float | None, option("Pa s, if it is known: only G is fitted")] = None
    stretch: Annotated[float | None, option(_STRETCH)] = None
    shots: options.Shots = None
    group: options.Group = "auto"
    out: options.Out = Path("cavirheo-collapse-time")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions import collapse_times
        from cavirheo.io.shots import shot_numbers
        from cavirheo.reporting import file_names
        from cavirheo.writing import style
        from cavirheo.writing.document import Outputs, write_json

        shot_numbers(self.shots)
        files, liquid = run.files(self.files), self.liquid
        drawing = self.pictures and style.available()
        fine = self.stretch is None or 1 < self.stretch < 1e3
        require(fine, f"--stretch must be R_max/R_0 above 1, got {self.stretch!r}", "collapse_time.stretch")
        outputs = Outputs(self.out, "collapse-time.json", "shots.csv", inputs=files)
        groups, problems, remarks = collapse_times.read_groups(files, liquid, self.stretch, self.group, self.shots)
        run.refuse(problems)
        run.notes += remarks
        run.need(groups, "collapse time")
        if self.exact:
            run.say("simulating (the solver is compiled once per machine, 10 to 30 s) ...")
        how: dict[str, Any] = {"exact": self.exact, "shear_modulus": self.shear_modulus, "viscosity": self.viscosity}
        for one in groups:
            one.answer(self.material, medium=liquid, **how)
        document = collapse_times.CollapseTimes(
            command=run.command, date=run.date, material=self.material, medium=asdict(liquid), groups=groups,
            notes=run.notes + ([] if drawing or not self.pictures else [style.NO_PICTURES]),
        )  # fmt: skip
        outputs.write("shots.csv", collapse_times.write_csv, document)
        answered = [one for one in groups if one.best] if drawing else []
        for one, stem in zip(answered, file_names([one.name for one in answered]), strict=True):
            document.notes += outputs.picture(f"{stem}.png", style.save, collapse_times.figure, one, document)
        outputs.write("collapse-time.json", write_json, document)
        outputs.finish()
        run.show(document, collapse_times.print_table)
        unanswered = any(one.unusable or one.doubts or one.best is None or not one.best.answered for one in groups)
        run.end(f"written to {self.out}", unanswered or (self.exact and any(one.exact is None for one in groups)))

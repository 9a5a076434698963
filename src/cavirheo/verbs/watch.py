"""`cavirheo watch`: a folder in, each recording answered as it arrives; result.json and a page for the wall out."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from cavirheo.errors import require
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, option
from cavirheo.verbs.run import Run


@dataclass(kw_only=True)
class Watch(options.Inference):
    """Every recording that arrives in a folder, answered as `infer` does, until Ctrl-C."""

    folder: Annotated[Path, argument("FOLDER", "where the recordings arrive: R(t) files or videos", readable=False)]
    once: Annotated[bool, option("answer the files that exist, write the report, and stop", None, "--once")] = False
    patience: Annotated[
        float, option("how long to try a file again that cannot be read, s", options.INPUT, min=0.0)
    ] = 10.0
    wanted_percent: options.WantedPercent = 10.0

    def __call__(self, run: Run) -> None:
        from cavirheo.io.option_tables import is_size, read_column
        from cavirheo.parallel import aside, cores
        from cavirheo.physics.simulate import load_solver
        from cavirheo.reporting import wall_page, write_report
        from cavirheo.reporting.table import print_line, print_table
        from cavirheo.watch import Watch as Watching
        from cavirheo.writing import digits

        folder, out, liquid = self.folder, self.out, self.liquid
        require(folder.is_dir(), f"{folder} is no folder: give the one where recordings arrive", "watch.folder")
        self.check_verify([folder])
        analysis = self.analysis
        if self.column is not None and not is_size(self.column):
            read_column(self.column)
        reading = {one.name: getattr(self, one.name) for one in fields(options.Reading) if one.name != "column"}
        watching = Watching(
            folder, out, analysis, lambda path: self.recordings([path], liquid), reading, group=self.group,
            column=self.column, command=run.command, date=run.date, say=run.say, patience=self.patience,
            wanted=0.01 * self.wanted_percent, show=print_line if not run.quiet else lambda _: None,
        )  # fmt: skip
        aside(load_solver)
        result = watching.write()
        page = f"{out / wall_page.PAGE} shows the latest" + ("" if self.once else "; Ctrl-C ends")
        run.say(f"watching {folder}: {len(result.curves)} answered before; {page}")
        try:
            while watching.once() or watching.pause() or not self.once:
                pass
            stopped = False
        except KeyboardInterrupt:  # the usual end
            stopped = True
        pairs, notes = watching.answered()
        how: dict[str, Any] = {"date": run.date, "notes": notes, "draw": self.pictures, "workers": cores()}
        result = write_report(out, pairs, run.command, **how)
        run.show(result, print_table)
        run.unreadable = 0 if stopped else watching.unreadable
        failed = not stopped and any(record.verdict in ("failed", "check_input") for record in result.curves)
        run.end(f"{digits.counted(len(pairs), 'curve')} in {{seconds}}; report: {out / 'report.html'}", failed)

"""One call of a verb: what it was, the files that it read, the time that it took, and its exit status."""

from __future__ import annotations

import math
import shlex
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from cavirheo.errors import require

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve
    from cavirheo.physics.media import Medium
    from cavirheo.unfinished import Step


class Run:
    """Begins when it is made. `command` and `date` are as documents have them; `unreadable` counts files, named in
    `notes`."""

    def __init__(self) -> None:
        self.began = time.perf_counter()
        self.command = shlex.join(["cavirheo", *sys.argv[1:]])
        self.date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
        self.unreadable = 0
        self.notes: list[str] = []  # on the run as a whole

    def refuse(self, problems: list[str]) -> None:
        """Say on stderr which files cannot be read, and count them."""
        self.unreadable += len(problems)
        self.notes += [f"not read: {problem}" for problem in problems]
        for problem in problems:
            print(f"error: {problem}", file=sys.stderr)

    def read(
        self, files: list[Path], medium: Medium, rmax_um: float | None, exposure_us: float | None = None
    ) -> list[RadiusCurve]:
        """All curves of all files, and the solver loaded. Raises InputError: there is none."""
        from cavirheo.parallel import aside
        from cavirheo.physics.simulate import load_solver
        from cavirheo.reading.shots import read_shots

        exposure = exposure_us or 0.0
        good = exposure_us is None or 0.0 < exposure < math.inf
        require(good, f"--exposure-us must be a positive time in us, got {exposure:g}")
        scale = None if rmax_um is None else rmax_um * 1e-6
        shots = read_shots(files, density=medium.density, pressure=medium.pressure, max_radius=scale)
        self.refuse(shots.problems)
        self.notes += shots.remarks
        curves = shots.curves
        require(len(curves) > 0, "no curve could be read")
        aside(load_solver)
        return [curve.with_exposure(exposure * 1e-6) for curve in curves] if exposure else curves

    def report(self, curves: list[RadiusCurve], first: Step, out: Path, verify: str = "none", **settings: Any) -> None:
        """The end of `infer` and `fit`: the curves answered by the first step, the answers verified (`settings` are
        those of `verify_many`), documents into `out`, the table, the exit status."""
        from cavirheo.reporting import outputs, write_report
        from cavirheo.reporting.table import print_table
        from cavirheo.unfinished import Step, Unfinished

        outputs(out, curves)
        steps, kept = [first], Unfinished(out)
        if verify != "none":
            from cavirheo.inference.verify import verify_many

            steps.append(Step("verifying", verify_many, {"level": verify, **settings}))
        found = kept.answers(curves, *steps)
        pairs, note = [(curves[i], answer) for i, answer in found.items()], kept.note(len(found), len(curves))
        if note:
            if pairs:
                notes = [note, *self.notes]
                write_report(out, pairs, self.command, date=self.date, notes=notes, complete=False)
            self.stop(note, out / "result.json" if pairs else None)
        result = write_report(out, pairs, self.command, date=self.date, notes=self.notes)
        kept.remove()
        print_table(result)
        failed = any(record.verdict in ("failed", "check_input") for record in result.curves)
        self.end(f"{len(curves)} curves in {{seconds}}; report: {out / 'report.html'}", failed)

    def stop(self, said: str, written: Path | None) -> NoReturn:
        """The last line of a run that was interrupted, and its exit status."""
        print(f"{said}: {written}" if written else said, file=sys.stderr)
        raise typer.Exit(130)

    def end(self, said: str, failed: bool = False) -> None:
        """The last line on stderr, `{seconds}` replaced by the time taken; status 2: unreadable files, 1: `failed`."""
        print(said.replace("{seconds}", f"{time.perf_counter() - self.began:.1f} s"), file=sys.stderr)
        if self.unreadable or failed:
            raise typer.Exit(2 if self.unreadable else 1)

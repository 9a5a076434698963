"""One call of a verb: what it was, the files that it read, what it says, the time that it took, its exit status."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from cavirheo.errors import InputError, require
from cavirheo.writing import terminal
from cavirheo.writing.claim import current

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.analysis import Analysis
    from cavirheo.parallel import Executor
    from cavirheo.physics.media import Medium
    from cavirheo.verbs.options import Measured
    from cavirheo.writing.document import Document


def command_line() -> str:
    """What was typed, as documents have it."""
    return shlex.join(["cavirheo", *sys.argv[1:]])


class Run:
    """Begins when it is made. `command` and `date` are as documents have them; `unreadable` counts files, named in
    `notes`."""

    def __init__(self, *, json: bool = False, quiet: bool = False) -> None:
        self.began = time.perf_counter()
        self.command = command_line()
        self.date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
        self.unreadable = 0
        self.notes: list[str] = []  # on the run as a whole
        self.told: list[str] = []  # those that stderr has
        self.json, self.quiet = json, quiet or json

    def bar(
        self, what: str, total: int | None = None, *, unit: str = "curves"
    ) -> AbstractContextManager[Callable[..., None]]:
        """`terminal.bar`, if anything is to be seen."""
        return terminal.bar(what, total, shown=not self.quiet, unit=unit)

    def files(self, given: list[Path]) -> list[Path]:
        """Those that folders, patterns and `-` (standard input) stand for; one without a file is refused by itself."""
        from cavirheo.io.files import expand, sha256

        found: list[Path] = []
        for one in given:
            try:
                found += expand([one], self.say)
                if str(one) == "-" and (claim := current()):
                    claim.inputs.append(sha256(found[-1]))
            except InputError as error:
                self.refuse([str(error)])
        self.need(found, "file")
        return list(dict.fromkeys(found))

    def refuse(self, problems: list[str]) -> None:
        """Say on stderr which files cannot be read, and count them."""
        self.unreadable += len(problems)
        self.told += [f"not read: {problem}" for problem in problems]
        self.notes += self.told[-len(problems) :] if problems else []
        for problem in problems:
            terminal.say(f"error: {problem}")

    def need(self, found: Sequence[Any], what: str) -> None:
        """Ends the run where nothing could be read; why not is said already, if files were refused."""
        require(bool(found) or self.unreadable > 0, f"no {what} could be read", "run.nothing")
        if not found:
            raise typer.Exit(2)

    def read(self, files: list[Path], medium: Medium, reading: Measured) -> list[RadiusCurve]:
        """All curves of all files, with what a declared column says of them, and the solver loaded. Raises InputError:
        there is none, or the column is not theirs."""
        from cavirheo.parallel import aside
        from cavirheo.physics.simulate import load_solver

        found = reading.recordings(files, medium, reading.exclude)
        self.refuse(found.problems)
        self.notes += found.remarks + found.hints
        curves = found.curves
        self.need(curves, "curve")
        if reading.column is not None:
            from cavirheo.io.column import with_column

            curves = with_column(curves, reading.column)
        aside(load_solver)
        return curves

    def report(
        self,
        curves: list[RadiusCurve],
        analysis: Analysis,
        out: Path,
        *,
        pictures: bool = True,
        figures: Sequence[str] = (),
        executor: Executor | None = None,
    ) -> None:
        """The end of `infer` and `fit`: the curves answered, documents into `out`, the table, the exit status."""
        from cavirheo.parallel import cores
        from cavirheo.reporting import outputs, write_report
        from cavirheo.reporting.record import Answered
        from cavirheo.reporting.table import print_table
        from cavirheo.workflow.analyse import Unfinished
        from cavirheo.writing import digits

        folder, kept = outputs(out, curves, figures), Unfinished(out, shown=not self.quiet, executor=executor)
        analysis.check(curves)
        answers = kept.answers(curves, analysis)
        pairs, note = Answered([curves[i] for i in answers.indices], answers), kept.note(len(answers), len(curves))
        if note:
            if folder.holds("report.html"):
                self.stop(f"{note}; until then the earlier answers stay", out / "result.json")
            if pairs:
                notes = [note, *self.notes]
                write_report(out, pairs, self.command, date=self.date, notes=notes, complete=False)
            self.stop(note, out / "result.json" if pairs else None)
        how: dict[str, Any] = {"date": self.date, "notes": self.notes, "draw": pictures, "workers": cores()}
        with self.bar("drawing", unit="figures") if figures else nullcontext() as advance:
            result = write_report(out, pairs, self.command, figures, done=advance, **how)
        kept.remove()
        self.show(result, partial(print_table, analysis=analysis, out=out, notes_shown=self.told))
        failed = any(record.verdict in ("failed", "check_input") for record in result.curves)
        self.end(f"{digits.counted(len(curves), 'curve')} in {{seconds}}; report: {out / 'report.html'}", failed)

    def show(self, document: Document, table: Callable[[Any], None]) -> None:
        """The result on stdout: as `table` prints it, or the document as it is in its file (--json)."""
        if self.json:
            from cavirheo.writing.document import as_json

            sys.stdout.write(as_json(document))
        elif not self.quiet:
            table(document)

    def say(self, text: str) -> None:
        """One line on stderr, if it may."""
        if not self.quiet:
            terminal.say(text)

    def stop(self, said: str, written: Path | None) -> NoReturn:
        """The last line of a run that was interrupted, and its exit status."""
        terminal.say(f"{said}: {written}" if written else said)
        raise typer.Exit(130)

    def end(self, said: str, failed: bool = False) -> None:
        """The last line on stderr, `{seconds}` replaced by the time taken; status 2: unreadable files, 1: `failed`."""
        self.say(said.replace("{seconds}", f"{time.perf_counter() - self.began:.1f} s"))
        if self.unreadable or failed:
            raise typer.Exit(2 if self.unreadable else 1)

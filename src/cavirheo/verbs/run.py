"""One call of a verb: what it was, the files that it read, what it says, the time that it took, its exit status."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from cavirheo.errors import InputError, require
from cavirheo.writing import terminal
from cavirheo.writing.claim import current

if TYPE_CHECKING:
    from cavirheo.reporting.record import Result
    from cavirheo.writing.document import Document


def command_line() -> str:
    """What was typed, as documents have it."""
    return shlex.join(["cavirheo", *sys.argv[1:]])


def doubtful(result: Result) -> bool:
    """Whether a curve of it failed, or its input is doubtful."""
    return any(record.verdict in ("failed", "check_input") for record in result.curves)


class Run:
    """Begins when it is made. `command` and `date` are as documents have them; `unreadable` counts files, named in
    `notes`."""

    def __init__(self, *, json: bool = False, quiet: bool = False) -> None:
        self.began = time.perf_counter()
        self.command = command_line()
        self.date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
        self.unreadable = 0
        self.notes: list[str] = []  # on the run as a whole
        self.refusals: list[str] = []  # those that stderr has
        self.json, self.quiet = json, quiet or json

    @property
    def head(self) -> dict[str, Any]:
        """What a document says of the run."""
        return {"command": self.command, "date": self.date, "notes": [*self.notes]}

    def bar(
        self, what: str, total: int | None = None, *, unit: str = "curves"
    ) -> AbstractContextManager[Callable[..., None]]:
        """`terminal.bar`, if anything is to be seen."""
        return terminal.bar(what, total, visible=not self.quiet, unit=unit)

    def files(self, patterns: list[Path]) -> list[Path]:
        """Those that folders, patterns and `-` (standard input) stand for; one without a file is refused by itself."""
        from cavirheo.io.files import expand, sha256

        files: list[Path] = []
        for pattern in patterns:
            try:
                files += expand([pattern], self.say)
                if str(pattern) == "-" and (claim := current()):
                    claim.inputs.append(sha256(files[-1]))
            except InputError as error:
                self.refuse([str(error)])
        self.need(files, "file")
        return list(dict.fromkeys(files))

    def refuse(self, problems: list[str]) -> None:
        """Say on stderr which files cannot be read, and count them."""
        self.unreadable += len(problems)
        for problem in problems:
            self.refusals.append(f"not read: {problem}")
            self.notes.append(self.refusals[-1])
            terminal.say(f"error: {problem}")

    def need(self, items: Sequence[Any], what: str) -> None:
        """Ends the run where nothing could be read; why not is said already, if files were refused."""
        require(bool(items) or self.unreadable > 0, f"no {what} could be read", "run.nothing")
        if not items:
            raise typer.Exit(2)

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

    def stop(self, message: str, written: Path | None) -> NoReturn:
        """The last line of a run that was interrupted, and its exit status."""
        terminal.say(f"{message}: {written}" if written else message)
        raise typer.Exit(130)

    def end(self, message: str, failed: bool = False) -> None:
        """The last line on stderr, `{seconds}` replaced by the time taken; status 2: unreadable files, 1: `failed`."""
        self.say(message.replace("{seconds}", f"{time.perf_counter() - self.began:.1f} s"))
        if self.unreadable or failed:
            raise typer.Exit(2 if self.unreadable else 1)

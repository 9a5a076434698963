"""How a verb becomes a command (help in panels, check for finite numbers, lock of its folder), and one run of it: input
files, messages, duration and exit status."""

from __future__ import annotations

import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from typer.core import TyperCommand

from cavirheo.errors import InputError
from cavirheo.settings import BUBBLE, CLUSTER, INPUT, INTERVAL, MATERIAL, OUTPUT
from cavirheo.verbs.options import Verb
from cavirheo.writing import terminal

if TYPE_CHECKING:
    from cavirheo.reporting.record import Result
    from cavirheo.writing.document import Claim, Document, Outputs

_OUTPUT_OPTIONS = {"out", "replace", "quiet", "pictures", "every_shot"}
_NEUTRAL_OPTIONS = _OUTPUT_OPTIONS | {"scheduler", "slurm", "once"}  # options that change no answer
# order of the options on the first screen ("" stands for all others), and of the panels
_OPTION_ORDER = ("material", "laws", "stretch", "bubble", "", "out", "replace", "quiet", "help")
_PANELS = ("Arguments", "Options", INPUT, MATERIAL, BUBBLE, INTERVAL, OUTPUT, CLUSTER)


def has_problems(result: Result) -> bool:
    """Whether a curve or a group of the result failed, or is doubted."""
    verdicts = {record.verdict for record in result.curves}
    verdicts |= {group.verdict for group in result.groups}
    return not verdicts.isdisjoint(("failed", "check_input"))


class Run:
    """One run of a command, timed from its creation. `command` (what was typed) and `date` are as in documents."""

    def __init__(self, *, quiet: bool = False) -> None:
        self.start_time = time.perf_counter()
        self.command = shlex.join(["cavirheo", *sys.argv[1:]])
        self.date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
        self.unreadable = 0  # number of unreadable files, which `notes` name
        self.notes: list[str] = []  # on the run as a whole
        self.printed_notes: list[str] = []  # the notes that are already printed on stderr
        self.quiet = quiet
        self.claim: Claim | None = None  # of a verb that writes documents
        self.folders = ExitStack()  # which the run holds

    @property
    def document_fields(self) -> dict[str, Any]:
        return {"command": self.command, "date": self.date, "notes": [*self.notes]}

    def progress_bar(self, label: str, total: int, unit: str = "curves") -> AbstractContextManager[Callable[..., None]]:
        return terminal.progress_bar(label, total, visible=not self.quiet, unit=unit)

    def files(self, patterns: list[Path]) -> list[Path]:
        """Return the files of the folders and patterns, each once, and a film with its header as one; a folder or a
        pattern without any file is refused alone."""
        from cavirheo.io.files import expand, without_headers

        files: list[Path] = []
        for pattern in patterns:
            try:
                files += expand(pattern, self.say)
            except InputError as error:
                self.note_unreadable([str(error)])
        self.require_any(files, "file")
        return without_headers(files)

    def outputs(self, folder: Path, *names: str, inputs: Iterable[Path] = ()) -> Outputs:
        """Hold a folder until the run ends; returns its `Outputs`. Raises InputError."""
        from cavirheo.writing.document import Outputs, locked_folder

        assert self.claim is not None
        self.folders.enter_context(locked_folder(folder))
        return Outputs(self.claim, folder, *names, inputs=inputs)

    def note_unreadable(self, problems: list[str]) -> None:
        """Print on stderr which files cannot be read, note and count them."""
        self.unreadable += len(problems)
        for problem in problems:
            self.printed_notes.append(f"not read: {problem}")
            self.notes.append(self.printed_notes[-1])
            terminal.say(f"error: {problem}")

    def require_any(self, items: Sequence[Any], kind: str) -> None:
        """End the run if there are no items. Raises typer.Exit(2) if files were refused before, else InputError."""
        if not items and not self.unreadable:
            raise InputError(f"no {kind} could be read", "run.nothing")
        if not items:
            raise typer.Exit(2)

    def show(self, document: Document, table: Callable[[Any], None] | None = None) -> None:
        """Print the document: by `table`, else as `cavirheo show` does."""
        if not self.quiet:
            from cavirheo.loading import print_table

            (table or print_table)(document)

    def write_document(self, outputs: Outputs, document: Document) -> None:
        """Write KIND.json, the last file of a run, and print the document on stdout."""
        from cavirheo.writing.document import write_json

        outputs.write(f"{document.kind}.json", write_json, document)
        outputs.finish()
        self.show(document)

    def say(self, text: str) -> None:
        """Print one line on stderr, unless the run is quiet."""
        if not self.quiet:
            terminal.say(text)

    def end_interrupted(self, message: str, written: Path | None) -> NoReturn:
        """Print the last line of an interrupted run, and exit with status 130."""
        terminal.say(f"{message}: {written}" if written else message)
        sys.exit(130)

    def end(self, summary: str, failed: bool = False, places: str = "") -> None:
        """Print the last line on stderr: `summary`, the duration and `places`. Exit with status 2 if files were
        unreadable, or 1 if `failed`."""
        self.say(f"{summary} in {time.perf_counter() - self.start_time:.1f} s{places}")
        if self.unreadable or failed:
            raise typer.Exit(2 if self.unreadable else 1)


class Command(TyperCommand):
    """A verb of the command line."""

    def invoke(self, ctx: Any) -> None:
        """Run the verb. Raises InputError: a number is not finite; typer.Exit(130): interrupted."""
        for name, value in ctx.params.items():
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, float) and not isfinite(number):
                    option = name.replace("_", "-")
                    raise InputError(f"--{option} must be a finite number, got {number}", "option.finite")
        try:
            verb = super().invoke(ctx)
            if isinstance(verb, Verb):  # calls for the same answers make the same claim, in any current folder
                from cavirheo.writing.document import Claim

                run = Run(quiet=verb.quiet)
                options = {name: value for name, value in vars(verb).items() if name not in _NEUTRAL_OPTIONS}
                request = json.loads(json.dumps({"verb": type(verb).__name__} | options, default=os.path.realpath))
                run.claim = Claim(run.command, request, verb.replace)
                with run.folders:
                    verb(run)
        except KeyboardInterrupt:
            raise typer.Exit(130) from None

    def panels(self, ctx: Any) -> Mapping[str, list[tuple[str, str]]]:
        """Return the rows (argument or option, its help) of each panel, by title."""
        panels: dict[str, list[tuple[str, str]]] = {title: [] for title in _PANELS}
        places = {name: place for place, name in enumerate(_OPTION_ORDER)}
        for parameter in sorted(self.get_params(ctx), key=lambda parameter: places.get(parameter.name, places[""])):
            if row := parameter.get_help_record(ctx):
                argument = parameter.param_type_name == "argument"
                title = getattr(parameter, "rich_help_panel", None) or ("Arguments" if argument else "Options")
                panels.setdefault(title, []).append((str(parameter.metavar), row[1]) if argument else row)
        return {title: rows for title, rows in panels.items() if rows}

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        arguments = (parameter for parameter in self.params if parameter.param_type_name == "argument")
        return ["[OPTIONS]", *(str(parameter.metavar) for parameter in arguments)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        for title, rows in self.panels(ctx).items():
            with formatter.section(title):
                formatter.write_dl(rows)

    def get_short_help_str(self, limit: int = 0) -> str:
        return " ".join((self.help or "").partition("\n\n")[0].split())

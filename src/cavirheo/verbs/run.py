"""What verbs share: options, how one becomes a command (help in panels, lock of its folder), and one run of it: input
files, messages, duration and exit status.

The annotations of options are objects, not text, as in settings.py.
"""

import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TypeVar

import typer
from typer.core import TyperCommand

from cavirheo.errors import InputError
from cavirheo.settings import BUBBLE, CLUSTER, INPUT, INTERVAL, MATERIAL, OUTPUT, number, option
from cavirheo.writing import terminal

if TYPE_CHECKING:
    from cavirheo.reporting.record import Result
    from cavirheo.writing.document import Document, Outputs

UsageError: Any = typer.BadParameter.__base__  # an error in the call; typer has no public name for it
Content = TypeVar("Content")
# options that change no answer
_NEUTRAL_OPTIONS = {"out", "replace", "quiet", "pictures", "every_shot", "scheduler", "slurm", "once"}
# order of the options on the first screen ("" stands for all others), and of the panels
_OPTION_ORDER = ("material", "laws", "stretch", "bubble", "", "out", "replace", "quiet", "help")
_PANELS = ("Arguments", "Options", INPUT, MATERIAL, BUBBLE, INTERVAL, OUTPUT, CLUSTER)


def _named_folder(text: object) -> Path:
    if not str(text).strip():
        message = f"a folder must have a name, got {str(text)!r}; leave the option out for the usual one"
        raise typer.BadParameter(message)
    return Path(str(text))


def _folder_without_answers(text: object) -> Path:
    from cavirheo.writing.document import LIST_FILE

    folder = _named_folder(text)
    if os.path.lexists(folder / LIST_FILE):
        raise typer.BadParameter(f"{folder} holds the answers of another run: name another folder")
    return folder


def _folder(help: str, parser: Callable[[object], Path]) -> Any:
    return option(help, None, "-o", "--out", parser=parser, metavar="FOLDER")


# for documents: a run locks it; --replace belongs to it
Out = Annotated[Path, _folder("folder for the results", _named_folder)]
# for work that a later call continues
ResumableOut = Annotated[Path, _folder("folder, which may hold a part", _folder_without_answers)]
Quiet = Annotated[bool, option("print errors only, no table and no progress", None, "--quiet")]
REFERENCES = "CSV of published values, or sweeps of a rheometer, beside the answers; may be repeated"
_SCHEDULER = "of a dask cluster: tcp://HOST:PORT  [default: the cores of this machine]"
Scheduler = Annotated[str | None, option(_SCHEDULER, CLUSTER)]
_SLURM = "ask SLURM for so many jobs, as dask-jobqueue is set"
Slurm = Annotated[int | None, number(_SLURM, CLUSTER, kind=int, above=0)]


def numbers(name: str, text: str | None, kind: type[Any], mark: str, expected: str, count: int = 0) -> Any:
    """The `count` numbers of an option; None if it is not given. Raises InputError, which says what is expected."""
    if text is None:
        return None
    try:
        values = tuple(map(kind, text.split(mark)))
    except ValueError:
        values = ()
    if not values or len(values) != (count or len(values)):
        raise InputError(f"{name} must be {expected}, got {text!r}", f"option.{name[2:]}")
    return values


def has_problems(result: "Result") -> bool:
    """Whether a curve or a group of the result failed, or is doubted."""
    verdicts = {row.verdict for row in result.curves} | {group.verdict for group in result.groups}
    return not verdicts.isdisjoint(("failed", "check_input"))


class Run:
    """One run of a command, timed from its creation. `command` (what was typed) and `date` are as in documents.

    request: the verb, its inputs and every option that an answer depends on, by which a run knows its own answers
    again, in any current folder. replace: whether answers of other runs may be replaced.
    """

    def __init__(self, *, quiet: bool, request: Mapping[str, Any] | None = None, replace: bool = False) -> None:
        self.start_time = time.perf_counter()
        self.command = shlex.join(["cavirheo", *sys.argv[1:]])
        self.date = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
        self.request = request or {}
        self.replace = replace
        self.quiet = quiet
        self.unreadable = 0  # number of unreadable files, which `notes` name
        self.notes: list[str] = []  # on the run as a whole
        self.printed_notes: list[str] = []  # the notes that are already printed on stderr
        self.folders = ExitStack()  # which the run holds

    @property
    def document_fields(self) -> dict[str, Any]:
        return {"command": self.command, "date": self.date, "notes": [*self.notes]}

    def progress_bar(self, label: str, total: int, unit: str = "curves") -> AbstractContextManager[Callable[..., None]]:
        return terminal.progress_bar(label, total, visible=not self.quiet, unit=unit)

    def read(self, kind: str, paths: Iterable[Path], reader: Callable[[Path], Iterable[Content]]) -> list[Content]:
        """All that a reader finds in these paths; one that is refused costs itself alone. Raises as `require_any`."""
        found: list[Content] = []
        for path in paths:
            try:
                found += reader(path)
            except InputError as error:
                self.note_unreadable(str(error))
        self.require_any(found, kind)
        return found

    def files(self, patterns: list[Path]) -> list[Path]:
        """The files of the folders and patterns, each once, and a film with its header as one."""
        from cavirheo.io.files import expand, without_headers
        from cavirheo.loading import document_of

        def files_of(pattern: Path) -> list[Path]:
            document = document_of(pattern)
            if not document:
                return expand(pattern, self.say)
            with suppress(InputError):  # a folder without measurements
                paths = expand(pattern, self.say)
                if paths != [pattern]:
                    return paths
            message = f"no measurement in {pattern}: `cavirheo show {document}` prints what it holds"
            raise InputError(message, "run.document")

        return without_headers(self.read("file", patterns, files_of))

    def outputs(self, folder: Path, *names: str, inputs: Iterable[Path] = ()) -> "Outputs":
        """Hold a folder until the run ends; returns its `Outputs`. Raises InputError."""
        from cavirheo.writing.document import Claim, Outputs, locked_folder

        self.folders.enter_context(locked_folder(folder))
        return Outputs(Claim(self.command, self.request, self.replace), folder, *names, inputs=inputs)

    def note_unreadable(self, *problems: str) -> None:
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

    def show(self, document: "Document", table: Callable[[Any], None] | None = None) -> None:
        """Print the document: by `table`, else as `cavirheo show` does."""
        if not self.quiet:
            from cavirheo.loading import print_table

            (table or print_table)(document)

    def write_document(self, outputs: "Outputs", document: "Document") -> None:
        """Write KIND.json, the last file of a run, and print the document on stdout."""
        from cavirheo.writing.document import write_json

        outputs.write(f"{document.kind}.json", write_json, document)
        outputs.finish()
        self.show(document)

    def note(self, text: str) -> None:
        """Print a note of the document on stderr, unless the run is quiet."""
        self.printed_notes.append(text)
        self.say(text)

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


@dataclass(frozen=True, kw_only=True)
class Verb:
    """A command that writes documents into a folder, which it locks. Its fields are the values of its arguments and
    options; those of the last base class come first."""

    out: Out = Path("cavirheo-result")
    replace: Annotated[bool, option("write over the answers of another run in that folder", None, "--replace")] = False
    quiet: Quiet = False

    def __call__(self, run: Run) -> None:
        """Run the command. Raises InputError, and typer.Exit with the exit status."""
        raise NotImplementedError


class Command(TyperCommand):
    """A verb of the command line."""

    def invoke(self, ctx: Any) -> None:
        """Run the verb. Raises InputError; typer.Exit, with status 130 if it was interrupted."""
        try:
            verb = super().invoke(ctx)
            if isinstance(verb, Verb):
                options = {name: value for name, value in vars(verb).items() if name not in _NEUTRAL_OPTIONS}
                request = json.loads(json.dumps({"verb": type(verb).__name__} | options, default=os.path.realpath))
                run = Run(quiet=verb.quiet, request=request, replace=verb.replace)
                with run.folders:
                    verb(run)
        except KeyboardInterrupt:
            raise typer.Exit(130) from None

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As typer; errors that it raises without a context get this one, by which the help page is named."""
        try:
            return super().parse_args(ctx, args)
        except UsageError as error:
            error.ctx = error.ctx or ctx
            raise

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

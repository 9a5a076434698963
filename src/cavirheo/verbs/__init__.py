"""The command line: one file per group of verbs; `options` and `run` are shared by all."""

from __future__ import annotations

import os
import re
import signal
import sys
from contextlib import suppress
from typing import Annotated, Any

import typer

import cavirheo
from cavirheo.errors import InputError, SolverError
from cavirheo.parallel import end_processes
from cavirheo.verbs import companions, curves, documents, histories, machine
from cavirheo.verbs.options import option
from cavirheo.verbs.run import Command
from cavirheo.writing.digits import elide
from cavirheo.writing.terminal import say

_VERBS: tuple[tuple[Any, str], ...] = (  # in the order of --help: a class, or a function where the options are few
    (curves, "Infer Watch Fit WhichLaw"),
    (histories, "Measure"),
    (companions, "Design Compare Rheometer CollapseTime"),
    (documents, "show cite"),
    (machine, "app"),
    (histories, "Simulate laws"),
    (documents, "models"),
    (machine, "generate train Evaluate cluster"),
)
_UsageError: Any = typer.BadParameter.__base__  # an error in the call; typer has no public name for it
app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
for _module, _names in _VERBS:
    for _name in _names.split():  # WhichLaw is which-law
        app.command(re.sub(r"(?<=[a-z])(?=[A-Z])", "-", _name).lower(), cls=Command)(getattr(_module, _name))


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: Annotated[bool, option("show the version and exit", None, "--version")] = False,
    verbose: Annotated[bool, option("with --version: all that a bug report needs", None, "--verbose")] = False,
) -> None:
    """Material properties of soft matter from the radius history R(t) of a laser-made bubble."""
    if verbose and not version:
        raise typer.BadParameter("--verbose goes with --version")
    if version:
        print(documents.installation_report() if verbose else f"cavirheo {cavirheo.__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        context.fail("Missing command.")


_command: Any = typer.main.get_command(app)


def main() -> None:
    """The command line in this process: errors of the user become one line and exit status 2."""
    try:
        sys.exit(_command(prog_name="cavirheo", standalone_mode=False))
    except _UsageError as error:
        message = error.format_message().replace("Value error, ", "")  # pydantic's
        if "\n" in message.strip():  # no arguments at all: show the help
            error.show()
        else:
            where = error.ctx.command_path if error.ctx else "cavirheo"
            errors = getattr(error.__cause__, "errors", None)  # pydantic's, with the invalid input
            got = f", got {elide(repr(errors()[0]['input']), 60)}" if errors else ""
            say(f"error: {message.rstrip('.')}{got}; see {where} --help")
        sys.exit(2)
    except (InputError, SolverError, OSError) as error:
        say(f"error: {error}")
        sys.exit(2)


def _open_streams() -> None:
    """Open every closed standard stream, for child processes too, on os.devnull; outputs escape characters that their
    encoding lacks."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if not (stream := getattr(sys, name)):
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # os.open takes the lowest free number: this one
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115  # until the end
        elif number:
            stream.reconfigure(errors="backslashreplace")


def entry() -> None:
    """Run `main` as a program, and exit at once by os._exit: a normal exit takes a third of a second for the compiled
    libraries, and waits for threads that still compute."""
    _open_streams()
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _interrupt)
    status = 0
    try:
        main()
        sys.stdout.flush()
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except KeyboardInterrupt:
        status = 130
    except BrokenPipeError:  # the reader of stdout has ended, as `head` does
        status = 1
    except OSError as error:
        print(f"error: what was to be printed cannot be written: {error.strerror}", file=sys.stderr)
        status = 2
    if files := sys.modules.get("cavirheo.io.files"):
        files.remove_temporary_files()
    end_processes()
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def _interrupt(number: int, frame: object) -> None:
    """Handle Ctrl-C, SIGTERM and SIGHUP: the first signal ends the work, and finished answers are written; the second
    ends the process."""
    for each in _SIGNALS:
        signal.signal(each, _exit_at_once)
    raise KeyboardInterrupt


def _exit_at_once(number: int, frame: object) -> None:
    if sys.stderr.isatty():
        os.write(2, b"\033[?25h")  # show the cursor again, which a progress bar hides
    os._exit(130)

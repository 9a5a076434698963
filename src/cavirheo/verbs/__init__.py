"""The command line: one file per group of verbs; `run` is shared by all."""

from __future__ import annotations

import re
import sys
from typing import Annotated, Any

import typer

import cavirheo
from cavirheo.errors import InputError, SolverError
from cavirheo.settings import option
from cavirheo.verbs import companions, curves, histories, showing, training
from cavirheo.verbs.run import Command, UsageError
from cavirheo.writing.terminal import say, write

_VERBS: tuple[tuple[Any, str], ...] = (  # in the order of --help: a class, or a function where the options are few
    (curves, "Infer Watch Fit WhichLaw"),
    (histories, "Measure"),
    (companions, "Design Compare Rheometer CollapseTime"),
    (showing, "show cite app"),
    (histories, "Simulate"),
    (showing, "laws"),
    (training, "models generate train"),
)
_EXTRAS = {  # libraries that a part of the program needs, and the extra that installs them
    "gradio": "app",
    "torch": "train",
    **dict.fromkeys(("distributed", "dask", "dask_jobqueue", "cryptography"), "cluster"),
}
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
) -> None:
    """Material properties of soft matter from the radius history R(t) of a laser-made bubble."""
    if version:
        write(f"cavirheo {cavirheo.__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        context.fail("Missing command.")


_command: Any = typer.main.get_command(app)


def main() -> None:
    """The command line in this process: errors of the user become one line and exit status 2."""
    try:
        status = _command(prog_name="cavirheo", standalone_mode=False)
        if status == 130:  # typer's for Ctrl-C
            say("interrupted")
        sys.exit(status)
    except UsageError as error:
        error.message = error.message.removeprefix("Value error, ")  # of pydantic, with which typer reads choices
        message = error.format_message()
        if "\n" in message.strip():  # no arguments at all: show the help
            error.show()
        else:
            where = error.ctx.command_path if error.ctx else "cavirheo"
            say(f"error: {message.rstrip('.')}; see {where} --help")
        sys.exit(2)
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library not in _EXTRAS:
            raise
        say(f'error: this needs {library}: pip install "cavirheo[{_EXTRAS[library]}]"')
        sys.exit(2)
    except (InputError, SolverError, OSError) as error:
        say(f"error: {error}")
        sys.exit(2)

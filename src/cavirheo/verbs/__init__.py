"""The command line: one file per verb; what they share is in `options` and `run`."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Annotated

import typer

from cavirheo.errors import InputError, SolverError
from cavirheo.verbs.options import with_surroundings

_VERBS = "infer compare simulate laws generate train evaluate models fit which_law rheometer collapse_time app"
_FOUND = [getattr(import_module(f"cavirheo.verbs.{name}"), name) for name in _VERBS.split()]
app = typer.Typer(
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip
for _verb in _FOUND:
    app.command(_verb.__name__.replace("_", "-"))(with_surroundings(_verb))


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"cavirheo {version('cavirheo')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="show the version and exit", is_eager=True, callback=_show_version)
    ] = False,
) -> None:
    """Material properties of soft matter from the radius history R(t) of a laser-made bubble."""


def main() -> None:
    """The command line in this process: errors of the user become one line and exit status 2."""
    try:
        app()
    except (InputError, SolverError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def entry() -> None:
    """`main` as a program: leaves at once, for tearing down the compiled libraries takes a third of a second."""
    status = 0
    try:
        main()
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)

"""The command line: one file per verb; what they share is in `options` and `run`."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from cavirheo.errors import InputError, SolverError
from cavirheo.verbs.app import app as browser_app
from cavirheo.verbs.collapse_time import collapse_time
from cavirheo.verbs.compare import compare
from cavirheo.verbs.evaluate import evaluate
from cavirheo.verbs.fit import fit
from cavirheo.verbs.generate import generate
from cavirheo.verbs.infer import infer
from cavirheo.verbs.laws import laws
from cavirheo.verbs.models import models
from cavirheo.verbs.rheometer import rheometer
from cavirheo.verbs.simulate import simulate
from cavirheo.verbs.train import train
from cavirheo.verbs.which_law import which_law

app = typer.Typer(
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip
_VERBS = (infer, compare, simulate, laws, generate, train, evaluate, models, fit, which_law, rheometer, collapse_time)


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


for _verb in _VERBS:
    app.command()(_verb)
app.command("app")(browser_app)


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

"""How a verb becomes a command: its help in panels, numbers that are finite, and the folder that it holds."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from contextlib import nullcontext
from math import isfinite
from pathlib import Path
from typing import Any

from typer import Exit
from typer.core import TyperCommand

from cavirheo.errors import require
from cavirheo.verbs.options import Documents, Verb
from cavirheo.verbs.run import Run, command_line
from cavirheo.writing.claim import Claim, claimed

# options that change no answer
_SHOWING = ("out", "replace", "json", "quiet", "pictures", "figures", "scheduler", "once", "patience")
_LAST = ("out", "replace", "json", "quiet", "help")  # of the first screen


class Command(TyperCommand):
    """A verb of the command line."""

    def invoke(self, ctx: Any) -> None:
        """Raises InputError: a number that is not finite. An interrupt where nothing is to be saved is status 130."""
        for name, value in ctx.params.items():
            for number in value if isinstance(value, tuple) else (value,):
                fine = not isinstance(number, float) or isfinite(number)
                require(fine, f"--{name.replace('_', '-')} must be a finite number, got {number}", "option.finite")
        try:
            verb = super().invoke(ctx)
            if isinstance(verb, Verb):
                with claimed(_claim(verb)) if isinstance(verb, Documents) else nullcontext():
                    verb(Run(json=getattr(verb, "json", False), quiet=getattr(verb, "quiet", False)))
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            raise Exit(130) from None

    def panels(self, ctx: Any) -> Mapping[str, list[tuple[str, str]]]:
        """(argument or option, its help) of each panel, by title."""
        panels: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in sorted(self.get_params(ctx), key=lambda parameter: parameter.name in _LAST):
            if row := parameter.get_help_record(ctx):
                argument = parameter.param_type_name == "argument"
                title = getattr(parameter, "rich_help_panel", None) or ("Arguments" if argument else "Options")
                panels.setdefault(title, []).append((str(parameter.metavar), row[1]) if argument else row)
        return {title: rows for title, rows in panels.items() if rows}

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """'[OPTIONS] FILE...'"""
        arguments = (parameter for parameter in self.params if parameter.param_type_name == "argument")
        return ["[OPTIONS]", *(str(parameter.metavar) for parameter in arguments)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """A section for each panel."""
        for title, rows in self.panels(ctx).items():
            with formatter.section(title):
                formatter.write_dl(rows)

    def get_short_help_str(self, limit: int = 0) -> str:
        """The first paragraph, whole."""
        return " ".join((self.help or "").partition("\n\n")[0].split())


def _claim(verb: Documents) -> Claim:
    """The same for two calls that ask for the same answers, from whichever folder."""
    request = {name: _resolved(value) for name, value in vars(verb).items() if name not in _SHOWING}
    return Claim(command_line(), {"verb": type(verb).__name__, **request}, verb.replace)


def _resolved(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_resolved(item) for item in value]
    return os.path.realpath(value) if isinstance(value, Path) else value

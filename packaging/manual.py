"""The manual page cavirheo(1), made from the code: `python packaging/manual.py man/cavirheo.1`, as `make man` does."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import typer

import cavirheo
from cavirheo.verbs import app

STATUSES = {
    0: "All curves were answered, and no verdict is check_input.",
    1: "Some curve could not be answered, or its verdict is check_input.",
    2: "Wrong usage, an unreadable file, or results that cannot be written.",
    130: "Interrupted.",
}


def page() -> str:
    """The page in the macros of man(7): what the program is, every verb with its options, exit statuses."""
    return "\n".join(_lines()) + "\n"


def _lines() -> Iterator[str]:
    whole: Any = typer.main.get_command(app)  # type: ignore[attr-defined]
    yield f'.TH CAVIRHEO 1 "" "cavirheo {cavirheo.__version__}" "User Commands"'
    yield from (".SH NAME", f"cavirheo \\- {_text(_lower(whole.help))}")
    yield from (".SH SYNOPSIS", ".B cavirheo", r"[options] \fICOMMAND\fR [arguments]")
    yield ".SH OPTIONS"
    context = whole.make_context("cavirheo", [], resilient_parsing=True)
    yield from _options(filter(None, (one.get_help_record(context) for one in whole.params)))
    yield ".SH COMMANDS"
    for name, verb in whole.commands.items():
        context = verb.make_context(name, [], resilient_parsing=True)
        usage = " ".join(verb.collect_usage_pieces(context))
        yield from (f'.SS "cavirheo {_text(name)} {_text(usage)}"', _text(verb.help))
        for title, rows in verb.panels(context).items():
            yield from (".PP", _text(f"{title}:"))
            yield from _options(rows)
    yield ".SH EXIT STATUS"
    for status, means in STATUSES.items():
        yield from (".TP", f".B {status}", _text(means))


def _options(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    for what, means in rows:
        yield from (".TP", f".B {_text(what)}", _text(means) or r"\&")


def _lower(text: str) -> str:
    return (text[0].lower() + text[1:]).strip().rstrip(".")


def _text(text: str) -> str:
    """As roff shows it as it stands: hyphens that can be copied, no commands, other letters than ASCII by number."""
    plain = " ".join(text.split()).replace("\\", r"\e").replace("-", r"\-").replace('"', r"\(dq")
    plain = re.sub(r"[^\x00-\x7f]", lambda found: f"\\[u{ord(found[0]):04X}]", plain)
    return r"\&" + plain if plain[:1] in (".", "'") else plain


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(page(), "ascii")

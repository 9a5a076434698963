"""The terminal: consoles, bars that move, tables and remarks, set up here alone (rich is imported when first used)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def console(*, stderr: bool = False) -> Console:
    """Where results are printed (stdout), or what is only said meanwhile (stderr); text is printed as it is."""
    from rich.console import Console

    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


@contextmanager
def bar(what: str, total: int | None = None, *, shown: bool = True) -> Iterator[Callable[..., None]]:
    """A bar on stderr that vanishes when done; yields `advance(count=1, total=None, what=None)`.

    advance counts what is done; it may also tell the total, or say anew what is being done.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(stderr=True), transient=True, disable=not shown) as progress:
        task = progress.add_task(what, total=total)

        def advance(count: int = 1, total: int | None = None, what: str | None = None) -> None:
            progress.update(task, advance=count, total=total, description=what)

        yield advance


def table(first: str, heads: Sequence[str], *, left: Sequence[str] = (), title: str = "", gap: int = 1) -> Table:
    """A table whose first column may fold; the others are right-aligned unless named in `left`."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    made = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, gap, 0, 0), show_edge=False)
    if title:
        made.title, made.title_justify, made.title_style = title, "left", "dim"
    made.add_column(first, overflow="fold")
    for head in heads:
        made.add_column(head, justify="left" if head in left else "right", no_wrap=True)
    return made


def once(about: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """{message: names} of (name, message), each message once and in order; empty messages are left out.

    Messages that differ in their numbers alone are one, with "6.5 to 12" for a number that is not the same in all.
    """
    found: dict[str, list[tuple[str, list[str]]]] = {}
    for name, message in about:
        form = _NUMBER.sub("{}", re.sub("[{}]", "", message))
        if message:
            found.setdefault(form, []).append((name, _NUMBER.findall(message)))
    return {
        form.format(*(_range(values) for values in zip(*(numbers for _, numbers in mine), strict=True))): [
            name for name, _ in mine
        ]
        for form, mine in found.items()
    }


def _range(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"


def print_remarks(
    to: Console, remarks: Mapping[str, Sequence[str]], notes: Iterable[str] = (), *, most: int | None = None
) -> None:
    """A line for each message, after the names (at most `most`, if given) that it is about; then notes on the whole."""
    from rich.text import Text

    for message, names in remarks.items():
        shown = names[:most]
        who = ", ".join(shown) + (f" and {len(names) - len(shown)} more" if len(shown) < len(names) else "")
        to.print(Text("• ").append(who, "bold").append(f": {message}"))
    for note in notes:
        to.print(Text(f"• {note}"))

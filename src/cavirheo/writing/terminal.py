"""The terminal: consoles, bars that move, tables and remarks, set up here alone (rich is imported when first used)."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cavirheo.writing.digits import LOOKS, elide, printable, shortened

_LONGEST = 1000  # characters of one line
RATE_OVER = 120.0  # s over which a rate is taken: an answer may take many, and a cluster brings many at once
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_UNIT = re.compile(r" ?(?:%|[kM]?Pa|[mnuµ]?[ms]|px|K|kg/m3|times|frames|shots|curves)(?!\w)")  # of an amount

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Task
    from rich.table import Table
    from rich.text import Text


def console(**how: Any) -> Console:
    """Where results are printed, or with `stderr` progress; text as it is, but without control characters."""
    from rich.console import Console

    class Plain(Console):
        def render_str(self, text: str, **how: Any) -> Text:
            return super().render_str(printable(text), **how)

    return Plain(markup=False, emoji=False, highlight=False, **how)


def say(text: str) -> None:
    """One line on stderr, of a length that a screen can hold whatever a file put into it."""
    print(elide(" ".join(printable(text).splitlines()), _LONGEST), file=sys.stderr)


@contextmanager
def bar(
    what: str, total: int | None = None, *, visible: bool = True, unit: str = "curves"
) -> Iterator[Callable[..., None]]:
    """A bar on stderr that vanishes when done, with so many of `unit` per second and the time left; nothing where
    stderr is no terminal. Yields `advance(count=1, total=None, what=None)`: more that is done, and, if given, of how
    many, and anew what is being done."""
    on = console(stderr=True)
    if not (visible and on.is_terminal):  # rich 13 ends a bar that is disabled with an empty line
        yield lambda count=1, total=None, what=None: None
        return

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.table import Column
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            """'136 curves/s', '7.2 curves/min' where it is less than one per second; nothing while it is not known."""
            if not task.speed:
                return Text()
            per, amount = ("s", task.speed) if task.speed >= 1.0 else ("min", 60.0 * task.speed)
            return Text(f"{amount:.0f} {unit}/{per}" if amount >= 100.0 else f"{amount:.2g} {unit}/{per}", "dim")

    whole = Column(no_wrap=True)  # where it is narrow, the words fold
    columns = (
        TextColumn("{task.description}", table_column=Column()),
        BarColumn(20),
        MofNCompleteColumn(table_column=whole),
        Rate(whole),
        TimeRemainingColumn(table_column=whole),
        TextColumn("left", "dim"),
    )
    with Progress(*columns, speed_estimate_period=RATE_OVER, console=on, transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda count=1, total=None, what=None: progress.update(task, advance=count, total=total, description=what)


def table(first: str, heads: Sequence[str], *, left: Sequence[str] = (), title: str = "", gap: int = 1) -> Table:
    """A table of which nothing is cut off: where it is narrow, words fold, and numbers last. Numbers are right-aligned:
    all but the first column and those in `left`."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    grid = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, gap, 0, 0), show_edge=False)
    if title:
        grid.title, grid.title_justify, grid.title_style = title, "left", "dim"
    for head in (first, *heads):
        words = head in (first, *left)
        grid.add_column(head, justify="left" if words else "right", overflow="fold", no_wrap=not words)
    return grid


def add_rows(to: Table, rows: Sequence[tuple[str, Sequence[Any], str]]) -> None:
    """A row for each (name, cells, style), long names shortened."""
    for name, (_, entries, style) in zip(shortened([name for name, *_ in rows]), rows, strict=True):
        to.add_row(name, *entries, style=style)


def by_message(messages: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """{message: names} of (name, message), each message once and in order; empty messages are left out.

    Messages that differ in their numbers alone are one: amounts that are not the same in all become "6.5 to 12 %".
    Where one of these numbers has no unit, it may be the name of a thing or the end of an interval: then "…" stands for
    each of them.
    """
    by_form: dict[str, list[tuple[str, list[str]]]] = {}
    for name, message in messages:
        form = _NUMBER.sub("{}", re.sub("[{}]", "", message))
        if message:
            by_form.setdefault(form, []).append((name, _NUMBER.findall(message)))
    return {
        _merged(form, list(zip(*(numbers for _, numbers in mine), strict=True))): [name for name, _ in mine]
        for form, mine in by_form.items()
    }


def _merged(form: str, columns: Sequence[Sequence[str]]) -> str:
    """The form with its numbers. columns: for each of them, what it is in every message."""
    parts = form.split("{}")[1:]
    ends = [(min(column, key=float), max(column, key=float)) for column in columns]
    alike = [float(low) == float(high) for low, high in ends]
    amounts = all(same or _UNIT.match(part) for part, same in zip(parts, alike, strict=True))
    ranges = (f"{low} to {high}" if amounts else "…" for low, high in ends)
    return form.format(*(low if same else text for text, same, (low, _) in zip(ranges, alike, ends, strict=True)))


def print_remarks(
    to: Console, remarks: Mapping[str, Sequence[str]], notes: Iterable[str] = (), *, most: int = 10**9, mark: Any = "• "
) -> None:
    """A line for each message, after a mark (text, or text and style) and the names that it is about, at most so many;
    then notes on the whole."""
    from rich.text import Text

    for message, names in remarks.items():
        listed = printable(", ".join(names[:most])) + f" and {len(names) - most} more" * (len(names) > most)
        to.print(Text.assemble(mark, (listed, "bold"), f": {printable(message)}"))
    for note in notes:
        to.print(Text(f"• {printable(note)}"))


def print_warnings(to: Console, warnings: Iterable[tuple[str, str]]) -> None:
    """What is to be checked of recordings and settings, of (name, sentence): each once, before all other remarks."""
    look, names = LOOKS["check_input"], {text: [*dict.fromkeys(of)] for text, of in by_message(warnings).items()}
    print_remarks(to, names, most=2, mark=(f"{look.words}: ", look.terminal))

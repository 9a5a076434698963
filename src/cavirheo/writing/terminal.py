"""Output in a terminal: consoles, progress bars, tables and remarks (rich is imported when it is first used). All that
the package prints passes through `console`, `write` or `say`, which escape control characters."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cavirheo.writing.digits import FILLER, NO_BREAK, elide, printable, spaced, together

MOST_REMARKS = 20  # of one kind below a table
_LEAST_WORDS = 8  # characters of a column of words in a narrow terminal
_MAX_LINE = 1000  # most characters of one line

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text


def console(*, stderr: bool = False) -> Console:
    """A console for results, or on stderr for progress; text is unchanged, except for control characters."""
    from rich.console import Console

    class Plain(Console):
        def render_str(self, text: str, **options: Any) -> Text:
            return super().render_str(printable(text), **options)

    return Plain(markup=False, emoji=False, highlight=False, stderr=stderr)


def write(text: str) -> None:
    """Print text on stdout."""
    print(printable(text))


def say(text: str) -> None:
    """Print one line on stderr, shortened to _MAX_LINE characters."""
    print(elide(" ".join(printable(text).splitlines()), _MAX_LINE), file=sys.stderr)


@contextmanager
def progress_bar(what: str, total: int, *, visible: bool = True, unit: str = "curves") -> Iterator[Callable[..., None]]:
    """Progress bar on stderr with the number of `unit` and the time left; it disappears at the end. There is none if
    stderr is no terminal. Yields `advance(count=1, what=None)`, which adds `count` and, if given, sets a new
    description."""
    on = console(stderr=True)
    if not (visible and on.is_terminal):  # rich 13 ends a bar that is disabled with an empty line
        yield lambda count=1, what=None: None
        return

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = ("{task.description}", BarColumn(20), MofNCompleteColumn(), unit, TimeRemainingColumn())
    with Progress(*columns, "left", speed_estimate_period=120.0, console=on, transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda count=1, what=None: progress.update(task, advance=count, description=what)


def print_table(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    left: Sequence[str] = (),
    title: str = "",
    bold: int | None = None,
) -> None:
    """Print a table, if it has rows, of which one may be `bold`. No text is cut off: in a narrow terminal, columns of
    words fold, and where it is too narrow for the numbers, lines are longer than it. All columns except the first and
    those in `left` hold numbers."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    if not rows:
        return
    if title:
        print_text(title, style="dim")
    grid = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    for head, column in zip(heads, zip(*rows, strict=True), strict=True):
        widest = max(len(line) for cell in (head, *column) for line in cell.splitlines())
        look: Any = {"justify": "right", "no_wrap": True, "min_width": widest}
        if head in (heads[0], *left):
            look = {"min_width": _LEAST_WORDS}
        grid.add_column(head, overflow="fold", **look)
    for k, cells in enumerate(rows):
        grid.add_row(*cells, style="bold" if k == bold else "")
    to = console()
    to.width = max(to.width, to.measure(grid, options=to.options.update(width=_MAX_LINE)).minimum)
    to.print(grid)


def names_by_text(texts: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """{text: names} of (name, text), each text once, the most frequent first; empty texts are left out."""
    names: dict[str, list[str]] = {}
    for name, text in texts:
        if text and name not in names.setdefault(text, []):
            names[text].append(name)
    return dict(sorted(names.items(), key=lambda item: -len(item[1])))


def lines_of(text: str, width: int, most: int | None = None) -> list[str]:
    """The text in lines of `width`, `most` at most, broken between words, but not between a number and its unit."""
    how: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False, "placeholder": " …"}
    lines = textwrap.wrap(spaced(together(text)), width, max_lines=most, **how)
    return [line.replace(NO_BREAK, " ").replace(FILLER, "") for line in lines]


def print_line(*parts: tuple[str, str]) -> None:
    """Print a line of texts, each with its style."""
    from rich.text import Text

    console().print(Text.assemble(*((printable(text), style) for text, style in parts)), soft_wrap=True)


def print_text(text: str, *, first: str = "", look: str = "", style: str = "", indent: int = 0) -> None:
    """Print a text, broken into lines by `lines_of`. first: its beginning, in the style `look`. indent: columns before
    each line."""
    for line in lines_of(printable(first + text), console().width - indent):
        head = line[: len(first)] if line.startswith(first) else ""
        print_line((" " * indent + head, look), (line[len(head) :], style))
        first = ""


def print_remarks(
    remarks: Mapping[str, Sequence[str]],
    notes: Iterable[str] = (),
    *,
    most: int = 5,
    mark: str = "•",
    limit: int = MOST_REMARKS,
) -> None:
    """Print each of the first `limit` texts after a mark and its names, `most` of them at most; then the notes."""
    for text, names in list(remarks.items())[:limit]:
        more = f" and {len(names) - most} more" if len(names) > most else ""
        print_text(f": {text}", first=f"{mark} {', '.join(names[:most])}{more}", look="bold")
    if len(remarks) > limit:
        print_text(f"{mark} {len(remarks) - limit} more such remarks")
    for note in notes:
        print_text(note, first="• ")

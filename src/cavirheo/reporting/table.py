"""The answers as a table: for the terminal (rich) and for spreadsheets (CSV)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.reporting.record import CurveRecord, GroupRecord, Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import spread_of, write_rows

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

FITS = ("least_squares", "laplace")  # methods whose answer is a maximum
_WINDOWS = {"1": "1 collapse", "2": "2 collapses", "3": "3 collapses", "all": "whole recording"}
_WIDE = 110  # columns; below this an interval stands under its median, and only those of G and mu are shown


def print_table(result: Result, console: Console | None = None) -> None:
    """One row per curve, one per group (mean ± standard deviation), then the messages in full."""
    from rich.text import Text

    console = console or terminal.console()
    wide = console.width >= _WIDE
    factor, unit = result.modulus_unit
    heads = ["R_max\nµm", "λ", f"G\n{unit}", "µ\nPa s", "RMSE\n%", "collapses" if wide else "col-\nlapses", "verdict"]
    rows = [_cells(record, factor, wide) for record in result.curves]
    group_rows = [_group_cells(group, factor) for group in result.groups]
    columns = zip(heads, *rows, *group_rows, strict=True)
    taken = sum(max(len(line) for text in column for line in text.split("\n")) for column in columns)
    room = max(console.width - taken - (1 + wide) * len(heads), 12)

    table = terminal.table("curve", heads, left=("verdict",), gap=int(wide))
    names = [record.name for record in result.curves]
    short = [digits.elide(name, room) for name in names]
    if len(set(short)) == len(set(names)):  # no two look like one
        names = short
    for name, record, (*row, verdict) in zip(names, result.curves, rows, strict=True):
        table.add_row(*map(Text, [name, *row]), Text(verdict, digits.LOOKS[record.verdict].terminal))
    table.add_section()
    for group, row in zip(result.groups, group_rows, strict=True):
        table.add_row(*map(Text, [digits.elide(group.name, room), *row]), style="bold")
    console.print(table)
    key = "RMSE: measured minus simulated, % of R_max"
    if any(record.viscosity_Pa_s.q05 is not None for record in result.curves):
        key += "; [ , ]: central 90 % interval"
    console.print(Text(key, "dim"))
    if (windows := windows_table(result)) is not None:
        console.print(windows)
    notes = [note for note in result.notes if not note.startswith("not read: ")]  # said on stderr already
    terminal.print_remarks(console, terminal.once((r.name, r.message) for r in result.curves), notes, most=2)


def _cells(record: CurveRecord, factor: float, wide: bool) -> list[str]:
    words, joint = digits.LOOKS[record.verdict].words, " " if wide else "\n"
    collapses, end = record.window.collapses, record.window.t_star_end
    window = digits.MISSING if collapses is None else str(collapses)
    window += f", t* ≤ {digits.significant(end, 2)}" if wide and end is not None else ""
    return [
        digits.micrometres(record.max_radius_m),
        digits.quantity(record.stretch) if wide else digits.quantity(record.stretch).split(" ")[0],
        digits.quantity(record.shear_modulus_Pa, factor, joint=joint),
        digits.quantity(record.viscosity_Pa_s, joint=joint),
        digits.percent(record.rmse_over_rmax),
        window,
        words if wide else words.replace(" range", "\nrange"),
    ]


def _group_cells(group: GroupRecord, factor: float) -> list[str]:
    counts = group.basis.replace(" trusted ", " trusted\n") or f"n = {group.n}"
    counts += f"\n{group.n_failed} failed" if group.n_failed else ""
    G, mu = digits.spread(group.shear_modulus_Pa, factor), digits.spread(group.viscosity_Pa_s)
    return ["", "", G, mu, "", "", counts]


def write_csv(path: str | Path, result: Result) -> None:
    """One line per curve; SI units in the names of the columns; empty where there is no number."""
    quantities = ("stretch", "shear_modulus_Pa", "viscosity_Pa_s")
    plain = ("max_radius_m", *quantities, "rmse_over_rmax", "collapses", "t_star_end", "verdict", "message")
    ends = {"median": "", "q05": "_q05", "q95": "_q95"}
    head = ["name", "group", "source", "material", "method"]
    for name in plain:
        head += [name + end for end in ends.values()] if name in quantities else [name]
    rows = []
    for record in result.curves:
        values = {n + end: getattr(getattr(record, n), part) for n in quantities for part, end in ends.items()}
        rows.append(vars(record) | vars(record.window) | values)
    write_rows(path, head, rows)


def window_cells(record: CurveRecord, factor: float) -> dict[str, str]:
    """'6.44, 0.0295' (G, mu) for windows of 1, 2, 3 and all collapses, if a fit answers; * where one is at a bound."""
    fitted = record.method in FITS and record.answered
    found = {key: window for key, window in record.windows.items() if fitted and key in _WINDOWS}
    cells = dict.fromkeys(_WINDOWS.values() if found else (), digits.MISSING)
    for key, window in found.items():
        values = [(window.best.get("shear_modulus"), factor), (window.best.get("viscosity"), 1.0)]
        known = [digits.significant(value * scale) for value, scale in values if value is not None]
        cells[_WINDOWS[key]] = (", ".join(known) or digits.MISSING) + ("*" if window.at_bound else "")
    return cells


def _mean_cells(records: list[CurveRecord], factor: float) -> Iterator[str]:
    """Mean ± standard deviation of G and mu over the trusted curves that have the window, and how many they are."""
    for key in _WINDOWS:
        trusted = [record for record in records if record.trusted and record.method in FITS]
        having = [record.windows[key].best for record in trusted if key in record.windows]
        G, mu = (spread_of([best.get(name) for best in having]) for name in ("shear_modulus", "viscosity"))
        known = [text for text in (digits.spread(G, factor), digits.spread(mu)) if text != digits.MISSING]
        yield f"{', '.join(known)} (n = {len(having)})" if known else digits.MISSING


def windows_table(result: Result) -> Table | None:
    """For the terminal: G and mu of every curve and group for windows of 1, 2, 3 and all collapses."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    factor, unit = result.modulus_unit
    rows = [(record.name, cells) for record in result.curves if (cells := window_cells(record, factor))]
    if not rows:
        return None
    table = Table("curve", *_WINDOWS.values(), box=SIMPLE_HEAD, pad_edge=False, show_edge=False, title_justify="left")
    table.title = f"G ({unit}), µ (Pa s) by the window that is fitted; *: a parameter at its bound"
    table.title_style = "dim"
    for name, cells in rows:
        table.add_row(digits.elide(name, 24), *cells.values())
    table.add_section()
    for group, members in result.members():
        if len(members) > 1:
            means = _mean_cells([result.curves[i] for i in members], factor)
            table.add_row(digits.elide(group.name, 24), *means, style="bold")
    return table

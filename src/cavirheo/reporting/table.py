"""The answers as a table: for the terminal (rich) and for spreadsheets (CSV)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.reporting import fitted
from cavirheo.reporting.record import CurveRecord, GroupRecord, Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import write_rows

if TYPE_CHECKING:
    from rich.console import Console

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
    gap = 2 if wide else 1
    room = max(console.width - taken - gap * len(heads), 12)

    table = terminal.table("curve", heads, left=("verdict",), gap=gap - 1)
    names = [record.name for record in result.curves]
    short = [digits.elide(name, room) for name in names]
    if len(set(short)) < len(set(names)):  # two would look like one
        short = names
    for name, record, row in zip(short, result.curves, rows, strict=True):
        verdict = Text(row.pop(), digits.LOOKS[record.verdict].terminal)
        table.add_row(*map(Text, [name, *row]), verdict)
    table.add_section()
    for group, row in zip(result.groups, group_rows, strict=True):
        table.add_row(*map(Text, [digits.elide(group.name, room), *row]), style="bold")
    console.print(table)
    key = "RMSE: measured minus simulated, % of R_max"
    if any(record.viscosity_Pa_s.q05 is not None for record in result.curves):
        key += "; [ , ]: central 90 % interval"
    console.print(Text(key, "dim"))
    if (windows := fitted.windows_table(result)) is not None:
        console.print(windows)
    terminal.print_remarks(console, terminal.once((r.name, r.message) for r in result.curves), result.notes)


def _cells(record: CurveRecord, factor: float, wide: bool) -> list[str]:
    joint = " " if wide else "\n"
    collapses, end = record.window.collapses, record.window.t_star_end
    words = digits.LOOKS[record.verdict].words
    return [
        digits.micrometres(record.max_radius_m),
        digits.quantity(record.stretch) if wide else digits.quantity(record.stretch).split(" ")[0],
        digits.quantity(record.shear_modulus_Pa, factor, joint=joint),
        digits.quantity(record.viscosity_Pa_s, joint=joint),
        digits.percent(record.rmse_over_rmax),
        (digits.MISSING if collapses is None else str(collapses))
        + (f", t* ≤ {digits.significant(end, 2)}" if wide and end is not None else ""),
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
    head = ["name", "group", "source", "material", "method"]
    for name in plain:
        head += [name, f"{name}_q05", f"{name}_q95"] if name in quantities else [name]
    rows = []
    for record in result.curves:
        row = vars(record) | vars(record.window)
        for name in quantities:
            value = getattr(record, name)
            row |= {name: value.median, f"{name}_q05": value.q05, f"{name}_q95": value.q95}
        rows.append(row)
    write_rows(path, head, rows)

"""Sweeps, their properties and the table beside bubbles, for the terminal (rich)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from cavirheo.beside.rheometer.record import FrequencySweep, Rheometry, Row, StrainSweep, span, warning
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Spread, spread_of

if TYPE_CHECKING:
    from rich.console import Console

_MISSING = digits.MISSING


def print_rheometry(document: Rheometry, rows: Sequence[Row] = (), console: Console | None = None) -> None:
    """The sweeps, what the material is, what could not be found; then, with `rows`, the table beside bubbles."""
    from rich.text import Text

    console = console or terminal.console()
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in document.sweeps])
    if document.strain_sweeps:
        lines = [_strain_cells(sweep, factor) for sweep in document.strain_sweeps]
        means = [_mean(document.strain_sweeps, "linear_to", 100.0), _mean(document.strain_sweeps, _G, factor)]
        means.append(_mean(document.strain_sweeps, "crossover_strain", 100.0))
        heads = [f"linear, ±{100 * document.tolerance:g} %\n%", f"plateau G'\n{unit}", "G' = G''\nat %"]
        console.print(_table("strain sweep", heads, lines, means if len(lines) > 1 else []))
    if document.frequency_sweeps:
        lines = [_frequency_cells(sweep, factor) for sweep in document.frequency_sweeps]
        means = [_mean(document.frequency_sweeps, _G, factor), ""]
        means += [_mean(document.frequency_sweeps, name) for name in ("viscosity_Pa_s", "tan_delta")]
        means += [_mean(document.frequency_sweeps, name) for name in ("complex_viscosity_Pa_s", "crossover_rad_per_s")]
        heads = [f"plateau G'\n{unit}", "over\nrad/s", "µ = G''/ω\nPa s", "tan δ\n", "|η*|\nPa s", "G' = G''\nat rad/s"]
        console.print(_table("frequency sweep", heads, lines, means if len(lines) > 1 else []))
        console.print(Text(f"µ, tan δ and |η*| at {document.at_rad_per_s:g} rad/s", "dim"))
    answer = Text(document.material, "bold").append(f": G = {_with_unit(document.shear_modulus_Pa, factor, unit)}", "")
    answer.append(f" ({document.shear_modulus_from})")
    if document.frequency_sweeps:
        answer.append(f", µ = {_with_unit(document.viscosity_Pa_s, 1.0, 'Pa s')} at {document.at_rad_per_s:g} rad/s")
    console.print(answer)
    about: dict[str, list[str]] = {}  # each note once, with the sweeps it is about
    for sweep in document.sweeps:
        for note in filter(None, (sweep.message, *sweep.notes)):
            about.setdefault(note, []).append(sweep.name)
    for note, names in about.items():
        console.print(Text("• ").append(", ".join(names), "bold").append(f": {note}"))
    for note in document.notes:
        console.print(Text(f"• {note}"))
    if rows:
        console.print()
        _print_rows(rows, console)


def _strain_cells(sweep: StrainSweep, factor: float) -> list[str]:
    linear = _MISSING
    if sweep.linear_from is not None and sweep.linear_to is not None:
        ends = [digits.significant(100 * end) for end in (sweep.linear_from, sweep.linear_to)]
        linear = (" to " if sweep.departs else " to ≥ ").join(ends)
    return [sweep.name, linear, _digits(sweep.plateau_storage_Pa, factor), _digits(sweep.crossover_strain, 100.0)]


def _frequency_cells(sweep: FrequencySweep, factor: float) -> list[str]:
    start, end = sweep.plateau_from_rad_per_s, sweep.plateau_to_rad_per_s
    return [
        sweep.name,
        _digits(sweep.plateau_storage_Pa, factor),
        _MISSING if start is None or end is None else span(start, end),
        _digits(sweep.viscosity_Pa_s),
        _digits(sweep.tan_delta),
        _digits(sweep.complex_viscosity_Pa_s),
        _digits(sweep.crossover_rad_per_s),
    ]


def _print_rows(rows: Sequence[Row], console: Console) -> None:
    from rich.text import Text

    factor, unit = digits.modulus_unit([row.shear_modulus_Pa.mean for row in rows])
    lines = []
    for row in rows:
        doubts = {"not ok": row.doubtful, "failed": row.failed}
        known = row.regime_from is not None and row.regime_to is not None
        lines.append(
            [
                digits.elide(row.material, 30),
                row.method.replace(", ", "\n", 1),
                "\n".join([str(row.n), *(f"{count} {what}" for what, count in doubts.items() if count)]),
                digits.spread(row.shear_modulus_Pa, factor),
                digits.spread(row.viscosity_Pa_s),
                (f"{span(row.regime_from or 0, row.regime_to or 0, 2)} {row.regime_unit}" if known else _MISSING)
                + f"\n{row.deformation}",
            ]
        )
    heads = ["method", "n", f"G\n{unit}", "µ\nPa s", "ω or strain rate,\ndeformation"]
    console.print(_table("material", heads, lines, [], left=("method", heads[-1])))
    console.print(Text(warning(rows), "yellow"))


def _table(first: str, heads: list[str], lines: list[list[str]], means: list[str], left: Sequence[str] = ()):  # type: ignore[no-untyped-def]  # rich is imported late
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column(first, overflow="fold")
    for head in heads:
        table.add_column(head, justify="left" if head in left else "right", no_wrap=True)
    for line in lines:
        table.add_row(*map(Text, line))
    if means:
        table.add_section()
        table.add_row(*map(Text, ["mean ± std", *means]), style="bold")
    return table


_G = "plateau_storage_Pa"


def _mean(sweeps: Sequence[StrainSweep] | Sequence[FrequencySweep], name: str, factor: float = 1.0) -> str:
    return digits.spread(spread_of([getattr(sweep, name) for sweep in sweeps]), factor)


def _with_unit(value: Spread, factor: float, unit: str) -> str:
    return _MISSING if value.mean is None else f"{digits.spread(value, factor)} {unit}"


def _digits(value: float | None, factor: float = 1.0) -> str:
    return _MISSING if value is None else digits.significant(value * factor)

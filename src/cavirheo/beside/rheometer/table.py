"""Sweeps, their properties and the table beside bubbles, for the terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cavirheo.beside.rheometer.document import BesideRow, Rheometry, span, warning
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Spread, spread_of

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_Column = tuple[str, float, Callable[[Any], str] | None]  # field, factor, how it is written if not as a number
_G = "plateau_storage_Pa"


def print_rheometry(document: Rheometry, rows: Sequence[BesideRow] = (), console: Console | None = None) -> None:
    """The sweeps, what the material is, what could not be found; then, with `rows`, the table beside bubbles."""
    from rich.text import Text

    console = console or terminal.console()
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in document.sweeps])
    if document.strain_sweeps:
        columns: dict[str, _Column] = {
            f"linear, ±{100 * document.tolerance:g} %\n%": ("linear_to", 100.0, _linear),
            f"plateau G'\n{unit}": (_G, factor, None),
            "G' = G''\nat %": ("crossover_strain", 100.0, None),
        }
        console.print(_sweeps("strain sweep", document.strain_sweeps, columns))
    at = f"{document.at_rad_per_s:g} rad/s"
    if document.frequency_sweeps:
        columns = {
            f"plateau G'\n{unit}": (_G, factor, None),
            "over\nrad/s": ("", 1.0, _plateau),
            "µ = G''/ω\nPa s": ("viscosity_Pa_s", 1.0, None),
            "tan δ\n": ("tan_delta", 1.0, None),
            "|η*|\nPa s": ("complex_viscosity_Pa_s", 1.0, None),
            "G' = G''\nat rad/s": ("crossover_rad_per_s", 1.0, None),
        }
        console.print(_sweeps("frequency sweep", document.frequency_sweeps, columns))
        console.print(Text(f"µ, tan δ and |η*| at {at}", "dim"))
    answer = Text(document.material, "bold").append(f": G = {_with_unit(document.shear_modulus_Pa, factor, unit)}", "")
    answer.append(f" ({document.shear_modulus_from})")
    if document.frequency_sweeps:
        answer.append(f", µ = {_with_unit(document.viscosity_Pa_s, 1.0, 'Pa s')} at {at}")
    console.print(answer)
    remarks = terminal.once((sweep.name, note) for sweep in document.sweeps for note in (sweep.message, *sweep.notes))
    terminal.print_remarks(console, remarks, document.notes)
    if rows:
        console.print()
        console.print(_beside(rows))
        console.print(Text(warning(rows), "yellow"))


def _sweeps(first: str, sweeps: Sequence[Any], columns: Mapping[str, _Column]) -> Table:
    """A row per sweep; the mean where there are several."""
    from rich.text import Text

    table = terminal.table(first, list(columns))
    for sweep in sweeps:
        cells = [words(sweep) if words else _number(sweep, name, factor) for name, factor, words in columns.values()]
        table.add_row(*map(Text, [sweep.name, *cells]))
    if len(sweeps) > 1:
        spreads = [(spread_of([getattr(s, name, None) for s in sweeps]), name, f) for name, f, _ in columns.values()]
        cells = [digits.spread(spread, factor) if name else "" for spread, name, factor in spreads]
        table.add_section()
        table.add_row(*map(Text, ["mean ± std", *cells]), style="bold")
    return table


def _number(sweep: Any, name: str, factor: float) -> str:
    value = getattr(sweep, name)
    return digits.MISSING if value is None else digits.significant(value * factor)


def _linear(sweep: Any) -> str:
    if sweep.linear_from is None or sweep.linear_to is None:
        return digits.MISSING
    ends = [digits.significant(100 * end) for end in (sweep.linear_from, sweep.linear_to)]
    return (" to " if sweep.departs else " to ≥ ").join(ends)


def _plateau(sweep: Any) -> str:
    start, end = sweep.plateau_from_rad_per_s, sweep.plateau_to_rad_per_s
    return digits.MISSING if start is None or end is None else span(start, end)


def _beside(rows: Sequence[BesideRow]) -> Table:
    from rich.text import Text

    factor, unit = digits.modulus_unit([row.shear_modulus_Pa.mean for row in rows])
    heads = ["method", "n", f"G\n{unit}", "µ\nPa s", "ω or strain rate,\ndeformation"]
    table = terminal.table("material", heads, left=(heads[0], heads[-1]))
    for row in rows:
        doubts = {"not ok": row.doubtful, "failed": row.failed}
        regime = digits.MISSING
        if row.regime_from is not None and row.regime_to is not None:
            regime = f"{span(row.regime_from, row.regime_to, 2)} {row.regime_unit}"
        cells = [
            digits.elide(row.material, 30),
            row.method.replace(", ", "\n", 1),
            "\n".join([str(row.n), *(f"{count} {what}" for what, count in doubts.items() if count)]),
            digits.spread(row.shear_modulus_Pa, factor),
            digits.spread(row.viscosity_Pa_s),
            f"{regime}\n{row.deformation}",
        ]
        table.add_row(*map(Text, cells))
    return table


def _with_unit(value: Spread, factor: float, unit: str) -> str:
    return digits.MISSING if value.mean is None else f"{digits.spread(value, factor)} {unit}"

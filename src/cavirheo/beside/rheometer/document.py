"""rheometer.json: all sweeps of one material and what was found in them (schema 1); and its row beside bubbles.

```
schema 1, version, command, date, notes      as in result.json
material, tolerance                          the name; the part of G' by which it may leave its plateau
shear_modulus_Pa, shear_modulus_from         mean, std, median over the sweeps that have it; where it comes from
viscosity_Pa_s, at_rad_per_s                 G''/omega at this angular frequency
linear_to                                    largest strain of the linear range
strain_sweeps, frequency_sweeps              one entry each, below
```
Every number is SI (a strain of 1 is 100 %) and finite, or null where it was not found; `message` then says why.
rheometer.csv has one line per sweep with the same names; table.csv one line per material and method.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.beside.rheometer.sweeps import FrequencySweep, StrainSweep, SweepProperties
from cavirheo.reporting.record import CurveRecord, GroupRecord, Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Record, Spread, spread_of, write_rows

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


class Rheometry(Document):
    """The document."""

    material: str
    tolerance: float
    at_rad_per_s: float
    shear_modulus_Pa: Spread
    shear_modulus_from: str
    viscosity_Pa_s: Spread
    linear_to: Spread
    strain_sweeps: list[StrainSweep]
    frequency_sweeps: list[FrequencySweep]

    @property
    def sweeps(self) -> list[StrainSweep | FrequencySweep]:
        return [*self.strain_sweeps, *self.frequency_sweeps]


class BesideRow(Record):
    """One material by one method, in the table beside bubbles: mean ± std over `n`.

    `doubtful` and `failed` are bubbles beside those. `regime`: angular frequencies in rad/s or strain rates in 1/s.
    """

    material: str
    method: str
    n: int
    doubtful: int = 0
    failed: int = 0
    shear_modulus_Pa: Spread
    viscosity_Pa_s: Spread
    regime_from: float | None
    regime_to: float | None
    regime_unit: str
    deformation: str


def rheometry(strain: Sequence[StrainSweep], frequency: Sequence[FrequencySweep], **head: Any) -> Rheometry:
    """The document. G is the plateau of the frequency sweeps; without one, that of the strain sweeps of a solid.

    `head` are the other fields: material, tolerance, at_rad_per_s, command, date, notes.
    """
    plateaus = [sweep.plateau_storage_Pa for sweep in frequency if sweep.plateau_storage_Pa is not None]
    origin = "plateau of the frequency sweep"
    if not plateaus:
        solid = [s for s in strain if (s.plateau_storage_Pa or 0.0) > (s.plateau_loss_Pa or 0.0)]
        plateaus = [s.plateau_storage_Pa for s in solid if s.plateau_storage_Pa is not None]
        held = [s.frequency_rad_per_s for s in solid if s.frequency_rad_per_s is not None]
        origin = "plateau of the strain sweep" + (f" at {digits.significant(held[0])} rad/s" if held else "")
    document = Rheometry(
        shear_modulus_Pa=spread_of([*plateaus]),
        shear_modulus_from=origin if plateaus else "no plateau",
        viscosity_Pa_s=spread_of([sweep.viscosity_Pa_s for sweep in frequency]),
        linear_to=spread_of([sweep.linear_to for sweep in strain]),
        strain_sweeps=list(strain),
        frequency_sweeps=list(frequency),
        **head,
    )
    limits = [sweep.linear_to for sweep in strain if sweep.linear_to is not None and sweep.departs]
    for sweep in frequency:
        if sweep.strain is not None and sweep.strain > min(limits, default=math.inf):
            document.notes.append(
                f"{sweep.name} was run at a strain of {digits.percent(sweep.strain)} %, beyond the linear range "
                f"(to {digits.percent(min(limits))} %): its moduli are not those of the linear range"
            )
    return document


def write_csv(path: Path, document: Rheometry) -> None:
    """One line per sweep."""
    fields = [name for kind in (SweepProperties, StrainSweep, FrequencySweep) for name in kind.model_fields]
    head = [name for name in dict.fromkeys(["kind", *fields]) if name not in ("data", "notes")]
    write_rows(path, head, (sweep.model_dump() for sweep in document.sweeps))


def beside(document: Rheometry, result: Result) -> list[BesideRow]:
    """The rheometer's row, then one for each group of bubbles."""
    strain, frequency = document.strain_sweeps, document.frequency_sweeps
    omegas = [w for s in frequency for w in (s.from_rad_per_s, s.to_rad_per_s)]
    omegas = omegas or [s.frequency_rad_per_s for s in strain if s.frequency_rad_per_s is not None]
    strains = [s.strain for s in frequency if s.strain is not None]
    strains = strains or [s.linear_to for s in strain if s.linear_to is not None]
    rheometer = BesideRow(
        material=document.material,
        method="rheometer" + (f", µ at {document.at_rad_per_s:g} rad/s" if frequency else ""),
        n=max(len(frequency), len(strain)),
        shear_modulus_Pa=document.shear_modulus_Pa,
        viscosity_Pa_s=document.viscosity_Pa_s,
        regime_from=min(omegas, default=None),
        regime_to=max(omegas, default=None),
        regime_unit="rad/s",
        deformation=f"strain ≤ {digits.percent(max(strains))} %" if strains else "small strain",
    )
    return [rheometer, *(_bubbles(group, [result.curves[k] for k in members]) for group, members in result.members())]


def _bubbles(group: GroupRecord, curves: list[CurveRecord]) -> BesideRow:
    """The row of a group: its means, and the regime of the shots that they are over."""
    trusted = getattr(group, "n_trusted", None)  # None: a document from before means were over trusted answers alone
    counted = [c for c in curves if (c.answered if trusted is None else c.verdict == "ok")]
    rates = [curve.strain_rate_per_s for curve in counted if curve.strain_rate_per_s is not None]
    stretches = [curve.stretch.median for curve in counted if curve.stretch.median is not None]
    return BesideRow(
        material=group.name,
        method=f"bubble, {', '.join(dict.fromkeys(curve.method for curve in curves))}",
        n=group.n if trusted is None else trusted,
        doubtful=group.n - group.verdicts.get("ok", 0),
        failed=group.n_failed,
        shear_modulus_Pa=group.shear_modulus_Pa,
        viscosity_Pa_s=group.viscosity_Pa_s,
        regime_from=min(rates, default=None),
        regime_to=max(rates, default=None),
        regime_unit="1/s",
        deformation=f"λ = {span(min(stretches), max(stretches), 2)}" if stretches else "large strain",
    )


def warning(rows: Sequence[BesideRow]) -> str:
    """That the regimes of the rows differ, in their own numbers."""

    def regime(unit: str) -> str:
        ends = [end for row in rows if row.regime_unit == unit for end in (row.regime_from, row.regime_to)]
        known = [end for end in ends if end is not None]
        return f"{span(min(known), max(known), 2)} {unit}" if known else f"{digits.MISSING} {unit}"

    return (
        f"The regimes differ: the rheometer measures at {regime('rad/s')} and small strain, the bubble at "
        f"{regime('1/s')} and large strain. G and µ depend on both: unequal values are not a contradiction."
    )


def span(low: float, high: float, count: int = 3) -> str:
    """'0.10 to 100', '1.5e5 to 2.5e5', or one number where both ends read the same."""
    ends = [
        digits.significant(end, count) if end < 1e4 else f"{end:.{count - 1}e}".replace("e+0", "e")
        for end in (low, high)
    ]
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)


def write_table(path: Path, rows: Sequence[BesideRow]) -> None:
    """One line per row, and the warning below as a comment."""
    spreads = ("shear_modulus_Pa", "viscosity_Pa_s")
    head: list[str] = []
    for name in BesideRow.model_fields:
        head += [name, f"{name}_std"] if name in spreads else [name]
    lines = []
    for row in rows:
        line = row.model_dump(exclude=set(spreads))
        for name in spreads:
            line |= {name: getattr(row, name).mean, f"{name}_std": getattr(row, name).std}
        lines.append(line)
    write_rows(path, head, lines)
    with path.open("a", encoding="utf-8") as file:
        file.write(f"# {warning(rows)}\n")


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

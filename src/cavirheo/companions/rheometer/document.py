"""rheometer.json (schema 1): all sweeps of one material, what was found in them, and its row beside bubbles.

Numbers are SI (a strain of 1 is 100 %) and finite, or null where not found; `message` then says why.
rheometer.csv has one line per sweep with the same names; table.csv one per material and method.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cavirheo.companions.rheometer.sweeps import FrequencySweep, StrainSweep, Sweep, frequency_sweep, strain_sweep
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Published, Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Record, Spread, spread_of, write_rows

if TYPE_CHECKING:
    from rich.table import Table


class Rheometry(Document):
    """All sweeps of one material, and what was found in them.

    Attributes:
        material: its name.
        tolerance: part of G' by which it may leave its plateau.
        at_rad_per_s: frequency at which mu is taken, rad/s.
        shear_modulus_Pa: G over the sweeps that have it, Pa.
        shear_modulus_from: where G comes from.
        viscosity_Pa_s: G''/omega at this frequency, Pa s.
        linear_to: largest strain of the linear range.
        strain_sweeps: one entry each.
        frequency_sweeps: one entry each.
    """

    kind: Literal["rheometer"] = "rheometer"
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

    `doubtful` and `failed` are bubbles beside those. `regime`: rad/s, or strain rates in 1/s.
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


def rheometry(
    found: Sequence[Sweep], material: str, tolerance: float = 0.05, at: float = 1.0, **head: Any
) -> Rheometry:
    """The document of these sweeps as they were read; `head`: command, date, notes.

    G is the plateau of the frequency sweeps; without one, that of the strain sweeps of a solid.
    """
    strain = [strain_sweep(one, tolerance) for one in found if isinstance(one, StrainSweep)]
    frequency = [frequency_sweep(one, at) for one in found if isinstance(one, FrequencySweep)]
    solid = [s for s in strain if (s.plateau_storage_Pa or 0.0) > (s.plateau_loss_Pa or 0.0)]
    modulus, origin = spread_of([s.plateau_storage_Pa for s in frequency]), "plateau of the frequency sweep"
    if modulus.mean is None:
        held = _known(s.frequency_rad_per_s for s in solid)
        modulus = spread_of([s.plateau_storage_Pa for s in solid])
        origin = "plateau of the strain sweep" + (f" at {digits.significant(held[0])} rad/s" if held else "")
    document = Rheometry(
        material=material,
        tolerance=tolerance,
        at_rad_per_s=at,
        shear_modulus_Pa=modulus,
        shear_modulus_from="no plateau" if modulus.mean is None else origin,
        viscosity_Pa_s=spread_of([sweep.viscosity_Pa_s for sweep in frequency]),
        linear_to=spread_of([sweep.linear_to for sweep in strain]),
        strain_sweeps=strain,
        frequency_sweeps=frequency,
        **head,
    )
    limit = min(_known(sweep.linear_to for sweep in strain if sweep.departs), default=math.inf)
    document.notes += [
        f"{sweep.name} was run at a strain of {digits.percent(sweep.strain)} %, beyond the linear range "
        f"(to {digits.percent(limit)} %): its moduli are not those of the linear range"
        for sweep in frequency
        if sweep.strain is not None and sweep.strain > limit
    ]
    return document


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def write_csv(path: Path, document: Rheometry) -> None:
    """One line per sweep."""
    fields = dict.fromkeys(["kind", *Sweep.model_fields, *StrainSweep.model_fields, *FrequencySweep.model_fields])
    head = [name for name in fields if name not in ("x", "storage", "loss", "notes")]
    write_rows(path, head, (sweep.model_dump() for sweep in document.sweeps))


def shared_name(files: Sequence[Path]) -> str:
    """'gel' of gel_strain.csv and gel_frequency.csv: the words with which all names begin, or the first name."""
    words = [re.split(r"[\W_]+", path.stem) for path in files]
    shared = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
    return ("_".join(column[0] for column in shared) if len(files) > 1 else "") or files[0].stem


def beside(document: Rheometry, result: Result) -> list[BesideRow]:
    """The rheometer's row, then one for each group of bubbles."""
    return [_itself(document), *(_bubbles(one, [result.curves[k] for k in of]) for one, of in result.members())]


def published(document: Rheometry) -> Published:
    """As values of another method, which names the regime: a viscosity at this frequency is not that of a bubble."""
    row, at = _itself(document), f"viscosity_at_{document.at_rad_per_s:g}_rad_per_s"
    name = f"rheometer, {_span([row.regime_from, row.regime_to], 2)} rad/s, {row.deformation}"
    values = {"shear_modulus": row.shear_modulus_Pa, at: row.viscosity_Pa_s}
    return {name: {key: value for key, value in values.items() if value.mean is not None}}


def _itself(document: Rheometry) -> BesideRow:
    strain, frequency = document.strain_sweeps, document.frequency_sweeps
    omegas = [w for s in frequency for w in (s.from_rad_per_s, s.to_rad_per_s)]
    strains = _known(s.strain for s in frequency) or _known(s.linear_to for s in strain)
    return _row(
        document,
        omegas or [s.frequency_rad_per_s for s in strain],
        material=document.material,
        method="rheometer" + (f", µ at {document.at_rad_per_s:g} rad/s" if frequency else ""),
        n=max(len(frequency), len(strain)),
        regime_unit="rad/s",
        deformation=f"strain ≤ {digits.percent(max(strains))} %" if strains else "small strain",
    )


def _bubbles(group: GroupRecord, curves: list[CurveRecord]) -> BesideRow:
    """The row of a group: its means, and the regime of the shots that they are over."""
    trusted = group.n_trusted  # None: a document from before means were over trusted answers alone
    counted = [c for c in curves if (c.answered if trusted is None else c.trusted)]
    methods = dict.fromkeys(curve.method for curve in curves)
    bubbles = dict.fromkeys(curve.bubble.title for curve in curves if curve.answered)
    stretches = _known(curve.stretch.median for curve in counted)
    return _row(
        group,
        [curve.strain_rate_per_s for curve in counted],
        material=group.name,
        method=", ".join([*bubbles, *methods]) or "bubble",
        n=group.n if trusted is None else trusted,
        doubtful=group.n - sum(curve.trusted for curve in curves),
        failed=group.n_failed,
        regime_unit="1/s",
        deformation=f"λ = {_span(stretches, 2)}" if stretches else "large strain",
    )


def _row(means: Rheometry | GroupRecord, regime: Iterable[float | None], **other: Any) -> BesideRow:
    known = _known(regime)
    other |= {name: getattr(means, name) for name in ("shear_modulus_Pa", "viscosity_Pa_s")}
    return BesideRow(regime_from=min(known, default=None), regime_to=max(known, default=None), **other)


def warning(rows: Sequence[BesideRow]) -> str:
    """That the regimes of the rows differ, in their own numbers."""
    ends: dict[str, list[float | None]] = {"rad/s": [], "1/s": []}
    for row in rows:
        ends[row.regime_unit] += [row.regime_from, row.regime_to]
    slow, fast = (f"{_span(known, 2)} {unit}" for unit, known in ends.items())
    return (
        f"The regimes differ: the rheometer measures at {slow} and small strain, the bubble at {fast} and large "
        "strain. G and µ depend on both: unequal values are not a contradiction."
    )


def _span(values: Iterable[float | None], count: int = 3) -> str:
    """'0.10 to 100', '1.5e5 to 2.5e5', or one number where both ends read the same."""
    known = _known(values) or [math.nan]
    ends = [
        digits.significant(end, count) if end < 1e4 else f"{end:.{count - 1}e}".replace("e+0", "e")
        for end in (min(known), max(known))
    ]
    return digits.MISSING if math.isnan(known[0]) else " to ".join(dict.fromkeys(ends))


def write_table(path: Path, rows: Sequence[BesideRow]) -> None:
    """One line per row, and the warning below as a comment."""
    lines = []
    for row in rows:
        cells = ({k: v.mean, f"{k}_std": v.std} if isinstance(v, Spread) else {k: v} for k, v in row)
        lines.append({name: value for some in cells for name, value in some.items()})
    write_rows(path, list(lines[0]), lines)
    with path.open("a", encoding="utf-8") as file:
        file.write(f"# {warning(rows)}\n")


_Column = tuple[str, float, Callable[[Any], str] | None]  # field, factor, how it is written if not as a number


def print_rheometry(document: Rheometry, rows: Sequence[BesideRow] = ()) -> None:
    """The sweeps, the material, the remarks; with `rows` the table beside bubbles."""
    from rich.text import Text

    console = terminal.console()
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in document.sweeps])
    plateau: dict[str, _Column] = {f"plateau G'\n{unit}": ("plateau_storage_Pa", factor, None)}
    answer = f": G = {_with_unit(document.shear_modulus_Pa, factor, unit)} ({document.shear_modulus_from})"
    if document.strain_sweeps:
        linear: _Column = ("linear_to", 100.0, _linear)
        columns = {f"linear, ±{100 * document.tolerance:g} %\n%": linear, **plateau}
        columns["G' = G''\nat %"] = ("crossover_strain", 100.0, None)
        console.print(_sweeps("strain sweep", document.strain_sweeps, columns))
    if document.frequency_sweeps:
        columns = {
            **plateau,
            "over\nrad/s": ("", 1.0, lambda sweep: _span([sweep.plateau_from_rad_per_s, sweep.plateau_to_rad_per_s])),
            "µ = G''/ω\nPa s": ("viscosity_Pa_s", 1.0, None),
            "tan δ\n": ("tan_delta", 1.0, None),
            "|η*|\nPa s": ("complex_viscosity_Pa_s", 1.0, None),
            "G' = G''\nat rad/s": ("crossover_rad_per_s", 1.0, None),
        }
        at = f"{document.at_rad_per_s:g} rad/s"
        console.print(_sweeps("frequency sweep", document.frequency_sweeps, columns))
        console.print(f"µ, tan δ and |η*| at {at}", style="dim")
        answer += f", µ = {_with_unit(document.viscosity_Pa_s, 1.0, 'Pa s')} at {at}"
    console.print(Text.assemble((digits.printable(document.material), "bold"), answer))
    remarks = terminal.once((sweep.name, note) for sweep in document.sweeps for note in (sweep.message, *sweep.notes))
    terminal.print_remarks(console, remarks, document.notes)
    if rows:
        console.print()
        console.print(_beside(rows))
        console.print(warning(rows), style="yellow")


def _sweeps(first: str, sweeps: Sequence[Sweep], columns: Mapping[str, _Column]) -> Table:
    """A row per sweep; the mean where there are several."""
    table = terminal.table(first, list(columns))
    shown = [[*(sweep.name for sweep in sweeps), "mean ± std"]]
    for name, factor, words in columns.values():
        values = [getattr(sweep, name, None) for sweep in sweeps]
        cells = [*map(words, sweeps)] if words else [digits.spread(Spread(mean=value), factor) for value in values]
        shown.append([*cells, digits.spread(spread_of(values), factor) if name else ""])
    *rows, mean = zip(*shown, strict=True)
    for row in rows:
        table.add_row(*row)
    if len(rows) > 1:
        table.add_section()
        table.add_row(*mean, style="bold")
    return table


def _linear(sweep: StrainSweep) -> str:
    ends = [digits.significant(100 * end) for end in _known([sweep.linear_from, sweep.linear_to])]
    return (" to " if sweep.departs else " to ≥ ").join(ends) or digits.MISSING


def _beside(rows: Sequence[BesideRow]) -> Table:
    factor, unit = digits.modulus_unit([row.shear_modulus_Pa.mean for row in rows])
    heads = ["method", "n", f"G\n{unit}", "µ\nPa s", "ω or strain rate,\ndeformation"]
    table = terminal.table("material", heads, left=(heads[0], heads[-1]))
    for name, row in zip(digits.shortened([row.material for row in rows]), rows, strict=True):
        doubts = {"not trusted": row.doubtful, "failed": row.failed}
        regime = _span([row.regime_from, row.regime_to], 2)
        unit = "" if row.regime_from is None else f" {row.regime_unit}"
        table.add_row(
            name,
            row.method.replace(", ", "\n"),
            "\n".join([str(row.n), *(f"{count} {what}" for what, count in doubts.items() if count)]),
            digits.spread(row.shear_modulus_Pa, factor),
            digits.spread(row.viscosity_Pa_s),
            f"{regime}{unit}\n{row.deformation}",
        )
    return table


def _with_unit(value: Spread, factor: float, unit: str) -> str:
    return digits.spread(value, factor) + ("" if value.mean is None else f" {unit}")

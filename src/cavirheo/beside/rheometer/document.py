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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cavirheo.beside.rheometer.sweeps import FrequencySweep, StrainSweep, SweepProperties
from cavirheo.reporting.record import CurveRecord, GroupRecord, Result
from cavirheo.writing import digits
from cavirheo.writing.document import Document, Model, Spread, spread_of, write_rows


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


class BesideRow(Model):
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

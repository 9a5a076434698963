"""collapse-time.json (schema 1): what collapse times say of each material; and shots.csv, a line per shot.

```
schema 1, version, command, date, notes      as in result.json
material, medium                             the law; the constants used
groups                                       one per table, or per file or folder of curves:
  name, source, source_sha256, n, unusable   shots, and how many of them could not be used (their `message` says why)
  analytic, exact                            the answers (CollapseEstimate); exact is null unless it was asked for
  shots                                      R_max, lambda, t_1 and t_1/t_RC as measured and of the models
```
Every number is SI and finite, or null where it was not found; `message` then says why.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.errors import SolverError
from cavirheo.inference.collapse_time import CollapseEstimate, CollapseValue, Shots, estimate
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Finite, Quantity, Record, write_rows

if TYPE_CHECKING:
    from rich.console import Console


class CollapseShot(Record):
    """One shot. `message`: why it cannot be used, empty if it can."""

    name: str
    max_radius_m: Finite = None
    stretch: Finite = None
    stretch_from: str = ""
    collapse_time_s: Finite = None
    measured: Finite = None  # t_1/t_RC
    analytic: Finite = None
    exact: Finite = None
    message: str = ""


class CollapseGroup(Record):
    """The shots of one material: a table, or curves of one file or folder; and what they say, once asked."""

    name: str
    source: str
    source_sha256: str
    n: int
    unusable: int
    notes: list[str] = []
    analytic: CollapseEstimate | None = None
    exact: CollapseEstimate | None = None
    shots: list[CollapseShot]

    @property
    def usable(self) -> list[CollapseShot]:
        return [shot for shot in self.shots if not shot.message]

    @property
    def best(self) -> CollapseEstimate | None:
        """The exact answer where there is one."""
        return self.exact or self.analytic

    def estimates(self) -> list[tuple[str, CollapseEstimate]]:
        """Each answer with its name."""
        pairs = (("analytic", self.analytic), ("exact", self.exact))
        return [(name, estimate) for name, estimate in pairs if estimate is not None]

    def answer(self, material: str, *, exact: bool = False, **options: Any) -> None:
        """Estimate G and mu from the shots that can be used, if there are any; `options` are those of `estimate`.

        A simulation that fails leaves no exact answer, and a note.
        """
        if not self.usable:
            return
        radius, stretch, time = (
            np.array([getattr(shot, name) for shot in self.usable])
            for name in ("max_radius_m", "stretch", "collapse_time_s")
        )
        shots = Shots(radius, stretch, time, [shot.name for shot in self.usable])
        self.analytic = estimate(shots, material, **options)
        try:
            self.exact = estimate(shots, material, exact=True, **options) if exact else None
        except SolverError as error:
            self.notes.append(f"no exact answer: {error}")
        for k, shot in enumerate(self.usable):
            shot.measured, shot.analytic = self.analytic.measured[k], self.analytic.model[k]
            shot.exact = self.exact.model[k] if self.exact else None


class CollapseTimes(Document):
    """The document."""

    material: str
    medium: dict[str, Any]
    groups: list[CollapseGroup]

    @property
    def modulus_unit(self) -> tuple[float, str]:
        """(factor from Pa, its name) of G in all tables and pictures of this document."""
        found = [estimate.shear_modulus_Pa.value for group in self.groups for _, estimate in group.estimates()]
        return digits.modulus_unit(value for value in found if value)


def write_csv(path: Path, document: CollapseTimes) -> None:
    """One line per shot of every group."""
    rows = ({"group": group.name, **shot.model_dump()} for group in document.groups for shot in group.shots)
    write_rows(path, ["group", *CollapseShot.model_fields], rows)


def interval(value: CollapseValue, factor: float = 1.0, *, joint: str = " ") -> str:
    """'6.5 [4.5, 8.6]', to the digits that the interval leaves; without it where there is none."""
    low, high = (None, None) if value.low == value.high else (value.low, value.high)
    if value.value == 0 and high is not None:  # which leaves no digits to go by
        return f"0{joint}[0, {digits.significant(high * factor, 2)}]"
    return digits.quantity(Quantity(median=value.value, q05=low, q95=high), factor, joint=joint)


def print_table(document: CollapseTimes, console: Console | None = None) -> None:
    """A row per group and model, then what is to be known of them."""
    from rich.text import Text

    console = console or terminal.console()
    factor, unit = document.modulus_unit
    heads = ("n", "model", f"G [95 %]\n{unit}", "µ [95 %]\nPa s", "scatter\n% of t₁")
    table = terminal.table("material", heads, left=("model",))
    table.columns[0].min_width = 10
    for group in document.groups:
        for k, (name, found) in enumerate(group.estimates() or [(digits.MISSING, None)]):
            n = f"{group.n}" if not group.unusable else f"{group.n - group.unusable}/{group.n}"
            who = digits.elide(group.name, 30) if k == 0 else ""
            table.add_row(*map(Text, [who, n, name, *_cells(found, factor)]))
    console.print(table)
    remarks = terminal.once(remark for group in document.groups for remark in _remarks(group, factor, unit))
    terminal.print_remarks(console, remarks, most=5)
    slopes = [group.best.shear_modulus_Pa.per_percent for group in document.groups if group.best]
    if moves := [abs(slope) * factor for slope in slopes if slope]:
        ends = " to ".join(dict.fromkeys(digits.significant(end, 2) for end in (min(moves), max(moves))))
        common = f"t₁ of all shots 1 % longer (R_max, frame rate, density) lowers G by {ends} {unit}"
        console.print(Text(f"intervals: from the scatter of the shots alone; {common}", "dim"))
    terminal.print_remarks(console, {}, document.notes)


def _remarks(group: CollapseGroup, factor: float, unit: str) -> Iterator[tuple[str, str]]:
    """(whom it is about, what is to be known)."""
    for name, found in group.estimates():
        who = f"{group.name} ({name})"
        yield who, found.message
        if found.downweighted:
            yield who, f"weighted down: {', '.join(found.downweighted)}"
        if found.pairs and found.shear_modulus_Pa.value is None:
            pairs = "; ".join(f"{G * factor:.3g}, {mu:.2g}" for G, mu in found.pairs)
            yield who, f"equally good pairs (G {unit}, µ Pa s): {pairs}"
    for shot in group.shots:
        if shot.message:
            who = shot.name if shot.name.startswith(group.name) else f"{group.name} {shot.name}"
            yield who, f"left out: {shot.message}"
    for note in group.notes:
        yield group.name, note
    if origins := sorted({shot.stretch_from for shot in group.shots} - {"", "table"}):
        yield group.name, f"lambda: {', '.join(origins)}"


def _cells(found: CollapseEstimate | None, factor: float) -> list[str]:
    if found is None:
        return [digits.MISSING] * 3
    return [
        interval(found.shear_modulus_Pa, factor, joint="\n"),
        interval(found.viscosity_Pa_s, joint="\n"),
        digits.MISSING if found.scatter is None else digits.significant(100 * found.scatter, 2),
    ]

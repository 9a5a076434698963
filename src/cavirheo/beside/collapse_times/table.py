"""The estimates of all groups, for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from cavirheo.beside.collapse_times.document import CollapseGroup, CollapseTimes
from cavirheo.inference.collapse_time import CollapseEstimate, CollapseValue
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity

if TYPE_CHECKING:
    from rich.console import Console


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

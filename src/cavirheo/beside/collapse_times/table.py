"""The estimates of all groups, for the terminal (rich)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from cavirheo.beside.collapse_times.record import CollapseTimes, Fit, GroupRecord, Value
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity

if TYPE_CHECKING:
    from rich.console import Console


def interval(value: Value, factor: float = 1.0, *, joint: str = " ") -> str:
    """'6.5 [4.5, 8.6]', to the digits that the interval leaves; without it where there is none."""
    low, high = (None, None) if value.low == value.high else (value.low, value.high)
    if value.value == 0 and high is not None:  # which leaves no digits to go by
        return f"0{joint}[0, {digits.significant(high * factor, 2)}]"
    return digits.quantity(Quantity(median=value.value, q05=low, q95=high), factor, joint=joint)


def print_table(document: CollapseTimes, console: Console | None = None) -> None:
    """A row per group and model, then what is to be known of them."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    console = console or terminal.console()
    factor, unit = document.modulus_unit
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("material", overflow="fold", min_width=10)
    for head in ("n", "model", f"G [95 %]\n{unit}", "µ [95 %]\nPa s", "scatter\n% of t₁"):
        table.add_column(head, justify="left" if head == "model" else "right", no_wrap=True)
    for group in document.groups:
        fits = [(name, fit) for name, fit in (("analytic", group.analytic), ("exact", group.exact)) if fit]
        for k, (name, fit) in enumerate(fits or [("–", None)]):
            n = f"{group.n}" if not group.unusable else f"{group.n - group.unusable}/{group.n}"
            table.add_row(*map(Text, [digits.elide(group.name, 30) if k == 0 else "", n, name, *_cells(fit, factor)]))
    console.print(table)
    about: dict[str, list[str]] = {}  # each note once, with those it is about
    for group in document.groups:
        for who, note in _notes(group, factor, unit):
            about.setdefault(note, []).append(who)
    for note, names in about.items():
        who = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        console.print(Text("• ").append(who, "bold").append(f": {note}"))
    slopes = [fit.shear_modulus_Pa.per_percent for group in document.groups if (fit := group.exact or group.analytic)]
    if moves := [abs(slope) * factor for slope in slopes if slope]:
        ends = " to ".join(dict.fromkeys(digits.significant(end, 2) for end in (min(moves), max(moves))))
        common = f"t₁ of all shots 1 % longer (R_max, frame rate, density) lowers G by {ends} {unit}"
        console.print(Text(f"intervals: from the scatter of the shots alone; {common}", "dim"))
    for note in document.notes:
        console.print(Text(f"• {note}"))


def _notes(group: GroupRecord, factor: float, unit: str) -> Iterator[tuple[str, str]]:
    """(whom it is about, what is to be known)."""
    for name, fit in (("analytic", group.analytic), ("exact", group.exact)):
        if fit is None:
            continue
        who = f"{group.name} ({name})"
        if fit.message:
            yield who, fit.message
        if fit.downweighted:
            yield who, f"weighted down: {', '.join(fit.downweighted)}"
        if fit.pairs and fit.shear_modulus_Pa.value is None:
            pairs = "; ".join(f"{G * factor:.3g}, {mu:.2g}" for G, mu in fit.pairs)
            yield who, f"equally good pairs (G {unit}, µ Pa s): {pairs}"
    for shot in group.shots:
        if shot.message:
            who = shot.name if shot.name.startswith(group.name) else f"{group.name} {shot.name}"
            yield who, f"left out: {shot.message}"
    for note in group.notes:
        yield group.name, note
    origins = sorted({shot.stretch_from for shot in group.shots} - {"", "table"})
    if origins:
        yield group.name, f"lambda: {', '.join(origins)}"


def _cells(fit: Fit | None, factor: float) -> list[str]:
    if fit is None:
        return [digits.MISSING] * 3
    return [
        interval(fit.shear_modulus_Pa, factor, joint="\n"),
        interval(fit.viscosity_Pa_s, joint="\n"),
        digits.MISSING if fit.scatter is None else digits.significant(100 * fit.scatter, 2),
    ]

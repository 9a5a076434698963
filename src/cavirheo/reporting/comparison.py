"""The answers of groups beside values of other methods: one table for the terminal and the report."""

from __future__ import annotations

from cavirheo.reporting.record import MAIN_FIELDS, OUR_METHOD, Result
from cavirheo.writing import digits, terminal


def comparison_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """(heads, rows) of texts, a row for each group, quantity and method; of a group the answer is last."""
    heads = ["group", "quantity", "method", "value", f"{OUR_METHOD}\nover it"]
    rows = []
    for group in result.groups:
        for name in dict.fromkeys([*MAIN_FIELDS, *(name for values in group.published.values() for name in values)]):
            symbol, factor, unit, _ = result.shown(name)
            if name not in MAIN_FIELDS:  # of a rheometer, at one angular frequency
                symbol, unit = f"µ at {name.removeprefix('viscosity_at_').removesuffix('_rad_per_s')} rad/s", "Pa s"
            ours = group.value(name)
            for method, values in group.published.items():
                if value := values.get(name):
                    ratio = ours.median / value.mean if ours.median is not None and value.mean else None
                    words = digits.spread(value, factor)
                    rows.append([group.name, f"{symbol}, {unit}", method, words, digits.number(ratio)])
            if name in MAIN_FIELDS:
                rows.append([group.name, f"{symbol}, {unit}", OUR_METHOD, digits.quantity(ours, factor), ""])
    return heads, rows


def comparison_key(result: Result) -> str:
    """How to read the table."""
    key = f"{OUR_METHOD}: the material of all shots that count, and its 90 % interval; others: mean ± deviation."
    if bubbles := ", ".join(dict.fromkeys(shot.bubble_title for shot in result.curves if shot.has_answer)):
        key += f" Our answers assume the {bubbles}."
    if any(method.startswith("rheometer") for group in result.groups for method in group.published):
        key += " A rheometer measures at small strain and low rates, a bubble at large strain and 1e5/s: unequal"
        key += " values are no contradiction."
    return key


def print_comparison(result: Result) -> None:
    """Print the table and its key."""
    heads, rows = comparison_table(result)
    groups = ["", *(row[0] for row in rows)]
    rows = [["" if row[0] == above else row[0], *row[1:]] for above, row in zip(groups, rows, strict=False)]
    terminal.print_table(heads, rows, left=("quantity", "method"))
    terminal.print_text(comparison_key(result), style="dim")

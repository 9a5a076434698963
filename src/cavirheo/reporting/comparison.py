"""The answers of groups beside values of other methods: one table for comparison.csv, the terminal and the report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cavirheo.reporting.record import MAIN_FIELDS, OUR_METHOD, GroupRecord, Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity, Spread, write_rows

REFERENCE_METHODS = ("IMR", "rheometer")  # methods relative to which errors are given


def _references(result: Result) -> list[str]:
    return [name for name in REFERENCE_METHODS if any(group.published.get(name) for group in result.groups)]


def _values(group: GroupRecord) -> list[tuple[str, str, Spread | Quantity]]:
    """(parameter, method, value) of each value of a group by other methods and of its answer, which is last."""
    values: list[tuple[str, str, Spread | Quantity]] = []
    for name in dict.fromkeys([*MAIN_FIELDS, *(name for values in group.published.values() for name in values)]):
        values += [(name, method, of[name]) for method, of in group.published.items() if name in of]
        if name in MAIN_FIELDS and group.n:
            values.append((name, OUR_METHOD, group.value(name)))
    return values


def _middle(value: Spread | Quantity) -> float | None:
    return value.mean if isinstance(value, Spread) else value.median


def _error(group: GroupRecord, reference: str, name: str, method: str, value: Spread | Quantity) -> float | None:
    """|value - mean of the reference| / mean of the reference; None of the reference itself, or without a number."""
    expected = group.published.get(reference, {}).get(name, Spread()).mean
    middle = _middle(value)
    return abs(middle - expected) / expected if middle is not None and expected and method != reference else None


def write_comparison(path: Path, result: Result) -> None:
    """Write CSV with a line for each group, quantity and method: SI, errors as fractions, empty cells for missing
    numbers. A group without any value has one line."""
    columns = ["set", "quantity", "method", "value", "std", "q05", "q95", "bound"]
    columns += [*(f"error_to_{name}" for name in _references(result)), "n_shots", "n_counted", "verdict"]
    lines = list[dict[str, Any]]()
    for group in result.groups:
        shots = group.n + group.n_failed
        facts = {"set": group.name, "n_shots": shots, "n_counted": group.n_counted, "verdict": group.verdict}
        for name, method, value in _values(group):
            line = {**facts, "quantity": MAIN_FIELDS.get(name, name), "method": method, "value": _middle(value)}
            line |= {f"error_to_{to}": _error(group, to, name, method, value) for to in _references(result)}
            lines.append({**vars(value), **line})
        lines += [] if _values(group) else [facts]
    write_rows(path, columns, lines)


def comparison_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """(heads, rows) of texts, a row for each group, quantity and method."""
    references = _references(result)
    heads = ["group", "quantity", "method", "value", *(f"error to\n{name}, %" for name in references)]
    rows = []
    for group in result.groups:
        for name, method, value in _values(group):
            symbol, factor, unit, _ = result.shown(name)
            if name not in MAIN_FIELDS:  # of a rheometer, at one angular frequency
                symbol, unit = f"µ at {name.removeprefix('viscosity_at_').removesuffix('_rad_per_s')} rad/s", "Pa s"
            words = digits.spread(value, factor) if isinstance(value, Spread) else digits.quantity(value, factor)
            errors = [digits.percent(_error(group, to, name, method, value)) for to in references]
            rows.append([group.name, f"{symbol}, {unit}", method, words, *errors])
    return heads, rows


def comparison_key(result: Result) -> str:
    """How to read the table."""
    key = f"{OUR_METHOD}: the material of all shots that count, and its 90 % interval; others: mean ± deviation."
    if references := " or ".join(_references(result)):
        key += f" Error to {references}: |value − its mean| / its mean."
    if bubbles := ", ".join(dict.fromkeys(shot.bubble_title for shot in result.curves if shot.has_answer)):
        key += f" Our answers assume the {bubbles}."
    if any(method.startswith("rheometer") for group in result.groups for method in group.published):
        key += " A rheometer measures at small strain and low rates, a bubble at large strain and 1e5/s: unequal"
        key += " values are no contradiction."
    return key


def print_comparison(result: Result) -> None:
    """Print the table and its key."""
    console = terminal.console()
    heads, rows = comparison_table(result)
    groups = ["", *(row[0] for row in rows)]
    rows = [["" if row[0] == above else row[0], *row[1:]] for above, row in zip(groups, rows, strict=False)]
    terminal.print_table(console, heads, rows, left=("quantity", "method"))
    terminal.print_text(console, comparison_key(result), style="dim")

"""The groups of a result beside published values: a table for the terminal and as CSV.

A row is a parameter of a group by all methods. Our mean is over the trusted shots that determine it; where others were
answered, too, it stands beside the mean over all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

import numpy as np

from cavirheo.posterior import Verdict
from cavirheo.reporting.answer import CurveRecord, Unit, in_unit
from cavirheo.reporting.group import OURS, GroupRecord, error_of, spread_over
from cavirheo.reporting.material import KEYS
from cavirheo.reporting.record import Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Spread, write_rows

if TYPE_CHECKING:
    from rich.table import Table

TRUSTED, ALL = f"{OURS}, trusted", f"{OURS}, all"  # how our two means are called where they differ
_WIDE = 100  # columns; below this cells have two lines
_VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


class ComparedParameter(NamedTuple):
    """A parameter of a group: name: natural, "" for a group without any. values: by method, ours under TRUSTED, ALL."""

    group: GroupRecord
    shots: Sequence[CurveRecord]
    name: str
    values: dict[str, Spread]

    @property
    def answers(self) -> list[str]:
        """What our means are called: one name where all answered shots are trusted, nothing without a recording."""
        if not self.shots or self.name not in (*KEYS, ""):
            return []
        return [OURS] if self.values[ALL].n == self.values[TRUSTED].n else [TRUSTED, ALL]

    def value(self, method: str) -> Spread:
        return self.values.get(TRUSTED if method == OURS else method, Spread())

    def error(self, reference: str, method: str) -> float | None:
        """|mean - mean of the reference| / mean of the reference."""
        return error_of(self.value(method), self.value(reference))

    @property
    def misfits(self) -> list[float | None]:
        """Median, smallest and largest RMSE over R_max of the answered shots."""
        misfits = [shot.rmse_over_rmax for shot in self.shots if shot.has_answer and shot.rmse_over_rmax is not None]
        return [float(np.median(misfits)), min(misfits), max(misfits)] if misfits else [None] * 3


class Comparison:
    """What the tables of a result have in common."""

    def __init__(self, result: Result) -> None:
        self.rows: list[ComparedParameter] = [row for shots in result.shots() for row in _rows(*shots)]
        self.methods: list[str] = list(dict.fromkeys(method for group in result.groups for method in group.published))
        self.references: list[str] = list(dict.fromkeys(method for group in result.groups for method in group.errors))
        means = [value.mean for row in self.rows if row.name == "shear_modulus" for value in row.values.values()]
        self.modulus_unit: Unit = digits.modulus_unit([0.0, *means])  # one for all rows

    def unit(self, name: str) -> Unit:
        """(factor from SI, what stands over a column)."""
        if name in KEYS:
            symbol, factor, unit = in_unit(name, self.modulus_unit)
            return factor, f"{symbol} ({unit})"
        return 1.0, name.replace("viscosity_at_", "µ at ").replace("_rad_per_s", " rad/s (Pa s)") or digits.MISSING


def _rows(group: GroupRecord, shots: Sequence[CurveRecord]) -> Iterator[ComparedParameter]:
    """One for each parameter that is published or inferred; a liquid has no G."""
    answers = [shot for shot in shots if shot.has_answer]
    inferred = [
        name for name in KEYS if group.value(name).mean is not None or any(shot.value(name).median for shot in answers)
    ]
    published = [name for values in group.published.values() for name in values]
    for name in sorted({*inferred, *published}, key=[*KEYS, *published].index) or [""]:
        values: dict[str, Spread] = {method: of[name] for method, of in group.published.items() if name in of}
        yield ComparedParameter(
            group, shots, name, values | {TRUSTED: group.value(name), ALL: spread_over(answers, name)}
        )


def remarks(group: GroupRecord, shots: Sequence[CurveRecord]) -> list[str]:
    """The material, and shots with another verdict than ok."""
    lines = [group.material.line] if group.material else []
    if counts := [f"{digits.VERDICTS[v]} {n}" for v in _VERDICTS[1:] if (n := group.verdicts.get(v))]:
        lines.append(f"of {digits.counted(len(shots), 'shot')}: {', '.join(counts)}")
    reasons = terminal.by_message((shot.name, shot.message) for shot in shots if not shot.has_answer)
    return lines + [f"{', '.join(names)}: {message}" for message, names in reasons.items()]


def print_comparison(result: Result) -> None:
    """A line for each group, parameter and method; then what is to be known of each group and of all."""
    comparison, console = Comparison(result), terminal.console()
    console.print(comparison_table(comparison, wide=console.width >= _WIDE))
    console.print(_key(comparison), style="dim")
    for group, shots in result.shots():
        terminal.print_remarks(console, {remark: [group.name] for remark in remarks(group, shots)})
    terminal.print_remarks(console, {}, result.notes)


def print_with_published(result: Result, warning: str) -> None:
    """The table and what must be known of it, below what is printed of another method."""
    console = terminal.console()
    console.print()
    console.print(comparison_table(Comparison(result), wide=console.width >= _WIDE))
    console.print(warning, style="yellow")


def comparison_table(comparison: Comparison, *, wide: bool) -> Table:
    """For the terminal."""
    heads = ["", "method", "mean ± std", *(f"error to\n{reference}, %" for reference in comparison.references)]
    heads += ["shots", "trusted", "RMSE\n% of R_max" if wide else "RMSE\n% of\nR_max"]
    table = terminal.table("set", heads, left=heads[:2], gap=int(wide))
    before = None
    for row in comparison.rows:
        factor, label = comparison.unit(row.name)
        head = ["" if row.group is before else row.group.name, label]
        shots = [f"{row.group.n} of {len(row.shots)}", str(row.group.n_trusted)] if row.answers else ["", ""]
        middle, low, high = map(digits.percent, row.misfits)
        misfit = middle if middle == digits.MISSING else f"{middle}{' ' if wide else chr(10)}({low}–{high})"
        counts = [*shots, misfit]
        for method in [method for method in row.values if method not in (TRUSTED, ALL)] + row.answers:
            texts = [*head, method, digits.spread(row.value(method), factor)]
            errors = {to: digits.percent(row.error(to, method)) for to in comparison.references if to != method}
            texts += [errors.get(to, "") for to in comparison.references]  # no method is its own reference
            ours = method in row.answers
            table.add_row(*texts, *(counts if ours else []), style="bold" if ours and method != ALL else None)
            head, counts = ["", ""], [] if ours else counts
        before = row.group
        table.add_section()
    return table


def write_csv(path: Path, result: Result) -> None:
    """One line for each group and parameter, SI, errors as fractions; empty where there is no number."""
    comparison, lines = Comparison(result), list[dict[str, Any]]()
    parts = dict.fromkeys(comparison.methods, ("mean", "std")) | dict.fromkeys((TRUSTED, ALL), ("mean", "std", "n"))
    names = {method: method.replace(", ", "_") if method in (TRUSTED, ALL) else method for method in parts}
    for row in comparison.rows:
        line: dict[str, Any] = {"set": row.group.name, "quantity": KEYS.get(row.name, row.name)}
        for method, name in names.items():
            line |= {f"{name}_{part}": getattr(row.value(method), part) for part in parts[method]}
        for to in comparison.references:
            line |= {f"{name}_error_to_{to}": row.error(to, method) for method, name in names.items() if method != to}
        line |= {"n_shots": len(row.shots), "n_answered": row.group.n}
        line |= {f"n_{verdict}": row.group.verdicts.get(verdict, 0) for verdict in _VERDICTS}
        ends = (f"rmse_over_rmax_{end}" for end in ("median", "smallest", "largest"))
        line |= zip(ends, row.misfits, strict=True)
        line |= {"models": ", ".join(row.group.models), "message": "; ".join(remarks(row.group, row.shots))}
        lines.append(line)
    write_rows(path, list(lines[0]) if lines else [], lines)


def _key(comparison: Comparison) -> str:
    words = "Mean ± standard deviation over the trusted shots that determine it. "
    if any(len(row.answers) > 1 for row in comparison.rows):
        words = f"{TRUSTED}: {words[0].lower()}{words[1:]}"
        words += f"{ALL}: over all answered shots, those with an input warning included. "
    if comparison.references:
        words += f"Error to {' or '.join(comparison.references)}: |mean − its mean| / its mean, in %. "
    words += "RMSE: measured minus simulated, % of R_max, median (smallest–largest)."
    shots = (shot for row in comparison.rows for shot in row.shots if shot.has_answer)
    bubbles = ", ".join(dict.fromkeys(shot.bubble.title for shot in shots))
    return words + (f" Our answers assume the {bubbles}." if bubbles else "")

"""The comparison as a table: for the terminal (a line per method), for papers (Markdown) and for programs (CSV)."""

from __future__ import annotations

from math import floor, log10
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.beside.published.record import Comparison, Estimate, QuantityRecord, Range, SetRecord
from cavirheo.beside.published.references import MU, OURS, G
from cavirheo.posterior import Verdict
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Spread, write_rows

if TYPE_CHECKING:
    from rich.console import Console

Units = dict[str, tuple[float, str, str]]  # quantity -> (factor from SI, symbol, unit)
_VERDICTS: tuple[Verdict, ...] = ("ok", "model_does_not_fit", "outside_training_range", "failed")


def units(comparison: Comparison) -> Units:
    """One unit of G for the whole table."""
    largest = max(
        (e.mean or 0.0 for _, row in comparison.rows() if row and row.quantity == G for _, e in row.estimates()),
        default=0.0,
    )
    return {G: (1e-3, "G", "kPa") if largest >= 1000 else (1.0, "G", "Pa"), MU: (1.0, "µ", "Pa s")}


def print_table(comparison: Comparison, console: Console | None = None) -> None:
    """One line per set, quantity and method; then what the numbers hide: other verdicts, problems, files left out."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    console = console or terminal.console()
    in_units = units(comparison)
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("set", overflow="fold")
    table.add_column("")
    table.add_column("method", overflow="fold")
    table.add_column("mean ± std", justify="right", no_wrap=True)
    for reference in comparison.reference_methods:
        table.add_column(f"error to\n{reference}, %", justify="right")
    table.add_column("shots", justify="right", no_wrap=True)
    table.add_column("ok", justify="right", no_wrap=True)
    table.add_column("RMSE\n% of R_max", justify="right", no_wrap=True)
    before = None
    for about, row in comparison.rows():
        name = "" if about is before else about.name
        head = [name, "{1} ({2})".format(*in_units[row.quantity]) if row else digits.MISSING]
        ours = [_shots(about), str(about.verdicts.get("ok", 0)), _range(about.rmse_over_rmax)]
        for method, estimate in row.estimates() if row else [(OURS, Estimate())]:
            mine = method == OURS
            errors = [error(row, reference, method) for reference in comparison.reference_methods]
            value = _value(estimate, in_units[row.quantity][0], mine) if row else digits.MISSING
            cells = [*head, method, value, *errors, *(ours if mine else [""] * 3)]
            table.add_row(*map(Text, cells), style="bold" if mine else "")
            head = ["", ""]
        before = about
        table.add_section()
    console.print(table)
    console.print(Text(_key(comparison), "dim"))
    for about in comparison.sets:
        for remark in remarks(about, in_units):
            console.print(Text("• ").append(about.name, "bold").append(": " + remark))
    for note in comparison.notes:
        console.print(Text("• " + note))


def markdown(comparison: Comparison) -> str:
    """One row per set and quantity, and how the sets were answered."""
    in_units, errors = units(comparison), comparison.errors()
    head = ["Set", "Quantity", *comparison.methods, OURS]
    head += [f"{method} to {reference}, %" for reference, method in errors]
    head += ["Shots", "ok", "RMSE, % of R_max"]
    lines = [head, ["---"] * len(head)]
    for about, row in comparison.rows():
        cells = [about.name]
        if row is None:
            cells += [digits.MISSING] * (len(comparison.methods) + 2 + len(errors))
        else:
            factor, symbol, unit = in_units[row.quantity]
            cells.append(f"{symbol} ({unit})")
            cells += [_value(row.published.get(method, Estimate()), factor, False) for method in comparison.methods]
            cells.append(_value(row.ours, factor, True))
            cells += [error(row, *pair) for pair in errors]
        cells += [_shots(about), str(about.verdicts.get("ok", 0)), _range(about.rmse_over_rmax)]
        lines.append(cells)
    parts = ["| " + " | ".join(map(_escaped, cells)) + " |" for cells in lines]
    parts += ["", _key(comparison), ""]
    for about in comparison.sets:
        settings = [f"model {about.model}", f"density {about.medium['density']:g} kg/m³"]
        settings += [
            f"{key} {value}" for key, value in about.settings.items() if key not in ("files", "density", "model")
        ]
        parts.append(f"- {_escaped(about.name)}: {'; '.join([*map(_escaped, settings + remarks(about, in_units))])}")
    parts += [f"- {_escaped(note)}" for note in comparison.notes]
    return "\n".join([*parts, "", f"cavirheo {comparison.version}, {comparison.date}: `{comparison.command}`", ""])


def write_csv(path: Path, comparison: Comparison) -> None:
    """One line per set and quantity, SI; relative errors and RMSE as fractions; empty where there is no number."""
    in_units = units(comparison)
    methods = [f"{method}_{part}" for method in comparison.methods for part in ("mean", "std")]
    errors = [f"{method}_error_to_{reference}" for reference, method in comparison.errors()]
    ours = [f"{OURS}_{part}" for part in ("mean", "std", "n", "ok_mean", "ok_std", "ok_n")]
    counts = ["n_shots", "n_answered", *(f"n_{verdict}" for verdict in _VERDICTS)]
    rmse = [f"rmse_over_rmax_{part}" for part in ("median", "smallest", "largest")]
    head = ["set", "quantity", *methods, *ours, *errors, *counts, *rmse, "model", "density", "report", "message"]
    rows = []
    for about, row in comparison.rows():
        cells: dict[str, object] = {
            "set": about.name, "n_shots": about.n_shots, "n_answered": about.n_answered, "model": about.model,
            "density": about.medium["density"], "report": about.report, "message": "; ".join(remarks(about, in_units)),
        }  # fmt: skip
        cells |= {f"n_{verdict}": about.verdicts.get(verdict, 0) for verdict in _VERDICTS}
        cells |= {f"rmse_over_rmax_{key}": value for key, value in about.rmse_over_rmax}
        if row:
            cells["quantity"] = row.quantity
            for name, value in (*row.published.items(), (OURS, row.ours), (f"{OURS}_ok", row.ours_ok)):
                cells |= {f"{name}_mean": value.mean, f"{name}_std": value.std}
            cells |= {f"{OURS}_n": row.ours.n, f"{OURS}_ok_n": row.ours_ok.n}
            for reference, of in row.relative_errors.items():
                cells |= {f"{method}_error_to_{reference}": value for method, value in of.items()}
        rows.append(cells)
    write_rows(path, head, rows)


def remarks(about: SetRecord, in_units: Units) -> list[str]:
    """What must be known of a set besides its numbers: doubtful and failed shots, problems, files left out."""
    found = []
    if counts := [f"{digits.VERDICTS[v]} {n}" for v in _VERDICTS[1:] if (n := about.verdicts.get(v))]:
        found.append(f"of {about.n_shots} shots: {', '.join(counts)}")
    if 0 < about.verdicts.get("ok", 0) < about.n_answered:
        alone = [(in_units[row.quantity], row.ours_ok) for row in about.quantities if row.ours_ok.n]
        values = [f"{symbol} {_value(value, factor, True)} {unit}" for (factor, symbol, unit), value in alone]
        found.append(f"the {about.verdicts['ok']} ok alone: {', '.join(values)}")
    reasons: dict[str, list[str]] = {}
    for shot in about.shots:
        if shot.verdict == "failed":
            reasons.setdefault(shot.message, []).append(shot.name)
    found += [f"{', '.join(names)}: {message}" for message, names in reasons.items()]
    return found + about.problems + about.notes


def error(row: QuantityRecord | None, reference: str, method: str) -> str:
    """In per cent; nothing where a method is its own reference."""
    value = row.relative_errors.get(reference, {}).get(method) if row else None
    if value is None:
        return "" if method == reference else digits.MISSING
    return f"{100 * value:.0f}" if value >= 0.0995 else digits.significant(100 * value, 2)


def _value(estimate: Estimate, factor: float, ours: bool) -> str:
    """Ours to the digits that the spread leaves; a published one as it was published."""
    if estimate.mean is None:
        return digits.MISSING
    if ours:
        return digits.spread(Spread(mean=estimate.mean, std=estimate.std), factor)
    parts = [f"{value * factor:.10g}" for value in (estimate.mean, estimate.std) if value is not None]
    places = max(len(part.partition(".")[2]) for part in parts)
    return " ± ".join(parts if any("e" in part for part in parts) else [f"{float(part):.{places}f}" for part in parts])


def _shots(about: SetRecord) -> str:
    return f"{about.n_answered} of {about.n_shots}"


def _range(value: Range) -> str:
    if value.median is None or value.smallest is None or value.largest is None:
        return digits.MISSING
    places = max(1 - floor(log10(100 * value.median)), 0) if value.median > 0 else 1
    median, smallest, largest = (f"{100 * v:.{places}f}" for v in (value.median, value.smallest, value.largest))
    return f"{median} ({smallest}–{largest})"


def _key(comparison: Comparison) -> str:
    words = "Mean ± standard deviation over the answered shots, doubtful ones (not ok) included. "
    if comparison.reference_methods:
        words += f"Error to {' or '.join(comparison.reference_methods)}: |mean − its mean| / its mean, in %. "
    return words + "RMSE: measured minus simulated, % of R_max, median (smallest–largest)."


def _escaped(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())

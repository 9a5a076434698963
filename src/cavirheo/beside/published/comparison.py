"""comparison.json: published values and ours, set by set. SI; relative errors and RMSE as fractions; null: none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.beside.published.references import MU, OURS, G, MethodValue, ReferenceSet
from cavirheo.posterior import Verdict
from cavirheo.reporting.record import CurveRecord
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Record, Spread, spread_of, write_rows

if TYPE_CHECKING:
    from rich.console import Console

TRUSTED, ALL = f"{OURS}, ok", f"{OURS}, all"  # how our two means are called where they differ


class ComparedQuantity(Record):
    """One row: a quantity of a set by all methods.

    `ours` is over all answered shots, `ours_ok` over the trusted ones (verdict ok) alone.
    `relative_errors[reference][method]` is |mean - mean of the reference| / mean of the reference, of `ours`.
    """

    quantity: str
    published: dict[str, MethodValue]
    ours: MethodValue
    ours_ok: MethodValue
    relative_errors: dict[str, dict[str, float]]

    def answers(self) -> list[tuple[str, MethodValue]]:
        """Our means with their names: over the trusted shots; where others were answered, over all, too."""
        if self.ours.n == self.ours_ok.n:
            return [(OURS, self.ours)]
        return [(TRUSTED, self.ours_ok), (ALL, self.ours)]

    def error(self, reference: str, value: MethodValue) -> float | None:
        """|mean - mean of the reference| / mean of the reference; None where one of the two is not known."""
        of = self.published.get(reference, MethodValue()).mean
        return None if of is None or value.mean is None else abs(value.mean - of) / of


class ComparedShot(Record):
    name: str
    shear_modulus_Pa: float | None
    viscosity_Pa_s: float | None
    rmse_over_rmax: float | None
    verdict: Verdict
    message: str

    @classmethod
    def of(cls, curve: CurveRecord) -> ComparedShot:
        plain = {name: getattr(curve, name) for name in ("name", "rmse_over_rmax", "verdict", "message")}
        return cls(shear_modulus_Pa=curve.shear_modulus_Pa.median, viscosity_Pa_s=curve.viscosity_Pa_s.median, **plain)


class ComparedRange(Record):
    median: float | None = None
    smallest: float | None = None
    largest: float | None = None


class ComparedSet(Record):
    """One set. `problems` are files that are missing or unreadable; `notes` what was left out on purpose."""

    name: str
    files: list[str]
    model: str
    settings: dict[str, Any]
    medium: dict[str, Any]
    report: str | None
    quantities: list[ComparedQuantity]
    n_shots: int
    n_answered: int
    verdicts: dict[str, int]
    rmse_over_rmax: ComparedRange
    shots: list[ComparedShot]
    problems: list[str]
    notes: list[str]


class Comparison(Document):
    """The document."""

    methods: list[str]
    reference_methods: list[str]
    sets: list[ComparedSet]

    @property
    def doubtful(self) -> bool:
        """Whether a mean of ours would change by leaving out shots that are answered but not trusted."""
        return any(len(row.answers()) > 1 for about in self.sets for row in about.quantities)

    def rows(self) -> Iterator[tuple[ComparedSet, ComparedQuantity | None]]:
        """Every set with each of its quantities; a set without any has one row all the same."""
        for about in self.sets:
            yield from ((about, row) for row in about.quantities)
            if not about.quantities:
                yield about, None

    def errors(self) -> list[tuple[str, str]]:
        """(reference, method) of which some set has a relative error."""
        all_errors = [row.relative_errors for about in self.sets for row in about.quantities]
        found = {(reference, method) for errors in all_errors for reference in errors for method in errors[reference]}
        return [(a, b) for a in self.reference_methods for b in (*self.methods, OURS) if (a, b) in found]


def compared_set(
    about: ReferenceSet, curves: Sequence[CurveRecord], references: Sequence[str], **found: Any
) -> ComparedSet:
    """The rows of a set from its published values and the answers to its shots; `found` are the fields left."""
    verdicts = [curve.verdict for curve in curves]
    errors = np.array([c.rmse_over_rmax for c in curves if c.answered and c.rmse_over_rmax is not None])
    spread = {"median": np.median(errors), "smallest": errors.min(), "largest": errors.max()} if errors.size else {}
    rows = [_quantity(quantity, about, curves, references) for quantity in (G, MU)]
    return ComparedSet(
        name=about.name,
        settings=about.settings,
        quantities=[row for row in rows if row.published or row.ours.mean is not None],  # a liquid has no G
        n_shots=len(curves),
        n_answered=sum(curve.answered for curve in curves),
        verdicts={verdict: verdicts.count(verdict) for verdict in dict.fromkeys(verdicts)},
        rmse_over_rmax=ComparedRange(**spread),
        shots=[ComparedShot.of(curve) for curve in curves],
        **found,
    )


def _quantity(
    quantity: str, about: ReferenceSet, curves: Sequence[CurveRecord], references: Sequence[str]
) -> ComparedQuantity:
    row = ComparedQuantity(
        quantity=quantity,
        published={method: value for (method, which), value in about.values.items() if which == quantity},
        ours=_mean([getattr(curve, quantity).median for curve in curves if curve.answered]),
        ours_ok=_mean([getattr(curve, quantity).median for curve in curves if curve.verdict == "ok"]),
        relative_errors={},
    )
    methods = {**row.published, OURS: row.ours}
    for reference in references:
        if reference in row.published:
            errors = {m: row.error(reference, value) for m, value in methods.items() if m != reference}
            row.relative_errors[reference] = {m: error for m, error in errors.items() if error is not None}
    return row


def _mean(values: list[float | None]) -> MethodValue:
    spread = spread_of(values)
    return MethodValue(mean=spread.mean, std=spread.std, n=sum(value is not None for value in values))


Units = dict[str, tuple[float, str, str]]  # quantity -> (factor from SI, symbol, unit)
_VERDICTS: tuple[Verdict, ...] = ("ok", "model_does_not_fit", "outside_training_range", "failed")


def units(comparison: Comparison) -> Units:
    """One unit of G for the whole table."""
    moduli = [row for about in comparison.sets for row in about.quantities if row.quantity == G]
    means = [value.mean for row in moduli for value in (row.ours, *row.published.values())]
    factor, unit = digits.modulus_unit([mean or 0.0 for mean in (means or [0.0])])
    return {G: (factor, "G", unit), MU: (1.0, "µ", "Pa s")}


def print_table(comparison: Comparison, console: Console | None = None) -> None:
    """One line per set, quantity and method; then what the numbers hide: other verdicts, problems, files left out."""
    from rich.text import Text

    console = console or terminal.console()
    in_units = units(comparison)
    heads = ["", "method", "mean ± std", *(f"error to\n{reference}, %" for reference in comparison.reference_methods)]
    wide = console.width >= 100
    heads += ["shots", "ok", "RMSE\n% of R_max" if wide else "RMSE\n% of\nR_max"]
    table = terminal.table("set", heads, left=heads[:2], gap=int(wide))
    for column in (table.columns[2], *table.columns[4:-3]):  # methods and errors may fold
        column.no_wrap, column.overflow, column.min_width = False, "fold", 8
    before = None
    for about, row in comparison.rows():
        head = ["" if about is before else about.name, digits.MISSING]
        ours = [cell if wide else cell.replace(" (", "\n(") for cell in _counts(about)]
        if row:
            factor, symbol, unit = in_units[row.quantity]
            head[1] = f"{symbol} ({unit})"
            for method, value in row.published.items():
                cells = [*head, method, _as_published(value, factor)]
                table.add_row(*map(Text, [*cells, *_errors(row, method, value, comparison.reference_methods)]))
                head = ["", ""]
        for name, value in row.answers() if row else [(OURS, MethodValue())]:
            errors = _errors(row, name, value, comparison.reference_methods)
            cells = [*head, name, _as_ours(value, in_units[row.quantity][0] if row else 1.0), *errors, *ours]
            table.add_row(*map(Text, cells), style="bold" if name != ALL else "")
            head, ours = ["", ""], []
        before = about
        table.add_section()
    console.print(table)
    console.print(Text(_key(comparison), "dim"))
    for about in comparison.sets:
        terminal.print_remarks(console, {remark: [about.name] for remark in remarks(about)})
    terminal.print_remarks(console, {}, comparison.notes)


def markdown(comparison: Comparison) -> str:
    """One row per set and quantity, and how the sets were answered."""
    in_units = units(comparison)
    names = [TRUSTED, ALL] if comparison.doubtful else [OURS]  # one column each for the whole table
    pairs = [(to, m) for to, method in comparison.errors() for m in (names if method == OURS else [method])]
    head = ["Set", "Quantity", *comparison.methods, *names, *(f"{method} to {to}, %" for to, method in pairs)]
    head += ["Shots", "ok", "RMSE, % of R_max"]
    lines = [head, ["---"] * len(head)]
    for about, row in comparison.rows():
        cells = [about.name]
        if row is None:
            cells += [digits.MISSING] * (len(head) - 4)
        else:
            factor, symbol, unit = in_units[row.quantity]
            values = {**row.published, **dict.fromkeys((OURS, ALL), row.ours), TRUSTED: row.ours_ok}
            cells.append(f"{symbol} ({unit})")
            cells += [_as_published(values.get(method, MethodValue()), factor) for method in comparison.methods]
            cells += [_as_ours(values[name], factor) for name in names]
            cells += [cell for to, m in pairs for cell in _errors(row, m, values.get(m, MethodValue()), [to])]
        lines.append([*cells, *_counts(about)])
    parts = ["| " + " | ".join(map(_escaped, cells)) + " |" for cells in lines]
    parts += ["", _key(comparison), ""]
    for about in comparison.sets:
        settings = [f"model {about.model}", f"density {about.medium['density']:g} kg/m³"]
        settings += [
            f"{key} {value}" for key, value in about.settings.items() if key not in ("files", "density", "model")
        ]
        parts.append(f"- {_escaped(about.name)}: {'; '.join([*map(_escaped, settings + remarks(about))])}")
    parts += [f"- {_escaped(note)}" for note in comparison.notes]
    return "\n".join([*parts, "", f"cavirheo {comparison.version}, {comparison.date}: `{comparison.command}`", ""])


def write_csv(path: Path, comparison: Comparison) -> None:
    """One line per set and quantity, SI; relative errors and RMSE as fractions; empty where there is no number."""
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
            "density": about.medium["density"], "report": about.report, "message": "; ".join(remarks(about)),
        }  # fmt: skip
        cells |= {f"n_{verdict}": about.verdicts.get(verdict, 0) for verdict in _VERDICTS}
        cells |= {f"rmse_over_rmax_{key}": value for key, value in about.rmse_over_rmax}
        if row:
            cells["quantity"] = row.quantity
            for name, value in (*row.published.items(), (OURS, row.ours), (f"{OURS}_ok", row.ours_ok)):
                cells |= {f"{name}_{part}": getattr(value, part) for part in ("mean", "std", "n")}
            for reference, of in row.relative_errors.items():
                cells |= {f"{method}_error_to_{reference}": value for method, value in of.items()}
        rows.append(cells)
    write_rows(path, head, rows)


def remarks(about: ComparedSet) -> list[str]:
    """What must be known of a set besides its numbers: doubtful and failed shots, problems, files left out."""
    found = []
    if counts := [f"{digits.VERDICTS[v]} {n}" for v in _VERDICTS[1:] if (n := about.verdicts.get(v))]:
        found.append(f"of {about.n_shots} shots: {', '.join(counts)}")
    reasons = terminal.once((shot.name, shot.message) for shot in about.shots if shot.verdict == "failed")
    found += [f"{', '.join(names)}: {message}" for message, names in reasons.items()]
    return found + about.problems + about.notes


def _errors(row: ComparedQuantity | None, method: str, value: MethodValue, references: list[str]) -> list[str]:
    """To each reference, in per cent; nothing where a method is its own reference."""
    found = []
    for reference in references:
        error = row.error(reference, value) if row and method != reference else None
        if error is None:
            found.append("" if method == reference else digits.MISSING)
        else:
            found.append(f"{100 * error:.0f}" if error >= 0.0995 else digits.significant(100 * error, 2))
    return found


def _as_ours(value: MethodValue, factor: float) -> str:
    """To the digits that the spread leaves."""
    return digits.spread(Spread(mean=value.mean, std=value.std), factor)


def _as_published(value: MethodValue, factor: float) -> str:
    """With the digits that it was published with."""
    parts = [f"{number * factor:.10g}" for number in (value.mean, value.std) if number is not None]
    places = max((len(part.partition(".")[2]) for part in parts), default=0)
    if not any("e" in part for part in parts):
        parts = [f"{float(part):.{places}f}" for part in parts]
    return " ± ".join(parts) or digits.MISSING


def _counts(about: ComparedSet) -> list[str]:
    """Answered of all shots; the trusted ones; RMSE: median (smallest–largest), % of R_max."""
    low, middle, high = (getattr(about.rmse_over_rmax, name) for name in ("smallest", "median", "largest"))
    words = digits.MISSING
    if middle is not None:
        places = max(1 - floor(log10(100 * middle)), 0) if middle > 0 else 1
        words = "{:.{places}f} ({:.{places}f}–{:.{places}f})".format(
            *(100 * v for v in (middle, low, high)), places=places
        )
    return [f"{about.n_answered} of {about.n_shots}", str(about.verdicts.get("ok", 0)), words]


def _key(comparison: Comparison) -> str:
    words = "Mean ± standard deviation over the shots with the verdict ok. "
    if comparison.doubtful:
        words = f"{TRUSTED}: mean ± standard deviation over the shots with the verdict ok. "
        words += f"{ALL}: over all answered shots, doubtful ones included. "
    if comparison.reference_methods:
        words += f"Error to {' or '.join(comparison.reference_methods)}: |mean − its mean| / its mean, in %. "
    return words + "RMSE: measured minus simulated, % of R_max, median (smallest–largest)."


def _escaped(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())

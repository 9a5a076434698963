"""comparison.json: published values and ours, set by set. SI, errors as fractions; null: none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import floor, isfinite, log10
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from cavirheo.companions.published.references import MU, NO_FILES, OURS, G, MethodValue, ReferenceSet
from cavirheo.posterior import TRUSTED, Verdict
from cavirheo.reporting.answer import CurveRecord
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Record, Spread, spread_of, write_rows

COUNTED, ALL = f"{OURS}, trusted", f"{OURS}, all"  # how our two means are called where they differ
_NATURAL = {G: "shear_modulus", MU: "viscosity"}
_VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


class ComparedQuantity(Record):
    """One row: a quantity of a set by all methods; of a set without any, a row without values.

    Attributes:
        quantity: "shear_modulus_Pa" or "viscosity_Pa_s".
        published: values by method, SI.
        ours: over all answered shots that determine it.
        ours_ok: over the trusted shots that determine it.
        relative_errors: by reference and method, |mean - mean of the reference| / that mean, of `ours`.
    """

    quantity: str = ""
    published: dict[str, MethodValue] = {}
    ours: MethodValue = MethodValue()
    ours_ok: MethodValue = MethodValue()
    relative_errors: dict[str, dict[str, float]] = {}

    def value(self, method: str) -> MethodValue:
        ours = {OURS: self.ours, ALL: self.ours, COUNTED: self.ours_ok}
        return (ours | self.published).get(method, MethodValue())

    def answers(self) -> list[str]:
        """What our means are called: over the trusted shots; where others were answered, over all, too."""
        return [OURS] if self.ours.n == self.ours_ok.n else [COUNTED, ALL]

    def error(self, reference: str, method: str) -> float | None:
        """|mean - mean of the reference| / that mean; None where one of the two is not known."""
        of, mean = self.value(reference).mean, self.value(method).mean
        return None if of is None or mean is None else abs(mean - of) / of


class ComparedShot(Record):
    """A shot of a set, in short.

    Attributes:
        name: of the curve.
        shear_modulus_Pa: G, Pa; null where the shot only bounds it.
        viscosity_Pa_s: mu, Pa s; null where the shot only bounds it.
        rmse_over_rmax: root mean square of measured minus simulated radius, over R_max.
        verdict: "ok", or what is wrong.
        message: why.
    """

    name: str
    shear_modulus_Pa: float | None
    viscosity_Pa_s: float | None
    rmse_over_rmax: float | None
    verdict: Verdict
    message: str

    @property
    def trusted(self) -> bool:
        """Whether it counts in our means."""
        return self.verdict in TRUSTED


class ComparedRange(Record):
    """A number over the shots of a set.

    Attributes:
        median: of them.
        smallest: of them.
        largest: of them.
    """

    median: float | None = None
    smallest: float | None = None
    largest: float | None = None


class ComparedSet(Record):
    """One set.

    Attributes:
        name: of the set.
        files: that were read.
        model: the network, or the fit, that answered it.
        bubbles: what our answers assume of the bubble, by name.
        settings: that the file of references gives for it.
        medium: the constants used, SI.
        report: its report.html, from the folder of the document; null where there is none.
        quantities: a row for each.
        n_shots: curves.
        n_answered: curves with an answer.
        verdicts: how many curves have each.
        rmse_over_rmax: root mean square of measured minus simulated radius, over R_max.
        shots: in short.
        problems: files missing or unreadable.
        notes: what was left out on purpose.
        material: a line of each group in its result.json, where its shots have intervals; left out where there is none.
    """

    name: str
    files: list[str]
    model: str
    bubbles: list[str] = []
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
    material: list[str] = []
    _if_any = ("material",)

    @property
    def recorded(self) -> bool:
        """Whether there are recordings of it to be answered."""
        return self.settings.get("files") != NO_FILES

    def remarks(self) -> list[str]:
        """What is to be known besides: doubtful and failed shots, problems, files left out."""
        found = [*self.material]
        if counts := [f"{digits.VERDICTS[v]} {n}" for v in _VERDICTS[1:] if (n := self.verdicts.get(v))]:
            found.append(f"of {self.n_shots} shots: {', '.join(counts)}")
        reasons = terminal.once((shot.name, shot.message) for shot in self.shots if shot.verdict == "failed")
        found += [f"{', '.join(names)}: {message}" for message, names in reasons.items()]
        return found + self.problems + self.notes


class Comparison(Document):
    """Published values and ours, set by set.

    Attributes:
        methods: in the order of the columns.
        reference_methods: those that errors are to.
        sets: one for each set.
    """

    kind: Literal["comparison"] = "comparison"
    methods: list[str]
    reference_methods: list[str]
    sets: list[ComparedSet]

    def rows(self) -> Iterator[tuple[ComparedSet, ComparedQuantity]]:
        """Every set with each of its quantities, or with a row without values."""
        return ((about, row) for about in self.sets for row in about.quantities or [ComparedQuantity()])

    @property
    def bubbles(self) -> str:
        """What our answers assume: "field's bubble"."""
        return ", ".join(dict.fromkeys(name for about in self.sets for name in about.bubbles))

    @property
    def answers(self) -> list[str]:
        """What our means are called in the whole table."""
        return max((row.answers() for _, row in self.rows()), key=len, default=[OURS])

    def errors(self) -> list[tuple[str, str]]:
        """(reference, method) of which some set has a relative error."""
        found = {(to, method) for _, row in self.rows() for to, of in row.relative_errors.items() for method in of}
        return [(to, m) for to in self.reference_methods for m in (*self.methods, OURS) if (to, m) in found]


def compared_set(
    about: ReferenceSet, curves: Sequence[CurveRecord], references: Sequence[str], **found: Any
) -> ComparedSet:
    """The rows of a set from its published values and the answers; `found` are the other fields."""
    verdicts = [curve.verdict for curve in curves]
    errors = [c.rmse_over_rmax for c in curves if c.answered and c.rmse_over_rmax is not None]
    spread = {"median": np.median(errors), "smallest": min(errors), "largest": max(errors)} if errors else {}
    rows = [_quantity(quantity, about, curves, references) for quantity in (G, MU)]
    inferred = {name for name in (G, MU) for c in curves if c.answered and getattr(c, name).median is not None}
    return ComparedSet(
        name=about.name,
        bubbles=list(dict.fromkeys(curve.bubble.title for curve in curves if curve.answered)),
        settings=about.settings,
        quantities=[row for row in rows if row.published or row.quantity in inferred],  # a liquid has no G
        n_shots=len(curves),
        n_answered=sum(curve.answered for curve in curves),
        verdicts={verdict: verdicts.count(verdict) for verdict in dict.fromkeys(verdicts)},
        rmse_over_rmax=ComparedRange(**spread),
        shots=[_shot(curve) for curve in curves],
        **found,
    )


def _shot(curve: CurveRecord) -> ComparedShot:
    plain: dict[str, Any] = {name: getattr(curve, name) for name in ComparedShot.model_fields}
    return ComparedShot(**plain | {name: curve.determined(_NATURAL[name]) for name in (G, MU)})


def _quantity(
    quantity: str, about: ReferenceSet, curves: Sequence[CurveRecord], references: Sequence[str]
) -> ComparedQuantity:
    published = {method: value for (method, which), value in about.values.items() if which == quantity}
    answered = [(c.determined(_NATURAL[quantity]), c.trusted) for c in curves if c.answered]
    ours, trusted = ([value for value, counts in answered if counts or not only] for only in (False, True))
    row = ComparedQuantity(quantity=quantity, published=published, ours=_mean(ours), ours_ok=_mean(trusted))
    for reference in references:
        if reference in published:
            errors = {m: row.error(reference, m) for m in (*published, OURS) if m != reference}
            row.relative_errors[reference] = {m: error for m, error in errors.items() if error is not None}
    return row


def _mean(values: list[float | None]) -> MethodValue:
    spread = spread_of(values)
    return MethodValue(mean=spread.mean, std=spread.std, n=sum(value is not None for value in values))


def units(comparison: Comparison) -> dict[str, tuple[float, str]]:
    """(factor from SI, what stands over a column) by quantity: one unit of G for the whole table."""
    moduli = [row for _, row in comparison.rows() if row.quantity == G]
    means = [value.mean for row in moduli for value in (row.ours, *row.published.values())]
    factor, unit = digits.modulus_unit([0.0, *means])
    return {G: (factor, f"G ({unit})"), MU: (1.0, "µ (Pa s)"), "": (1.0, digits.MISSING)}


def print_table(comparison: Comparison) -> None:
    """One line per set, quantity and method; then the remarks on each set."""
    console = terminal.console()
    wide, in_units = console.width >= 100, units(comparison)
    heads = ["", "method", "mean ± std", *(f"error to\n{reference}, %" for reference in comparison.reference_methods)]
    heads += ["shots", "trusted", "RMSE\n% of R_max" if wide else "RMSE\n% of\nR_max"]
    table = terminal.table("set", heads, left=heads[:2], gap=int(wide))
    before = None
    for about, row in comparison.rows():
        factor, label = in_units[row.quantity]
        head = ["" if about is before else about.name, label]
        counts = [cell if wide else cell.replace(" (", "\n(") for cell in _counts(about)]
        for method in (*row.published, *(row.answers() if about.recorded else [])):
            cells = [*head, method, _written(row, method, factor)]
            cells += [_error(row, reference, method) for reference in comparison.reference_methods]
            ours = method not in row.published
            table.add_row(*cells, *(counts if ours else []), style="bold" if ours and method != ALL else None)
            head, counts = ["", ""], [] if ours else counts
        before = about
        table.add_section()
    console.print(table)
    console.print(_key(comparison), style="dim")
    for about in comparison.sets:
        terminal.print_remarks(console, {remark: [about.name] for remark in about.remarks()})
    terminal.print_remarks(console, {}, comparison.notes)


def markdown(comparison: Comparison) -> str:
    """One row per set and quantity, and how the sets were answered."""
    in_units, names = units(comparison), comparison.answers
    methods = [*comparison.methods, *names]
    pairs = [(to, m) for to, method in comparison.errors() for m in (names if method == OURS else [method])]
    head = ["Set", "Quantity", *methods, *(f"{method} to {to}, %" for to, method in pairs)]
    head += ["Shots", "trusted", "RMSE, % of R_max"]
    lines = [head, ["---"] * len(head)]
    for about, row in comparison.rows():
        factor, label = in_units[row.quantity]
        values = [_written(row, method, factor) for method in methods]
        lines.append([about.name, label, *values, *(_error(row, to, m) for to, m in pairs), *_counts(about)])
    parts = ["| " + " | ".join(map(_escaped, cells)) + " |" for cells in lines]
    parts += ["", _key(comparison), ""]
    for about in comparison.sets:
        others = {key: value for key, value in about.settings.items() if key not in ("files", "density", "model")}
        messages = [f"model {about.model}", f"density {about.medium['density']:g} kg/m³"] if about.recorded else []
        messages += [*(f"{key} {value}" for key, value in others.items()), *about.remarks()]
        parts.append(f"- {_escaped(about.name)}: {'; '.join(map(_escaped, messages))}")
    parts += [f"- {_escaped(note)}" for note in comparison.notes]
    return "\n".join([*parts, "", f"cavirheo {comparison.version}, {comparison.date}: `{comparison.command}`", ""])


def write_csv(path: Path, comparison: Comparison) -> None:
    """One line per set and quantity, SI, errors as fractions; empty where there is no number."""
    head = ["set", "quantity", *(f"{method}_{part}" for method in comparison.methods for part in ("mean", "std"))]
    head += [f"{OURS}_{part}" for part in ("mean", "std", "n", "ok_mean", "ok_std", "ok_n")]
    head += [f"{method}_error_to_{reference}" for reference, method in comparison.errors()]
    head += ["n_shots", "n_answered", *(f"n_{verdict}" for verdict in _VERDICTS)]
    head += [*(f"rmse_over_rmax_{part}" for part in ComparedRange.model_fields), "model", "density", "report"]
    rows = []
    for about, row in comparison.rows():
        cells = dict(about) | {"set": about.name, "quantity": row.quantity, "density": about.medium["density"]}
        cells |= {f"n_{verdict}": about.verdicts.get(verdict, 0) for verdict in _VERDICTS}
        cells |= {f"rmse_over_rmax_{part}": value for part, value in about.rmse_over_rmax}
        for name, value in {**row.published, OURS: row.ours, f"{OURS}_ok": row.ours_ok}.items():
            cells |= {f"{name}_{part}": number for part, number in value}
        for reference, of in row.relative_errors.items():
            cells |= {f"{method}_error_to_{reference}": error for method, error in of.items()}
        rows.append(cells | {"message": "; ".join(about.remarks())})
    write_rows(path, [*head, "message"], rows)


def _error(row: ComparedQuantity, reference: str, method: str) -> str:
    """In per cent; nothing where a method is its own reference."""
    error = row.error(reference, method)
    if method == reference or error is None:
        return "" if method == reference else digits.MISSING
    return f"{100 * error:.0f}" if error >= 0.0995 else digits.significant(100 * error, 2)


def _written(row: ComparedQuantity, method: str, factor: float) -> str:
    """With the digits that it was published with; ours to those that the spread leaves."""
    value = row.value(method)
    if method not in row.published:
        return digits.spread(Spread(mean=value.mean, std=value.std), factor)
    parts = [f"{number * factor:.10g}" for number in (value.mean, value.std) if number is not None]
    places = max((len(part.partition(".")[2]) for part in parts), default=0)
    if not any("e" in part for part in parts):
        parts = [f"{float(part):.{places}f}" for part in parts]
    return " ± ".join(parts)


def _counts(about: ComparedSet) -> list[str]:
    """Answered of all shots; the trusted ones; RMSE: median (smallest–largest), % of R_max."""
    spread = [100 * value for _, value in about.rmse_over_rmax if value is not None]
    words = digits.MISSING
    if len(spread) == 3 and all(map(isfinite, spread)):
        places = max(1 - floor(log10(spread[0])), 0) if spread[0] > 0 else 1
        middle, low, high = (f"{value:.{places}f}" for value in spread)
        words = f"{middle} ({low}–{high})"
    trusted = str(sum(shot.trusted for shot in about.shots))
    shots = [f"{about.n_answered} of {about.n_shots}", trusted] if about.recorded else ["", ""]
    return [*shots, words]


def _key(comparison: Comparison) -> str:
    words = "Mean ± standard deviation over the trusted shots that determine it. "
    if len(comparison.answers) > 1:
        words = f"{COUNTED}: {words[0].lower()}{words[1:]}"
        words += f"{ALL}: over all answered shots, doubtful ones included. "
    if comparison.reference_methods:
        words += f"Error to {' or '.join(comparison.reference_methods)}: |mean − its mean| / its mean, in %. "
    words += "RMSE: measured minus simulated, % of R_max, median (smallest–largest)."
    return words + (f" Our answers assume the {comparison.bubbles}." if comparison.bubbles else "")


def _escaped(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())

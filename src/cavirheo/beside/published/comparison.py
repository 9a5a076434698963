"""comparison.json: published values and ours, set by set. SI; relative errors and RMSE as fractions; null: none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cavirheo.beside.published.references import MU, OURS, G, MethodValue, ReferenceSet
from cavirheo.posterior import Verdict
from cavirheo.reporting.record import CurveRecord
from cavirheo.writing.document import Document, Model, spread_of

TRUSTED, ALL = f"{OURS}, ok", f"{OURS}, all"  # how our two means are called where they differ


class ComparedQuantity(Model):
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


class ComparedShot(Model):
    name: str
    shear_modulus_Pa: float | None
    viscosity_Pa_s: float | None
    rmse_over_rmax: float | None
    verdict: Verdict
    message: str


class ComparedRange(Model):
    median: float | None = None
    smallest: float | None = None
    largest: float | None = None


class ComparedSet(Model):
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
        shots=[
            ComparedShot(
                name=curve.name,
                shear_modulus_Pa=curve.shear_modulus_Pa.median,
                viscosity_Pa_s=curve.viscosity_Pa_s.median,
                rmse_over_rmax=curve.rmse_over_rmax,
                verdict=curve.verdict,
                message=curve.message,
            )
            for curve in curves
        ],
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

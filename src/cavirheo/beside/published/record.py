"""comparison.json: published values and ours, set by set. SI; relative errors and RMSE as fractions; null: none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cavirheo.beside.published.references import MU, OURS, G, ReferenceSet
from cavirheo.posterior import Verdict
from cavirheo.reporting.record import CurveRecord
from cavirheo.writing.document import Document, Model, Spread, spread_of

QUANTITIES = (G, MU)


class Estimate(Model):
    """What one method says of one quantity: published, or the mean ± standard deviation over our n shots."""

    mean: float | None = None
    std: float | None = None
    n: int | None = None
    source: str = ""


class QuantityRecord(Model):
    """One row: a quantity of a set by all methods.

    `ours_ok` is over the shots with the verdict ok alone. `relative_errors[reference][method]` is |mean - mean of the
    reference| / mean of the reference.
    """

    quantity: str
    published: dict[str, Estimate]
    ours: Estimate
    ours_ok: Estimate
    relative_errors: dict[str, dict[str, float]]

    def estimates(self) -> Iterator[tuple[str, Estimate]]:
        yield from self.published.items()
        yield OURS, self.ours


class Shot(Model):
    name: str
    shear_modulus_Pa: float | None
    viscosity_Pa_s: float | None
    rmse_over_rmax: float | None
    verdict: Verdict
    message: str


class Range(Model):
    median: float | None = None
    smallest: float | None = None
    largest: float | None = None


class SetRecord(Model):
    """One set. `problems` are files that are missing or unreadable; `notes` what was left out on purpose."""

    name: str
    files: list[str]
    model: str
    settings: dict[str, Any]
    medium: dict[str, Any]
    report: str | None
    quantities: list[QuantityRecord]
    n_shots: int
    n_answered: int
    verdicts: dict[str, int]
    rmse_over_rmax: Range
    shots: list[Shot]
    problems: list[str]
    notes: list[str]


class Comparison(Document):
    """The document."""

    methods: list[str]
    reference_methods: list[str]
    sets: list[SetRecord]

    def rows(self) -> Iterator[tuple[SetRecord, QuantityRecord | None]]:
        """Every set with each of its quantities; a set without any has one row all the same."""
        for about in self.sets:
            yield from ((about, row) for row in about.quantities)
            if not about.quantities:
                yield about, None

    def errors(self) -> list[tuple[str, str]]:
        """(reference, method) of which some set has a relative error."""
        found = {
            (reference, method)
            for about in self.sets
            for row in about.quantities
            for reference, errors in row.relative_errors.items()
            for method in errors
        }
        return [(a, b) for a in self.reference_methods for b in (*self.methods, OURS) if (a, b) in found]


def set_record(
    about: ReferenceSet, curves: Sequence[CurveRecord], references: Sequence[str], **found: Any
) -> SetRecord:
    """The rows of a set from its published values and the answers to its shots; `found` are the fields left."""
    answered = [curve for curve in curves if curve.answered]
    verdicts = [curve.verdict for curve in curves]
    errors = np.array([c.rmse_over_rmax for c in answered if c.rmse_over_rmax is not None])
    return SetRecord(
        name=about.name,
        settings=about.settings,
        quantities=[
            row for quantity in QUANTITIES if (row := _quantity(quantity, about, answered, references)) is not None
        ],
        n_shots=len(curves),
        n_answered=len(answered),
        verdicts={verdict: verdicts.count(verdict) for verdict in dict.fromkeys(verdicts)},
        rmse_over_rmax=Range(median=np.median(errors), smallest=errors.min(), largest=errors.max())
        if errors.size
        else Range(),
        shots=[
            Shot(
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
    quantity: str, about: ReferenceSet, answered: Sequence[CurveRecord], references: Sequence[str]
) -> QuantityRecord | None:
    """None if nobody has a value: a Newtonian liquid has no G."""
    published = {
        method: Estimate(mean=value.mean, std=value.std, source=value.source)
        for (method, which), value in about.values.items()
        if which == quantity
    }
    ours = _estimate([getattr(curve, quantity).median for curve in answered])
    if not published and ours.mean is None:
        return None
    means = {**{method: value.mean for method, value in published.items()}, OURS: ours.mean}
    errors = {
        reference: {m: abs(mean - of) / of for m, mean in means.items() if mean is not None and m != reference}
        for reference in references
        if (of := means.get(reference)) is not None
    }
    return QuantityRecord(
        quantity=quantity,
        published=published,
        ours=ours,
        ours_ok=_estimate([getattr(curve, quantity).median for curve in answered if curve.verdict == "ok"]),
        relative_errors=errors,
    )


def _estimate(values: list[float | None]) -> Estimate:
    spread: Spread = spread_of(values)
    return Estimate(mean=spread.mean, std=spread.std, n=sum(value is not None for value in values))

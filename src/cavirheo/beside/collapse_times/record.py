"""collapse-time.json (schema 1): what collapse times say of each material; and shots.csv, a line per shot.

```
schema 1, version, command, date, notes      as in result.json
material, medium                             the law; the constants used
groups                                       one per table, or per file or folder of curves:
  name, source, source_sha256, n, unusable   shots, and how many of them could not be used (their `message` says why)
  analytic, exact                            the answers below; exact is null unless it was asked for
  shots                                      R_max, lambda, t_1 and t_1/t_RC as measured and of the models
```
Every number is SI and finite, or null where it was not found; `message` then says why.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.beside.collapse_times.read import Group
from cavirheo.inference.collapse_time import Estimate
from cavirheo.physics.media import Medium
from cavirheo.writing import digits
from cavirheo.writing.document import Document, Model, write_rows

Answers = tuple[Estimate | None, Estimate | None]  # analytic and exact


class Value(Model):
    """`low`, `high`: 95 % interval from the scatter of the shots; `per_percent`: change if all t_1 were 1 % longer."""

    value: float | None = None
    low: float | None = None
    high: float | None = None
    per_percent: float | None = None


class Fit(Model):
    shear_modulus_Pa: Value
    viscosity_Pa_s: Value
    correlation: float | None = None
    scatter: float | None = None  # standard deviation of ln(t_1/t_model)
    identified: bool
    at_bound: list[str] = []
    downweighted: list[str] = []  # shots that count less than half
    pairs: list[tuple[float, float]] = []  # equally good G in Pa and mu in Pa s
    message: str = ""


class Shot(Model):
    name: str
    max_radius_m: float | None = None
    stretch: float | None = None
    stretch_from: str = ""
    collapse_time_s: float | None = None
    measured: float | None = None  # t_1/t_RC
    analytic: float | None = None
    exact: float | None = None
    message: str = ""


class GroupRecord(Model):
    name: str
    source: str
    source_sha256: str
    n: int
    unusable: int
    notes: list[str] = []
    analytic: Fit | None = None
    exact: Fit | None = None
    shots: list[Shot]

    @property
    def answered(self) -> bool:
        """Whether there is a number for all that was asked."""
        best = self.exact or self.analytic
        return best is not None and best.shear_modulus_Pa.value is not None and best.viscosity_Pa_s.value is not None


class CollapseTimes(Document):
    """The document."""

    material: str
    medium: dict[str, Any]
    groups: list[GroupRecord]

    @property
    def modulus_unit(self) -> tuple[float, str]:
        """(factor from Pa, its name) of G in all tables and pictures of this document."""
        fits = [fit for group in self.groups for fit in (group.analytic, group.exact) if fit]
        return digits.modulus_unit(fit.shear_modulus_Pa.value for fit in fits if fit.shear_modulus_Pa.value)


def collapse_times(
    groups: Sequence[Group],
    answers: Sequence[Answers],
    *,
    material: str,
    medium: Medium,
    command: str,
    date: str,
    notes: Sequence[str] = (),
) -> CollapseTimes:
    """The document of groups and their answers (None where a group has no shot that can be used)."""
    return CollapseTimes(
        command=command,
        date=date,
        notes=list(notes),
        material=material,
        medium=asdict(medium),
        groups=[_group(group, *pair) for group, pair in zip(groups, answers, strict=True)],
    )


def _group(group: Group, analytic: Estimate | None, exact: Estimate | None) -> GroupRecord:
    shots, k = [], 0
    for row in group.rows:
        shot = Shot(
            name=row.name,
            max_radius_m=_finite(row.max_radius),
            stretch=_finite(row.stretch),
            stretch_from=row.stretch_from,
            collapse_time_s=_finite(row.time),
            message=row.message,
        )
        if not row.message and analytic is not None:
            shot.measured, shot.analytic = _finite(analytic.measured[k]), _finite(analytic.model[k])
            shot.exact = None if exact is None else _finite(exact.model[k])
            k += 1
        shots.append(shot)
    names = [row.name for row in group.usable]
    return GroupRecord(
        name=group.name,
        source=group.source,
        source_sha256=group.sha256,
        n=len(group.rows),
        unusable=len(group.rows) - len(names),
        notes=group.notes,
        analytic=None if analytic is None else _fit(analytic, names),
        exact=None if exact is None else _fit(exact, names),
        shots=shots,
    )


def _fit(found: Estimate, names: Sequence[str]) -> Fit:
    def value(k: int, of: float, interval: tuple[float, float]) -> Value:
        ends = {"low": _finite(interval[0]), "high": _finite(interval[1])}
        return Value(value=_finite(of), **ends, per_percent=_finite(found.per_percent[k]))

    spread = float(np.sqrt(np.prod(np.diag(found.covariance))))
    return Fit(
        shear_modulus_Pa=value(0, found.shear_modulus, found.shear_modulus_interval),
        viscosity_Pa_s=value(1, found.viscosity, found.viscosity_interval),
        correlation=_finite(found.covariance[0, 1] / spread) if spread > 0 else None,
        scatter=_finite(found.scatter),
        identified=found.identified,
        at_bound=list(found.at_bound),
        downweighted=[name for name, weight in zip(names, found.weight, strict=True) if weight < 0.5],
        pairs=[(float(G), float(mu)) for G, mu in found.pairs],
        message=found.message,
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def write_csv(path: Path, document: CollapseTimes) -> None:
    """One line per shot of every group."""
    rows = ({"group": group.name, **shot.model_dump()} for group in document.groups for shot in group.shots)
    write_rows(path, ["group", *Shot.model_fields], rows)

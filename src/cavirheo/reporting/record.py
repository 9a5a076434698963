"""result.json: the answers as a document that other programs read (schema 1), and back.

Every number is SI and finite, or null: a method without an interval has null q05 and q95, a curve without an answer
has null everywhere and says why in `message`. Means of a group are over its trusted curves, those with verdict ok.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import model_validator
from pydantic_core import to_jsonable_python

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Checks, Diagnostics, Evidence, Posterior, Verdict, WindowAnswer
from cavirheo.writing import digits, document
from cavirheo.writing.document import Document, Finite, Quantity, Record, Spread, finite, spread_of

Pairs = Sequence[tuple[RadiusCurve, Posterior]]

_DIFFERENCES = ("rmse_over_rmax", "mae_over_rmax", "max_difference_over_rmax")


class Compared(Record):
    """The window: from R_max to t_star_end (t/t_c), holding so many complete collapses."""

    collapses: int | None = None
    t_star_end: Finite = None

    @property
    def words(self) -> str:
        """'3 collapses, t* ≤ 3.1'."""
        words = [] if self.collapses is None else [digits.counted(self.collapses, "collapse")]
        words += [] if self.t_star_end is None else [f"t* ≤ {digits.significant(self.t_star_end, 2)}"]
        return ", ".join(words) or digits.MISSING


class CurveRecord(Record):
    """One row. `other_parameters` holds what was inferred besides G, mu and the stretch, in SI.

    `windows`, `evidence` and `diagnostics` are those of the Posterior; `provenance` is for people alone.
    """

    name: str
    source: str
    group: str
    group_source: str  # the file or folder whose shots form the group
    max_radius_m: Finite
    time_of_max_s: Finite
    strain_rate_per_s: Finite
    stretch: Quantity
    material: str
    contents: str = "equilibrium"
    method: str
    shear_modulus_Pa: Quantity
    viscosity_Pa_s: Quantity
    other_parameters: dict[str, Quantity] = {}
    rmse_over_rmax: Finite
    mae_over_rmax: Finite
    max_difference_over_rmax: Finite
    window: Compared
    verdict: Verdict
    message: str
    notes: list[str]
    seconds: float
    windows: dict[str, WindowAnswer] = {}
    evidence: Evidence | None = None
    diagnostics: Diagnostics = Diagnostics()
    provenance: dict[str, Any]

    @property
    def answered(self) -> bool:
        return self.verdict != "failed"

    @property
    def trusted(self) -> bool:
        return self.verdict == "ok"


class GroupRecord(Record):
    """The shots of one file: n answered, n_failed not; `verdicts` counts the curves with each.

    Means are over the n_trusted with verdict ok; null in documents of before, whose means are over all n.
    """

    name: str
    n: int
    n_trusted: int | None = None
    n_failed: int
    shear_modulus_Pa: Spread
    viscosity_Pa_s: Spread
    verdicts: dict[str, int]

    @property
    def shots(self) -> str:
        """'5 shots, 1 failed'."""
        return digits.counted(self.n, "shot") + (f", {self.n_failed} failed" if self.n_failed else "")

    @property
    def basis(self) -> str:
        """'mean of 3 trusted of 5 answered'; nothing where all that were answered are trusted."""
        if self.n_trusted is None or self.n_trusted == self.n:
            return ""
        return f"{f'mean of {self.n_trusted}' if self.n_trusted else 'no mean: none'} trusted of {self.n} answered"


class Result(Document):
    """The document."""

    curves: list[CurveRecord]
    groups: list[GroupRecord]

    @model_validator(mode="after")
    def _each_curve_in_a_group(self) -> Result:
        if len(self.groups) != len(_members(self.curves)):
            raise ValueError("its groups are not those of its curves")
        return self

    @property
    def modulus_unit(self) -> tuple[float, str]:
        """(factor from Pa, its name) of G in all tables and pictures of this document."""
        return digits.modulus_unit(curve.shear_modulus_Pa.median for curve in self.curves)

    def members(self) -> list[tuple[GroupRecord, list[int]]]:
        """Each group with the indices of its curves."""
        return list(zip(self.groups, _members(self.curves).values(), strict=True))


def result(pairs: Pairs, command: str, *, date: str | None = None, notes: Sequence[str] = ()) -> Result:
    """The record of all curves and of their groups (the files they came from), in the order given."""
    curves = [curve_record(curve, posterior) for curve, posterior in pairs]
    members = _members(curves)
    stems = [group for group, _ in members]
    groups = [
        _group(group if stems.count(group) == 1 or not source else source, [curves[i] for i in indices])
        for (group, source), indices in members.items()
    ]
    return Result(command=command, date=date, notes=list(notes), curves=curves, groups=groups)


def read_json(path: str | Path) -> Result:
    """A result.json as it was written. Raises InputError if there is none or it is not one of ours."""
    return document.read_json(path, Result)


def curve_record(curve: RadiusCurve, posterior: Posterior) -> CurveRecord:
    """The row of one curve."""
    verdict, message = posterior.checks.verdict, posterior.checks.message.removeprefix(f"{curve.name}:").lstrip()
    if verdict != "failed":  # an answer that is none must not pass for one, whatever the method says of itself
        draws = zip(posterior.names, posterior.theta.T, strict=True)
        broken = [name for name, values in draws if not np.all(np.isfinite(values))]
        if broken:
            said = f"the method's answer is not a finite number: {', '.join(broken)}"
            message = f"{said}; {message}" if message else said
        if broken or not posterior.theta.size:
            verdict = "failed"
    answered = verdict != "failed"
    checks = posterior.checks if answered else Checks("failed")

    def quantity(name: str) -> Quantity:
        if not answered or name not in posterior.parameters:
            return Quantity()
        low, high = posterior.interval(name) or (None, None)
        return Quantity(median=posterior.median(name), q05=low, q95=high)

    values = {name: quantity(name) for name in ("shear_modulus", "viscosity", "stretch", *posterior.parameters)}
    G, mu, stretch = (values.pop(name) for name in ("shear_modulus", "viscosity", "stretch"))
    if answered and stretch.median is None:  # not the network's own, but fitted after it or given
        stretch = Quantity(median=finite(posterior.stretch))
    return CurveRecord(
        **{name: getattr(curve, name) for name in ("name", "source", "group", "group_source")},
        **{name: getattr(checks, name) for name in _DIFFERENCES},
        max_radius_m=_measured(curve, "max_radius"), time_of_max_s=_measured(curve, "time_of_max"),
        strain_rate_per_s=_measured(curve, "strain_rate"), material=posterior.material, method=posterior.method,
        contents=posterior.bubble.contents,
        stretch=stretch, shear_modulus_Pa=G, viscosity_Pa_s=mu, other_parameters=values,
        window=Compared(collapses=checks.collapses, t_star_end=checks.t_star_end),
        verdict=verdict, message=message or ("" if answered else "no parameters were found"), notes=list(curve.notes),
        seconds=finite(posterior.seconds) or 0.0, evidence=posterior.evidence,
        windows={key: _known(window) for key, window in posterior.windows.items()},
        diagnostics=_known(posterior.diagnostics), provenance=_plain(posterior.provenance),
    )  # fmt: skip


def _members(curves: Sequence[CurveRecord]) -> dict[tuple[str, str], list[int]]:
    """Indices of the curves of each group; two files of one name in different folders are two groups."""
    found: dict[tuple[str, str], list[int]] = {}
    for index, record in enumerate(curves):
        found.setdefault((record.group, record.group_source), []).append(index)
    return found


def _group(name: str, members: list[CurveRecord]) -> GroupRecord:
    """The mean over the trusted curves, and how many have which verdict."""
    trusted = [record for record in members if record.trusted]
    n = sum(record.answered for record in members)
    return GroupRecord(
        name=name, n=n, n_trusted=len(trusted), n_failed=len(members) - n,
        shear_modulus_Pa=spread_of([record.shear_modulus_Pa.median for record in trusted]),
        viscosity_Pa_s=spread_of([record.viscosity_Pa_s.median for record in trusted]),
        verdicts=dict(Counter(record.verdict for record in members)),
    )  # fmt: skip


def _measured(curve: RadiusCurve, name: str) -> float | None:
    """A number that the curve itself gives, null where it says that it cannot be determined."""
    with suppress(InputError):
        value = getattr(curve, name)
        return value() if callable(value) else value
    return None


def _known(fields: Any) -> Any:
    """A dataclass as JSON can hold it, without the entries of its mappings that are no numbers."""
    return {
        name: {key: item for key, item in value.items() if item is not None} if isinstance(value, dict) else value
        for name, value in _plain(fields).items()
    }


def _plain(value: Any) -> Any:
    """As JSON can hold it: arrays as lists, NaN as null, what is not data as its text."""
    return to_jsonable_python(value, inf_nan_mode="null", fallback=lambda v: getattr(v, "tolist", v.__str__)())

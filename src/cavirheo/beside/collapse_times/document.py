"""collapse-time.json (schema 1): what collapse times say of each material; and shots.csv, a line per shot.

```
schema 1, version, command, date, notes      as in result.json
material, medium                             the law; the constants used
groups                                       one per table, or per file or folder of curves:
  name, source, source_sha256, n, unusable   shots, and how many of them could not be used (their `message` says why)
  analytic, exact                            the answers (CollapseEstimate); exact is null unless it was asked for
  shots                                      R_max, lambda, t_1 and t_1/t_RC as measured and of the models
```
Every number is SI and finite, or null where it was not found; `message` then says why.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.errors import SolverError
from cavirheo.inference.collapse_time import CollapseEstimate, Shots, estimate
from cavirheo.writing import digits
from cavirheo.writing.document import Document, Finite, Model, write_rows


class CollapseShot(Model):
    """One shot. `message`: why it cannot be used, empty if it can."""

    name: str
    max_radius_m: Finite = None
    stretch: Finite = None
    stretch_from: str = ""
    collapse_time_s: Finite = None
    measured: Finite = None  # t_1/t_RC
    analytic: Finite = None
    exact: Finite = None
    message: str = ""


class CollapseGroup(Model):
    """The shots of one material: a table, or curves of one file or folder; and what they say, once asked."""

    name: str
    source: str
    source_sha256: str
    n: int
    unusable: int
    notes: list[str] = []
    analytic: CollapseEstimate | None = None
    exact: CollapseEstimate | None = None
    shots: list[CollapseShot]

    @property
    def usable(self) -> list[CollapseShot]:
        return [shot for shot in self.shots if not shot.message]

    @property
    def best(self) -> CollapseEstimate | None:
        """The exact answer where there is one."""
        return self.exact or self.analytic

    def estimates(self) -> list[tuple[str, CollapseEstimate]]:
        """Each answer with its name."""
        pairs = (("analytic", self.analytic), ("exact", self.exact))
        return [(name, estimate) for name, estimate in pairs if estimate is not None]

    def answer(self, material: str, *, exact: bool = False, **options: Any) -> None:
        """Estimate G and mu from the shots that can be used, if there are any; `options` are those of `estimate`.

        A simulation that fails leaves no exact answer, and a note.
        """
        if not self.usable:
            return
        radius, stretch, time = (
            np.array([getattr(shot, name) for shot in self.usable])
            for name in ("max_radius_m", "stretch", "collapse_time_s")
        )
        shots = Shots(radius, stretch, time, [shot.name for shot in self.usable])
        self.analytic = estimate(shots, material, **options)
        try:
            self.exact = estimate(shots, material, exact=True, **options) if exact else None
        except SolverError as error:
            self.notes.append(f"no exact answer: {error}")
        for k, shot in enumerate(self.usable):
            shot.measured, shot.analytic = self.analytic.measured[k], self.analytic.model[k]
            shot.exact = self.exact.model[k] if self.exact else None


class CollapseTimes(Document):
    """The document."""

    material: str
    medium: dict[str, Any]
    groups: list[CollapseGroup]

    @property
    def modulus_unit(self) -> tuple[float, str]:
        """(factor from Pa, its name) of G in all tables and pictures of this document."""
        found = [estimate.shear_modulus_Pa.value for group in self.groups for _, estimate in group.estimates()]
        return digits.modulus_unit(value for value in found if value)


def write_csv(path: Path, document: CollapseTimes) -> None:
    """One line per shot of every group."""
    rows = ({"group": group.name, **shot.model_dump()} for group in document.groups for shot in group.shots)
    write_rows(path, ["group", *CollapseShot.model_fields], rows)

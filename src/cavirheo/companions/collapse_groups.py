"""The shots of one material with their collapse times, and what these say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cavirheo.errors import SolverError
from cavirheo.inference.collapse_time import CollapseEstimate, Shots, estimate
from cavirheo.writing.document import Finite, Record

MEASURED = {"R_max": "max_radius_m", "lambda": "stretch", "t_1": "collapse_time_s"}  # column: field of a shot


class CollapseShot(Record):
    """One shot.

    Attributes:
        name: of the shot.
        max_radius_m: R_max, m.
        stretch: lambda = R_max/R_0.
        stretch_from: where lambda comes from.
        collapse_time_s: t_1, from R_max to the first minimum, s.
        measured: t_1/t_RC.
        analytic: t_1/t_RC of the analytic model.
        exact: t_1/t_RC of the simulation.
        message: why it cannot be used, empty if it can.
    """

    name: str
    max_radius_m: Finite = None
    stretch: Finite = None
    stretch_from: str = ""
    collapse_time_s: Finite = None
    measured: Finite = None
    analytic: Finite = None
    exact: Finite = None
    message: str = ""

    @classmethod
    def of(cls, name: str, values: Sequence[float], origin: str, message: str = "") -> CollapseShot:
        """From R_max, lambda and t_1 in SI, and where lambda comes from."""
        fields: Any = dict(zip(MEASURED.values(), values, strict=True))
        return cls(name=name, stretch_from=origin, message=message, **fields)


class CollapseGroup(Record):
    """The shots of one material and what they say.

    Attributes:
        name: of the table, or of the file or folder of curves.
        source: this file or folder.
        source_sha256: its SHA-256.
        n: shots.
        unusable: how many of them could not be used; their `message` says why.
        notes: on the group as a whole.
        doubts: about the recordings and their settings.
        analytic: answer of the analytic model.
        exact: answer with simulated collapse times; null unless it was asked for.
        shots: R_max, lambda, t_1 and t_1/t_RC of each.
    """

    name: str
    source: str
    source_sha256: str
    n: int = 0
    unusable: int = 0
    notes: list[str] = []
    doubts: list[str] = []
    analytic: CollapseEstimate | None = None
    exact: CollapseEstimate | None = None
    shots: list[CollapseShot]

    def model_post_init(self, _: Any) -> None:
        self.n, self.unusable = len(self.shots), len(self.shots) - len(self.usable)

    @property
    def usable(self) -> list[CollapseShot]:
        return [shot for shot in self.shots if not shot.message]

    @property
    def best(self) -> CollapseEstimate | None:
        """The exact answer where there is one."""
        return self.exact or self.analytic

    def columns(self) -> list[np.ndarray]:
        """R_max, lambda and t_1 of the shots that can be used, each (n,), SI."""
        return [np.array([getattr(shot, field) for shot in self.usable]) for field in MEASURED.values()]

    def estimates(self) -> dict[str, CollapseEstimate]:
        """The answers by model."""
        return {name: found for name in ("analytic", "exact") if (found := getattr(self, name))}

    def answer(self, material: str, *, exact: bool = False, **options: Any) -> None:
        """Estimate G and mu from the usable shots, if any; `options` are those of `estimate`.

        A simulation that fails leaves no exact answer, and a note.
        """
        if not self.usable:
            return
        radius, stretch, time = self.columns()
        shots = Shots(radius, stretch, time, [one.name for one in self.usable])
        self.analytic = estimate(shots, material, **options)
        try:
            self.exact = estimate(shots, material, exact=True, **options) if exact else None
        except SolverError as error:
            self.notes.append(f"no exact answer: {error}")
        for k, one in enumerate(self.usable):
            one.measured, one.analytic = self.analytic.measured[k], self.analytic.model[k]
            one.exact = self.exact.model[k] if self.exact else None

"""An analysis whose answers are known, for tests of what is done with answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.inference.analysis import Analysis
from cavirheo.posterior import Posterior


@dataclass(frozen=True)
class KnownAnalysis(Analysis):
    """`of(curve)` is the answer, or `of(curve, begun)` where it begins with another."""

    of: Callable[..., Posterior] | None = None

    def answer(self, curve: RadiusCurve, begun: Posterior | None = None, **_: Any) -> Posterior:
        assert self.of
        return self.of(curve) if begun is None else self.of(curve, begun)

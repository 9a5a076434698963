"""`fit` and `fit_many` as tests call them: of the contents that are asked for alone, which takes half the time."""

from __future__ import annotations

from typing import Any

import cavirheo
from cavirheo import Posterior, RadiusCurve


def fit(curve: RadiusCurve, *args: Any, **options: Any) -> Posterior:
    return cavirheo.fit(curve, *args, **{"others": False, **options})


def fit_many(curves: list[RadiusCurve], *args: Any, **options: Any) -> list[Posterior]:
    return cavirheo.fit_many(curves, *args, **{"others": False, **options})

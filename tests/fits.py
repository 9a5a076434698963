"""`fit` and `fit_many` as tests call them: of the field's bubble alone, with which their shots are simulated."""

from typing import Any

import cavirheo
from cavirheo import Posterior, RadiusCurve


def fit(curve: RadiusCurve, *args: Any, **options: Any) -> Posterior:
    return cavirheo.fit(curve, *args, **{"others": False, "bubble": "field", **options})


def fit_many(curves: list[RadiusCurve], *args: Any, **options: Any) -> list[Posterior]:
    return cavirheo.fit_many(curves, *args, **{"others": False, "bubble": "field", **options})

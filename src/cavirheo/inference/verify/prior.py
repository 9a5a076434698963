"""The prior of one shot's parameters, in the order and the units of a fit (fit/parameters.py)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cavirheo.errors import InputError
from cavirheo.inference.fit.parameters import Family
from cavirheo.inference.fit.shots import Shot
from cavirheo.prior import Prior

_LN10 = float(np.log(10.0))
SIGMAS = 3.0  # standard deviations of the radius scale and of R_max within their bounds


def prior_of(shot: Shot, family: Family, ranges: Mapping[str, Sequence[float]] | None = None) -> Prior:
    """The prior of a shot's parameters, in the order of a fit: the law's, then the shot's own.

    log10 of the law's parameters and of the stretch: uniform in the ranges that a fit searches, or in `ranges`
    ({"shear_modulus": [low, high] in SI}); the stretch normal where the plateau gives it. Time origin: uniform within
    its bound. Radius scale and R_max: normal, with a third of their bound as standard deviation.

    Raises:
        InputError: a range for an unknown parameter, or one that is not positive and rising.
    """
    given = dict(ranges or {})
    own = shot.own
    bounds = np.concatenate([family.bounds(), own.bounds])
    names = [*family.parameters, *own.names]
    mean, std = np.zeros(len(names)), np.full(len(names), np.inf)
    for i, name in enumerate(names):
        if name in given and name in (*family.parameters, "stretch"):
            pair = given.pop(name)
            if len(pair) != 2 or not 0 < pair[0] < pair[1] < np.inf:
                raise InputError(f"the prior range of {name} must be [low, high] with 0 < low < high, got {list(pair)}")
            bounds[i] = np.log10(pair)
        if name == "stretch" and shot.stretch_prior:
            value, deviation = shot.stretch_prior
            mean[i], std[i] = np.log10(value), deviation / (value * _LN10)
        if name in ("radius_scale", "max_radius_factor"):
            std[i] = 1.0 / SIGMAS
    if given:
        raise InputError(f"no prior range can be set for {', '.join(given)}; known: {', '.join(names)}")
    return Prior(tuple(names), bounds[:, 0], bounds[:, 1], mean, std)

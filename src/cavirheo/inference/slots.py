"""The coordinates z in which a posterior network answers: eight slots that all its laws share.

A parameter of a law, the stretch and the accommodation are normal under their prior, which is uniform in log10 between
the ends that a search has (parameters.py): z = Phi^-1((log10 value - low)/(high - low)). Two laws put what acts alike
into one slot. A power law's consistency alone says little: its slot holds the viscosity at 1e5/s instead,

    z = (log10 K + 5 (n - 1) + 1.5)/2,

so that the density of (K, n) is that of (z, n) over 2. R_max, clock and scale are over the half-widths that their
priors have.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from cavirheo.arrays import Floats
from cavirheo.inference.law import Family
from cavirheo.parameters import PARAMETERS

SLOTS = (
    "viscosity", "shear_modulus", "shape", "stretch", "accommodation", "max_radius_factor", "time_origin",
    "radius_scale",
)  # fmt: skip
_SHARED = {"consistency": "viscosity", "stiffening": "shape", "exponent": "shape"}
_RATE_DECADES = 5.0  # of the shear rate, 1/s, at which a power law's viscosity is taken
_AT_RATE = (-1.5, 2.0)  # middle and half-width of log10 of that viscosity
_INSIDE = 1e-9  # of the probability, that z keeps away from the bounds


def slot(name: str) -> int:
    """The slot of a parameter."""
    return SLOTS.index(_SHARED.get(name, name))


def used(law: str, contents: str) -> list[int]:
    """The slots of a law (`Family`) with these contents, camera included, ascending."""
    names = [*Family(law).parameters, "stretch", *(["accommodation"] if contents == "kinetic" else []), *SLOTS[5:]]
    return sorted(map(slot, names))


def to_slots(names: tuple[str, ...], log10: Floats) -> Floats:
    """(k, 8) z from log10 values (k, names) of a law, the stretch and the accommodation; 0 in slots without."""
    z = np.zeros((len(log10), len(SLOTS)))
    for name, value in zip(names, log10.T, strict=True):
        low, high = _range(name)
        z[:, slot(name)] = ndtri(np.clip((value - low) / (high - low), _INSIDE, 1.0 - _INSIDE))
    if "consistency" in names:
        at_rate = log10[:, names.index("consistency")] + _thinning(log10[:, names.index("exponent")])
        z[:, 0] = (at_rate - _AT_RATE[0]) / _AT_RATE[1]
    return z


def from_slots(names: tuple[str, ...], z: Floats) -> tuple[Floats, Floats]:
    """log10 values (k, names) from z (k, 8), and log |dz/dlog10| (k,), by which a density of z becomes one of them."""
    log10, log_jacobian = np.empty((len(z), len(names))), np.zeros(len(z))
    for i, name in enumerate(names):
        low, high = _range(name)
        here = z[:, slot(name)]
        log10[:, i] = low + (high - low) * ndtr(here)
        if name != "consistency":
            log_jacobian += 0.5 * (here**2 + np.log(2.0 * np.pi)) - np.log(high - low)
    if "consistency" in names:
        at_rate = _AT_RATE[0] + _AT_RATE[1] * z[:, 0]
        log10[:, names.index("consistency")] = at_rate - _thinning(log10[:, names.index("exponent")])
        log_jacobian -= np.log(_AT_RATE[1])
    return log10, log_jacobian


def _range(name: str) -> tuple[float, float]:
    found = PARAMETERS[name].searched
    assert found is not None
    return found


def _thinning(log10_exponent: Floats) -> Floats:
    """log10 of the viscosity at the rate over the consistency."""
    return np.asarray(_RATE_DECADES * (10.0**log10_exponent - 1.0))

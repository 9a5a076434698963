"""The latent coordinates z in which a posterior network answers: nine that all its laws and bubbles share.

Each coordinate is standard normal under its prior. A parameter of a law, the stretch and the accommodation have a prior
that is uniform in log10 between the ends of a search (parameters.py), z = Phi^-1((log10 value - low)/(high - low)).
The confinement damping has the half of a normal (`damping`). Two laws have one coordinate for what acts alike. That of
a power law's reference viscosity is normal, z = (log10 mu_ref + 1.5)/2. R_max, clock and scale are over the half-widths
that their priors have.

The network answers one by one, each given those before it. What is known beforehand (a stated stretch, an
accommodation) comes first, so that the density of the others given it is at hand.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from cavirheo.arrays import Floats
from cavirheo.inference.experiment import LARGEST, ZETA
from cavirheo.inference.law import Family
from cavirheo.parameters import PARAMETERS

CAMERA = ("max_radius_factor", "time_origin", "radius_scale")
COORDINATES = ("stretch", "confinement_damping", "accommodation", "viscosity", "shear_modulus", "shape", *CAMERA)
BUBBLE_NAMES = {"field": (), "real": ("confinement_damping", "accommodation")}  # beside those of all
_SHARED = {"reference_viscosity": "viscosity", "stiffening": "shape", "exponent": "shape"}
_REFERENCE = (-1.5, 2.0)  # mean and standard deviation of log10 of a reference viscosity
_FARTHEST = 3.0  # z of a given damping: training has one in a thousand beyond
_INSIDE = 1e-9  # of the probability, that z keeps away from the bounds


def z_index(name: str) -> int:
    """Of the coordinate of a parameter."""
    return COORDINATES.index(_SHARED.get(name, name))


def used(law: str, bubble: str) -> list[int]:
    """Indices of the coordinates of a law (`Family`) with this bubble (of BUBBLE_NAMES), camera included, ascending."""
    return sorted(map(z_index, [*Family(law).parameters, "stretch", *BUBBLE_NAMES[bubble], *CAMERA]))


def to_latent(names: tuple[str, ...], log10: Floats) -> Floats:
    """(k, 9) z from log10 values (k, names) of a law, the stretch and the accommodation; 0 in all others."""
    z = np.zeros((len(log10), len(COORDINATES)))
    for name, value in zip(names, log10.T, strict=True):
        if name == "reference_viscosity":
            z[:, z_index(name)] = (value - _REFERENCE[0]) / _REFERENCE[1]
        else:
            low, high = _range(name)
            z[:, z_index(name)] = ndtri(np.clip((value - low) / (high - low), _INSIDE, 1.0 - _INSIDE))
    return z


def from_latent(names: tuple[str, ...], z: Floats) -> tuple[Floats, Floats]:
    """log10 values (k, names) from z (k, 9), and log |dz/dlog10| (k,), by which a density of z becomes one of them."""
    log10, log_jacobian = np.empty((len(z), len(names))), np.zeros(len(z))
    for i, name in enumerate(names):
        coordinate = z[:, z_index(name)]
        if name == "reference_viscosity":
            log10[:, i] = _REFERENCE[0] + _REFERENCE[1] * coordinate
            log_jacobian -= np.log(_REFERENCE[1])
        else:
            low, high = _range(name)
            log10[:, i] = low + (high - low) * ndtr(coordinate)
            log_jacobian += 0.5 * (coordinate**2 + np.log(2.0 * np.pi)) - np.log(high - low)
    return log10, log_jacobian


def damping(z: Floats) -> Floats:
    """The confinement damping of z: its prior is the half of a normal from 0 up, cut as that of an experiment."""
    return np.asarray(ZETA * ndtri(0.5 + (ndtr(LARGEST) - 0.5) * ndtr(z)))


def damping_to_latent(damping: float) -> float:
    """z of a given confinement damping; that of nothing is where training has hardly any smaller one."""
    inside = (ndtr(damping / ZETA) - 0.5) / (ndtr(LARGEST) - 0.5)
    return float(np.clip(ndtri(np.clip(inside, _INSIDE, 1.0 - _INSIDE)), -_FARTHEST, _FARTHEST))


def _range(name: str) -> tuple[float, float]:
    ends = PARAMETERS[name].searched
    assert ends is not None
    return ends

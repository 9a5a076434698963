"""A sweep of a rheometer, as it is read and written, and what it says. Nothing is extrapolated."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import median_filter

from cavirheo.arrays import Bools, Floats
from cavirheo.writing.digits import counted
from cavirheo.writing.document import Finite, Record

_SHORTEST = 3.0  # largest over smallest strain of a linear range
_STRAY = 0.2  # part of the points of a linear range that may stray from it, each alone
_FLAT = 0.1  # |d ln G'/d ln omega| of a plateau
_DECADE = 0.99 * math.log(10.0)  # of a plateau; instruments set 0.1 and 1 rad/s to within a per cent
Measured = Annotated[Any, Field(exclude=True, repr=False)]  # (n,) floats, which are not written


class Sweep(Record):
    """Moduli over strain (a strain of 1 is 100 %) or over angular frequency in rad/s, sorted, SI.

    Attributes:
        kind: "strain" or "frequency", which is x.
        x: (n,) not written.
        storage: (n,) G', Pa; not written.
        loss: (n,) G'', Pa; not written.
        name: of the sweep.
        source: the file, as it was given.
        source_sha256: its SHA-256.
        points: how many.
        held: what x is not, in its median: the angular frequency in rad/s of a strain sweep, the strain of the other.
        x_from: smallest x.
        x_to: largest x.
        plateau_storage_Pa: G' of the plateau; in a strain sweep that of the linear range, Pa.
        plateau_loss_Pa: G'' of the linear range, Pa.
        plateau_from: its first x.
        plateau_to: its last x; in a strain sweep where G' leaves the band, or the largest one where it does not.
        departs: "softens" or "stiffens" beyond the linear range; null where G' stays in the band.
        crossover: x where G' = G''.
        crossover_modulus_Pa: G' there, Pa.
        at_rad_per_s: frequency of the following numbers, rad/s.
        viscosity_Pa_s: G''/omega there, Pa s.
        tan_delta: G''/G' there.
        complex_viscosity_Pa_s: |G*|/omega there, Pa s.
        notes: what was recognised, converted or left out.
        message: why a number is missing.
    """

    kind: Literal["strain", "frequency"]
    x: Measured = ()
    storage: Measured = ()
    loss: Measured = ()
    name: str = ""
    source: str = ""
    source_sha256: str = ""
    points: int = 0
    held: Finite = None
    x_from: Finite = None
    x_to: Finite = None
    plateau_storage_Pa: Finite = None
    plateau_loss_Pa: Finite = None
    plateau_from: Finite = None
    plateau_to: Finite = None
    departs: str | None = None
    crossover: Finite = None
    crossover_modulus_Pa: Finite = None
    at_rad_per_s: Finite = None
    viscosity_Pa_s: Finite = None
    tan_delta: Finite = None
    complex_viscosity_Pa_s: Finite = None
    notes: list[str] = []
    message: str = ""


def strain_sweep(sweep: Sweep, tolerance: float = 0.05) -> Sweep:
    """The same sweep with its linear range, plateau and crossover.

    The linear range is the longest one (at least a factor of 3 in strain) in which G' stays within `tolerance` of its
    median and has no trend: the median slope of all pairs of points, |d ln G'/d ln strain|, is at most `tolerance`.
    One stray point does not end it, two in succession to one side do. It may begin above the smallest strain, where
    the torque is low. It ends where G', interpolated between two points, leaves the band, if it does.
    """
    gamma, storage, first = sweep.x, sweep.storage, 0
    if found := _linear_range(gamma, storage, tolerance):
        first, last, level = found
        sweep.plateau_from, sweep.plateau_storage_Pa = gamma[first], level
        sweep.plateau_loss_Pa = float(np.median(sweep.loss[first : last + 1]))
        sweep.plateau_to, sweep.departs = _limit(gamma, storage, last, level, tolerance)
        points, low = f"{counted(first, 'point')} below the linear range", storage[:first]
        if first > 2 and np.all(low > level * (1 + tolerance)):
            sweep.notes.append(f"G' is higher in the {points}: the true one may lie there, or below the data")
        elif first:
            off = 100 * np.max(np.abs(low / level - 1))
            sweep.notes.append(f"{points} left out of it: up to {off:.2g} % off (low torque?)")
    else:
        band = f"within {100 * tolerance:g} % over a factor of {_SHORTEST:g} in strain"
        sweep.message = f"no linear range: nowhere does G' stay {band}"
    yields = [(x, modulus) for x, modulus, falls in _crossovers(sweep) if falls and x > gamma[first]]
    sweep.x_from, sweep.x_to = gamma[0], gamma[-1]
    if yields:
        sweep.crossover, sweep.crossover_modulus_Pa = yields[0]
    return sweep


def _linear_range(gamma: Floats, storage: Floats, tolerance: float) -> tuple[int, int, float] | None:
    """First and last point, and the level: the median of the points within the band."""
    x, y = np.log(gamma), np.log(storage)
    first, last = np.triu_indices(len(x), 2)
    order = np.lexsort((first, x[first] - x[last]))  # the longest, then the one at smaller strain
    for i, j in zip(first[order], last[order], strict=True):
        if x[j] - x[i] < math.log(_SHORTEST):
            break
        part = storage[i : j + 1]
        away = part / np.median(part) - 1
        outside = np.abs(away) > tolerance
        twice = outside[1:] & outside[:-1] & (away[1:] * away[:-1] > 0)
        if outside[0] or outside[-1] or twice.any() or outside.mean() > _STRAY:
            continue
        a, b = np.triu_indices(len(part), 1)
        if abs(np.median((y[i + b] - y[i + a]) / (x[i + b] - x[i + a]))) <= tolerance:
            return int(i), int(j), float(np.median(part[~outside]))
    return None


def _limit(gamma: Floats, storage: Floats, last: int, level: float, tolerance: float) -> tuple[float, str | None]:
    """The strain at which G' leaves the band, and how; or the largest strain and None."""
    if last == len(gamma) - 1:
        return float(gamma[last]), None
    departs = "softens" if storage[last + 1] < level else "stiffens"
    inside, outside = np.log(storage[last : last + 2] / level) - np.log1p(
        -tolerance if departs == "softens" else tolerance
    )
    part = np.clip(inside / (inside - outside), 0.0, 1.0) if inside != outside else 1.0
    return float(gamma[last] * (gamma[last + 1] / gamma[last]) ** part), departs


def frequency_sweep(sweep: Sweep, at: float = 1.0) -> Sweep:
    """The same sweep with its plateau, its viscosity at the angular frequency `at` (rad/s) and its crossover.

    The plateau is the longest range of at least a decade in which |d ln G'/d ln omega|, fitted over half a decade round
    each point, is at most 0.1. The viscosity is G''/omega; G'' and G' are interpolated by monotone cubics (PCHIP)
    through their logarithms, never extrapolated.
    """
    omega = sweep.x
    sweep.x_from, sweep.x_to, sweep.at_rad_per_s = omega[0], omega[-1], at
    if flat := _plateau(omega, sweep.storage):
        first, last = flat
        sweep.plateau_from, sweep.plateau_to = omega[first], omega[last]
        sweep.plateau_storage_Pa = float(np.median(sweep.storage[first : last + 1]))
    else:
        sweep.notes.append(f"no plateau of G': nowhere is d ln G'/d ln ω within ±{_FLAT:g} over a decade")
    above = int(np.clip(np.searchsorted(omega, at), 1, len(omega) - 1))
    if not omega[0] * 0.999 <= at <= omega[-1] * 1.001:  # digits of the export, no more
        outside = f"{at:g} rad/s lies outside the data, {omega[0]:.3g} to {omega[-1]:.3g} rad/s"
        sweep.message = f"{outside}: µ is not extrapolated; ask for another frequency with --at"
    elif omega[above] > 10 * omega[above - 1]:
        gap = f"the data nearest to {at:g} rad/s are more than a decade apart"
        sweep.message = f"{gap}: µ is not interpolated over such a gap"
    else:
        moduli = PchipInterpolator(np.log(omega), np.log([sweep.storage, sweep.loss]), axis=1)
        storage, loss = np.exp(moduli(math.log(np.clip(at, omega[0], omega[-1])))).tolist()
        sweep.viscosity_Pa_s, sweep.tan_delta = loss / at, loss / storage
        sweep.complex_viscosity_Pa_s = math.hypot(storage, loss) / at
    if found := _crossovers(sweep):
        sweep.crossover, sweep.crossover_modulus_Pa, _ = found[0]
    if others := ", ".join(f"{x:.3g}" for x, _, _ in found[1:]):
        sweep.notes.append(f"G' = G'' also at {others} rad/s")
    return sweep


def _plateau(omega: Floats, storage: Floats) -> tuple[int, int] | None:
    """First and last point of the longest flat range."""
    x, y = np.log(omega), np.log(storage)
    flat = np.zeros(len(x), dtype=bool)
    for k in range(len(x)):
        near = np.abs(x - x[k]) <= 0.25 * math.log(10.0) * 1.01
        near[max(k - 1, 0) : k + 2] = True
        flat[k] = abs(np.polyfit(x[near], y[near], 1)[0]) <= _FLAT
    edges = np.flatnonzero(np.diff(_steady(flat), prepend=False, append=False))
    first, last = max(
        zip(edges[::2], edges[1::2] - 1, strict=True), key=lambda run: x[run[1]] - x[run[0]], default=(0, 0)
    )
    return (int(first), int(last)) if x[last] - x[first] >= _DECADE else None


def _crossovers(sweep: Sweep) -> list[tuple[float, float, bool]]:
    """(x, G' = G'', whether G'' wins beyond) in the logarithms, without single stray points."""
    solid = sweep.storage > sweep.loss
    keep = solid == _steady(solid)
    x, storage, loss, solid = (values[keep] for values in (sweep.x, sweep.storage, sweep.loss, solid))
    found = []
    for k in np.flatnonzero(solid[1:] != solid[:-1]):
        before, after = np.log(storage[k : k + 2] / loss[k : k + 2])
        part = before / (before - after)
        position, modulus = (values[k] * (values[k + 1] / values[k]) ** part for values in (x, storage))
        found.append((float(position), float(modulus), bool(solid[k])))
    return found


def _steady(flags: Bools) -> Bools:
    """As their neighbours where these agree."""
    return median_filter(flags.astype(np.int8), 3, mode="nearest").astype(bool)

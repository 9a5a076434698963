"""Sweeps, as they are read and written, and what one says. Nothing is extrapolated."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.interpolate import PchipInterpolator

from cavirheo.arrays import Bools, Floats
from cavirheo.writing.document import Record

_SHORTEST = 3.0  # largest over smallest strain of a linear range
_STRAY = 0.2  # part of the points of a linear range that may stray from it, each alone
_FLAT = 0.1  # |d ln G'/d ln omega| of a plateau
_DECADE = 0.99 * math.log(10.0)  # of a plateau; instruments set 0.1 and 1 rad/s to within a per cent
Measured = Annotated[Any, Field(exclude=True, repr=False)]  # (n,) floats, which are not written


class Sweep(Record):
    """Moduli over strain or angular frequency, sorted, in SI.

    Attributes:
        x: (n,) strain as a fraction, or angular frequency in rad/s; not written.
        storage: (n,) G', Pa; not written.
        loss: (n,) G'', Pa; not written.
        name: of the sweep.
        source: the file, as it was given.
        source_sha256: its SHA-256.
        points: how many.
        notes: what was recognised, converted or left out.
        message: why a number is missing.
    """

    x: Measured = ()
    storage: Measured = ()
    loss: Measured = ()
    name: str = ""
    source: str = ""
    source_sha256: str = ""
    points: int = 0
    notes: list[str] = []
    message: str = ""


class StrainSweep(Sweep):
    """Moduli over strain; a strain of 1 is 100 %.

    Attributes:
        kind: "strain".
        frequency_rad_per_s: of the oscillation, rad/s.
        strain_from: smallest strain.
        strain_to: largest strain.
        plateau_storage_Pa: G' of the linear range, Pa.
        plateau_loss_Pa: G'' of the linear range, Pa.
        linear_from: first strain of the linear range.
        linear_to: its last strain; the largest one where G' stays in the band.
        departs: "softens" or "stiffens" beyond; null where G' stays in the band.
        crossover_strain: where G' = G''.
        crossover_modulus_Pa: G' there, Pa.
    """

    kind: Literal["strain"] = "strain"
    frequency_rad_per_s: float | None = None
    strain_from: float | None = None
    strain_to: float | None = None
    plateau_storage_Pa: float | None = None
    plateau_loss_Pa: float | None = None
    linear_from: float | None = None
    linear_to: float | None = None
    departs: str | None = None
    crossover_strain: float | None = None
    crossover_modulus_Pa: float | None = None


class FrequencySweep(Sweep):
    """Moduli over angular frequency.

    Attributes:
        kind: "frequency".
        strain: of the oscillation.
        from_rad_per_s: smallest frequency, rad/s.
        to_rad_per_s: largest frequency, rad/s.
        plateau_storage_Pa: G' of the plateau, Pa.
        plateau_from_rad_per_s: first frequency of the plateau, rad/s.
        plateau_to_rad_per_s: its last frequency, rad/s.
        at_rad_per_s: frequency of the following numbers, rad/s.
        storage_at_Pa: G' there, Pa.
        loss_at_Pa: G'' there, Pa.
        viscosity_Pa_s: G''/omega there, Pa s.
        tan_delta: G''/G' there.
        complex_viscosity_Pa_s: |G*|/omega there, Pa s.
        crossover_rad_per_s: where G' = G'', rad/s.
        crossover_modulus_Pa: G' at the crossover, Pa.
    """

    kind: Literal["frequency"] = "frequency"
    strain: float | None = None
    from_rad_per_s: float | None = None
    to_rad_per_s: float | None = None
    plateau_storage_Pa: float | None = None
    plateau_from_rad_per_s: float | None = None
    plateau_to_rad_per_s: float | None = None
    at_rad_per_s: float | None = None
    storage_at_Pa: float | None = None
    loss_at_Pa: float | None = None
    viscosity_Pa_s: float | None = None
    tan_delta: float | None = None
    complex_viscosity_Pa_s: float | None = None
    crossover_rad_per_s: float | None = None
    crossover_modulus_Pa: float | None = None


def strain_sweep(sweep: StrainSweep, tolerance: float = 0.05) -> StrainSweep:
    """The same sweep with its linear range, plateau and crossover.

    The linear range is the longest one (at least a factor of 3 in strain) in which G' stays within `tolerance` of its
    median and has no trend: the median slope of all pairs of points, |d ln G'/d ln strain|, is at most `tolerance`.
    One stray point does not end it, two in succession to one side do. It may begin above the smallest strain, where
    the torque is low. It ends where G', interpolated between two points, leaves the band, if it does.
    """
    gamma, storage = sweep.x, sweep.storage
    sweep.strain_from, sweep.strain_to = gamma[0], gamma[-1]
    first = 0
    if found := _linear_range(gamma, storage, tolerance):
        first, last, level = found
        sweep.linear_from, sweep.plateau_storage_Pa = gamma[first], level
        sweep.plateau_loss_Pa = float(np.median(sweep.loss[first : last + 1]))
        sweep.linear_to, sweep.departs = _limit(gamma, storage, last, level, tolerance)
        if first:
            sweep.notes.append(_below(storage[:first], level, tolerance))
    else:
        band = f"within {100 * tolerance:g} % over a factor of {_SHORTEST:g} in strain"
        sweep.message = f"no linear range: nowhere does G' stay {band}"
    for x, modulus, yields in _crossovers(sweep):
        if yields and x > gamma[first]:
            sweep.crossover_strain, sweep.crossover_modulus_Pa = x, modulus
            break
    return sweep


def _linear_range(gamma: Floats, storage: Floats, tolerance: float) -> tuple[int, int, float] | None:
    """First and last point, and the level: the median of the points within the band."""
    x, y = np.log(gamma), np.log(storage)
    first, last = np.triu_indices(len(x), 2)
    span = x[last] - x[first]
    order = np.lexsort((first, -span))  # the longest, then the one at smaller strain
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
    edge = level * (1 - tolerance if departs == "softens" else 1 + tolerance)
    inside, outside = np.log(storage[last : last + 2] / edge)
    part = np.clip(inside / (inside - outside), 0.0, 1.0) if inside != outside else 1.0
    return float(gamma[last] * (gamma[last + 1] / gamma[last]) ** part), departs


def _below(storage: Floats, level: float, tolerance: float) -> str:
    """What the points at strains below the linear range say."""
    n = len(storage)
    points = f"{n} point{'s' * (n > 1)} below the linear range"
    if n > 2 and np.all(storage > level * (1 + tolerance)):
        return f"G' is higher in the {points}: the true one may lie there, or below the data"
    return f"{points} left out of it: up to {100 * np.max(np.abs(storage / level - 1)):.2g} % off (low torque?)"


def frequency_sweep(sweep: FrequencySweep, at: float = 1.0) -> FrequencySweep:
    """The same sweep with its plateau, its viscosity at the angular frequency `at` (rad/s) and its crossover.

    The plateau is the longest range of at least a decade in which |d ln G'/d ln omega|, fitted over half a decade round
    each point, is at most 0.1. The viscosity is G''/omega; G'' and G' are interpolated by monotone cubics (PCHIP)
    through their logarithms, never extrapolated.
    """
    omega = sweep.x
    sweep.from_rad_per_s, sweep.to_rad_per_s, sweep.at_rad_per_s = omega[0], omega[-1], at
    if flat := _plateau(omega, sweep.storage):
        first, last = flat
        sweep.plateau_from_rad_per_s, sweep.plateau_to_rad_per_s = omega[first], omega[last]
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
        inside = math.log(np.clip(at, omega[0], omega[-1]))
        storage, loss = (
            float(np.exp(PchipInterpolator(np.log(omega), np.log(modulus))(inside)))
            for modulus in (sweep.storage, sweep.loss)
        )
        sweep.storage_at_Pa, sweep.loss_at_Pa, sweep.tan_delta = storage, loss, loss / storage
        sweep.viscosity_Pa_s, sweep.complex_viscosity_Pa_s = loss / at, math.hypot(storage, loss) / at
    if crossovers := _crossovers(sweep):
        sweep.crossover_rad_per_s, sweep.crossover_modulus_Pa, _ = crossovers[0]
    if others := ", ".join(f"{x:.3g}" for x, _, _ in crossovers[1:]):
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
    flat ^= _alone(flat)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flat.astype(int), [0]])))
    runs = [(first, last - 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]
    first, last = max(runs, key=lambda run: x[run[1]] - x[run[0]], default=(0, 0))
    return (int(first), int(last)) if x[last] - x[first] >= _DECADE else None


def _crossovers(sweep: Sweep) -> list[tuple[float, float, bool]]:
    """(x, G' = G'', whether G'' wins beyond) in the logarithms, without single stray points."""
    solid = sweep.storage > sweep.loss
    keep = ~_alone(solid)
    x, storage, loss, solid = (values[keep] for values in (sweep.x, sweep.storage, sweep.loss, solid))
    found = []
    for k in np.flatnonzero(solid[1:] != solid[:-1]):
        before, after = np.log(storage[k : k + 2] / loss[k : k + 2])
        part = before / (before - after)
        position, modulus = (values[k] * (values[k + 1] / values[k]) ** part for values in (x, storage))
        found.append((float(position), float(modulus), bool(solid[k])))
    return found


def _alone(flags: Bools) -> Bools:
    """Where a flag differs from both its neighbours."""
    alone = np.zeros_like(flags)
    alone[1:-1] = (flags[1:-1] != flags[:-2]) & (flags[1:-1] != flags[2:])
    return alone

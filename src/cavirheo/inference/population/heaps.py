"""Whether the shots of a group disagree: their intervals of a parameter fall into two heaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cavirheo.arrays import NORMAL_90, Floats
from cavirheo.posterior import Heap, Posterior

FEWEST = 2  # shots in a heap
LEAST_SHARE = 0.2  # of the shots in the smaller heap: fewer are outliers
APART = 0.3  # decades between the middles of the heaps
CLEAR = 4.0  # this distance over the deviation of a shot within its heap


def two_heaps(answers: Sequence[Posterior], shots: Sequence[str], name: str) -> tuple[Heap, Heap] | None:
    """The two heaps into which the intervals of a parameter (natural name) fall, the lower one first; None if they do
    not: no interval of one reaches one of the other, and the heaps are clearly farther apart than they are wide.

    A heap of bounds alone is taken at the limit that is nearest to the other heap. A bound that reaches over the gap,
    so that its shot may belong to either heap, is in none."""
    known, ends = _intervals(answers, shots, name)
    fewest = max(FEWEST, int(np.ceil(LEAST_SHARE * len(known))))
    valued = np.all(np.isfinite(ends), axis=1)
    halves = 0.5 * np.diff(ends[valued], axis=1)
    own = float(np.median(halves)) / NORMAL_90 if len(halves) else 0.0
    best, most = None, 0
    for gap in np.unique(ends[np.isfinite(ends[:, 1]), 1]):
        low, high = ends[:, 1] <= gap, ends[:, 0] > gap
        inside = int(np.count_nonzero(low | high))
        if min(np.count_nonzero(low), np.count_nonzero(high)) < fewest or np.any(valued & ~low & ~high):
            continue
        below, above = ends[low & valued].mean(axis=1), ends[high & valued].mean(axis=1)
        off = np.concatenate([part - np.mean(part) for part in (below, above) if len(part)] or [below])
        free = max(len(off) - bool(len(below)) - bool(len(above)), 1)
        width = float(np.hypot(np.linalg.norm(off) / np.sqrt(free), own))
        bottom = np.mean(below) if len(below) else np.max(ends[low, 1])
        top = np.mean(above) if len(above) else np.min(ends[high, 0])
        if inside > most and top - bottom > max(APART, CLEAR * width):
            first, second = ([known[i] for i in np.flatnonzero(heap)] for heap in (low, high))
            best, most = (_heap(first, ends[low]), _heap(second, ends[high])), inside
    return best


def _intervals(answers: Sequence[Posterior], shots: Sequence[str], name: str) -> tuple[list[str], Floats]:
    """Names of the shots that determine a parameter, or bound it on one side, and (n, 2) log10 of the ends; infinite
    where there is a bound alone."""
    known, ends = [], []
    for answer, shot in zip(answers, shots, strict=True):
        interval, bound = answer.interval(name), answer.bound(name)
        if interval is None or bound in ("undetermined", "wide") or interval[1] <= 0.0:
            continue
        low = -np.inf if bound == "upper" or interval[0] <= 0.0 else float(np.log10(interval[0]))
        high = np.inf if bound == "lower" else float(np.log10(interval[1]))
        known.append(shot)
        ends.append((low, high))
    return known, np.array(ends, dtype=float).reshape(-1, 2)


def _heap(shots: Sequence[str], ends: Floats) -> Heap:
    lows, highs = (values[np.isfinite(values)] for values in ends.T)
    low = float(10.0 ** np.min(lows)) if len(lows) else None
    high = float(10.0 ** np.max(highs)) if len(highs) else None
    return Heap(tuple(shots), low, high)

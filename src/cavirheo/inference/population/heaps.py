"""Whether the shots of a group disagree: their intervals of a parameter fall into two heaps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import NORMAL_90, Floats
from cavirheo.posterior import Posterior

FEWEST = 2  # shots in a heap
LEAST_SHARE = 0.2  # of the shots in the smaller heap: fewer are outliers
APART = 0.3  # decades between the middles of the heaps
CLEAR = 4.0  # this distance over the deviation of a shot within its heap


class Heap(NamedTuple):
    """Shots whose intervals of a parameter are alike.

    Attributes:
        shots: their names.
        low: lower end of their intervals, SI; None if they are only bounded from above.
        high: upper end of their intervals, SI; None if they are only bounded from below.
    """

    shots: tuple[str, ...]
    low: float | None
    high: float | None


def two_heaps(answers: Sequence[Posterior], shots: Sequence[str], name: str) -> tuple[Heap, Heap] | None:
    """The two heaps into which the intervals of a parameter (natural name) fall, the lower one first; None if they do
    not: no interval of one reaches one of the other, and the heaps are clearly farther apart than they are wide.

    A bound is taken at the limit of its heap that is nearest to the other heap; it has no deviation."""
    known, ends = _intervals(answers, shots, name)
    fewest = max(FEWEST, int(np.ceil(LEAST_SHARE * len(known))))
    if len(known) < 2 * fewest:
        return None
    order = np.argsort(_middles(ends), kind="stable")
    ends = ends[order]
    middles = _middles(ends)
    valued = np.all(np.isfinite(ends), axis=1)
    halves = 0.5 * np.diff(ends[valued], axis=1)
    own = float(np.median(halves)) / NORMAL_90 if len(halves) else 0.0
    for first in range(fewest, len(order) - fewest + 1):
        low, high = ends[:first], ends[first:]
        if np.max(low[:, 1]) >= np.min(high[:, 0]):
            continue
        below = np.where(valued[:first], middles[:first], np.max(low[:, 1]))
        above = np.where(valued[first:], middles[first:], np.min(high[:, 0]))
        apart = float(np.mean(above) - np.mean(below))
        parts = [part for part in (middles[:first][valued[:first]], middles[first:][valued[first:]]) if len(part)]
        squares = sum(float(np.sum((part - np.mean(part)) ** 2)) for part in parts)
        free = max(int(np.count_nonzero(valued)) - len(parts), 1)
        width = float(np.hypot(np.sqrt(squares / free), own))
        if apart > max(APART, CLEAR * width):
            names = [[known[i] for i in sorted(part)] for part in (order[:first], order[first:])]
            return _heap(names[0], low), _heap(names[1], high)
    return None


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


def _middles(ends: Floats) -> Floats:
    """(n,) middle of each interval in log10, or its only end."""
    filled = np.where(np.isfinite(ends), ends, ends[:, ::-1])
    return np.asarray(np.mean(filled, axis=1))


def _heap(shots: Sequence[str], ends: Floats) -> Heap:
    low, high = np.min(ends[:, 0]), np.max(ends[:, 1])
    if np.all(np.isneginf(ends[:, 0])):
        return Heap(tuple(shots), None, float(10.0**high))
    if np.all(np.isposinf(ends[:, 1])):
        return Heap(tuple(shots), float(10.0**low), None)
    lowest = float(np.min(ends[np.isfinite(ends[:, 0]), 0]))
    highest = float(np.max(ends[np.isfinite(ends[:, 1]), 1]))
    return Heap(tuple(shots), float(10.0**lowest), float(10.0**highest))

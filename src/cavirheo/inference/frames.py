"""The frames that an analysis compares: those of a recording, or means of neighbours where they are far denser than the
motion needs.

The mean of k frames has the noise of one over sqrt(k), and misses the radius at their mean time by R'' v/2, where v is
the variance of their times. The energy of the bubble limits |R''|: between two collapses the pressure in the bubble and
the wall's speed are at most those that the work against the ambient pressure gives (Rayleigh 1917,
doi:10.1080/14786440808635681), so that with the largest radius R_k of this part of the motion

    |R''| <= R_k^3/R^4 (0.915/t_1)^2 R_max^2,   t_1 the time of the first collapse.

So many frames are averaged that this limit of R'' v/2 is a share b of the noise of their mean, the same share for all,
and the mean is corrected by R'' v/2 of neighbouring means. Frames beside a collapse stay single.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.landmarks import RAYLEIGH

MOST_FRAMES = 180  # a recording with more frames is averaged
LONGEST_MEAN = 0.05  # longest time of a mean over that of the first collapse
LEAST_BIAS, LARGEST_BIAS = 1e-3, 2.0  # smallest and largest share b
BISECTIONS = 12  # that find b
SOLVER_ERROR = 1e-3  # of R_max, the error of the solver: smaller noise counts as this


class ComparedFrames(NamedTuple):
    """Means (m,) of frames: time in s, radius and its standard deviation in m (NaN where unknown), the number of
    averaged frames, and whether these are usable."""

    time: Floats
    radius: Floats
    radius_std: Floats
    averaged: Floats
    usable: Bools


def compared_frames(curve: RadiusCurve, usable: Bools | None = None, most: int = MOST_FRAMES) -> ComparedFrames:
    """The measured frames of a curve, which begins at R_max; or at most `most` means of them, if the motion is slow
    enough. usable: (n,) of the measured frames; others, such as spikes, enter no mean. Raises InputError: the curve has
    no R_max."""
    measured = np.isfinite(curve.radius)
    time, radius, std = curve.time[measured], curve.radius[measured], curve.radius_std[measured]
    usable = np.ones(len(time), dtype=bool) if usable is None else usable
    if len(time) <= most:
        return ComparedFrames(time, radius, std, np.ones(len(time)), usable)
    group = _groups(curve, time, radius, usable, most)
    count = np.bincount(group).astype(float)

    def mean(values: Floats) -> Floats:
        return np.bincount(group, values) / count

    middle, means = mean(time - time[0]), mean(radius)
    variance = mean((time - time[0] - middle[group]) ** 2)
    curvature = np.pad(2.0 * np.diff(np.diff(means) / np.diff(middle)) / (middle[2:] - middle[:-2]), 1, mode="edge")
    means -= 0.5 * curvature * variance
    deviation = np.sqrt(mean(std**2) / count)
    return ComparedFrames(time[0] + middle, means, deviation, count, mean(usable.astype(float)) == 1.0)


def _groups(curve: RadiusCurve, time: Floats, radius: Floats, usable: Bools, most: int) -> NDArray[np.int64]:
    """(n,) index of the mean of each frame, with the smallest share b for which there are at most `most` means."""
    top, start, collapses = curve.max_radius, curve.time_of_max, curve.collapse_times()
    first = (collapses[0] if len(collapses) else time[-1]) - start
    part = np.searchsorted(collapses, time)
    largest = np.zeros(len(collapses) + 1)
    np.maximum.at(largest, part[usable], radius[usable] / top)
    largest = np.maximum.accumulate(largest[::-1])[::-1]  # of this part of the motion and all later ones
    padded = np.pad(radius / top, 2, mode="edge")
    smallest = np.min(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    curvature = largest[np.maximum(part - 1, 0)] ** 3 / smallest**4
    step = np.diff(time, prepend=2.0 * time[0] - time[1]) * (RAYLEIGH / first)
    noise = max(curve.noise / top, SOLVER_ERROR)

    def groups(bias: float) -> NDArray[np.int64]:
        # a mean of the length w has v = w^2/12, and the noise of w/step frames
        length = (24.0 * bias * noise * np.sqrt(step) / curvature) ** 0.4
        share = np.minimum(step / np.minimum(length, LONGEST_MEAN * RAYLEIGH), 1.0)
        share[~usable] = 1.0
        share[1:][~usable[:-1]] = 1.0
        return np.unique(np.floor(np.cumsum(share)), return_inverse=True)[1]

    low, high = LEAST_BIAS, LARGEST_BIAS
    for _ in range(BISECTIONS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if groups(middle)[-1] < most else (middle, high)
    return groups(high)

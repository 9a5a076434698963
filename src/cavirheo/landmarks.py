"""Find the maximum and the collapses of a radius history: the fits of RadiusCurve, as functions of plain arrays.

- *Maximum.* Near its maximum a collapsing bubble follows R = R_max (1 - a s^2 - (2/3) a^2 s^4), s = t - t_max: the
  series of Rayleigh's equation R R'' + (3/2) R'^2 = -P to fourth order, a = P/(2 R_max^2), for any constant driving
  pressure P. (R_max, t_max, a) are fitted to the samples above 0.9 R_max. Samples with residuals above 0.5 % of R_max
  have less weight. Viscosity makes growth and collapse asymmetric: a term k s^3 is added where the noise is low enough
  to resolve it.
- *Collapses.* A minimum is a collapse if the radius rises by more than `least_rebound` after it. R^(5/2) is linear in
  time on either side of an inertial collapse: the time of the collapse is where the two lines through the neighbours of
  the smallest sample cross.

tests/io/test_curve.py measures the accuracy on simulated shots.
"""

from __future__ import annotations

from itertools import pairwise
from math import gamma, pi, sqrt

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError

RAYLEIGH = sqrt(pi / 6) * gamma(5 / 6) / gamma(4 / 3)  # collapse time of an empty bubble over R_max sqrt(rho/p): 0.9147
_LEAST_JUMP, _TOLERATED_REPEATS = 0.01, 2  # least jump of a moving radius, over the largest radius; tolerated repeats
_RESIDUAL_SCALE = 0.005  # of R_max: larger residuals have less weight in the fit of the maximum
_FALL_LEVEL, _FEWEST_SAMPLES = 0.7, 6  # of the first radii: samples before the fall below it are fitted; least number
_SERIES_ERROR = 0.004  # of R_max: error of the series for a fall in a viscous material
_LEAST_SHIFT = 0.5  # of the time of the fall to _FALL_LEVEL: least shift that counts; agarose from R_max: up to 0.36
_SERIES_PARAMETERS = 3  # number of parameters of the series of a maximum
_SPAN_VARIANCES = 9.0  # squared standard deviations: times of the maximum within them are possible
_TRIAL_CENTRES = 13  # number of times of the maximum that are tried first
_SPAN_TOLERANCE = 0.005  # of the time span of the samples: tolerance of the earliest and latest time of the maximum
_LEAST_CHI_SQUARE = 4.0  # least excess of chi-square of a maximum one frame before the first sample over the best fit
_SMALLEST_REBOUND = 0.03  # of R_max: least rise after a minimum that is a collapse
_NEAR_MAXIMUM = 0.9  # samples above this fraction of R_max enter its fit
AT_MAXIMUM = 0.97  # a recording whose first radius is above this shows no growth


def median_where_large(radius: Floats, values: Floats) -> float:
    """The median of the values at radii above half of the largest one; 0 without any."""
    large = radius > 0.5 * np.nanmax(radius, initial=0.0)
    return float(np.median(values[large])) if large.any() else 0.0


def _median_of_three(values: Floats) -> Floats:
    """Running median of three samples, mirrored at the ends: removes a single bad frame."""
    padded = np.pad(values, 1, mode="reflect")
    return np.asarray(np.median([padded[:-2], padded[1:-1], padded[2:]], axis=0))


def _range_near_maximum(smooth: Floats, peak: int, top: float) -> tuple[int, int]:
    """(first index, index after the last) of the smoothed samples (n,) around the peak that are near the top."""
    below = np.flatnonzero(smooth <= _NEAR_MAXIMUM * top)
    return int(below[below < peak].max(initial=-1)) + 1, int(below[below > peak].min(initial=len(smooth)))


def fit_maximum(time: Floats, radius: Floats, stated_time: float | None) -> tuple[float, float]:
    """(t_max, R_max) of measured samples (n,). `stated_time` is the time of the maximum that the file gives, or None.

    Raises InputError: no fall after the maximum, or too much scatter near it."""
    smooth = _median_of_three(radius)
    # use the maximum before the first deep fall: a late drift may exceed it; small early radii (a speck) may fall too
    highest = np.maximum.accumulate(smooth)
    fallen = (smooth < 0.6 * highest) & (highest > 0.5 * smooth.max())
    end = int(np.argmax(fallen)) if fallen.any() else len(smooth)
    peak = int(np.argmax(smooth[:end]))
    first, last_index = _range_near_maximum(smooth, peak, smooth[peak])
    if last_index == len(smooth):
        grows = peak >= len(smooth) - 2
        what, code = ("still grows at the end", "grows") if grows else ("never collapses", "never_falls")
        why = f"the bubble {what} (last radius {smooth[-1] / smooth[peak]:.2f} of the largest)"
        raise InputError(f"{why}; a recording must show R_max and the fall after it", f"curve.{code}")
    fitted = slice(first, last_index) if last_index - first > 2 else slice(max(peak - 1, 0), min(peak + 3, len(time)))
    unit = time[fitted][-1] - time[fitted][0]
    x, y = (time[fitted] - time[peak]) / unit, radius[fitted] / smooth[peak]
    frame, n = float(np.median(np.diff(x))), len(x)
    if first > 0 or smooth[: peak + 1].min() < AT_MAXIMUM * smooth[peak]:
        centre, top, cost = _fit_series(x, y)
        if min(np.count_nonzero(x < 0), np.count_nonzero(x > 0)) >= 4:
            skewed = _fit_series(x, y, skewed=True)
            if _clearly_better(skewed[2], cost, n - 4) and x[0] < skewed[0] < x[-1]:
                centre, top, _ = skewed
    else:
        # the stated time or the first frame, unless the data clearly show a maximum more than two frames away
        at = x[0] if stated_time is None else (stated_time - time[peak]) / unit
        centre, top, _ = _fit_series(x, y, centre=at)
        residual_scale = max(_RESIDUAL_SCALE, 3.0 * noise_std(radius) / smooth[peak])
        fixed = _fit_series(x, y, centre=at, residual_scale=residual_scale)
        free = _fit_series(x, y, residual_scale=residual_scale) if n > 4 else fixed
        if _clearly_better(free[2], fixed[2], n - 3) and abs(free[0] - at) > 2.0 * frame and x[0] <= free[0] <= x[-1]:
            centre, top, _ = free
    if not (x[0] - 2.0 * frame <= centre <= x[-1] and 0.9 < top < 1.15):  # noise spoiled the fit: keep the time
        centre, top, _ = _fit_series(x, y, centre=0.0)
    if not 0.9 < top < 1.15:
        raise InputError("no maximum can be fitted to the samples round the largest: they scatter", "curve.scatters")
    return float(time[peak] + centre * unit), float(top * smooth[peak])


def maximum_span(time: Floats, radius: Floats, maximum: tuple[float, float], noise: float) -> tuple[float, float]:
    """(earliest, latest) time of the maximum (t_max, R_max), s, that the samples (n,) near it allow: at times outside,
    the squared residuals of the series exceed the least ones by more than _SPAN_VARIANCES. noise: of the radius, m."""
    start, top = maximum
    peak = int(np.argmin(np.abs(time - start)))
    first, last = _range_near_maximum(_median_of_three(radius), peak, top)
    frame = float(np.median(np.diff(time)))
    if last - first <= _SERIES_PARAMETERS:  # too few samples for a fit: up to the samples beyond them
        return float(time[first]) - frame, float(time[min(last, len(time) - 1)])
    unit = time[last - 1] - time[first]
    x, y, deviation = (time[first:last] - start) / unit, radius[first:last] / top, noise / top
    residual_scale = max(_RESIDUAL_SCALE, 3.0 * deviation)

    def cost(centre: float) -> float:
        return _fit_series(x, y, centre=centre, residual_scale=residual_scale)[2]

    centres = np.linspace(x[0] - frame / unit, x[-1], _TRIAL_CENTRES)
    costs = [cost(centre) for centre in centres]
    best = int(np.argmin(costs))
    limit = costs[best] + _SPAN_VARIANCES * max(costs[best] / (len(x) - _SERIES_PARAMETERS), deviation**2)
    from scipy.optimize import brentq  # the import takes a third of a second

    ends = [
        end if value < limit else brentq(lambda centre: cost(centre) - limit, centres[best], end, xtol=_SPAN_TOLERANCE)
        for end, value in ((centres[0], costs[0]), (centres[-1], costs[-1]))
    ]
    return float(start + ends[0] * unit), float(start + ends[1] * unit)


def noise_std(radius: Floats) -> float:
    """Standard deviation of the noise of samples (n,), from the median absolute third difference: third differences
    cancel the motion except at the few collapses. 0 for fewer than 8 samples."""
    return float(1.4826 * np.median(np.abs(np.diff(radius, 3))) / np.sqrt(20.0)) if len(radius) > 7 else 0.0


def rounding_step(radius: Floats) -> float:
    """Rounding step of radii (n,), m: the number of which all are multiples; 0 if there is none."""
    steps = np.diff(np.unique(radius))
    if not len(steps):
        return 0.0
    multiples = np.append(radius, steps) / np.min(steps)
    return float(np.min(steps)) if np.all(np.abs(multiples - np.round(multiples)) < 1e-2) else 0.0


def repeated_samples(radius: Floats) -> tuple[int, int] | None:
    """(number of samples equal to the one before, how often each value occurs or 0 if that varies) of samples (n,) with
    more repeats than rounding explains, else None. Only values within a fast motion in one direction are examined:
    there, rounding makes two samples equal with a probability of at most about its step over the jump around them."""
    start = np.flatnonzero(np.diff(radius, prepend=np.nan) != 0)
    value, length = radius[start], np.diff(start, append=len(radius))
    step, before, after = rounding_step(radius), np.diff(value)[:-1], np.diff(value)[1:]
    slowest, whole = np.minimum(np.abs(before), np.abs(after)), np.abs(before + after)
    same_sign, jump = np.sign(before) == np.sign(after), _LEAST_JUMP * float(np.max(radius, initial=0.0))
    moves = same_sign & (slowest > max(1.5 * step, jump))
    lengths, by_chance = length[1:-1][moves], float(np.sum(step / whole[moves]))
    held = lengths[lengths > 1]
    if len(held) <= _TOLERATED_REPEATS + 3.0 * by_chance:
        return None
    times = int(np.median(held))
    return len(radius) - len(value), times if np.mean(lengths == times) > 0.9 else 0


def frames_missed(time: Floats, radius: Floats, noise: float) -> float:
    """Number of frames from the maximum to the first of samples (n,) that fall from their start; 0 unless it is more
    than one by _LEAST_CHI_SQUARE, and more than the shift of real falls, _LEAST_SHIFT. noise: of the radius, m."""
    top = float(radius[:3].max())
    fallen = radius < _FALL_LEVEL * top
    count = int(np.argmax(fallen)) if fallen.any() else len(radius)
    if count < _FEWEST_SAMPLES:
        return 0.0
    x, y = (time[:count] - time[0]) / (time[count - 1] - time[0]), radius[:count] / top
    frame, deviation = float(np.median(np.diff(x))), max(noise / top, _SERIES_ERROR)
    free, at_most = (_fit_series(x, y, centre=at, residual_scale=4.0 * deviation) for at in (None, -frame))
    clear = free[0] < -max(frame, _LEAST_SHIFT) and at_most[2] - free[2] > _LEAST_CHI_SQUARE * deviation**2
    return -free[0] / frame if clear else 0.0


def _clearly_better(cost: float, other_cost: float, degrees_of_freedom: int) -> bool:
    """Whether one more parameter lowers the sum of squares beyond chance (four standard deviations)."""
    return degrees_of_freedom > 0 and other_cost > cost * (1.0 + 16.0 / degrees_of_freedom)


def _fit_series(
    x: Floats, y: Floats, *, centre: float | None = None, skewed: bool = False, residual_scale: float = _RESIDUAL_SCALE
) -> tuple[float, float, float]:
    """Fit y = top (1 - a s^2 - (2/3) a^2 s^4) + k s^3, s = x - centre, by reweighted Gauss-Newton: (centre, top, cost).

    A given `centre` is kept; k = 0 unless `skewed`. cost: squared residuals, weighted down beyond `residual_scale`.
    """
    c2, c1, _ = np.polyfit(x, y, 2, full=True)[0]  # full: no warning if samples have the same time
    free = centre is None
    if centre is None:
        centre = float(np.clip(-c1 / (2.0 * c2), x[0], x[-1])) if c2 < 0 else float(x[np.argmax(y)])
    top, a, k = float(y.max()), max(float(-c2), 1e-3), 0.0
    cost = np.inf
    for _ in range(50):
        s = x - centre
        u = a * s * s
        shape = 1.0 - u - u * u * 2.0 / 3.0
        slope = -top * (1.0 + u * 4.0 / 3.0)  # d model/d u
        residual = y - top * shape - k * s**3
        weight = 1.0 / np.sqrt(1.0 + (residual / residual_scale) ** 2)
        cost = float(np.sum(weight * residual**2))
        columns = [shape, slope * s * s]
        columns += [-2.0 * a * slope * s - 3.0 * k * s * s] if free else []
        columns += [s**3] if skewed else []
        root = np.sqrt(weight)
        step = np.linalg.lstsq(np.stack(columns, axis=1) * root[:, None], residual * root, rcond=None)[0]
        top += float(step[0])
        a = max(a + float(np.clip(step[1], -0.5 * a, a)), 1e-6)
        if free:
            centre += float(np.clip(step[2], -0.25, 0.25))
        if skewed:
            k += float(step[-1])
        if np.max(np.abs(step)) < 1e-10:
            break
    return centre, top, cost


def spikes(radius: Floats, height: float) -> list[int]:
    """Indices of the samples that exceed both neighbours by more than `height`."""
    above = radius[1:-1] - np.maximum(radius[:-2], radius[2:])
    return [int(i) + 1 for i in np.flatnonzero(above > height)]


def turning_points(radius: Floats, threshold: float) -> tuple[list[int], list[int]]:
    """Indices of the alternating minima and maxima that stand out by more than `threshold`; index 0 is a maximum."""
    minima, maxima = list[int](), list[int]()
    extreme, falls = 0, True
    for i, value in enumerate(radius):
        rise = value - radius[extreme] if falls else radius[extreme] - value
        if rise < 0 or (extreme == 0 and rise > 0):
            extreme = i
        elif rise > threshold:
            (minima if falls else maxima).append(extreme)
            extreme, falls = i, not falls
    return minima, maxima


def least_rebound(top: float, noise: float) -> float:
    """Least rise of the radius after a minimum that is a collapse, m, for a maximum radius `top` and noise, m."""
    return float(np.clip(6.0 * noise, _SMALLEST_REBOUND * top, 4.0 * _SMALLEST_REBOUND * top))


def collapse_time(time: Floats, radius: Floats, i: int) -> float:
    """Time at which the lines of R^(5/2) before and after the smallest sample i cross, limited to its neighbours."""
    if i < 2 or i > len(time) - 3:
        return float(time[i])
    t, y = time[i - 2 : i + 3], radius[i - 2 : i + 3] ** 2.5
    falling, rising = (y[1] - y[0]) / (t[1] - t[0]), (y[4] - y[3]) / (t[4] - t[3])
    if not falling < 0 < rising:
        return float(t[2])
    crossing = (y[3] - rising * t[3] - y[1] + falling * t[1]) / (falling - rising)
    return float(np.clip(crossing, t[1], t[3]))


def drift_start(time: Floats, radius: Floats, minima: list[int], maxima: list[int], rise: float) -> float | None:
    """Time, s, from which the radius drifts upwards by more than `rise`, or None. A drift is a rebound higher than the
    one before, or a rise of the running median over a period that begins a period after the last collapse or later.
    It shows that the bubble breaks up, or that another bubble hides it."""
    if not minima:
        return None
    for collapse, following in pairwise([*minima[1:], len(radius)]):
        before = [i for i in maxima if i < collapse]
        if before and np.max(radius[collapse:following]) > radius[before[-1]] + rise:
            return float(time[collapse])
    period = time[minima[-1]] - time[minima[-2]] if len(minima) > 1 else 2.0 * (time[minima[0]] - time[0])
    late = int(np.searchsorted(time, time[minima[-1]] + period))
    width = max(late - minima[-1], 5)
    if len(time) - late < width:
        return None
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(radius[late:], width), axis=1)
    lowest = np.minimum.accumulate(smooth)
    risen = np.flatnonzero(smooth - lowest > rise)
    return float(time[late + int(np.argmin(smooth[: risen[0] + 1])) + width // 2]) if len(risen) else None

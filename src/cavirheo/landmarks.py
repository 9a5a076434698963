"""Where a radius history has its maximum and its collapses: the fits behind RadiusCurve, on bare arrays.

- *Maximum.* Near its maximum a collapsing bubble follows R = R_max (1 - a s^2 - (2/3) a^2 s^4), s = t - t_max: the
  series of Rayleigh's equation R R'' + (3/2) R'^2 = -P to fourth order, a = P/(2 R_max^2), for any constant driving
  pressure P. (R_max, t_max, a) are fitted to the samples above 0.9 R_max, each weighted down as its residual passes
  0.5 % of R_max. Growth and collapse are not mirror images (viscosity): a term k s^3 joins where the noise is low
  enough to see it.
- *Collapses.* A turning point counts when the radius rises again by more than `rebound`. Its time is where the two
  branches meet: R^(5/2) is linear in time on either side of an inertial collapse, and the two lines through the
  neighbours of the smallest sample cross there.

tests/io/test_curve.py measures how well, on simulated shots.
"""

from __future__ import annotations

from itertools import pairwise
from math import gamma, pi, sqrt

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require

RAYLEIGH = sqrt(pi / 6) * gamma(5 / 6) / gamma(4 / 3)  # collapse time of an empty bubble over R_max sqrt(rho/p): 0.9147
_JUMP, _REPEATED = 0.01, 2  # of the largest radius: what moves; repeated samples that are none yet
_KNEE = 0.005  # of R_max: residuals of the fit of the maximum beyond it count less
_STEEP, _FEWEST = 0.7, 6  # of the first radii: samples above it tell whether these fall; so many are needed
_SERIES = 0.004  # of R_max: what the series leaves of a fall in a viscous material
_SKEW = 0.5  # of the time of the fall to _STEEP: some agarose, recorded from R_max, falls as if it began at 0.36
_PARAMETERS = 3  # of the series of a maximum
_SPAN = 9.0  # squared standard deviations of its time that are possible,
_CENTRES = 13  # of which so many are tried first
_RESOLVED = 0.005  # of the samples' time, to which the first and the last one are known
_EVIDENCE = 12.0  # chi-square of a maximum a frame before the first sample over that of the best one
_SMALLEST_REBOUND = 0.03  # of R_max, that makes a minimum a collapse
_NEAR_MAXIMUM = 0.9  # samples above this fraction of R_max enter its fit
AT_MAXIMUM = 0.97  # a recording whose first radius is above this shows no growth


def _median_of_three(values: Floats) -> Floats:
    """Running median, mirrored at the ends: takes out a single bad frame."""
    padded = np.concatenate([values[1:2], values, values[-2:-1]])
    return np.asarray(np.median(np.stack([padded[:-2], padded[1:-1], padded[2:]]), axis=0))


def _near_maximum(smooth: Floats, peak: int, top: float) -> tuple[int, int]:
    """First index, and the one after the last, of the smoothed samples (n,) about the peak that are near the top."""
    below = np.flatnonzero(smooth <= _NEAR_MAXIMUM * top)
    return int(below[below < peak].max(initial=-1)) + 1, int(below[below > peak].min(initial=len(smooth)))


def fit_maximum(time: Floats, radius: Floats, stated: float | None) -> tuple[float, float]:
    """(t_max, R_max) of measured samples (n,). `stated` is the time of the maximum as the file gives it."""
    smooth = _median_of_three(radius)
    # the maximum before the first deep fall: a late drift may pass it; small early radii (a speck) may fall, too
    highest = np.maximum.accumulate(smooth)
    fallen = (smooth < 0.6 * highest) & (highest > 0.5 * smooth.max())
    end = int(np.argmax(fallen)) if fallen.any() else len(smooth)
    peak = int(np.argmax(smooth[:end]))
    first, last_index = _near_maximum(smooth, peak, smooth[peak])
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
        # at the time that the file states, else the first frame, unless the data clearly say another, by two frames
        at = x[0] if stated is None else (stated - time[peak]) / unit
        centre, top, _ = _fit_series(x, y, centre=at)
        knee = max(_KNEE, 3.0 * scatter(radius) / smooth[peak])
        fixed = _fit_series(x, y, centre=at, knee=knee)
        free = _fit_series(x, y, knee=knee) if n > 4 else fixed
        if _clearly_better(free[2], fixed[2], n - 3) and abs(free[0] - at) > 2.0 * frame and x[0] <= free[0] <= x[-1]:
            centre, top, _ = free
    if not (x[0] - 2.0 * frame <= centre <= x[-1] and 0.9 < top < 1.15):  # noise beat the fit: keep the time
        centre, top, _ = _fit_series(x, y, centre=0.0)
    why = "no maximum can be fitted to the samples round the largest; they scatter too much"
    require(0.9 < top < 1.15, why, "curve.scatters")
    return float(time[peak] + centre * unit), float(top * smooth[peak])


def maximum_span(time: Floats, radius: Floats, maximum: tuple[float, float], noise: float) -> tuple[float, float]:
    """(earliest, latest) time of the maximum (t_max, R_max), s, as far as the samples (n,) near it tell: the series
    about a time outside leaves more than _SPAN variances above the best one. noise: that of the radius, m."""
    start, top = maximum
    peak = int(np.argmin(np.abs(time - start)))
    first, last = _near_maximum(_median_of_three(radius), peak, top)
    frame = float(np.median(np.diff(time)))
    if last - first <= _PARAMETERS:  # between the samples that are not near it
        return float(time[first]) - frame, float(time[min(last, len(time) - 1)])
    unit = time[last - 1] - time[first]
    x, y, deviation = (time[first:last] - start) / unit, radius[first:last] / top, noise / top
    knee = max(_KNEE, 3.0 * deviation)

    def cost(centre: float) -> float:
        return _fit_series(x, y, centre=centre, knee=knee)[2]

    centres = np.linspace(x[0] - frame / unit, x[-1], _CENTRES)
    costs = [cost(centre) for centre in centres]
    best = int(np.argmin(costs))
    limit = costs[best] + _SPAN * max(costs[best] / (len(x) - _PARAMETERS), deviation**2)
    from scipy.optimize import brentq  # a third of a second to import

    ends = [
        end if value < limit else brentq(lambda centre: cost(centre) - limit, centres[best], end, xtol=_RESOLVED)
        for end, value in ((centres[0], costs[0]), (centres[-1], costs[-1]))
    ]
    return float(start + ends[0] * unit), float(start + ends[1] * unit)


def scatter(radius: Floats) -> float:
    """Standard deviation of the noise of samples (n,) from one to the next, from the median absolute third difference:
    these cancel the motion except at the few collapses; 0 below 8 samples."""
    return float(1.4826 * np.median(np.abs(np.diff(radius, 3))) / np.sqrt(20.0)) if len(radius) > 7 else 0.0


def rounding(radius: Floats) -> float:
    """Step of which all radii (n,) are multiples, m; 0 where they have no common one."""
    steps = np.diff(np.unique(radius))
    if not len(steps):
        return 0.0
    multiples = np.append(radius, steps) / np.min(steps)
    return float(np.min(steps)) if np.all(np.abs(multiples - np.round(multiples)) < 1e-2) else 0.0


def repeated(radius: Floats) -> tuple[int, int] | None:
    """(samples that equal the one before, times that each one stands, 0 if not alike) of samples (n,) that repeat more
    often than rounding explains; None: they do not. Where the radius moves on to one side by clearly more than the
    rounding, two equal samples are a chance of at most about the step over the jumps before and after them."""
    start = np.flatnonzero(np.diff(radius, prepend=np.nan) != 0)
    value, length = radius[start], np.diff(start, append=len(radius))
    step, before, after = rounding(radius), np.diff(value)[:-1], np.diff(value)[1:]
    slowest, whole = np.minimum(np.abs(before), np.abs(after)), np.abs(before + after)
    same_sign, jump = np.sign(before) == np.sign(after), _JUMP * float(np.max(radius, initial=0.0))
    moves = same_sign & (slowest > max(1.5 * step, jump))
    lengths, by_chance = length[1:-1][moves], float(np.sum(step / whole[moves]))
    held = lengths[lengths > 1]
    if len(held) <= _REPEATED + 3.0 * by_chance:
        return None
    times = int(np.median(held))
    return len(radius) - len(value), times if np.mean(lengths == times) > 0.9 else 0


def frames_missed(time: Floats, radius: Floats, noise: float) -> float:
    """Frames by which the maximum lies before the first of samples (n,) that fall from there on; 0 unless they say by
    _EVIDENCE that it is more than one, and more than the skew of real falls. noise: that of the radius, m."""
    top = float(radius[:3].max())
    fallen = radius < _STEEP * top
    count = int(np.argmax(fallen)) if fallen.any() else len(radius)
    if count < _FEWEST:
        return 0.0
    x, y = (time[:count] - time[0]) / (time[count - 1] - time[0]), radius[:count] / top
    frame, deviation = float(np.median(np.diff(x))), max(noise / top, _SERIES)
    free, at_most = (_fit_series(x, y, centre=at, knee=4.0 * deviation) for at in (None, -frame))
    clear = free[0] < -max(frame, _SKEW) and at_most[2] - free[2] > _EVIDENCE * deviation**2
    return -free[0] / frame if clear else 0.0


def _clearly_better(cost: float, than: float, freedom: int) -> bool:
    """Whether one more parameter lowers the sum of squares beyond chance (four standard deviations)."""
    return freedom > 0 and than > cost * (1.0 + 16.0 / freedom)


def _fit_series(
    x: Floats, y: Floats, *, centre: float | None = None, skewed: bool = False, knee: float = _KNEE
) -> tuple[float, float, float]:
    """Fit y = top (1 - a s^2 - (2/3) a^2 s^4) + k s^3, s = x - centre, by reweighted Gauss-Newton: (centre, top, cost).

    A given `centre` is kept; k = 0 unless `skewed`. cost is the sum of squared residuals, weighted down beyond `knee`.
    """
    c2, c1, _ = np.polyfit(x, y, 2, full=True)[0]  # and no warning where samples are of one instant
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
        weight = 1.0 / np.sqrt(1.0 + (residual / knee) ** 2)
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


def rebound(top: float, noise: float) -> float:
    """By how much a radius must rise after a minimum that this is a collapse, of the maximum and the noise, m."""
    return float(np.clip(6.0 * noise, _SMALLEST_REBOUND * top, 4.0 * _SMALLEST_REBOUND * top))


def collapses_backwards(radius: Floats) -> int:
    """How many collapses samples (n,) show before their largest, where they are several, more than after it, with
    maxima that rise, as those of a bubble do if time runs backwards. Else 0."""
    if len(radius) < _FEWEST:
        return 0
    smooth = _median_of_three(radius)
    last = int(np.argmax(smooth))
    least = rebound(float(smooth[last]), scatter(radius))
    minima, maxima = turning_points(smooth[last::-1], least)
    later, _ = turning_points(smooth[last:], least)
    if len(minima) <= max(1, len(later)):
        return 0
    earlier = [float(smooth[last - i]) for i in maxima[:2]]  # the last one before the largest first
    rises = earlier[-1] <= earlier[0] < smooth[last] - least
    return len(minima) if rises else 0


def collapse_time(time: Floats, radius: Floats, i: int) -> float:
    """Time at which the two branches of R^(5/2) round the smallest sample i meet, kept between its neighbours."""
    if i < 2 or i > len(time) - 3:
        return float(time[i])
    t, y = time[i - 2 : i + 3], radius[i - 2 : i + 3] ** 2.5
    falling, rising = (y[1] - y[0]) / (t[1] - t[0]), (y[4] - y[3]) / (t[4] - t[3])
    if not falling < 0 < rising:
        return float(t[2])
    crossing = (y[3] - rising * t[3] - y[1] + falling * t[1]) / (falling - rising)
    return float(np.clip(crossing, t[1], t[3]))


def drift(time: Floats, radius: Floats, minima: list[int], maxima: list[int], rise: float) -> int | None:
    """Index from which a radius drifts upwards, by more than `rise`, as no oscillating bubble does (it breaks up, or
    another comes before it); None: it does not. Either a rebound goes higher than the one before, or, a period after
    the last collapse, the running median over a period rises."""
    if not minima:
        return None
    for collapse, following in pairwise([*minima[1:], len(radius)]):
        before = [i for i in maxima if i < collapse]
        if before and np.max(radius[collapse:following]) > radius[before[-1]] + rise:
            return collapse
    period = time[minima[-1]] - time[minima[-2]] if len(minima) > 1 else 2.0 * (time[minima[0]] - time[0])
    late = int(np.searchsorted(time, time[minima[-1]] + period))
    width = max(late - minima[-1], 5)
    if len(time) - late < width:
        return None
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(radius[late:], width), axis=1)
    lowest = np.minimum.accumulate(smooth)
    risen = np.flatnonzero(smooth - lowest > rise)
    return late + int(np.argmin(smooth[: risen[0] + 1])) + width // 2 if len(risen) else None


def plateau(time: Floats, radius: Floats, first_collapse: float | None) -> tuple[float, float] | None:
    """`RadiusCurve.stretch_from_tail` of samples (n,) that begin at R_max."""
    duration = time[-1] - time[0]
    late = time > time[-1] - duration / 3.0
    before = (time > time[-1] - duration / 2.0) & ~late
    early = first_collapse is not None and 2.0 * (first_collapse - time[0]) > duration * 2.0 / 3.0
    if early or np.count_nonzero(late) < 8 or np.count_nonzero(before) < 3:
        return None
    level = float(np.mean(radius[late]))
    slope = float(np.polyfit(time[late] - time[-1], radius[late], 1)[0])
    drifts = max(abs(slope) * duration / 3.0, abs(level - float(np.median(radius[before])))) / level
    scatter = float(np.std(radius[late], ddof=1)) / level
    if scatter > 0.05 or drifts > 0.05:
        return None
    stretch = float(radius[0]) / level
    return stretch, stretch * float(np.hypot(scatter, drifts / 2.0))

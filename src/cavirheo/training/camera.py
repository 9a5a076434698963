"""Recordings of simulated curves: the camera, its noise, what is lost, and R_max as it is read off the frames.

Each time that a curve is shown, another camera films it: 20 to 400 frames at 0.1 to 10 us, any phase of the clock,
exposures of up to a frame, a scale that is wrong by half a per cent, noise of 0.1 to 5 % of R_max (or hardly any),
in half of them a slow discrepancy of radius and clock (inference/noise.py), frames that are missing, growth recorded or
not (then R_max lies up to a frame from the first one), and any end after the first collapse. Compiled, for it takes
place before every step of the training.
"""

# ruff: noqa: NPY002  compiled code has a generator of its own, which each call seeds

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats
from cavirheo.inference.bins import END, SCALE, cells, half_widths
from cavirheo.inference.latent import SLOTS
from cavirheo.physics.cache import compiled
from cavirheo.physics.media import WATER
from cavirheo.training.curves import STEPS, TOP, CurveStore

FEWEST, MOST = 20, 400  # frames
FASTEST, SLOWEST = 1e-7, 1e-5  # s between them
_ROOM = 3 * MOST


@dataclass(frozen=True)
class Filmed:
    """inputs: (m, SIZE). z: (m, 9). kind: (m,). discrepancy: (m,) 0 or 1. noise: (m,) true size of the white part."""

    inputs: NDArray[np.float32]
    z: NDArray[np.float32]
    kind: NDArray[np.int64]
    discrepancy: NDArray[np.float32]
    noise: Floats


def film(shots: CurveStore, index: NDArray[np.int64], seed: int) -> Filmed:
    """Recordings of curves `index` (m,), the same for equal seeds; those without a readable R_max are left out."""
    m = len(index)
    top = shots.max_radius[index].astype(float)
    t_c = WATER.time_scale(1.0) * top
    time, radius = np.empty((m, _ROOM)), np.empty((m, _ROOM))
    summary = np.zeros((m, 10))
    _film(shots.time[index], shots.radius[index], t_c, seed, time, radius, summary)
    read, frame, noise = summary[:, 2], summary[:, 3], summary[:, 5]
    with np.errstate(divide="ignore", invalid="ignore"):
        width_t, width_r = half_widths(frame / read, noise, summary[:, 9])
        early, more = -summary[:, 1] / read / width_t, (1.0 / read - 1.0) / width_r
    good = (summary[:, 0] > 0) & (np.abs(early) < 1.0) & (np.abs(more) < 1.0)  # what the priors allow
    count, _, read, frame, exposure, noise, discrepancy, scale, true_noise, late = summary[good].T
    count = count.astype(np.int64)
    sample = np.repeat(np.arange(len(count)), count)
    flat = np.concatenate([np.arange(c) for c in count]) if len(count) else np.empty(0, np.int64)
    rows = np.flatnonzero(good)[sample]
    numbers = {"max_radius": top[good] * read / scale, "frame": frame / read, "exposure": exposure / read}
    numbers |= {"noise": noise, "discrepancy": discrepancy, "late": late}
    inputs = cells(sample, time[rows, flat], radius[rows, flat], **numbers)
    z = shots.z[index][good].copy()
    z[:, SLOTS.index("max_radius_factor")] = 3.0 * more[good]
    z[:, SLOTS.index("time_origin")] = early[good]
    z[:, SLOTS.index("radius_scale")] = (scale - 1.0) / SCALE
    kind = shots.kind[index][good].astype(np.int64)
    return Filmed(inputs, z, kind, discrepancy.astype(np.float32), true_noise)


@compiled
def _at(curve: Any, t: float) -> float:
    """R/R_max at t* of a curve (STEPS + 1,) at regular times; R is even about R_max."""
    place = abs(t) * (STEPS / END)
    if place >= STEPS:
        return curve[STEPS]
    low = int(place)
    return curve[low] + (place - low) * (curve[low + 1] - curve[low])


@compiled
def _solve(a: float, b: float, c: float, d: float, e: float, f: float, x: float, y: float, z: float) -> Any:
    """The solution of the symmetric [[a, b, c], [b, d, e], [c, e, f]] with right side x, y, z; Cramer's rule."""
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    whole = a * p + b * q + c * r
    if abs(whole) < 1e-300:
        return 0.0, 0.0, 0.0
    first = (x * p + y * q + z * r) / whole
    second = (x * q + y * (a * f - c * c) + z * (b * c - a * e)) / whole
    third = (x * r + y * (b * c - a * e) + z * (a * d - b * b)) / whole
    return first, second, third


@compiled
def _maximum(time: Any, radius: Any, n: int) -> tuple[float, float, float]:
    """(time, radius, 1 if no growth is seen) of the maximum as landmarks.fit_maximum reads it, without skew; radius 0
    if there is none."""
    smooth = np.empty(n)
    for i in range(n):
        a, b, c = radius[max(i - 1, 0)], radius[i], radius[min(i + 1, n - 1)]
        if i == 0:
            a = radius[1]
        if i == n - 1:
            c = radius[n - 2]
        smooth[i] = max(min(a, b), min(max(a, b), c))
    peak, highest = 0, 0.0
    largest = np.max(smooth)
    for i in range(n):
        highest = max(highest, smooth[i])
        if smooth[i] < 0.6 * highest and highest > 0.5 * largest:
            break
        if smooth[i] > smooth[peak]:
            peak = i
    level = 0.9 * smooth[peak]
    last = peak
    while last < n and smooth[last] > level:
        last += 1
    if last == n:
        return 0.0, 0.0, 0.0
    first = peak
    while first > 0 and smooth[first - 1] > level:
        first -= 1
    grown = first > 0 or np.min(smooth[: peak + 1]) < 0.97 * smooth[peak]
    if last - first < 3:
        first, last = max(peak - 1, 0), min(peak + 3, n)
    unit = time[last - 1] - time[first]
    if not unit > 0:
        return 0.0, 0.0, 0.0
    zero, highest_smooth = time[peak], smooth[peak]
    s0 = s1 = s2 = s3 = s4 = r0 = r1 = r2 = 0.0  # the parabola through them
    top = 0.0
    for i in range(first, last):
        x, y = (time[i] - zero) / unit, radius[i] / highest_smooth
        top = max(top, y)
        s0, s1, s2, s3, s4 = s0 + 1.0, s1 + x, s2 + x * x, s3 + x**3, s4 + x**4
        r0, r1, r2 = r0 + y, r1 + x * y, r2 + x * x * y
    _, c1, c2 = _solve(s0, s1, s2, s2, s3, s4, r0, r1, r2)
    start, stop = (time[first] - zero) / unit, (time[last - 1] - zero) / unit
    centre, a = start, max(-c2, 1e-3)
    if grown:
        centre = min(max(-c1 / (2.0 * c2), start), stop) if c2 < 0 else 0.0
    for _ in range(10):
        m00 = m01 = m02 = m11 = m12 = m22 = v0 = v1 = v2 = 0.0
        for i in range(first, last):
            s = (time[i] - zero) / unit - centre
            u = a * s * s
            shape = 1.0 - u - u * u * (2.0 / 3.0)
            slope = -top * (1.0 + u * (4.0 / 3.0))
            residual = radius[i] / highest_smooth - top * shape
            weight = 1.0 / np.sqrt(1.0 + (residual / 0.005) ** 2)
            g1, g2 = slope * s * s, -2.0 * a * slope * s
            m00, m01, m02 = m00 + weight * shape * shape, m01 + weight * shape * g1, m02 + weight * shape * g2
            m11, m12, m22 = m11 + weight * g1 * g1, m12 + weight * g1 * g2, m22 + weight * g2 * g2
            v0, v1, v2 = v0 + weight * shape * residual, v1 + weight * g1 * residual, v2 + weight * g2 * residual
        if grown:
            d0, d1, d2 = _solve(m00, m01, m02, m11, m12, m22, v0, v1, v2)
            centre += min(max(d2, -0.25), 0.25)
        else:
            d0, d1, _ = _solve(m00, m01, 0.0, m11, 0.0, 1.0, v0, v1, 0.0)
        top += d0
        a = max(a + min(max(d1, -0.5 * a), a), 1e-6)
    if not (0.9 < top < 1.15 and start - 1.0 <= centre <= stop):
        return 0.0, 0.0, 0.0
    return zero + centre * unit, top * highest_smooth, 0.0 if grown else 1.0


@compiled
def _film(nodes: Any, values: Any, t_c: Any, seed: int, out_time: Any, out_radius: Any, summary: Any) -> None:
    """Film each curve into a row of `out_time` (t* of the read R_max) and `out_radius`; `summary` as `film` takes it
    apart, in t* of the true R_max; a row that stays 0 could not be read."""
    np.random.seed(seed)
    time, radius, third = np.empty(_ROOM), np.empty(_ROOM), np.empty(_ROOM)
    curve = np.empty(STEPS + 1)
    for m in range(len(t_c)):
        node, value = nodes[m], values[m]
        for i in range(1, len(node)):
            a, b = float(node[i - 1]), float(node[i])
            y, rise = (
                value[i - 1] * (TOP / 65535.0),
                (float(value[i]) - float(value[i - 1])) * (TOP / 65535.0) / (b - a),
            )
            for j in range(node[i - 1], node[i] + 1):
                curve[j] = y + rise * (j - a)
        fall = 1.5
        for i in range(1, len(node) - 1):  # the first collapse
            if value[i] < value[i - 1] and value[i] <= value[i + 1] and value[i] < 0.9 * value[0]:
                fall = node[i] * (END / STEPS)
                break
        shortest = min(1.25 * fall + 0.15, END - 0.5)
        end = shortest + (END - shortest) * np.random.random()
        if np.random.random() < 0.25:
            end = END
        quickest = np.log(max(FASTEST / t_c[m], end / MOST))
        slowest = np.log(max(min(SLOWEST / t_c[m], end / FEWEST), end / MOST * 1.01))
        frame = np.exp(quickest + (slowest - quickest) * np.random.random())
        grows = np.random.random() < 0.6
        phase = np.random.random() - 0.5 if grows else 2.0 * np.random.random() - 1.0
        before = int(min(1.0 + 8.0 * np.random.random(), 3.0 / frame, 60.0)) if grows else 0
        if grows:
            before = int(min(max(before, 0.6 / frame * np.random.random() + 1.0), 200.0))
        n = min(before + int(end / frame) + 1, _ROOM)
        exposure = 0.0
        if np.random.random() < 0.3:
            exposure = frame * np.random.random()
        scale = 2.0
        while abs(scale - 1.0) > 3.0 * SCALE:
            scale = 1.0 + SCALE * np.random.standard_normal()
        white = np.exp(np.log(1e-3) + np.log(50.0) * np.random.random())
        if np.random.random() < 0.12:
            white = 1e-4
        disturbed = np.random.random() < 0.5
        slow = late = 0.0
        tau = 1.0
        if disturbed:
            slow = np.exp(np.log(1e-3) + np.log(20.0) * np.random.random())
            which = 3.0 * np.random.random()
            late = 0.0 if which < 1 else 0.5 * slow if which < 2 else 2.0 * slow
            which = 3.0 * np.random.random()
            tau = 0.1 if which < 1 else 0.5 if which < 2 else 2.0
        lost = 0.2 * np.random.random() if np.random.random() < 0.3 else 0.0
        small = 0.05 + 0.2 * np.random.random() if np.random.random() < 0.2 else 0.0
        gap_start, gap_end = 2.0 * END, 0.0
        if np.random.random() < 0.1:
            gap_start = 0.5 + (end - 0.5) * np.random.random()
            gap_end = gap_start + 0.5 * np.random.random()
        count = 0
        a, b = np.random.standard_normal(), np.random.standard_normal()
        rho = np.exp(-frame / tau)
        innovation = np.sqrt(1.0 - rho * rho)
        for i in range(n):
            t = (i - before + phase) * frame
            if exposure > 0:
                y = 0.0
                for k in range(5):
                    y += 0.2 * _at(curve, t + (0.2 * k - 0.4) * exposure)
            else:
                y = _at(curve, t)
            if disturbed:
                a = rho * a + innovation * np.random.standard_normal()
                b = rho * b + innovation * np.random.standard_normal()
                speed = (_at(curve, t + 0.5 * frame) - _at(curve, t - 0.5 * frame)) / frame
                y += slow * a + late * b * speed * (1.0 if t > 0 else -1.0)
            y += white * np.random.standard_normal()
            away = np.random.random() < lost or y < small or gap_start < t < gap_end
            if away or y <= 0.003 or t > END:
                continue
            time[count], radius[count] = t, y
            count += 1
        if count < 12:
            continue
        origin, read, no_growth = _maximum(time, radius, count)
        if read < 0.7 or read > 1.4:
            continue
        first = 0
        while first < count and time[first] < origin:
            first += 1
        left = count - first
        if left < 10:
            continue
        for i in range(left):
            out_time[m, i] = (time[first + i] - origin) / read
            out_radius[m, i] = radius[first + i] / read
        for i in range(left - 3):
            rise = out_radius[m, i + 3] - out_radius[m, i]
            third[i] = abs(rise - 3.0 * (out_radius[m, i + 2] - out_radius[m, i + 1]))
        noise = 1.4826 * np.sort(third[: left - 3])[(left - 3) // 2] / np.sqrt(20.0)
        summary[m, 0], summary[m, 1], summary[m, 2], summary[m, 3], summary[m, 4] = left, origin, read, frame, exposure
        summary[m, 5], summary[m, 6], summary[m, 7], summary[m, 8] = noise, 1.0 if disturbed else 0.0, scale, white
        summary[m, 9] = no_growth

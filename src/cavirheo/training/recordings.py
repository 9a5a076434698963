"""Training data of a posterior network: curves that are simulated once, and new recordings of them at each step.

A curve is stored as R/R_max at 512 of 2,401 regular times to t* = 6, dense where it bends. For each use a new camera is
drawn: 20 to 400 frames at 0.1 to 10 us, any phase of the clock, exposures of up to a frame, a scale with an error of
half a per cent, noise of 0.1 to 5 % of R_max (or hardly any), in half of the recordings a slow discrepancy of the
radius, often also of the clock (inference/noise.py), lost frames, growth recorded or not (then R_max lies up to a frame
from the first one), and an end at any time after the first collapse. R_max is determined from the frames. The code is
compiled, because it runs before every step of the training.
"""

# ruff: noqa: NPY002  compiled code has a generator of its own, which each call seeds

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.inference.assumptions import Family
from cavirheo.inference.experiment import half_widths
from cavirheo.inference.posterior_network import (
    BUBBLE_NAMES,
    COORDINATES,
    END,
    SCALE,
    binned,
    damping,
    to_latent,
    z_index,
)
from cavirheo.parameters import PARAMETERS
from cavirheo.physics.accuracy import ROUGH
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.cache import compiled
from cavirheo.physics.media import WATER
from cavirheo.physics.simulate import simulate
from cavirheo.prior import uniforms
from cavirheo.training.recipe import PosteriorTable

NODES = 512
STEPS = 2400  # intervals of the regular times
LARGEST_RADIUS = 1.1  # R/R_max that is stored as the largest integer
MIN_FRAMES, MAX_FRAMES = 20, 400  # frames from R_max to the end
MIN_INTERVAL, MAX_INTERVAL = 1e-7, 1e-5  # s between frames
_ROW_LENGTH = 3 * MAX_FRAMES


Columns = Mapping[str, Any]  # arrays (n, ...) of many curves, by name
COLUMNS: dict[str, tuple[Any, tuple[int, ...]]] = {  # dtype and shape of a row
    "time": (np.uint16, (NODES,)),  # indices of the regular times; may be on the disk
    "radius": (np.uint16, (NODES,)),
    "z": (np.float32, (len(COORDINATES),)),
    "kind": (np.uint8, ()),  # index of the pair of law and bubble
    "max_radius": (np.float32, ()),  # m
}


def simulated_curves(table: PosteriorTable, seed: int, block: range) -> dict[str, Any]:
    """Columns of the curves `block`, without those whose simulation failed."""
    curves = [curve for index in block if (curve := simulated_curve(table, seed, index)) is not None]
    rows = np.array(curves, dtype=[(name, *column) for name, column in COLUMNS.items()])
    return {name: rows[name] for name in COLUMNS}


def simulated_curve(table: PosteriorTable, seed: int, index: int) -> tuple[Any, ...] | None:
    """Curve `index`: (time, radius, z, kind, max_radius), or None if its simulation failed."""
    draws = uniforms(seed, index, 9)
    shares = np.cumsum([share for *_, share in table.kinds])
    kind = int(np.searchsorted(shares, draws[0] * shares[-1], side="right"))
    law, bubble_name, _ = table.kinds[kind]
    family, extra = Family(law), ["accommodation"] if "accommodation" in BUBBLE_NAMES[bubble_name] else []
    names = (*family.parameters, "stretch", *extra)  # drawn uniformly in log10, as R_max is
    bounds = np.array([PARAMETERS[name].search_range for name in names])
    low, high = (1e-6 * end for end in table.max_radius_um)
    log10 = bounds[:, 0] + draws[2 : 2 + len(names)] * (bounds[:, 1] - bounds[:, 0])
    max_radius = float(low * (high / low) ** draws[1])
    z = to_latent(names, log10[None])[0]
    bubble = FIELD
    if bubble_name == "real":
        z[z_index("confinement_damping")] = ndtri(draws[8])
        damped = float(damping(z[z_index("confinement_damping")]))
        bubble = Bubble("kinetic", float(10.0 ** log10[-1]), confinement_damping=damped)
    law_size = len(family.parameters)
    stretch = float(10.0 ** log10[law_size])
    times = np.linspace(0.0, END, STEPS + 1) * WATER.time_scale(max_radius)
    material = family.material(log10[:law_size])
    settings: dict[str, Any] = {"time": times, "bubble": bubble, "accuracy": ROUGH, "throw": False}
    try:
        run = simulate(material, max_radius=max_radius, stretch=stretch, **settings)
    except InputError:
        return None
    if not run.ok or not np.isfinite(run.radius).all():
        return None
    radius = run.radius / max_radius
    chosen = nodes(radius)
    return chosen, np.round(np.clip(radius[chosen] / LARGEST_RADIUS, 0.0, 1.0) * 65535), z, kind, max_radius


def nodes(radius: Floats) -> NDArray[np.int64]:
    """Ascending indices (NODES,) of points of a curve (STEPS + 1,); straight lines between them follow the curve."""
    bend = np.zeros(STEPS + 1)
    bend[1:-1] = np.abs(np.diff(radius, 2))
    bend = np.maximum(bend, np.maximum(np.roll(bend, 1), np.roll(bend, -1)))
    density = np.sqrt(bend)
    density /= np.sum(density) + 1e-12
    # at most one node at each time: the excess is given to the other times
    share = 0.3 / (STEPS + 1) + 0.7 * density
    for _ in range(6):
        share = np.minimum(share, 1.0 / NODES)
        share /= np.sum(share)
    filled = np.cumsum(share) * (NODES - 1)
    chosen = np.unique(np.concatenate([[0, STEPS], np.searchsorted(filled, np.arange(1, NODES - 1))]))
    chosen = chosen[chosen <= STEPS]
    if len(chosen) < NODES:
        free = np.setdiff1d(np.arange(STEPS + 1), chosen)
        added = free[np.argsort(-share[free], kind="stable")[: NODES - len(chosen)]]
        chosen = np.sort(np.concatenate([chosen, added]))
    return chosen


class FilmedBatch(NamedTuple):
    """inputs: (m, SIZE). z: (m, 9). kind: (m,). discrepancy: (m,) 0 or 1. noise: (m,) true white noise over R_max."""

    inputs: NDArray[np.float32]
    z: NDArray[np.float32]
    kind: NDArray[np.int64]
    discrepancy: NDArray[np.float32]
    noise: Floats


def film(shots: Columns, index: NDArray[np.int64], seed: int) -> FilmedBatch:
    """Recordings of curves `index` (m,), the same for equal seeds; those without a readable R_max, or with an R_max or
    clock outside its prior, are left out."""
    m = len(index)
    rng = np.random.default_rng(seed)
    max_radius = shots["max_radius"][index].astype(float)
    nodes, radii = (columns[index].astype(float) for columns in (shots["time"], shots["radius"]))
    nodes, radii = nodes * (END / STEPS), radii * (LARGEST_RADIUS / 65535.0)
    middle = radii[:, 1:-1]
    minima = (middle < radii[:, :-2]) & (middle <= radii[:, 2:]) & (middle < 0.9 * radii[:, :1])
    collapse = np.where(minima.any(axis=1), nodes[np.arange(m), np.argmax(minima, axis=1) + 1], 1.5)  # t* of the first
    camera = _cameras(rng, collapse, WATER.time_scale(1.0) * max_radius)
    time, radius, summary = np.empty((m, _ROW_LENGTH)), np.empty((m, _ROW_LENGTH)), np.zeros((m, 5))
    _film(nodes, radii, camera, int(rng.integers(2**31)), time, radius, summary)
    count, origin, read, noise, no_growth = summary.T
    with np.errstate(divide="ignore", invalid="ignore"):
        width_t, width_r = half_widths(camera.frame / read, noise, no_growth)
        time_shift, radius_excess = -origin / read / width_t, (1.0 / read - 1.0) / width_r
    good = (count > 0) & (np.abs(time_shift) < 1.0) & (np.abs(radius_excess) < 1.0)  # what the priors allow
    camera, read, frames = camera[good], read[good], np.arange(_ROW_LENGTH) < count[good, None]
    discrepancy = 1.0 * (camera.radius_discrepancy > 0)
    numbers = {"max_radius": max_radius[good] * read / camera.scale, "frame": camera.frame / read}
    numbers |= {"exposure": camera.exposure / read, "noise": noise[good], "discrepancy": discrepancy}
    inputs = binned(np.nonzero(frames)[0], time[good][frames], radius[good][frames], **numbers, late=no_growth[good])
    z = shots["z"][index][good].copy()
    z[:, COORDINATES.index("max_radius_factor")] = 3.0 * radius_excess[good]
    z[:, COORDINATES.index("time_origin")] = time_shift[good]
    z[:, COORDINATES.index("radius_scale")] = (camera.scale - 1.0) / SCALE
    kind = shots["kind"][index][good].astype(np.int64)
    return FilmedBatch(inputs, z, kind, discrepancy.astype(np.float32), np.array(camera.white))


def _cameras(rng: np.random.Generator, collapse: Floats, t_c: Floats) -> Any:
    """Camera, noise and lost frames for each of m curves, as a record array; times in t*, lengths over the true R_max.

    collapse: (m,) t* of the first collapse. t_c: (m,) s, unit of t*.
    """

    def uniform(low: Any = 0.0, high: Any = 1.0) -> Floats:
        return low + (high - low) * rng.random(len(t_c))

    def log_uniform(low: Any, high: Any) -> Floats:
        return np.exp(uniform(np.log(low), np.log(high)))

    def in_share(share: float, values: Any, otherwise: Any = 0.0) -> Floats:
        return np.where(uniform() < share, values, otherwise)

    end = in_share(0.25, END, uniform(np.minimum(1.25 * collapse + 0.15, END - 0.5), END))
    slowest = np.minimum(MAX_INTERVAL / t_c, end / MIN_FRAMES)
    frame = log_uniform(np.maximum(MIN_INTERVAL / t_c, end / MAX_FRAMES), np.maximum(slowest, end / MAX_FRAMES * 1.01))
    grows = uniform() < 0.6
    growth = np.maximum(np.minimum(uniform(1.0, 9.0), 3.0 / frame), uniform(1.0, 1.0 + 0.6 / frame))
    before = np.where(grows, np.floor(np.minimum(growth, 200.0)), 0.0)  # frames before R_max
    radius_discrepancy = in_share(0.5, log_uniform(1e-3, 2e-2))
    gap = in_share(0.1, uniform(0.5, end), 2.0 * END)
    columns = {
        "frame": frame,
        "before": before - np.where(grows, uniform(-0.5, 0.5), uniform(-1.0, 1.0)),
        "count": np.minimum(before + np.floor(end / frame) + 1.0, _ROW_LENGTH),
        "exposure": in_share(0.3, frame * uniform()),
        "scale": 1.0 + SCALE * ndtri(uniform(ndtr(-3.0), ndtr(3.0))),
        "white": in_share(0.12, 1e-4, log_uniform(1e-3, 5e-2)),
        "radius_discrepancy": radius_discrepancy,  # size of the discrepancy of the radius
        "clock_discrepancy": radius_discrepancy * rng.choice((0.0, 0.5, 2.0), len(t_c)),  # the same of the clock
        "tau": rng.choice((0.1, 0.5, 2.0), len(t_c)),  # correlation time of both
        "lost": in_share(0.3, uniform(0.0, 0.2)),  # part of the frames that is lost
        "smallest": np.maximum(in_share(0.2, uniform(0.05, 0.25)), 0.003),  # smallest radius that is measured
        "gap": gap,
        "gap_end": gap + uniform(0.0, 0.5),
    }
    return np.rec.fromarrays(list(columns.values()), dtype=[(name, float) for name in columns])


@compiled
def _maximum(time: Any, radius: Any) -> tuple[float, float, float]:
    """(time, radius, 1 if no growth is seen) of the maximum, computed as in landmarks.fit_maximum without skew; radius
    0 if there is no maximum."""
    n = len(time)
    before, after = np.append(radius[1:2], radius[:-1]), np.append(radius[1:], radius[-2:-1])
    smooth = np.maximum(np.minimum(before, after), np.minimum(np.maximum(before, after), radius))
    peak, highest, largest = 0, 0.0, np.max(smooth)
    for i in range(n):
        highest = max(highest, smooth[i])
        if smooth[i] < 0.6 * highest and highest > 0.5 * largest:
            break
        if smooth[i] > smooth[peak]:
            peak = i
    level = 0.9 * smooth[peak]
    first = last = peak
    while last < n and smooth[last] > level:
        last += 1
    if last == n:
        return 0.0, 0.0, 0.0
    while first > 0 and smooth[first - 1] > level:
        first -= 1
    has_growth = first > 0 or np.min(smooth[: peak + 1]) < 0.97 * smooth[peak]
    if last - first < 3:
        first, last = max(peak - 1, 0), min(peak + 3, n)
    unit = time[last - 1] - time[first]
    if not unit > 0:
        return 0.0, 0.0, 0.0
    x, y = (time[first:last] - time[peak]) / unit, radius[first:last] / smooth[peak]
    rows = np.stack((np.ones(len(x)), x, x * x))
    _, slope, bend = np.linalg.solve(rows @ rows.T, rows @ y)
    top, centre, a = np.max(y), x[0], max(-bend, 1e-3)
    if has_growth:
        centre = min(max(-slope / (2.0 * bend), x[0]), x[-1]) if bend < 0 else 0.0
    for _ in range(10):
        s = x - centre
        u = a * s * s
        shape, fall = 1.0 - u - u * u * (2.0 / 3.0), -top * (1.0 + u * (4.0 / 3.0))
        residual = y - top * shape
        weight = 1.0 / np.sqrt(1.0 + (residual / 0.005) ** 2)
        rows = np.stack((shape, fall * s * s, -2.0 * a * fall * s))[: 3 if has_growth else 2]
        step = np.linalg.solve((rows * weight) @ rows.T, rows @ (weight * residual))
        top += step[0]
        if has_growth:
            centre += min(max(step[2], -0.25), 0.25)
        a = max(a + min(max(step[1], -0.5 * a), a), 1e-6)
    if not (0.9 < top < 1.15 and x[0] - 1.0 <= centre <= x[-1]):
        return 0.0, 0.0, 0.0
    return time[peak] + centre * unit, top * smooth[peak], 0.0 if has_growth else 1.0


@compiled
def _correlated_noise(rho: float, n: int) -> Any:
    """Values (n,) of a stationary Gaussian process of variance 1, with correlation `rho` between neighbours."""
    values = np.random.normal(0.0, 1.0, n)
    for i in range(1, n):
        values[i] = rho * values[i - 1] + np.sqrt(1.0 - rho * rho) * values[i]
    return values


@compiled
def _film(nodes: Any, radii: Any, cameras: Any, seed: int, out_time: Any, out_radius: Any, summary: Any) -> None:
    """Film each curve with its camera into a row of `out_time` (t* of the measured R_max) and `out_radius`.

    summary: number of frames; time (t*) and size (over the true R_max) of the measured R_max; noise from frame to
    frame; 1 where no growth is seen. The row of a recording whose R_max cannot be read stays 0.
    """
    np.random.seed(seed)
    for m in range(len(cameras)):
        node, curve, camera = nodes[m], radii[m], cameras[m]
        n, frame = int(camera.count), camera.frame
        t = (np.arange(n) - camera.before) * frame
        if camera.exposure > 0:
            y = np.zeros(n)
            for k in range(5):
                y += 0.2 * np.interp(np.abs(t + (0.2 * k - 0.4) * camera.exposure), node, curve)
        else:
            y = np.interp(np.abs(t), node, curve)  # R is even about R_max
        if camera.radius_discrepancy > 0:
            ahead = np.interp(np.abs(t + 0.5 * frame), node, curve)
            behind = np.interp(np.abs(t - 0.5 * frame), node, curve)
            rho = np.exp(-frame / camera.tau)
            y = y + camera.radius_discrepancy * _correlated_noise(rho, n)
            y += camera.clock_discrepancy * _correlated_noise(rho, n) * np.sign(t) * (ahead - behind) / frame
        y = y + camera.white * np.random.normal(0.0, 1.0, n)
        measured = (np.random.random(n) >= camera.lost) & (y >= camera.smallest) & (t <= END)
        measured &= (t <= camera.gap) | (t >= camera.gap_end)
        t, y = t[measured], y[measured]
        if len(t) < 12:
            continue
        origin, read, no_growth = _maximum(t, y)
        if read < 0.7 or read > 1.4:
            continue
        t, y = (t[t >= origin] - origin) / read, y[t >= origin] / read
        n = len(t)
        if n < 10:
            continue
        out_time[m, :n], out_radius[m, :n] = t, y
        third = y[3:] - y[:-3] - 3.0 * (y[2:-1] - y[1:-2])
        noise = 1.4826 * np.median(np.abs(third)) / np.sqrt(20.0)
        summary[m, 0], summary[m, 1], summary[m, 2], summary[m, 3], summary[m, 4] = n, origin, read, noise, no_growth

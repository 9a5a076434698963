"""Clock, radius scale and R_max factor of a recording, integrated out for each simulation without further simulations.

They move the frames of a bubble that is already solved. In units of t_c its radius is f R*((t - t_0)/(s f t_c)) with
clock t_0, radius scale s and R_max factor f. Parameters that scale with p t_c scale with the size: a viscosity or a
relaxation time of the law is s f times that of the simulation (`rescaled`). Otherwise size changes R* through heat and
mass transfer, and hardly through surface tension and sound: 1 % of size changes R* by 0.15 % of R_max RMS. If frames
are accurate enough to show this (`resolves_size`), a second simulation gives R* to first order in size. Otherwise one
near the maximum is used for all simulations, because the effect hardly changes across a posterior.

For each simulation, Gauss-Newton steps on the frames find the most likely p = (t_0, s, f). The integral over p is
Laplace's about it, with the curvature H of -log(likelihood x prior) there:

    p(frames | simulation) = p(frames | p) prior(p) (2 pi)^(m/2) |H|^(-1/2).

This integral is used to find maxima. If a collapse is close to a frame, the curvature depends on the side of the frame
on which the most likely clock is, and the logarithm of the integral is wrong by 1, at times by 6. Answers therefore do
not use it: draws of a surrogate include p (surrogate.py), and weighted simulations are integrated over p by importance
sampling (mode.py).

The clock is not linearised about one value for all simulations, because its nonlinear effect bends posteriors. Its
prior is normal here, with the standard deviation of the uniform one within its bound.

An extended residual has four parts: n frames, measured minus simulated over R_max; p in units of its prior's standard
deviations, as m pulls; the logarithm of the factor of the integral besides likelihood and exp(-pulls^2/2); and the
shape of the bubble, from which its frames can be computed again.

A shape is the instants of the collapses, over the length of the grid, and R/R_max at nodes between them, at fixed
shares of the time from one to the next. As a function of a parameter, R at a fixed instant has a kink where a collapse
passes it; a shape has none and changes smoothly. If size counts, the change of the shape for a bubble that is larger by
SIZE_STEP follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats
from cavirheo.inference.noise import Covariances, Noise, expanded, squared, summed
from cavirheo.parameters import parameter_of
from cavirheo.physics.cache import compiled, kernel

NAMES = ("time_origin", "radius_scale", "max_radius_factor")
GRID_STEP = 0.004  # largest step of the grid of a simulation, t_c
STEPS_PER_FRAME = 3.0  # fewest steps of this grid for each frame
MAX_GRID_STEPS = 4000  # most steps of this grid
MAX_NEWTON_STEPS = 20  # Gauss-Newton steps at most
ROUGH_GAIN, SHAPE_GAIN, FINAL_GAIN = 0.1, 0.02, 1e-5  # steps end at this gain: rough; then for a shape, a simulation
# clocks at which these steps start, in standard deviations: a clock read off noisy frames may be far off
CLOCK_STARTS = (-2.4, -1.8, -1.2, -0.6, 0.0, 0.6, 1.2, 1.8, 2.4)
MAX_CLIMBED_STARTS = 4  # starts at most from which steps are made: those that are likelier than both neighbours,
LIKELIEST_STARTS = 2  # and this number of the likeliest
SIZE_STEP = 0.02  # relative difference in size of the bubble of the second simulation
SIZE_EFFECT = 0.15  # RMS change of R* over the relative change of size, approximately
SIZE_SHARE = 0.25  # share of the noise above which such a change counts
INSTANTS, SHAPE_INSTANTS = 9, 3  # instants in an exposure, for a simulation and for a shape
MAX_COLLAPSES = 4  # collapses of a shape at most
SHAPE_ERROR = 0.1  # largest RMS error of a shape, over the noise
NODES = 40  # intervals between nodes of a shape from one collapse to the next, short near a collapse
ROUGH_SHARE, FINAL_SHARE = 0.1, 0.01  # least share of a noise grid point that counts in rough and final steps
# coefficients of `_angle`, the highest power first
ANGLE = (
    0.07969721832, -0.08889298994, 0.07098148633, -0.005915243983, 0.02323865936, 0.02799663997, 0.0477702493,
    0.1061027352, 0.6366197756,
)  # fmt: skip
EMPTY = np.empty(0)
_LOG_2PI = float(np.log(2.0 * np.pi))


class SimulatedCurve(NamedTuple):
    """A simulation at regular instants: R/R_max, its time derivative (1/s), and the derivatives of both by the
    logarithm of the bubble's size, 0 if size does not count. Or a shape: then these arrays are empty, and `last` is the
    index of the grid's last instant."""

    radius: Floats
    speed: Floats
    by_size: Floats
    speed_by_size: Floats = EMPTY
    shape: Floats = EMPTY
    last: float = 0.0


class Frames(NamedTuple):
    """The fields of `CameraNuisances` for (n,) frames, as compiled functions take them, with `time` counted from the
    middle of the clock's prior. free: (m,) indices of those of clock, scale and factor that are not exact."""

    time: Floats
    measured: Floats
    widths: Floats
    free: NDArray[np.int64]
    instants: Floats
    shares: Floats
    step: float


@dataclass(frozen=True, eq=False)
class CameraNuisances:
    """Clock t_0, radius scale s and R_max factor f of the camera for (n,) frames. time: (n,) s after the measured
    R_max. measured: (n,) R/R_max. widths: prior standard deviations of t_0 (s), s and f; 0 for an exact one. exposure:
    of a frame, s. step: of the grid of a simulation, s. collapses: number in a shape. simulates_size: whether each
    simulation has its own effect of the bubble's size. by_size: (numbers,) change of the shape for a bubble that is
    larger by SIZE_STEP, the same for all bubbles; empty if it is not used. clock: middle of the prior of t_0, s."""

    time: Floats
    measured: Floats
    widths: Floats
    exposure: float
    step: float
    collapses: int = 0
    simulates_size: bool = False
    by_size: Floats = field(default_factory=lambda: EMPTY)
    clock: float = 0.0

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """(m,) indices of those of t_0, s and f that are not exact."""
        return np.flatnonzero(self.widths > 0)

    @property
    def size(self) -> int:
        """Length of an extended residual."""
        return len(self.time) + len(self.free) + 1 + (2 if self.simulates_size else 1) * self.numbers

    @property
    def numbers(self) -> int:
        """Length of the shape of one bubble."""
        return self.collapses + (self.collapses + 1) * (NODES + 1)

    @cached_property
    def frames(self) -> Frames:
        """The frames for simulations."""
        instants, shares = exposure_nodes(self.exposure, INSTANTS)
        return Frames(self.time - self.clock, self.measured, self.widths, self.free, instants, shares, self.step)

    @cached_property
    def shape_frames(self) -> Frames:
        """The frames for shapes, with fewer instants."""
        instants, shares = exposure_nodes(self.exposure, SHAPE_INSTANTS)
        return self.frames._replace(instants=instants, shares=shares)

    @cached_property
    def grid(self) -> Floats:
        """Instants (k,) of a simulation, s after R_max, which cover all frames with any likely clock and scale."""
        end = (float(np.max(self.time)) - self.clock + 3.0 * self.widths[0] + 0.5 * self.exposure) * 1.05
        return np.asarray(self.step * np.arange(int(np.ceil(end / self.step)) + 3))

    def resolves_size(self, noise: Noise) -> bool:
        """Whether the effect of the bubble's size on R* counts in frames with this noise."""
        return SIZE_EFFECT * float(np.hypot(*self.widths[1:])) > SIZE_SHARE * noise.typical

    def extended(self, run: SimulatedCurve, noise: Noise) -> tuple[Floats, Floats]:
        """Extended residual (size,) of a simulation on `grid`, and the curvature H (m, m) in units of the prior."""
        noise_parts = noise.covariances, noise.constants, noise.power
        residual, curvature = _integrated(run, self.frames, self.starts, FINAL_GAIN, *noise_parts)
        shape = _shape(run, self.step, self.collapses)
        if not self.simulates_size:
            return np.concatenate([residual, shape]), curvature
        radius = run.radius + SIZE_STEP * run.by_size
        larger = SimulatedCurve(radius, run.speed + SIZE_STEP * run.speed_by_size, run.by_size)
        return np.concatenate([residual, shape, _shape(larger, self.step, self.collapses) - shape]), curvature

    def with_collapses(self, run: SimulatedCurve, z: Floats, noise: Noise) -> CameraNuisances:
        """The camera with as many collapses in a shape as the frames of a simulation on `grid` need: at least those
        that were counted and that it has before the last frame; more if the shape does not give its frames otherwise,
        by a camera about z (m,) with any start of the clock."""
        counted = _shape(run, self.step, self.collapses)[: self.collapses] * self.grid[-1]
        views = z + np.array(CLOCK_STARTS)[:, None] * (self.free == 0)
        best, least = self, np.inf
        for count in range(int(np.count_nonzero(counted < np.max(self.time) - self.clock)), MAX_COLLAPSES + 1):
            camera = replace(self, collapses=count)
            missed = np.array([camera.shape_error(run, view) for view in views]) / noise.typical
            rms = float(np.sqrt(np.mean(missed**2)))
            if rms < least:
                best, least = camera, rms
            if least < SHAPE_ERROR:
                break
        return best

    def shape_error(self, run: SimulatedCurve, z: Floats) -> Floats:
        """Radius (n,) by the shape of a simulation on `grid` minus that by the simulation, with a camera z (m,)."""
        shape = _shape(run, self.step, self.collapses)
        by_shape = _difference_of_shapes(shape[None], z[None], len(self.grid) - 1.0, self.shape_frames)[0]
        columns = np.empty((len(self.time), len(self.free) + 1))
        _linearise_frames(run._replace(by_size=EMPTY), self.frames, z, columns)
        return columns[:, -1] - by_shape

    def residuals_of_shapes(self, shapes: Floats, noise: Noise) -> Floats:
        """Extended residuals (k, n + m + 1) of bubbles of these shapes (k, numbers), without the shapes."""
        noise_parts = noise.covariances, noise.constants, noise.power
        shapes, last = np.ascontiguousarray(shapes[:, : self.numbers]), len(self.grid) - 1.0
        return np.asarray(_residuals_of_shapes(shapes, last, self.shape_frames, self.starts, *noise_parts))

    def difference_of_shapes(self, shapes: Floats, z: Floats) -> Floats:
        """Measured minus simulated (k, n) of bubbles of these shapes (k, numbers) with a camera z (k, m); NaN where the
        simulation failed."""
        if self.simulates_size or len(self.by_size):
            values = self.natural(z)
            grown = values["radius_scale"] * values["max_radius_factor"] - 1.0
            by_size = shapes[:, self.numbers :] if self.simulates_size else self.by_size
            shapes = shapes[:, : self.numbers] + (grown / SIZE_STEP)[:, None] * by_size
        shapes, z = np.ascontiguousarray(shapes), np.ascontiguousarray(z)
        return np.asarray(_difference_of_shapes(shapes, z, len(self.grid) - 1.0, self.shape_frames))

    def radius_of(self, shape: Floats) -> Floats:
        """R/R_max on `grid` of a bubble of this shape (numbers,)."""
        run = SimulatedCurve(EMPTY, EMPTY, EMPTY, EMPTY, shape[: self.numbers], len(self.grid) - 1.0)
        return np.asarray(_radius(run))

    @cached_property
    def starts(self) -> Floats:
        """Starts (k, m) of the steps to the most likely clock, scale and factor."""
        m = len(self.free)
        starts = np.zeros((len(CLOCK_STARTS) if m and not self.free[0] else 1, m))
        if len(starts) > 1:  # frames near a collapse may allow two clocks
            starts[:, 0] = CLOCK_STARTS
        return starts

    def natural(self, z: Floats) -> dict[str, Floats]:
        """time_origin (s), radius_scale and max_radius_factor from z (..., m)."""
        values = {name: np.full(z.shape[:-1], self.clock if name == NAMES[0] else 1.0) for name in NAMES}
        for k, i in enumerate(self.free):
            values[NAMES[i]] = values[NAMES[i]] + self.widths[i] * z[..., k]
        return values

    def z(self, residuals: Floats) -> Floats:
        """The most likely clock, scale and factor (..., m), in units of their prior, in extended residuals."""
        return residuals[..., len(self.time) : len(self.time) + len(self.free)]

    def draw(self, middle: Floats, curvature: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Draws z (k, m) of Gaussians with this curvature (m, m) about `middle` (k, m), and log densities (k,)."""
        k, m = middle.shape
        off = rng.standard_normal((k, m))
        height = 0.5 * float(np.linalg.slogdet(curvature)[1]) - 0.5 * m * _LOG_2PI
        spread = np.linalg.cholesky(np.linalg.inv(curvature)).T
        return middle + off @ spread, height - 0.5 * np.sum(off**2, axis=1)


def exposure_nodes(exposure: float, count: int) -> tuple[Floats, Floats]:
    """Offsets of `count` Gauss-Legendre instants in an exposure, in its unit, and their weights. An exposure of 0 has
    one instant."""
    nodes, shares = np.polynomial.legendre.leggauss(count if exposure else 1)
    return 0.5 * exposure * nodes, 0.5 * shares


def rescaled(names: Sequence[str], x: Floats, size: Floats) -> Floats:
    """log10 values (k, d) of a law's parameters for bubbles that are `size` (k,) times as large as simulated ones with
    the values x (k, d): viscosities and relaxation times grow with the size. NaN for a negative size."""
    x = np.array(x)
    with np.errstate(invalid="ignore"):
        log_size = np.log10(size)
    for i, name in enumerate(names):
        if parameter_of(name).unit in ("Pa s", "s"):
            power = 10.0 ** x[:, names.index("exponent")] if name == "reference_viscosity" else 1.0
            x[:, i] += power * log_size
    return x


@compiled
def _integrated(
    run: SimulatedCurve, frames: Frames, starts: Floats, last_gain: float, covariances: Covariances, constants: Floats,
    power: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    """The result of `CameraNuisances.extended` without the shape. starts: z (k, m) at which the steps start. last_gain:
    gain at which the last steps end. covariances, constants, power: of the noise."""
    weight, shifts, rank, factor = covariances
    m, residuals = len(frames.free), np.empty((len(starts), len(frames.time)))
    columns, next_columns = np.empty((len(frames.time), m + 1)), np.empty((len(frames.time), m + 1))
    for k in range(len(starts)):
        _linearise_frames(run, frames, starts[k], columns)
        residuals[k] = columns[:, m]
    squares = squared(residuals, weight, shifts, rank, factor)
    heights, largest = np.empty(len(starts)), np.zeros(len(rank))
    some = shifts, rank, factor, constants
    for k in range(len(starts)):
        height, share = summed(squares[:, k], constants, power)
        heights[k] = height - 0.5 * np.sum(starts[k] ** 2)
        largest = np.maximum(largest, share)
    padded = np.concatenate((np.array([-np.inf]), heights, np.array([-np.inf])))
    order = np.argsort(-heights)
    hill = (heights > padded[:-2]) & (heights >= padded[2:])
    hill[order[:LIKELIEST_STARTS]] = True
    order = order[hill[order]]
    top, best = -np.inf, starts[order[0]]
    tries = min(MAX_CLIMBED_STARTS, len(order))
    for k in range(tries + 1):  # a few steps from each start, then all steps from the best end
        z, least = (starts[order[k]], ROUGH_GAIN) if k < tries else (best, last_gain)
        if m and (k == 0 or k == tries):
            counted = np.flatnonzero(largest > (ROUGH_SHARE if k < tries else FINAL_SHARE) * np.max(largest))
            some = shifts[counted], rank[counted], factor[counted], constants[counted]
        _linearise_frames(run, frames, z, columns)
        height, gradient, curvature = expanded(columns, weight, *some, power)
        value = height - 0.5 * np.sum(z**2)
        for _ in range(MAX_NEWTON_STEPS if m else 0):
            direction, gain = _solved(curvature, gradient + z)[0], 0.0
            if 0.5 * np.sum((gradient + z) * direction) < least:
                break
            for length in (1.0, 0.5, 0.2, 0.05):
                next_z = z - length * direction
                _linearise_frames(run, frames, next_z, next_columns)
                height, slope, curved = expanded(next_columns, weight, *some, power)
                next_value = height - 0.5 * np.sum(next_z**2)
                if next_value > value:
                    gain, z, value, gradient, curvature = next_value - value, next_z, next_value, slope, curved
                    columns, next_columns = next_columns, columns
                    break
            if gain < least:
                break
        if value > top or k == tries:
            top, best = value, z
    integral = -0.5 * _solved(curvature, best)[1]  # the factors (2 pi)^(1/2) of prior and integral cancel
    return np.concatenate((columns[:, m], best, np.array([integral]))), curvature + np.eye(m)


@compiled
def _solved(curvature: Floats, vector: Floats) -> tuple[Floats, float]:
    """(C + 1)^-1 v and log |C + 1| by Cholesky's factor, C (m, m) and v (m,)."""
    m, solution, log_det = len(vector), vector.copy(), 0.0
    root = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1):
            left = curvature[i, j] + (1.0 if i == j else 0.0)
            for k in range(j):
                left -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(left) if i == j else left / root[j, j]
        log_det += 2.0 * np.log(root[i, i])
        for k in range(i):
            solution[i] -= root[i, k] * solution[k]
        solution[i] /= root[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            solution[i] -= root[k, i] * solution[k]
        solution[i] /= root[i, i]
    return solution, log_det


@kernel
def _linearise_frames(run: SimulatedCurve, frames: Frames, z: Floats, columns: Floats) -> None:
    """Write the derivatives of the simulated frames by z (m,), and measured minus simulated, into columns (n, m + 1).

    R is an even function of time. The effect of size is linear between two instants.
    """
    free, step, m = frames.free, frames.step, len(frames.free)
    clock, scale, factor = _decode_camera(frames, z)
    grown = scale * factor - 1.0
    for n in range(len(frames.time)):
        radius = by_clock = by_scale = by_factor = 0.0
        for instant, share in zip(frames.instants, frames.shares):  # noqa: B905 (the compiler knows no strict)
            since = (frames.time[n] + instant - clock) / (scale * factor)
            distance = abs(since) / step
            height, slope = _radius_at(run, distance, step)
            larger = 0.0
            if len(run.by_size):
                i = min(int(distance), len(run.by_size) - 2)
                rise_by_size = run.by_size[i + 1] - run.by_size[i]
                larger = run.by_size[i] + min(distance - i, 1.0) * rise_by_size
                height += grown * larger
                slope += grown * rise_by_size
            slope /= step
            if since < 0.0:
                slope = -slope
            moved = slope * since
            radius += share * factor * height
            by_clock -= share * slope / scale
            by_scale += share * factor * (factor * larger - moved / scale)
            by_factor += share * (height - moved + factor * scale * larger)
        for k in range(m):
            slope = by_clock if free[k] == 0 else by_scale if free[k] == 1 else by_factor
            columns[n, k] = slope * frames.widths[free[k]]
        columns[n, m] = frames.measured[n] - radius


@kernel
def _decode_camera(frames: Frames, z: Floats) -> tuple[float, float, float]:
    """Clock, scale and factor of z (m,)."""
    clock, scale, factor = 0.0, 1.0, 1.0
    for k in range(len(frames.free)):
        moved = frames.widths[frames.free[k]] * z[k]
        if frames.free[k] == 0:
            clock += moved
        elif frames.free[k] == 1:
            scale += moved
        else:
            factor += moved
    return clock, scale, factor


@kernel
def _radius_at(run: SimulatedCurve, distance: float, step: float) -> tuple[float, float]:
    """R/R_max at `distance` steps of the grid after its maximum, and its derivative by `distance`: cubic Hermite pieces
    between regular instants, or between the nodes of a shape."""
    if not len(run.shape):
        i = min(int(distance), len(run.radius) - 2)
        begin, end = run.speed[i] * step, run.speed[i + 1] * step
        return _cubic(run.radius[i], run.radius[i + 1], begin, end, min(distance - i, 1.0))
    shape = run.shape
    collapses, part, knot = (len(shape) - NODES - 1) // (NODES + 2), 0, 0.0
    while part < collapses and distance > shape[part] * run.last:
        knot = shape[part] * run.last
        part += 1
    length = max((shape[part] * run.last if part < collapses else run.last) - knot, 1e-9)
    place, rate = _place(min(max((distance - knot) / length, 0.0), 1.0), part, collapses)
    height, slope = _between_nodes(shape, collapses + part * (NODES + 1), place)
    return height, slope * rate / length


@kernel
def _between_nodes(shape: Floats, first: int, place: float) -> tuple[float, float]:
    """R/R_max at `place`, from 0 to NODES, between nodes from index `first` of a shape on, and its derivative."""
    i = min(int(place), NODES - 1)
    low, high = shape[first + i], shape[first + i + 1]
    rise = high - low
    begin = 0.5 * (high - shape[first + i - 1]) if i > 0 else 1.5 * rise - 0.5 * (shape[first + i + 2] - high)
    end = 0.5 * (shape[first + i + 2] - low) if i < NODES - 1 else 1.5 * rise - 0.5 * (low - shape[first + i - 1])
    return _cubic(low, high, begin, end, place - i)


@kernel
def _cubic(low: float, high: float, begin: float, end: float, t: float) -> tuple[float, float]:
    """Value and derivative at t, from 0 to 1, of the cubic with these values and derivatives at both ends."""
    rise = high - low
    square, cube = 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise
    return low + t * (begin + t * (square + t * cube)), begin + t * (2.0 * square + 3.0 * t * cube)


@kernel
def _place(share: float, part: int, collapses: int) -> tuple[float, float]:
    """Place between the nodes, from 0 to NODES, of a share of the time from one collapse to the next, and its
    derivative, which at a collapse is that a quarter of the way to the next node. After the last collapse the nodes are
    dense at its side alone."""
    least = (0.25 / NODES) ** 2
    if part == collapses:
        return NODES * np.sqrt(share), 0.5 * NODES / np.sqrt(max(share, least))
    both = max(share * (1.0 - share), least)
    return NODES * _angle(share), NODES / (np.pi * np.sqrt(both))


@kernel
def _angle(share: float) -> float:
    """arcsin(share^(1/2)) over pi/2, from 0 to 1, with an error of 3e-9: a polynomial, in a tenth of the time."""
    low = min(share, 1.0 - share)
    series = 0.0
    for i in range(len(ANGLE)):
        series = series * low + ANGLE[i]
    angle = np.sqrt(low) * series
    return angle if share < 0.5 else 1.0 - angle


@kernel
def _share(place: float, part: int, collapses: int) -> float:
    """Share of the time from one collapse to the next, at a place between the nodes: the inverse of `_place`."""
    fraction = place / NODES
    return fraction**2 if part == collapses else np.sin(0.5 * np.pi * fraction) ** 2


@compiled
def _shape(run: SimulatedCurve, step: float, collapses: int) -> Floats:
    """Shape of a simulation at regular instants, `step` s from each other. Collapses that it lacks are put at the end
    of the grid, where a later collapse leaves it."""
    last, knots, count = len(run.radius) - 1, np.empty(collapses + 2), 0
    knots[0], knots[-1] = 0.0, last
    for i in range(1, last):
        if count < collapses and run.speed[i] < 0.0 <= run.speed[i + 1]:
            count += 1
            knots[count] = i + _minimum(run.radius[i], run.radius[i + 1], run.speed[i] * step, run.speed[i + 1] * step)
    knots[count + 1 :] = last
    shape = np.empty(collapses + (collapses + 1) * (NODES + 1))
    shape[:collapses] = knots[1:-1] / last
    for k in range(collapses + 1):
        for j in range(NODES + 1):
            distance = knots[k] + _share(float(j), k, collapses) * (knots[k + 1] - knots[k])
            shape[collapses + k * (NODES + 1) + j] = _radius_at(run, distance, step)[0]
    return shape


@kernel
def _minimum(first: float, second: float, fall: float, rise: float) -> float:
    """Place of the minimum of R between two instants, from 0 to 1, with these radii and derivatives. R^5 is cubic
    there, because an empty cavity collapses as R^5 = A (t - t_0)^2 (Rayleigh 1917, doi:10.1080/14786440808635681)."""
    change, begin, end = second**5 - first**5, 5.0 * first**4 * fall, 5.0 * second**4 * rise
    square = 3.0 * (begin + end) - 6.0 * change
    linear = end - begin - square
    root = np.sqrt(max(linear**2 - 4.0 * begin * square, 0.0))
    return min(max(-2.0 * begin / (linear + root), 0.0), 1.0) if linear + root > 0.0 else begin / (begin - end)


@compiled
def _residuals_of_shapes(
    shapes: Floats, last: float, frames: Frames, starts: Floats, covariances: Covariances, constants: Floats,
    power: float,
) -> Floats:  # fmt: skip
    """The result of `CameraNuisances.residuals_of_shapes`."""
    residuals, nothing = np.empty((len(shapes), len(frames.time) + len(frames.free) + 1)), np.empty(0)
    for k in range(len(shapes)):
        run = SimulatedCurve(nothing, nothing, nothing, nothing, shapes[k], last)
        residuals[k] = _integrated(run, frames, starts, SHAPE_GAIN, covariances, constants, power)[0]
    return residuals


@compiled
def _difference_of_shapes(shapes: Floats, z: Floats, last: float, frames: Frames) -> Floats:
    """The result of `CameraNuisances.difference_of_shapes`: as `_linearise_frames`, in half the time without
    derivatives."""
    count, each, difference = len(frames.time), len(frames.instants), np.empty((len(shapes), len(frames.time)))
    collapses = (shapes.shape[1] - NODES - 1) // (NODES + 2)
    knots, rates = np.zeros(collapses + 2), np.empty(collapses + 1)
    share, parts = np.empty(count * each), np.empty(count * each, np.int64)
    for k in range(len(shapes)):
        shape = shapes[k]
        if not np.isfinite(np.sum(shape) + np.sum(z[k])):  # a simulation that failed
            difference[k] = np.nan
            continue
        knots[1 : collapses + 1], knots[collapses + 1] = shape[:collapses] * last, last
        for part in range(collapses + 1):
            rates[part] = 1.0 / max(knots[part + 1] - knots[part], 1e-9)
        clock, scale, factor = _decode_camera(frames, z[k])
        rate, part = 1.0 / (scale * factor * frames.step), 0
        for n in range(count):
            for j in range(each):
                distance = abs(frames.time[n] + frames.instants[j] - clock) * rate
                while part < collapses and distance > knots[part + 1]:
                    part += 1
                while part > 0 and distance <= knots[part]:
                    part -= 1
                share[n * each + j] = min(max((distance - knots[part]) * rates[part], 0.0), 1.0)
                parts[n * each + j] = part
        for i in range(len(share)):  # a loop of its own, so that the compiler vectorises it
            share[i] = NODES * (np.sqrt(share[i]) if parts[i] == collapses else _angle(share[i]))
        for n in range(count):
            radius = 0.0
            for j in range(each):
                first = collapses + parts[n * each + j] * (NODES + 1)
                radius += frames.shares[j] * _between_nodes(shape, first, share[n * each + j])[0]
            difference[k, n] = frames.measured[n] - factor * radius
    return difference


@compiled
def _radius(run: SimulatedCurve) -> Floats:
    """R/R_max at the instants of the grid of a shape."""
    radius = np.empty(int(run.last) + 1)
    for n in range(len(radius)):
        radius[n] = _radius_at(run, float(n), 1.0)[0]
    return radius

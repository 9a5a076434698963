"""Sampling of a log posterior over u, in which the prior is the standard normal distribution: scan, climb, sample.

A scan of the prior finds places to begin, and climbs by Gauss-Newton steps lead from the best of them to the maxima.
From each maximum points are laid out along the ridge on which it lies: the frames hold some directions of u tightly and
others hardly at all, and the tight ones are curved along the others. CurvedT Student's t distributions follow these
ridges; importance sampling draws from them, round by round, and fits them to where walkers among the likely draws
go; all draws count by the density of all rounds together (adaptive multiple importance sampling: Cornuet, Marin, Mira
and Robert 2012, doi:10.1111/j.1467-9469.2011.00756.x). Fitted to the draws themselves, with as many evaluations, they
find the evidence twice as far too low.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from cavirheo.arrays import Bools, Floats, at_levels, log_sum, relative_weights
from cavirheo.inference.noise import Noise
from cavirheo.prior import log_normal

FREEDOM = 8.0  # degrees of freedom of Student's t distributions
WIDE_SHARE, WIDE_FACTOR = 0.5, 2.2  # part of a mixture that is wider than was fitted, and how many times
LEAST_SHARE = 0.003  # a component of a mixture with a smaller share is dropped
WIDEST = 4  # principal axes of a ridge along which the others are bent
BENT_TO = 3.5  # widths of an axis up to which it bends the others
RIDGE_SHARE = 2.0  # a ridge's quadratic function is drawn towards 0 as if by so many draws
TIGHT = 10.0  # curvature over that of the prior from which on the frames hold a direction
SPREAD, LONGEST = 1.3, 0.6  # of places along a ridge: width over that of Laplace's integral; and of a step onto it
ALONG = 0.3  # width of the scatter about such a place along the ridge, over that of Laplace's integral
APART, NEAR = 9.0, 0.25  # squared distance, over d, of two peaks by their curvature, and of two places
SAME_HEIGHT = 0.5  # between two climbs that end at one maximum
DIFFERENCE = 1e-3  # step of all finite differences: of slopes in u, and of the wall's velocity in t/t_c
WALKED = 4  # steps of walkers, of which the last half are likely places
LENGTHS = np.array([0.25, 0.5, 1.0])  # of these steps, over the best one for a normal density
JITTER = 1e-4  # in u, of a step
FORGOTTEN = 30.0  # log weight below the largest from which on a draw is not looked at again
Frames = Callable[[Floats], Floats]  # residuals (k, n) at u (k, d)
T = TypeVar("T")
Requests = Generator[Floats, Floats, T]  # a computation that asks for residuals: it yields u (k, d) and is sent (k, n)


@dataclass(frozen=True)
class Budget:
    """How many evaluations a posterior takes.

    Attributes:
        scans: scans of the prior at most. Of an agarose shot with violent collapses one climb in 60 reaches the highest
            maximum, and 8 scans missed it in 2 of 4 seeds.
        scanned: draws of a scan. Climbs find more maxima than a longer scan.
        climbed: places among them from which climbs begin.
        begun: first steps of these climbs, without a discrepancy.
        kept: climbs that are then the highest of their peaks and go on.
        steps: of a climb at most.
        ridge: places along the ridge of a maximum.
        rounds: draws of the rounds of a model, which end when enough of all its draws are effective.
        walkers: likely draws that walk before each round.
        sampled: draws of quick frames, of all models together, that are to be effective; each model needs its share,
            and at least a fifth.
        effective: simulated draws of all models together that are to be effective.
        most: simulations.
    """

    scans: int = 32
    scanned: int = 600
    climbed: int = 16
    begun: int = 4
    kept: int = 6
    steps: int = 40
    ridge: int = 30
    rounds: tuple[int, ...] = (1000, 1500, 2000, 2500, 3000, 3500, 4000, 4500, 5000)
    walkers: int = 300
    sampled: float = 1000.0
    effective: float = 100.0
    most: int = 1800


EMULATED = Budget()
SIMULATED = Budget(
    scans=2,
    scanned=400,
    climbed=12,
    begun=3,
    kept=5,
    steps=20,
    ridge=12,
    rounds=(300, 600, 900, 1200),
    walkers=100,
    sampled=250.0,
)


class Maxima(NamedTuple):
    """Maxima u (m, d) of a log posterior, its values (m,) there, and the curvatures (m, d, d) of its negative."""

    u: Floats
    value: Floats
    curvature: Floats

    @classmethod
    def none(cls, dimension: int) -> Maxima:
        """No maximum yet."""
        return cls(np.zeros((0, dimension)), np.zeros(0), np.zeros((0, dimension, dimension)))

    def and_of(self, other: Maxima) -> Maxima:
        """These maxima and others."""
        return Maxima(*map(np.concatenate, zip(self, other, strict=True)))

    def apart(self, most: int, reach: float, *, peaks: bool) -> list[int]:
        """Indices of the highest maxima, none lower than the highest by `reach`, no two of them near each other, or
        with `peaks` no two of them on one peak."""
        d = self.u.shape[1]
        chosen = list[int]()
        for i in np.argsort(-self.value):
            off = self.u[i] - self.u[chosen]
            squares = np.einsum("ki,kij,kj->k", off, self.curvature[chosen], off)
            alone = squares > APART * d if peaks else np.sum(off**2, axis=1) > NEAR * d
            if self.value[i] > np.max(self.value) - reach and np.all(alone):
                chosen.append(int(i))
        return chosen[:most]


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws u (k, d) of a density, in random order, with its log (k,) at each of them, their log weights (k,), of which
    the exponentials sum to 1, and the log of the density's integral with its standard error."""

    u: Floats
    log_density: Floats
    log_weight: Floats
    log_evidence: float
    error: float


@dataclass(frozen=True, eq=False)
class CurvedT:
    """Student's t distribution along a curved ridge; WIDE_SHARE of the draws are from one that is WIDE_FACTOR times as
    wide, because fitted shapes miss their tails.

    In units of principal axes, z = (u - middle) axes/width, each axis is shifted by a quadratic function of
    those of the WIDEST axes that are wider than itself, which changes no volume; z without these shifts has a t
    distribution.

    Attributes:
        middle, width: (d,); axes: (d, d), columns from the narrowest to the widest.
        bend: (terms, d) coefficients of the quadratic functions.
        mean: (d,) of the t distribution; root: (d, d) Cholesky factor of its scale matrix.
    """

    middle: Floats
    axes: Floats
    width: Floats
    bend: Floats
    mean: Floats
    root: Floats

    @classmethod
    def straight(cls, middle: Floats, covariance: Floats) -> CurvedT:
        """The distribution about a place (d,) with this scale matrix (d, d)."""
        d = len(middle)
        square, axes = np.linalg.eigh(covariance)
        width = np.sqrt(np.maximum(square, 1e-12))
        return cls(middle, axes, width, np.zeros((len(_terms_of(d)[0]) + 1, d)), np.zeros(d), np.eye(d))

    @classmethod
    def through(cls, u: Floats, weight: Floats) -> CurvedT:
        """The distribution that is fitted to weighted draws u (k, d)."""
        weight, d = weight / np.sum(weight), u.shape[1]
        effective = 1.0 / np.sum(weight**2)
        middle = weight @ u
        off = u - middle
        straight = cls.straight(middle, (off.T * weight) @ off + 1e-10 * np.eye(d))
        z = off @ straight.axes / straight.width
        terms = _quadratic(z)
        weighted = terms.T * (effective * weight)
        bend = np.zeros_like(straight.bend)
        narrowest = np.append(d, np.minimum(*_terms_of(d)))  # axis in each term; none in the constant one
        for axis in range(d - 1):
            used = np.flatnonzero(narrowest > axis)
            penalty = RIDGE_SHARE * np.diag((used > 0).astype(float))
            bend[used, axis] = np.linalg.solve(weighted[used] @ terms[:, used] + penalty, weighted[used] @ z[:, axis])
        z -= terms @ bend
        mean = weight @ z
        scatter = ((z - mean).T * weight) @ (z - mean)
        alone = (d + 2.0) / (effective + d + 2.0)  # few draws do not tell correlations
        scatter = (1.0 - alone) * scatter + alone * np.diag(np.diag(scatter)) + 1e-8 * np.eye(d)
        return cls(middle, straight.axes, straight.width, bend, mean, np.linalg.cholesky(scatter))

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Draws (count, d)."""
        d = len(self.middle)
        stretched = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, count))
        stretched[rng.random(count) < WIDE_SHARE] *= WIDE_FACTOR
        z = self.mean + stretched[:, None] * rng.standard_normal((count, d)) @ self.root.T
        for axis in range(d - 2, max(d - WIDEST, 0) - 1, -1):
            z[:, axis] += _quadratic(z) @ self.bend[:, axis]
        if d > WIDEST:
            z[:, : d - WIDEST] += _quadratic(z) @ self.bend[:, : d - WIDEST]
        return np.asarray(self.middle + (z * self.width) @ self.axes.T)

    def log_density(self, u: Floats) -> Floats:
        """Log density (k,) at u (k, d)."""
        d = len(self.middle)
        z = (u - self.middle) @ (self.axes / self.width)
        z -= _quadratic(z) @ self.bend
        squares = np.sum(((z - self.mean) @ np.linalg.inv(self.root).T) ** 2, axis=1) / FREEDOM
        constant = gammaln((FREEDOM + d) / 2) - gammaln(FREEDOM / 2) - 0.5 * d * np.log(FREEDOM * np.pi)
        constant -= np.sum(np.log(np.diag(self.root))) + np.sum(np.log(self.width))
        power = -0.5 * (FREEDOM + d)
        wide = WIDE_SHARE / WIDE_FACTOR**d * (1.0 + squares / WIDE_FACTOR**2) ** power
        return np.asarray(constant + np.log((1.0 - WIDE_SHARE) * (1.0 + squares) ** power + wide))


@lru_cache
def _terms_of(d: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The two axes of each term of `_quadratic` but the first, of d axes; axis d stands for 1."""
    first, second = np.triu_indices(min(WIDEST, d) + 1)
    start = max(d - WIDEST, 0)
    return first[:-1] + start, second[:-1] + start


def _quadratic(z: Floats) -> Floats:
    """(k, terms) 1, the WIDEST columns of z (k, d), and all their products."""
    with_one = np.column_stack([np.clip(z, -BENT_TO, BENT_TO), np.ones(len(z))])
    first, second = _terms_of(z.shape[1])
    return np.column_stack([np.ones(len(z)), with_one[:, first] * with_one[:, second]])


@dataclass(frozen=True, eq=False)
class Mixture:
    """Mixture of bent Student's t distributions with shares (c,)."""

    share: Floats
    parts: tuple[CurvedT, ...]

    @classmethod
    def of_modes(cls, means: Sequence[Floats], covariances: Sequence[Floats], log_share: Sequence[float]) -> Mixture:
        """A straight component about each mode."""
        share = np.exp(np.asarray(log_share) - log_sum(log_share))
        return cls(share, tuple(map(CurvedT.straight, means, covariances)))

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Draws (count, d), in random order."""
        counts = rng.multinomial(count, self.share / np.sum(self.share))
        drawn = [part.draw(int(number), rng) for part, number in zip(self.parts, counts, strict=True)]
        return rng.permutation(np.concatenate(drawn))

    def _terms(self, u: Floats) -> Floats:
        """Log of share times density (c, k)."""
        densities = np.array([part.log_density(u) for part in self.parts])
        return np.asarray(np.log(self.share)[:, None] + densities)

    def log_density(self, u: Floats) -> Floats:
        """Log density (k,) at u (k, d)."""
        return log_sum(self._terms(u), axis=0)

    def fitted(self, u: Floats) -> Mixture:
        """A step of expectation maximisation to draws u (k, d); a component with few of them stays."""
        terms = self._terms(u)
        weight = np.exp(terms - log_sum(terms, axis=0))
        share = np.sum(weight, axis=1)
        effective = share**2 / np.maximum(np.sum(weight**2, axis=1), 1e-300)
        parts = [
            CurvedT.through(u, row) if number > 3 * u.shape[1] else part
            for part, row, number in zip(self.parts, weight, effective, strict=True)
        ]
        used = np.flatnonzero(share > LEAST_SHARE * len(u))
        return Mixture(share[used] / np.sum(share[used]), tuple(parts[i] for i in used))


def run_together(
    askings: Sequence[Requests[T]], residuals: Callable[[dict[int, Floats]], dict[int, Floats]]
) -> list[T]:
    """What several computations return. Each time the residuals that all of them ask for are computed in one call, by
    index of the computation: few bubbles cost nearly as much time as a hundred."""
    returned: dict[int, T] = {}
    asked: dict[int, Floats] = {}
    replies: dict[int, Floats | None] = dict.fromkeys(range(len(askings)))
    while replies:
        asked.clear()
        for i, reply in replies.items():
            try:
                asked[i] = next(askings[i]) if reply is None else askings[i].send(reply)
            except StopIteration as end:
                returned[i] = end.value
        replies = dict(residuals(asked)) if asked else {}
    return [returned[i] for i in range(len(askings))]


def run_alone(asking: Requests[T], residuals: Frames) -> T:
    """What one computation returns."""
    return run_together([asking], lambda asked: {0: residuals(asked[0])})[0]


def scanning(noise: Noise, dimension: int, budget: Budget, rng: np.random.Generator) -> Requests[Floats]:
    """(m, d) the best places of a scan of the prior, no two of them near each other."""
    u = rng.standard_normal((budget.scanned, dimension))
    value = noise.log_density((yield u)) + log_normal(u)
    chosen = list[Floats]()
    for i in np.argsort(-value)[: budget.scanned // 3]:
        if np.isfinite(value[i]) and all(np.sum((u[i] - other) ** 2) > NEAR * dimension for other in chosen):
            chosen.append(u[i])
        if len(chosen) == budget.climbed:
            break
    return np.array(chosen).reshape(-1, dimension)


def expanding(noise: Noise, u: Floats, missed: Floats) -> Requests[tuple[Floats, Floats]]:
    """Gradients (m, d) and Gauss-Newton curvatures (m, d, d) of the negative log posterior at u (m, d), where the
    residuals are `missed` (m, n)."""
    m, d = u.shape
    shifted = u[:, None, :] + DIFFERENCE * np.eye(d)
    found = yield shifted.reshape(-1, d)
    slopes = (missed[:, None, :] - found.reshape(m, d, -1)) / DIFFERENCE
    gradients, curvatures = noise.newton(missed, np.nan_to_num(slopes).transpose(0, 2, 1))
    return gradients + u, curvatures + np.eye(d)


def expand(residuals: Frames, noise: Noise, u: Floats, missed: Floats) -> tuple[Floats, Floats]:
    """`expanding` alone."""
    return run_alone(expanding(noise, u, missed), residuals)


def climbing(noise: Noise, u: Floats, steps: int = EMULATED.steps) -> Requests[Maxima]:
    """Maxima from u (m, d), by at most so many damped Gauss-Newton steps."""
    m, d = u.shape
    if not m:
        return Maxima.none(d)
    damping, u = np.full(m, 0.1), u.copy()
    missed = yield u
    value = noise.log_density(missed) + log_normal(u)
    curvature, gradient = np.tile(np.eye(d), (m, 1, 1)), np.zeros((m, d))
    moved = np.isfinite(value)
    for _ in range(steps):
        if not moved.any():
            break
        at = np.flatnonzero(moved)
        gradient[at], curvature[at] = yield from expanding(noise, u[at], missed[at])
        damped = curvature[at] + damping[at, None, None] * curvature[at] * np.eye(d)
        trial = u[at] - np.clip(np.linalg.solve(damped, gradient[at, :, None])[:, :, 0], -1.5, 1.5)
        found = yield trial
        height = noise.log_density(found) + log_normal(trial)
        better = height > value[at]
        moved[at] = np.where(better, height - value[at] > 0.02, damping[at] < 1e3)
        damping[at] *= np.where(better, 0.25, 6.0)
        risen = at[better]
        u[risen], value[risen], missed[risen] = trial[better], height[better], found[better]
    return Maxima(u, value, curvature)


def climb(residuals: Frames, noise: Noise, u: Floats, steps: int = EMULATED.steps) -> Maxima:
    """`climbing` alone."""
    return run_alone(climbing(noise, u, steps), residuals)


def finding_maxima(noise: Noise, dimension: int, budget: Budget, rng: np.random.Generator) -> Requests[Maxima]:
    """The maxima to which scans of the prior lead: as many scans as it takes until two climbs reach the highest one.
    Climbs begin without a discrepancy: with it, twice as many of them end at low maxima. Those on different peaks go
    on: where the highest did, half of the seeds missed a mode in a corner of the prior."""
    maxima, white = Maxima.none(dimension), noise.without_discrepancy()
    for _ in range(budget.scans):
        begun = yield from climbing(white, (yield from scanning(white, dimension, budget, rng)), budget.begun)
        best = begun.u[begun.apart(budget.kept, np.inf, peaks=True)]
        maxima = maxima.and_of((yield from climbing(noise, best, budget.steps)))
        if np.count_nonzero(maxima.value > np.max(maxima.value, initial=-np.inf) - SAME_HEIGHT) > 1:
            break
    return maxima


def ridges(
    residuals: Frames, noise: Noise, maxima: Maxima, budget: Budget, rng: np.random.Generator, most: int, reach: float
) -> Mixture:
    """CurvedT distributions along the ridge of each of the highest maxima (`Maxima.apart`).

    Places are drawn about the maximum in the directions that the frames hardly hold, and led back onto the ridge by two
    Gauss-Newton steps in the others; a distribution goes through them, with the widths of the posterior there."""
    parts, heights = list[CurvedT](), list[float]()
    for i in maxima.apart(most, reach, peaks=True):
        held, axes = np.linalg.eigh(maxima.curvature[i])
        loose = np.where(held < 4.0 * TIGHT, SPREAD / np.sqrt(held), 0.0)
        off = rng.standard_normal((budget.ridge, len(held))) * loose
        off[0] = 0.0
        u = np.clip(maxima.u[i] + off @ axes.T, -BENT_TO, BENT_TO)
        for _ in range(2):
            gradient, curvature = expand(residuals, noise, u, residuals(u))
            held, axes = np.linalg.eigh(curvature)
            along = np.einsum("kji,kj->ki", axes, gradient) / held
            step = np.where(held > TIGHT, -along, 0.0)
            step /= np.maximum(np.max(np.abs(step), axis=1) / LONGEST, 1.0)[:, None]
            u = u + np.einsum("kij,kj->ki", axes, step)
        missed = residuals(u)
        value = noise.log_density(missed) + log_normal(u)
        near = value > np.max(value) - reach
        if not near.any():  # the steps led to where there are no frames
            parts.append(CurvedT.straight(maxima.u[i], np.linalg.inv(maxima.curvature[i])))
            heights.append(float(maxima.value[i] - 0.5 * np.linalg.slogdet(maxima.curvature[i])[1]))
            continue
        _, curvature = expand(residuals, noise, u[near], missed[near])
        held, axes = np.linalg.eigh(curvature)
        width = np.where(held < TIGHT, ALONG, 1.0) / np.sqrt(held)
        off = width[:, None] * rng.standard_normal((len(held), 12, u.shape[1]))
        about = u[near][:, None] + np.einsum("kij,kaj->kai", axes, off)
        parts.append(CurvedT.through(about.reshape(-1, u.shape[1]), np.ones(12 * len(held))))
        heights.append(float(np.median(value[near] - 0.5 * np.linalg.slogdet(curvature)[1])))
    share = np.exp(np.array(heights) - np.max(heights)) + 0.05
    return Mixture(share / np.sum(share), tuple(parts))


@dataclass(frozen=True, eq=False)
class Rounds:
    """Draws u (k, d) in rounds, each from a mixture that is fitted to the draws before it.

    Attributes:
        mixtures, sizes: of the rounds.
        u: (k, d) the draws that are not forgotten; frames: (k, n) what was computed there.
        densities: (rounds, k) log density of each mixture there.
    """

    mixtures: tuple[Mixture, ...]
    sizes: tuple[int, ...]
    u: Floats
    frames: Floats
    densities: Floats

    @property
    def log_drawn(self) -> Floats:
        """(k,) log density of all rounds together."""
        return log_sum(self.densities + np.log(np.array(self.sizes) / sum(self.sizes))[:, None], axis=0)

    def without(self, forgotten: Bools) -> Rounds:
        """Without these draws (k,), which weigh nothing, but have been drawn."""
        kept = ~forgotten
        return replace(self, u=self.u[kept], frames=self.frames[kept], densities=self.densities[:, kept])

    def and_from(self, mixture: Mixture, size: int, frames: Frames, rng: np.random.Generator) -> Rounds:
        """These rounds and another one."""
        u = mixture.draw(size, rng)
        before = np.array([each.log_density(u) for each in self.mixtures])
        both = np.concatenate([self.u, u])
        densities = np.vstack([np.hstack([self.densities, before]), mixture.log_density(both)])
        seen = np.concatenate([self.frames, frames(u)])
        return Rounds((*self.mixtures, mixture), (*self.sizes, size), both, seen, densities)


def first_round(mixture: Mixture, size: int, frames: Frames, rng: np.random.Generator) -> Rounds:
    """A round from a mixture."""
    u = mixture.draw(size, rng)
    return Rounds((mixture,), (size,), u, frames(u), mixture.log_density(u)[None])


def sample(
    frames: Frames, log_density: Callable[[Floats, Floats], Floats], rounds: Rounds, sizes: Sequence[int],
    rng: np.random.Generator, enough: float = np.inf, walkers: int = EMULATED.walkers,
) -> tuple[Draws, Rounds]:  # fmt: skip
    """Draws of a density, whose log (k,) is that of u (k, d) and the frames (k, n) there, from these rounds and more of
    them, which have these sizes by their place among all. No round follows when `enough` draws are effective; of
    rounds beyond `sizes` there is one."""

    def density(u: Floats) -> Floats:
        return log_density(u, frames(u))

    value = log_density(rounds.u, rounds.frames)
    most = max(len(sizes), len(rounds.sizes) + 1)
    while True:
        log_weight = value - rounds.log_drawn
        done = len(rounds.sizes)
        if done == most or effective_size(log_weight) >= enough:
            break
        mixture = rounds.mixtures[-1]
        if np.count_nonzero(np.isfinite(log_weight)) > 10 * rounds.u.shape[1]:
            likely = walked(density, rounds.u, value, log_weight, walkers, rng)
            mixture = mixture.fitted(likely).fitted(likely)
        size = sizes[min(done, len(sizes) - 1)]
        rounds = rounds.and_from(mixture, size, frames, rng)
        value = np.concatenate([value, log_density(rounds.u[-size:], rounds.frames[-size:])])
    order, drawn = rng.permutation(len(value)), sum(rounds.sizes)
    top = np.max(log_weight)
    weight = np.exp(log_weight - top) if np.isfinite(top) else np.zeros(len(value))
    mean = max(float(np.sum(weight)) / drawn, 1e-300)
    variance = float(np.sum(weight**2)) / drawn - mean**2
    error = float(np.sqrt(max(variance, 0.0) / drawn) / mean)
    log_evidence = float(top + np.log(mean))
    shares = log_weight[order] - log_evidence - np.log(drawn)
    forgotten = log_weight < top - FORGOTTEN
    return Draws(rounds.u[order], value[order], shares, log_evidence, error), rounds.without(forgotten)


def walked(
    density: Callable[[Floats], Floats], u: Floats, value: Floats, log_weight: Floats, walkers: int,
    rng: np.random.Generator,
) -> Floats:  # fmt: skip
    """(m, d) likely places, from draws u (k, d) with values (k,) of the log density and log weights (k,).

    A mixture that is fitted to the draws themselves misses what few of them have reached. Here equally likely ones
    take steps of differential evolution (ter Braak 2006, doi:10.1007/s11222-006-8769-1), along differences of the
    places where all began. As long as few draws are effective, the density is flattened by a power."""
    d, good = u.shape[1], np.isfinite(log_weight)
    power = flattening(log_weight[good], 10.0 * d)
    levels = (np.arange(walkers) + rng.random()) / walkers
    chosen = np.flatnonzero(good)[at_levels(relative_weights(power * log_weight[good]), levels)]
    at, height, places = u[chosen], power * value[chosen], list[Floats]()
    for step in range(WALKED):
        first, second = u[chosen[rng.choice(walkers, (2, walkers))]]
        lengths = [*(LENGTHS * 2.38 / np.sqrt(2.0 * d)), 1.0]  # 1: from mode to mode
        trial = at + rng.choice(lengths, walkers)[:, None] * (first - second)
        trial += JITTER * rng.standard_normal(trial.shape)
        found = power * density(trial)
        accepted = np.log(rng.random(walkers)) < found - height
        at, height = np.where(accepted[:, None], trial, at), np.where(accepted, found, height)
        if step >= WALKED // 2:
            places.append(at)
    return np.concatenate(places)


def effective_size(log_weight: Floats) -> float:
    """Effective number of draws, (sum w)^2/sum w^2; 0 if all weights vanish. Kong 1992."""
    top = np.max(log_weight, initial=-np.inf)
    if not np.isfinite(top):
        return 0.0
    weight = np.exp(log_weight - top)
    return float(np.sum(weight) ** 2 / np.sum(weight**2))


def flattening(log_weight: Floats, least: float) -> float:
    """The largest power, up to 1, of weights of which then `least` draws, or half of all, are effective."""
    goal = min(least, 0.5 * len(log_weight))
    if effective_size(log_weight) >= goal:
        return 1.0
    low, high = 1e-6, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective_size(middle * log_weight) >= goal else (low, middle)
    return low

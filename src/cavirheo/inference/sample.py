"""Sampling of a log posterior over u, in which the prior is the standard normal distribution: scan, climb, sample.

A scan of the prior finds places to begin, climbs by Gauss-Newton steps lead from the best of them to the maxima, and
Markov chains then draw: steps along differences of two walkers (ter Braak and Vrugt 2008,
doi:10.1007/s11222-008-9104-9) reach the ends of curved ridges, jumps to a mixture of Student's t distributions that is
fitted to the walkers (Hastings 1970) lead from one maximum to another. The evidence is found by bridge sampling between
the chains and the draws of the mixture (Meng and Wong 1996, Statistica Sinica 6, 831).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from cavirheo.arrays import Floats, log_sum
from cavirheo.inference.noise import Noise
from cavirheo.prior import log_normal

FREEDOM = 8.0  # degrees of freedom of Student's t distributions
WIDE_SHARE, WIDE_FACTOR = 0.2, 2.0  # part of a mixture that is wider than was fitted, and how many times
LEAST_SHARE = 0.005  # a component of a mixture with a smaller share is dropped
STEP = 2.38 / np.sqrt(2.0)  # best length of a step along a difference, over the root of the dimension: ter Braak
NEVER = -1e9  # log density that stands for nothing, so that two have a difference
DIFFERENCE = 1e-3  # step of finite differences in u
Density = Callable[[Floats], Floats]  # log, (k,) at u (k, d)
Frames = Callable[[Floats], Floats]  # residuals (k, n) at u (k, d)


Groups = Callable[[Floats], NDArray[np.int64]]  # (k,) at u (k, d): between groups the physics jumps


def one_group(u: Floats) -> NDArray[np.int64]:
    """All places are alike."""
    return np.zeros(len(u), dtype=np.int64)


@dataclass(frozen=True)
class Budget:
    """How many evaluations a posterior takes.

    Attributes:
        scanned: draws of the prior.
        climbed: places among them from which climbs begin.
        steps: of a climb.
        walkers: Markov chains.
        settling: rounds of six steps and jumps after which the walkers have settled.
        rounds: of steps and jumps after that.
    """

    scanned: int = 10_000
    climbed: int = 36
    steps: int = 16
    walkers: int = 140
    settling: int = 3
    rounds: int = 20


EMULATED = Budget()
SIMULATED = Budget(scanned=600, climbed=4, steps=5, walkers=50, settling=2, rounds=8)


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws u (k, d) of a density, in random order, with its log (k,) at each of them, and the log of its integral with
    its standard error. log_weight: (k,) of the draws."""

    u: Floats
    log_density: Floats
    log_weight: Floats
    log_evidence: float
    error: float


@dataclass(frozen=True, eq=False)
class Mixture:
    """Mixture of Student's t distributions with shares (c,), means (c, d) and scale matrices (c, d, d)."""

    share: Floats
    mean: Floats
    scale: Floats

    @classmethod
    def of_modes(cls, means: Sequence[Floats], covariances: Sequence[Floats], log_share: Sequence[float]) -> Mixture:
        """A component about each mode; a tenth of the draws comes from components that are twice as wide."""
        share = np.exp(np.asarray(log_share) - log_sum(log_share))
        return cls(share, np.array(means), np.array(covariances)).widened(0.1, 2.0)

    @classmethod
    def through(cls, u: Floats, log_weight: Floats, count: int, rng: np.random.Generator) -> Mixture:
        """`count` components fitted to weighted draws u (k, d)."""
        weight = np.exp(log_weight - log_sum(log_weight))
        middle = weight @ u
        scale = ((u - middle).T * weight) @ (u - middle) * count ** (-2.0 / u.shape[1]) + 1e-12 * np.eye(u.shape[1])
        places = u[rng.choice(len(u), count, p=weight)]
        mixture = cls(np.full(count, 1.0 / count), places, np.array([scale] * count))
        for _ in range(4):
            mixture = mixture.fitted(u, log_weight)
        return mixture

    def widened(self, part: float = WIDE_SHARE, factor: float = WIDE_FACTOR) -> Mixture:
        """This mixture with `part` of the draws from wider components, because fitted shapes miss their tails."""
        return self.mixed_with(Mixture(self.share, self.mean, factor**2 * self.scale), part)

    def mixed_with(self, mixture: Mixture, part: float) -> Mixture:
        """This mixture with `part` of the draws from another mixture."""
        return Mixture(
            np.concatenate([(1.0 - part) * self.share, part * mixture.share]),
            np.concatenate([self.mean, mixture.mean]),
            np.concatenate([self.scale, mixture.scale]),
        )

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Draws (count, d)."""
        which = rng.choice(len(self.share), size=count, p=self.share / np.sum(self.share))
        normal = rng.standard_normal((count, self.mean.shape[1]))
        stretched = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, count))
        roots = np.linalg.cholesky(self.scale)[which]
        return np.asarray(self.mean[which] + stretched[:, None] * np.einsum("kij,kj->ki", roots, normal))

    def _terms(self, u: Floats) -> tuple[Floats, Floats]:
        """Log of share times density (c, k), and squared Mahalanobis distances (c, k)."""
        d = u.shape[1]
        roots = np.linalg.cholesky(self.scale)
        inverse = np.linalg.inv(roots)
        half = np.sum(np.log(np.diagonal(roots, axis1=1, axis2=2)), axis=1)
        off = inverse @ u.T - inverse @ self.mean[:, :, None]  # (c, d, k)
        squares = np.einsum("cdk,cdk->ck", off, off)
        nu = FREEDOM
        constant = gammaln((nu + d) / 2) - gammaln(nu / 2) - 0.5 * d * np.log(nu * np.pi)
        log_t = constant - half[:, None] - 0.5 * (nu + d) * np.log1p(squares / nu)
        return np.log(self.share)[:, None] + log_t, squares

    def log_density(self, u: Floats) -> Floats:
        """Log density (k,) at u (k, d)."""
        return log_sum(self._terms(u)[0], axis=0)

    def fitted(self, u: Floats, log_weight: Floats) -> Mixture:
        """Three steps of expectation maximisation; a component with few effective draws keeps a part of its shape."""
        mixture, (count, d) = self, u.shape
        log_weight = tempered(log_weight, 4.0 * d)
        weight = np.exp(log_weight - log_sum(log_weight))
        middle = weight @ u
        off = u - middle
        products = (off[:, :, None] * off[:, None, :]).reshape(count, d * d)
        for _ in range(3):
            terms, squares = mixture._terms(u)
            resp = np.exp(terms - log_sum(terms, axis=0)) * weight
            share = np.sum(resp, axis=1)
            used = share > LEAST_SHARE
            resp, share = resp[used], share[used]
            gamma = resp * (FREEDOM + d) / (FREEDOM + squares[used])
            trust = np.sum(gamma, axis=1)[:, None, None]
            mean = (gamma @ off)[:, :, None] / trust
            scatter = (gamma @ products).reshape(-1, d, d) - trust * mean * mean.transpose(0, 2, 1)
            effective = share**2 / np.sum(resp**2, axis=1)
            old = ((d + 2.0) / (effective + d + 2.0))[:, None, None]
            scale = (1.0 - old) * scatter / share[:, None, None] + old * mixture.scale[used] + 1e-12 * np.eye(d)
            mixture = Mixture(share / np.sum(share), middle + mean[:, :, 0], scale)
        return mixture


def scan(
    residuals: Frames,
    noise: Noise,
    dimension: int,
    budget: Budget,
    rng: np.random.Generator,
    groups: Groups = one_group,
) -> Floats:
    """(m, d) the best places of a scan of the prior in each group, no two of them near each other."""
    u = rng.standard_normal((budget.scanned, dimension))
    value = noise.log_density(residuals(u)) + log_normal(u)
    of, chosen = groups(u), list[Floats]()
    for g in np.unique(of):
        near = list[Floats]()
        mine = np.flatnonzero((of == g) & np.isfinite(value))
        for i in mine[np.argsort(-value[mine])][: max(len(mine) // 6, 20)]:
            if all(np.sum((u[i] - other) ** 2) > dimension for other in near):
                near.append(u[i])
            if len(near) * len(np.unique(of)) >= budget.climbed:
                break
        chosen += near
    return np.array(chosen).reshape(-1, dimension)


def climb(
    residuals: Frames, noise: Noise, u: Floats, budget: Budget, groups: Groups = one_group
) -> tuple[Floats, Floats, Floats]:
    """Maxima from u (m, d), each in its own group, by damped Gauss-Newton steps: u (m, d), log posteriors (m,),
    curvatures (m, d, d)."""
    m, d = u.shape
    of = groups(u)
    damping, u = np.full(m, 0.1), u.copy()
    missed = residuals(u)
    value = noise.log_density(missed) + log_normal(u)
    curvature, gradient = np.tile(np.eye(d), (m, 1, 1)), np.zeros((m, d))
    moved = np.ones(m, dtype=bool)
    for _ in range(budget.steps):
        active = moved & np.isfinite(value)
        at = np.flatnonzero(active)
        shifted = u[at, None, :] + DIFFERENCE * np.eye(d)
        slopes = (missed[at, None, :] - residuals(shifted.reshape(-1, d)).reshape(len(at), d, -1)) / DIFFERENCE
        for i, slope in zip(at, slopes, strict=True):
            first, second = noise.newton(missed[i], np.nan_to_num(slope).T.copy())
            gradient[i], curvature[i] = first + u[i], second + np.eye(d)
            gradient[i, ~np.any(slope, axis=1)] = 0.0  # without effect on frames: the prior alone would move it
        diagonal = np.einsum("kii->ki", curvature)
        damped = curvature + (damping[:, None] * diagonal)[:, :, None] * np.eye(d)
        trial = u - np.clip(np.linalg.solve(damped, gradient[:, :, None])[:, :, 0], -1.5, 1.5)
        found = residuals(trial)
        height = noise.log_density(found) + log_normal(trial)
        better = (height > value) & (groups(trial) == of)
        moved = better & (height - value > 0.02) | (~better & (damping < 1e3))
        u[better], value[better], missed[better] = trial[better], height[better], found[better]
        damping = np.where(better, damping / 4.0, damping * 6.0)
        if not moved.any():
            break
    return u, value, curvature


def about(u: Floats, value: Floats, curvature: Floats) -> Mixture:
    """The mixture of Student's t distributions about maxima, each with the share of its Laplace integral."""
    likely = value > np.max(value) - 20.0
    u, value, curvature = u[likely], value[likely], curvature[likely]
    scale = np.asarray(np.linalg.inv(curvature), dtype=float)
    log_share = value - 0.5 * np.linalg.slogdet(curvature)[1]
    share = np.asarray(np.exp(log_share - log_sum(log_share)) + 0.02)
    return Mixture(share / np.sum(share), u, scale).widened(0.5, 2.0)


def settle(target: Density, mixture: Mixture, budget: Budget, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Places of the walkers (k, d) and the log density there, from three rounds of importance sampling in which the
    mixture is fitted to the draws."""
    d = mixture.mean.shape[1]
    each = 6 * budget.walkers
    mixtures, u = [mixture], mixture.draw(each, rng)
    value = target(u)
    for _ in range(2):
        log_weight = value - log_sum(np.array([m.log_density(u) for m in mixtures]), axis=0)
        eased = tempered(log_weight, 6.0 * d)
        if not np.isfinite(eased).any():
            break
        good = np.isfinite(eased)
        count = int(np.clip(effective_size(eased) / (2 * d), 1, 8))
        mixtures.append(Mixture.through(u[good], eased[good], count, rng).widened(0.3, 2.0))
        new = mixtures[-1].draw(each, rng)
        u, value = np.concatenate([u, new]), np.concatenate([value, target(new)])
    log_weight = value - log_sum(np.array([m.log_density(u) for m in mixtures]), axis=0)
    eased = tempered(log_weight, 0.5 * budget.walkers)
    chosen = rng.choice(len(u), budget.walkers, p=np.exp(eased - log_sum(eased)))
    return u[chosen], np.maximum(value[chosen], NEVER)


class Walkers:
    """Markov chains of a density. Each half of the walkers jumps to the mixture that was fitted to the other half,
    because a mixture that has seen a walker's place would bias its jumps.

    u, value: (k, d) places and (k,) log density there; a step changes both."""

    def __init__(self, target: Density, u: Floats, value: Floats, rng: np.random.Generator) -> None:
        self.target, self.rng, self.u, self.value = target, rng, u.copy(), value.copy()
        self.fit()

    def fit(self) -> None:
        """Fit the mixtures to the present places."""
        first, second = np.array_split(self.u, 2)
        count = int(np.clip(len(first) / (5 * self.u.shape[1]), 1, 8))
        fits = (Mixture.through(half, np.zeros(len(half)), count, self.rng) for half in (second, first))
        self.mixtures = [fit.widened(0.3, 1.6) for fit in fits]
        self.before = self.u.copy()

    def _accept(self, u: Floats, value: Floats, log_odds: Floats) -> float:
        taken = np.log(self.rng.random(len(u))) < log_odds
        self.u[taken], self.value[taken] = u[taken], value[taken]
        return float(np.mean(taken))

    def step(self) -> None:
        """Step along the difference of the places that two other walkers had when the mixtures were fitted."""
        rng, (count, d) = self.rng, self.u.shape
        start = rng.integers(count, size=count)
        end = (start + rng.integers(1, count, size=count)) % count
        size = STEP / np.sqrt(d) * rng.uniform(0.4, 1.4, count)
        size[rng.random(count) < 0.1] = 1.0
        u = self.u + size[:, None] * (self.before[end] - self.before[start]) + 1e-4 * rng.standard_normal((count, d))
        value = self.target(u)
        self._accept(u, value, value - self.value)

    def jump(self) -> tuple[Floats, Floats, float]:
        """Propose draws of the mixtures. Returns the log of the density over that of the mixture, at the walkers (k,)
        and at the draws (k,), and the share of draws that is accepted."""
        halves = list(zip(self.mixtures, np.array_split(self.u, 2), strict=True))
        u = np.concatenate([mixture.draw(len(half), self.rng) for mixture, half in halves])
        value = self.target(u)
        parts = list(zip(self.mixtures, np.array_split(self.u, 2), np.array_split(u, 2), strict=True))
        here = self.value - np.concatenate([mixture.log_density(half) for mixture, half, _ in parts])
        there = value - np.concatenate([mixture.log_density(half) for mixture, _, half in parts])
        return here, there, self._accept(u, value, there - here)


def sample(
    target: Density, u: Floats, value: Floats, budget: Budget, rng: np.random.Generator, settling: int | None = None
) -> tuple[Draws, Floats, Floats]:
    """Draws of a density, and the last places of the walkers with the density there, from walkers at u (k, d)."""
    walkers = Walkers(target, u, value, rng)
    for _ in range(budget.settling if settling is None else settling):
        for _ in range(6):
            walkers.step()
            walkers.jump()
        walkers.fit()
    states, here, there, jumps = list[tuple[Floats, Floats]](), list[Floats](), list[Floats](), 0.0
    for _ in range(budget.rounds):
        walkers.step()
        before, drawn, taken = walkers.jump()
        here, there, jumps = [*here, before], [*there, drawn], jumps + taken
        states.append((walkers.u.copy(), walkers.value.copy()))
    log_evidence, error = bridge(np.concatenate(here), np.concatenate(there), len(u) * max(jumps, 1.0))
    places, heights = (np.concatenate(parts) for parts in zip(*states, strict=True))
    order = rng.permutation(np.flatnonzero(heights > NEVER))
    draws = Draws(places[order], heights[order], np.zeros(len(order)), log_evidence, error)
    return draws, walkers.u, walkers.value


def bridge(at: Floats, drawn: Floats, worth: float) -> tuple[float, float]:
    """Log of the integral of a density, and its standard error, from the log ratio of this density to a normalised one:
    `at` draws of the density, which are worth so many independent ones, and at draws of the normalised one (`drawn`).
    Meng and Wong 1996, Statistica Sinica 6, 831; Fruehwirth-Schnatter 2004, doi:10.1111/j.1368-423X.2004.00125.x."""
    at = at[np.isfinite(at)]
    top = float(np.median(at))
    above, others = np.exp(np.clip(at - top, -700.0, 700.0)), np.exp(np.clip(drawn - top, -700.0, 700.0))
    share = worth / (worth + len(drawn))
    integral = 1.0
    for _ in range(30):
        of_others = others / (share * others + (1.0 - share) * integral)
        of_draws = 1.0 / (share * above + (1.0 - share) * integral)
        integral = float(np.mean(of_others) / np.mean(of_draws))
    variance = np.var(of_others) / np.mean(of_others) ** 2 / len(drawn)
    variance += np.var(of_draws) / np.mean(of_draws) ** 2 / worth
    return top + float(np.log(integral)), float(np.sqrt(variance))


def generalised_pareto(x: Floats) -> tuple[float, float]:
    """(shape, scale) of the generalised Pareto distribution of x (n,), ascending, not negative, the last positive.

    The mean of theta = -shape/scale over its profile likelihood and a prior that the quartile of x sets (Zhang and
    Stephens 2009, doi:10.1198/tech.2009.08017): as good as maximum likelihood, without its search.
    """
    count = len(x)
    nodes = 30 + int(np.sqrt(count))
    quartile = max(x[int(count / 4.0 + 0.5) - 1], 1e-12 * x[-1])
    theta = 1.0 / x[-1] + (1.0 - np.sqrt(nodes / (np.arange(nodes) + 0.5))) / (3.0 * quartile)
    shape = np.mean(np.log1p(-theta[:, None] * x), axis=1)
    height = count * (np.log(-theta / shape) - shape - 1.0)
    weight = np.exp(height - np.max(height))
    mean = float(weight @ theta / np.sum(weight))
    shape_of_mean = float(np.mean(np.log1p(-mean * x)))
    return shape_of_mean, -shape_of_mean / mean


def effective_size(log_weight: Floats) -> float:
    """Effective number of draws, (sum w)^2/sum w^2; 0 if all weights vanish. Kong 1992."""
    top = np.max(log_weight, initial=-np.inf)
    if not np.isfinite(top):
        return 0.0
    weight = np.exp(log_weight - top)
    return float(np.sum(weight) ** 2 / np.sum(weight**2))


def tempered(log_weight: Floats, least: float) -> Floats:
    """log_weight, or the log of that power of the weights whose effective number of draws is `least`."""
    goal = min(least, 0.5 * np.count_nonzero(np.isfinite(log_weight)))
    if effective_size(log_weight) >= goal:
        return log_weight
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective_size(middle * log_weight) >= goal else (low, middle)
    return np.asarray(low * log_weight if low > 0 else np.where(np.isfinite(log_weight), 0.0, -np.inf))

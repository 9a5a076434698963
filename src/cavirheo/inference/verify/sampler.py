"""Sampling of a density that is cheap to compute: weighted draws, the evidence, and how far to trust the weights.

Mixtures of Student's t distributions, whose heavy tails bound the weights, are fitted to draws by a few steps of
expectation maximisation (Cappe et al. 2008, doi:10.1007/s11222-008-9059-x). Importance sampling draws from them. Markov
chains jump to draws of them, from one mode to another, and also reach the ends of curved ridges, which no mixture fits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ndtri

from cavirheo.arrays import Floats, even_points, log_sum
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.messages import Message
from cavirheo.prior import log_normal


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
        for _ in range(TUNING.mixture_fits):
            mixture = mixture.fitted(u, log_weight)
        return mixture

    def widened(self, part: float = TUNING.wide_share, factor: float = TUNING.wide_factor) -> Mixture:
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
        stretched = np.sqrt(TUNING.degrees_of_freedom / rng.chisquare(TUNING.degrees_of_freedom, count))
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
        nu = TUNING.degrees_of_freedom
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
            used = share > TUNING.component_least
            resp, share = resp[used], share[used]
            gamma = resp * (TUNING.degrees_of_freedom + d) / (TUNING.degrees_of_freedom + squares[used])
            trust = np.sum(gamma, axis=1)[:, None, None]
            mean = (gamma @ off)[:, :, None] / trust
            scatter = (gamma @ products).reshape(-1, d, d) - trust * mean * mean.transpose(0, 2, 1)
            effective = share**2 / np.sum(resp**2, axis=1)
            old = ((d + 2.0) / (effective + d + 2.0))[:, None, None]
            scale = (1.0 - old) * scatter / share[:, None, None] + old * mixture.scale[used] + 1e-12 * np.eye(d)
            mixture = Mixture(share / np.sum(share), middle + mean[:, :, 0], scale)
        return mixture


@dataclass(frozen=True, eq=False)
class Sample:
    """Draws u (k, d) with the log density of target and proposal (k,); the mean of exp(log_weight) is the evidence.
    common: standard error of an error that all log weights share. chosen: whether the draws were selected by their
    weights, so that the tail of the weights cannot be judged. camera: (k, m) z that was drawn with u, or None."""

    u: Floats
    log_target: Floats
    log_q: Floats
    common: float = 0.0
    chosen: bool = False
    camera: Floats | None = None

    @property
    def log_weight(self) -> Floats:
        return np.asarray(self.log_target - self.log_q)

    @property
    def ess(self) -> float:
        return effective_size(self.log_weight)

    @property
    def log_evidence(self) -> tuple[float, float]:
        """Log of the mean weight and its standard error, from the scatter of the weights and from `common`; (-inf,
        inf) if all weights vanish."""
        top = np.max(self.log_weight)
        if not np.isfinite(top):
            return -np.inf, np.inf
        scaled = np.exp(self.log_weight - top)
        mean = float(np.mean(scaled))
        scatter = np.std(scaled, ddof=1) / np.sqrt(len(scaled)) / mean
        return float(top + np.log(mean)), float(np.hypot(scatter, self.common))

    @cached_property
    def tail(self) -> tuple[float, float]:
        """(shape of the generalised Pareto distribution of the largest weights, part of their sum that it expects
        beyond the largest one); NaN for fewer than 25 weights above zero.

        With a shape above 0.7 the mean cannot be trusted (Vehtari, Simpson, Gelman, Yao and Gabry 2024,
        jmlr.org/papers/v25/19-556.html). But if nearly all weights are equal, a few that are three times as large give
        a large shape, too. Therefore the part is looked at as well: one weight is expected beyond the largest, and it
        exceeds this by the mean excess of the distribution there.
        """
        finite = np.sort(self.log_weight[np.isfinite(self.log_weight)])
        count = int(min(TUNING.tail_share * len(finite), 3.0 * np.sqrt(len(finite))))
        if count < 5:
            return float("nan"), float("nan")
        weight = np.exp(finite[-count - 1 :] - finite[-1])
        excesses = weight[1:] - weight[0]
        if not excesses[-1] > 0:
            return 0.0, 0.0
        shape, scale = generalised_pareto(excesses)
        excess = (scale + shape * excesses[-1]) / (1.0 - shape) if shape < 1.0 else np.inf
        return float(shape), float(max(excess, 0.0) / np.sum(np.exp(finite - finite[-1])))

    def chosen_indices(self, count: int, rng: np.random.Generator, power: float = 1.0) -> NDArray[np.int64]:
        """Indices of `count` draws that are distributed as the target, or as this power of it."""
        log_weight = tempered(power * self.log_target - self.log_q, 2.0 * count)
        weight = np.exp(log_weight - log_sum(log_weight))
        count = min(count, int(np.count_nonzero(weight)))
        return np.asarray(rng.choice(len(weight), count, replace=False, p=weight / np.sum(weight)))

    @property
    def reliable(self) -> bool:
        """Whether the mean of the weights can be trusted; with too few weights to judge it counts as trusted."""
        index, unseen = self.tail
        return self.chosen or not (index > TUNING.tail_index_most and unseen > TUNING.tail_unseen)

    def distrust(self, needed: float) -> Message | None:
        """Why the draws give no interval, which needs so many effective draws; None if they do. The tail does not
        matter for a small part of an answer."""
        if self.ess >= max(needed, 1.0) and (self.reliable or needed < TUNING.share_small * TUNING.effective_fewest):
            return None
        (index, unseen), values = self.tail, {"effective": self.ess, "needed": needed}
        tail = {"tail": index, "missing": None if self.reliable else unseen}
        return Message("interval.distrusted", {"draws": len(self.u), **values, **tail})


class Proposal(Protocol):
    """A normalised density from which draws can be taken."""

    def draw(self, count: int, rng: np.random.Generator) -> Floats: ...

    def log_density(self, u: Floats) -> Floats: ...


Density = Callable[[Floats], Floats]  # log, (k,) at (k, d)
Adapt = Callable[["Sample", np.random.Generator], Proposal]


def importance_sample(
    target: Density, proposal: Proposal, adapt: Adapt, rng: np.random.Generator, enough: float, each: int, fewest: int
) -> Sample:
    """Weighted draws of a density that is cheap to compute; they are worth `enough` independent draws if possible.

    Each round takes `each` draws. A proposal is adapted to the last rounds while too few of its draws are effective, or
    while fewer than `fewest` proposals have been adapted; each adaptation makes the next less likely. Only rounds of
    one proposal are returned, so that no draw has shaped the proposal that it comes from.
    """
    rounds: list[Sample] = []
    best, first, adapted = None, 0, 0  # first: round of the proposal
    while len(rounds) < TUNING.proposal_rounds:
        u = proposal.draw(each, rng)
        rounds.append(Sample(u, target(u), proposal.log_density(u)))
        draws = _joined(rounds[first:])
        if adapted < fewest or draws.ess < TUNING.proposal_efficiency * TUNING.proposal_easing**adapted * len(draws.u):
            if not draws.ess:
                break
            proposal = adapt(_joined(rounds[-TUNING.proposal_memory :]), rng)
            first, adapted = len(rounds), adapted + 1
            continue
        best = draws if best is None or draws.ess > best.ess else best
        if best.ess >= enough:
            break
    return best or rounds[-1]


def _joined(samples: Sequence[Sample]) -> Sample:
    """The draws of all samples with their weights."""
    names = ("u", "log_target", "log_q")
    u, log_target, log_q = (np.concatenate([getattr(each, name) for each in samples]) for name in names)
    return Sample(u, log_target, log_q)


_NEVER = -1e9  # log density that stands for nothing, so that two have a difference


class Coordinates:
    """Coordinates v in which steps of the chains are taken, too. Here they are u itself."""

    def to_straight(self, u: Floats) -> tuple[Floats, Floats]:
        """v (k, d) of u (k, d), and log |dv/du| (k,)."""
        return u, np.zeros(len(u))

    def from_straight(self, v: Floats) -> Floats:
        """u (k, d) of v (k, d); NaN where v has no u."""
        return v


class Walkers:
    """Markov chains of a density: places u (k, d) and the finite log density there (k,). before: places (k, d) at which
    the mixtures were fitted. Each half of the walkers jumps to the mixture that was fitted to the other half, because a
    mixture that has seen a walker's place would bias its jumps. further: a mixture that is added to the one through
    given places. coordinates: in which ridges of the density are straighter than in u."""

    def __init__(
        self, target: Density, u: Floats, further: Callable[[Floats], Mixture | None], coordinates: Coordinates
    ) -> None:
        self.target, self.further, self.coordinates = target, further, coordinates
        self.u, self.value = u.copy(), np.maximum(target(u), _NEVER)
        self.fitted: list[Mixture | None] = [None, None]

    def settle(self, rng: np.random.Generator) -> None:
        """Fit the mixtures to the places of the walkers, beginning from the last mixtures."""
        first, second = np.array_split(self.u, 2)
        self.before, self.mixtures = self.u.copy(), list[Mixture]()
        self.straight_before = self.coordinates.to_straight(self.before)[0]
        for i, half in enumerate((second, first)):
            equal, last = np.zeros(len(half)), self.fitted[i]
            count = int(np.clip(len(half) / (TUNING.jump_walkers * half.shape[1]), 1, TUNING.jump_components))
            fit = self.fitted[i] = last.fitted(half, equal) if last else Mixture.through(half, equal, count, rng)
            mixture, further = fit.widened(TUNING.jump_wide_share, TUNING.jump_wide_factor), self.further(half)
            self.mixtures.append(mixture.mixed_with(further, TUNING.flat_tail_share) if further else mixture)

    def _log_mixture(self, u: Floats) -> Floats:
        halves = zip(self.mixtures, np.array_split(u, 2), strict=True)
        return np.concatenate([mixture.log_density(half) for mixture, half in halves])

    def _accept(self, u: Floats, value: Floats, log_odds: Floats, rng: np.random.Generator) -> float:
        taken = np.log(rng.random(len(u))) < log_odds
        self.u[taken], self.value[taken] = u[taken], value[taken]
        return float(np.mean(taken))

    def step(self, rng: np.random.Generator) -> None:
        """Step along the difference of the places of two other walkers (ter Braak and Vrugt 2008,
        doi:10.1007/s11222-008-9104-9), in u or in the straight coordinates."""
        count, d = self.u.shape
        start = rng.integers(count, size=count)
        end = (start + rng.integers(1, count, size=count)) % count
        size = TUNING.step_factor / np.sqrt(d) * rng.uniform(0.25, 0.75, count)
        size[rng.random(count) < TUNING.whole_steps] = 1.0
        noise = 1e-4 * rng.standard_normal((count, d))
        u = self.u + size[:, None] * (self.before[end] - self.before[start]) + noise
        straight = rng.random(count) < TUNING.straight_steps
        v, log_slope = self.coordinates.to_straight(self.u[straight])
        difference = (self.straight_before[end] - self.straight_before[start])[straight]
        u[straight] = self.coordinates.from_straight(v + (size[:, None] + noise)[straight] * difference)
        inside = np.isfinite(u).all(axis=1)
        u[~inside] = self.u[~inside]
        value, log_odds = np.full(count, -np.inf), np.zeros(count)
        value[inside] = self.target(u[inside])
        log_odds[straight] = log_slope - self.coordinates.to_straight(u[straight])[1]
        self._accept(u, value, value - self.value + log_odds, rng)

    def jump(self, rng: np.random.Generator) -> tuple[Floats, Floats, float]:
        """Propose draws of the mixtures to the walkers (Hastings 1970). Returns the log of the density over that of the
        mixture at the walkers (k,) and at the draws (k,), and the share of draws that is accepted."""
        halves = zip(self.mixtures, np.array_split(self.u, 2), strict=True)
        u = np.concatenate([mixture.draw(len(half), rng) for mixture, half in halves])
        value = self.target(u)
        here, there = self.value - self._log_mixture(self.u), value - self._log_mixture(u)
        return here, there, self._accept(u, value, there - here, rng)


def markov_sample(
    target: Density, walkers: Floats, further: Callable[[Floats], Mixture | None], rng: np.random.Generator, draws: int,
    coordinates: Coordinates | None = None, settling: int = TUNING.fits_most,
) -> tuple[Sample, Floats]:  # fmt: skip
    """So many nearly independent draws of a density that is cheap to compute, with its integral; and the last places of
    the walkers (k, d). further, coordinates: as of `Walkers`. settling: the walkers settle in at most so many fits.

    Steps along differences alternate with jumps to a mixture, which is fitted to the walkers until they have settled.
    Then they go on until as many jumps are accepted as draws are needed. The integral is found by bridge sampling
    between the walkers and the draws of the mixture.
    """
    chains, heights = Walkers(target, walkers, further, coordinates or Coordinates()), [np.inf, np.inf]
    for _ in range(settling):
        chains.settle(rng)
        height = []
        for _ in range(TUNING.steps_per_fit):
            chains.step(rng)
            chains.jump(rng)
            height.append(np.mean(np.maximum(chains.value, np.max(chains.value) - TUNING.walker_depth)))
        heights.append(float(np.mean(height)))
        if np.ptp(heights[-3:]) < TUNING.settled_change:
            break
    states, here, there, jumps = list[tuple[Floats, Floats]](), list[Floats](), list[Floats](), 0.0
    while len(states) < TUNING.states_per_walker and min(jumps, len(states)) * len(walkers) < draws:
        for _ in range(2):
            chains.step(rng)
            before, of_mixture, taken = chains.jump(rng)
            here, there, jumps = [*here, before], [*there, of_mixture], jumps + taken
        states.append((chains.u.copy(), chains.value.copy()))
    log_integral, error = bridge(np.concatenate(here), np.concatenate(there), len(walkers) * max(jumps, 1.0))
    u, value = (np.concatenate(parts) for parts in zip(*states, strict=True))
    some = rng.permutation(np.flatnonzero(value > _NEVER))[:draws]
    _, first, often = np.unique(
        value[some], return_index=True, return_counts=True
    )  # states of a walker that stays are one draw
    u, value = u[some[first]], value[some[first]]
    log_q = value - np.log(often * len(often) / len(some)) - log_integral
    return Sample(u, value, log_q, common=error, chosen=True), chains.u


def bridge(at: Floats, drawn: Floats, worth: float) -> tuple[float, float]:
    """Log of the integral of a density, and its standard error, from the log ratio of this density to a normalised one:
    `at` draws of the density, which are worth so many independent ones, and at draws of the normalised one (`drawn`).
    Meng and Wong 1996, Statistica Sinica 6, 831; Fruehwirth-Schnatter 2004, doi:10.1111/j.1368-423X.2004.00125.x."""
    at = at[np.isfinite(at)]
    top = float(np.median(at))
    above, others = np.exp(np.clip(at - top, -700.0, 700.0)), np.exp(np.clip(drawn - top, -700.0, 700.0))
    share = worth / (worth + len(drawn))
    integral = 1.0
    for _ in range(TUNING.bridge_iterations):
        of_others = others / (share * others + (1.0 - share) * integral)
        of_draws = 1.0 / (share * above + (1.0 - share) * integral)
        integral = float(np.mean(of_others) / np.mean(of_draws))
    variance = np.var(of_others) / np.mean(of_others) ** 2 / len(drawn)
    variance += np.var(of_draws) / np.mean(of_draws) ** 2 / worth
    return top + float(np.log(integral)), float(np.sqrt(variance))


def integral_about(log_density: Density, middle: Floats, scale: float, counts: Sequence[int]) -> float:
    """Log of the integral of a density of a few coordinates about `middle` (d,), by importance sampling in stages with
    `counts` points. The first Gaussian has the standard deviation `scale`; each later one is fitted to the weighted
    points so far. All points are weighted by the mixture of the Gaussians.

    The points are the same at each call (Roberts' sequence, extremelearning.com.au/unreasonable-effectiveness-of-
    quasirandom-sequences), so that the integral changes smoothly with the density.
    """
    d = len(middle)
    points, log_value, root = np.empty((0, d)), np.empty(0), scale * np.eye(d)
    gaussians: list[tuple[float, Floats, Floats]] = []  # log number of points, middle and root of the covariance
    log_weight = np.empty(0)
    for count in counts:
        if len(points):
            flat = tempered(log_weight, TUNING.camera_effective)
            weight = np.exp(flat - log_sum(flat))
            middle = np.asarray(weight @ points)
            spread = ((points - middle).T * weight) @ (points - middle) + 1e-4 * np.eye(d)
            root = np.asarray(TUNING.camera_widening * np.linalg.cholesky(spread))
        gaussians.append((float(np.log(count)), middle, root))
        new = middle + ndtri(even_points(count, d)) @ root.T
        points, log_value = np.concatenate([points, new]), np.append(log_value, log_density(new))
        log_q = [
            size - np.sum(np.log(np.diag(root))) + log_normal(np.asarray(np.linalg.solve(root, (points - middle).T).T))
            for size, middle, root in gaussians
        ]
        log_weight = log_value - log_sum(np.array(log_q), axis=0)  # of the sum, not the mean, over the points
    return float(log_sum(log_weight))


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

"""Importance sampling of a density that is cheap to compute, by a proposal that is adapted to its draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.sample import effective_size

ROUNDS = 24  # of draws at most
EFFICIENCY, EASING = 0.05, 0.8  # a proposal with fewer effective draws is adapted; the limit falls at each adaptation
MEMORY = 3  # a proposal is adapted to so many of the last rounds
TAIL_SHARE = 0.2  # the tail index is that of so large a part of the draws
TAIL_INDEX, UNSEEN = 0.7, 0.02  # beyond these the mean of the weights is not trusted
Density = Callable[[Floats], Floats]  # log, (k,) at (k, d)


@dataclass(frozen=True, eq=False)
class Sample:
    """Draws u (k, d) with the log density of target and proposal (k,); the mean of exp(log_weight) is the evidence."""

    u: Floats
    log_target: Floats
    log_q: Floats

    @property
    def log_weight(self) -> Floats:
        return np.asarray(self.log_target - self.log_q)

    @property
    def ess(self) -> float:
        return effective_size(self.log_weight)

    @property
    def log_evidence(self) -> tuple[float, float]:
        """Log of the mean weight and its standard error, from the scatter of the weights; (-inf, inf) if all
        weights vanish."""
        top = np.max(self.log_weight)
        if not np.isfinite(top):
            return -np.inf, np.inf
        scaled = np.exp(self.log_weight - top)
        mean = float(np.mean(scaled))
        scatter = np.std(scaled, ddof=1) / np.sqrt(len(scaled)) / mean
        return float(top + np.log(mean)), float(scatter)

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
        count = int(min(TAIL_SHARE * len(finite), 3.0 * np.sqrt(len(finite))))
        if count < 5:
            return float("nan"), float("nan")
        weight = np.exp(finite[-count - 1 :] - finite[-1])
        excesses = weight[1:] - weight[0]
        if not excesses[-1] > 0:
            return 0.0, 0.0
        shape, scale = generalised_pareto(excesses)
        excess = (scale + shape * excesses[-1]) / (1.0 - shape) if shape < 1.0 else np.inf
        return float(shape), float(max(excess, 0.0) / np.sum(np.exp(finite - finite[-1])))

    @property
    def reliable(self) -> bool:
        """Whether the mean of the weights can be trusted; with too few weights to judge it counts as trusted."""
        index, unseen = self.tail
        return not (index > TAIL_INDEX and unseen > UNSEEN)


class Proposal(Protocol):
    """A normalised density from which draws can be taken."""

    def draw(self, count: int, rng: np.random.Generator) -> Floats: ...

    def log_density(self, u: Floats) -> Floats: ...


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
    while len(rounds) < ROUNDS:
        u = proposal.draw(each, rng)
        rounds.append(Sample(u, target(u), proposal.log_density(u)))
        draws = _joined(rounds[first:])
        if adapted < fewest or draws.ess < EFFICIENCY * EASING**adapted * len(draws.u):
            if not draws.ess:
                break
            proposal = adapt(_joined(rounds[-MEMORY:]), rng)
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

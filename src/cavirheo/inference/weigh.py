"""From draws of the emulator to draws of the solver: each is simulated and weighted by the likelihood of its frames.

A model (a law with the state of its switches, liquid or gel, real or field's bubble) is sampled, corrected and weighed
by itself; the answer has the draws of all models, each with the share of its evidence from simulations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats, at_levels, log_sum, relative_weights
from cavirheo.errors import SolverError
from cavirheo.inference.noise import Noise
from cavirheo.inference.sample import (
    EMULATED,
    Budget,
    Draws,
    Frames,
    Maxima,
    Requests,
    Rounds,
    climbing,
    effective_size,
    expanding,
    finding_maxima,
    first_round,
    ridges,
    run_together,
    sample,
)
from cavirheo.prior import log_normal

CORRECTING = 12  # simulations that tell the emulator's mean error of each frame
REACH = 15.0  # of log posterior, or of the log of Laplace's integral, below which a maximum or a model is left out
LOOKED_AT, REFINED = 4, 20  # maxima of a model that are simulated, and whose ridges are followed; steps from the best
LEAST_PART = 0.2  # of the effective draws of all models that each of them has
NEGLIGIBLE = 4.5  # log evidence below the best model's from which a model is not drawn from further
TELLING = 8.0  # effective draws that tell the evidence of a model; fewer find it too low
TURNS = 40  # times at most that more draws, of one of the models, are simulated
GOOD, LEAST_YIELD = 0.5, 0.1  # effective part of draws that need no better correction, and that is reckoned with
SLOPE_RIDGE, ROUGHNESS = 3.0, 0.1  # of the correction: ridge of its slopes, variance that the process leaves
FARTHEST = 2.5  # widths from the middle up to which the correction is linear
AT_ONCE = 256  # places that are corrected together: their matrices stay in the processor's cache
SPREAD_OUT = 4096  # equally likely draws among which those to be simulated are picked
FLATTENED = 0.75
"""Power of the density of corrected quick frames from which draws are simulated: they reach tails that these frames
miss. With it, 90 % intervals of real gels are 0.93 as wide as those of 2,500 simulated draws (0.84 without) and differ
half as much between seeds, for a third more simulations."""
OUTER = 0.02  # probability between an end of a prior and a place that comes from another model

Correction = Callable[[Floats], Floats]  # of residuals (k, n), at u (k, d)
T = TypeVar("T")


def _same(u: Floats) -> Floats:
    return u


@dataclass(frozen=True, eq=False)
class Model:
    """What is sampled: residuals at u (k, d), where the prior is standard normal.

    Attributes:
        quick, simulated: residuals (k, n) at x by a quick source and by the solver, NaN where there is no bubble; all
            models share them.
        noise: their distribution.
        dimension: d.
        log_prior: log of the probability of the model.
        to_x, to_u: from u (k, d) to x, which all models share, and back.
    """

    quick: Frames
    simulated: Frames
    noise: Noise
    dimension: int
    log_prior: float = 0.0
    to_x: Callable[[Floats], Floats] = _same
    to_u: Callable[[Floats, float], Floats] | None = None

    def log_posterior(self, u: Floats, residuals: Floats) -> Floats:
        """(k,) of residuals (k, n) at u (k, d)."""
        return self.noise.log_density(residuals) + log_normal(u) + self.log_prior


class Weighed(NamedTuple):
    """Draws that were simulated, of a model or of all of them.

    Attributes:
        x: (k, d) places.
        residuals: (k, n) of the simulations there.
        log_posterior: (k,) by these.
        log_weight: (k,); their exponentials sum to 1.
        log_evidence, error: log of the integral, and its standard error.
        effective: number of draws that are effective.
    """

    x: Floats
    residuals: Floats
    log_posterior: Floats
    log_weight: Floats
    log_evidence: float
    error: float
    effective: float

    @property
    def weights(self) -> Floats:
        """(k,) that sum to 1."""
        weight = relative_weights(self.log_weight)
        return weight / np.sum(weight)

    @property
    def solved(self) -> Weighed:
        """Without the draws that could not be simulated."""
        good = np.isfinite(self.log_weight)
        names = ("x", "residuals", "log_posterior", "log_weight")
        return self._replace(**{name: getattr(self, name)[good] for name in names})


@dataclass(frozen=True, eq=False)
class Sampled:
    """How far a model has been sampled. `known` and `rng` change in place, and copies share them.

    Attributes:
        model: the model.
        known: what its simulations tell.
        maxima: of its log posterior without `model.log_prior`; the last one is the highest by simulations, once it has
            been looked at.
        rounds: of quick frames.
        log_evidence: as far as it is known: Laplace's integral, then by the emulator, then by weighed draws.
        parts: weighed draws.
    """

    model: Model
    known: SimulatedPlaces
    maxima: Maxima
    rng: np.random.Generator
    rounds: Rounds | None = None
    log_evidence: float = -np.inf
    parts: tuple[Weighed, ...] = ()

    @property
    def effective(self) -> float:
        """Number of effective draws."""
        return merged(self.parts).effective

    @property
    def yielded(self) -> float:
        """Effective part of the last draws that were simulated."""
        return max(self.parts[-1].effective / len(self.parts[-1].x), LEAST_YIELD)


def posterior(models: Sequence[Model], seed: int, budget: Budget = EMULATED) -> Weighed:
    """The posterior over all models: each is scanned, climbed and sampled by its quick frames, then weighed by
    simulations. Models that are too unlikely are left out on the way. Raises SolverError: no bubble can be
    simulated."""
    started = [each for each in _started(models, seed, budget) if np.any(np.isfinite(each.maxima.value))]
    if not started:
        raise SolverError("no bubble of this law can be simulated at the times of the frames")
    looked = _with_simulated_maximum(_likely(_with_maxima_of_others(started, budget), REACH), budget)
    found = _likely([_with_first_evidence(each, budget) for each in _likely(looked, REACH)], NEGLIGIBLE)
    for _ in range(TURNS):
        logs = np.array([each.log_evidence for each in found])
        share = np.exp(logs - log_sum(logs))
        lacking = share - np.array([each.effective for each in found]) / budget.effective
        lacking[[each.effective < TELLING for each in found]] += 1.0
        worst = int(np.argmax(lacking))
        needed = budget.effective * min(lacking[worst], share[worst]) / found[worst].yielded
        most = budget.effective
        if found[worst].yielded < GOOD:  # the correction becomes better before more is spent
            most = sum(len(part.x) for part in found[worst].parts)
        left = budget.most - sum(each.known.count for each in found)
        if lacking[worst] <= 0.0 or left < CORRECTING:
            break
        wanted = int(np.clip(needed, CORRECTING, min(most, left)))
        found[worst] = _weighed(found[worst], wanted, budget, float(share[worst]))[1]
    return _combined([merged(each.parts) for each in found], np.zeros(len(found)))


def _likely(found: Sequence[Sampled], reach: float) -> list[Sampled]:
    """Those whose log evidence is less than `reach` below the largest."""
    top = max(each.log_evidence for each in found)
    return [each for each in found if each.log_evidence >= top - reach]


def _quickly(found: Sequence[Sampled], askings: Sequence[Requests[T]]) -> list[T]:
    """What a computation for each model returns, by quick frames of all of them together."""

    def residuals(asked: dict[int, Floats]) -> dict[int, Floats]:
        rows = SimulatedPlaces.quick_of_all([found[i].known for i in asked], list(asked.values()))
        return dict(zip(asked, rows, strict=True))

    return run_together(askings, residuals)


def _started(models: Sequence[Model], seed: int, budget: Budget) -> list[Sampled]:
    """The models with the maxima that a scan of the prior of each leads to."""
    streams = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(len(models)))
    found = [
        Sampled(model, SimulatedPlaces(model), Maxima.none(model.dimension), rng)
        for model, rng in zip(models, streams, strict=True)
    ]
    askings = [finding_maxima(each.model.noise, each.model.dimension, budget, each.rng) for each in found]
    return [replace(each, maxima=maxima) for each, maxima in zip(found, _quickly(found, askings), strict=True)]


def _with_maxima_of_others(found: Sequence[Sampled], budget: Budget) -> list[Sampled]:
    """Also with the maxima to which the highest ones of the other models lead."""
    highest = max(np.max(each.maxima.value) for each in found)
    tops = {
        i: each.model.to_x(each.maxima.u[each.maxima.apart(LOOKED_AT, REACH, peaks=False)])
        for i, each in enumerate(found)
        if np.max(each.maxima.value) > highest - REACH
    }
    askings = list[Requests[Maxima]]()
    for i, each in enumerate(found):
        places = [each.model.to_u(x, OUTER) for other, x in tops.items() if other != i and each.model.to_u]
        starts = np.concatenate([np.zeros((0, each.model.dimension)), *places])
        askings.append(climbing(each.model.noise, starts, budget.steps))
    crossed = list[Sampled]()
    for each, more in zip(found, _quickly(found, askings), strict=True):
        maxima = each.maxima.and_of(more)
        log_evidence = float(np.max(maxima.value)) + each.model.log_prior
        crossed.append(replace(each, maxima=maxima, log_evidence=log_evidence))
    return crossed


class Top(NamedTuple):
    """A place u (d,) of a model, with the log posterior and the residuals (n,) of its simulation."""

    u: Floats
    height: float
    residual: Floats


def _with_simulated_maximum(found: Sequence[Sampled], budget: Budget) -> list[Sampled]:
    """With the highest maximum by simulations, from those by quick frames and from that of the best other model."""
    places = [each.maxima.u[each.maxima.apart(LOOKED_AT, REACH, peaks=False)] for each in found]
    tops = _refined(found, _highest(found, places), budget)
    best = int(np.argmax([top.height for top in tops]))
    x = found[best].model.to_x(tops[best].u[None])
    others = [i for i, each in enumerate(found) if i != best and each.model.to_u]
    there = _highest([found[i] for i in others], [found[i].model.to_u(x, OUTER) for i in others])  # type: ignore[misc]
    higher = {i: top for i, top in zip(others, there, strict=True) if top.height > tops[i].height}
    refined = _refined([found[i] for i in higher], list(higher.values()), budget)
    for i, top in zip(higher, refined, strict=True):
        tops[i] = top
    for each, top in zip(found, tops, strict=True):
        each.known.keep_only(top.u, top.residual)
    quick = SimulatedPlaces.quick_of_all([each.known for each in found], [top.u[None] for top in tops])
    askings = [
        expanding(each.model.noise, top.u[None], missed) for each, top, missed in zip(found, tops, quick, strict=True)
    ]
    looked = list[Sampled]()
    for each, top, (_, shape) in zip(found, tops, _quickly(found, askings), strict=True):
        highest = Maxima(top.u[None], np.array([top.height - each.model.log_prior]), shape)
        laplace = top.height - 0.5 * float(np.linalg.slogdet(shape[0] / (2.0 * np.pi))[1])
        looked.append(replace(each, maxima=each.maxima.and_of(highest), log_evidence=laplace))
    return looked


def _highest(found: Sequence[Sampled], places: Sequence[Floats]) -> list[Top]:
    """The highest of the places u (k, d) of each model by simulations, or by quick frames if all of these fail."""
    tops = list[Top]()
    simulated = SimulatedPlaces.simulated([each.known for each in found], places)
    for each, u, residuals in zip(found, places, simulated, strict=True):
        heights = each.model.log_posterior(u, residuals)
        if not np.isfinite(heights).any():
            residuals = each.known.quick(u)
            heights = each.model.log_posterior(u, residuals)
        best = int(np.argmax(heights))
        tops.append(Top(u[best], float(heights[best]), residuals[best]))
    return tops


def _refined(found: Sequence[Sampled], tops: Sequence[Top], budget: Budget) -> list[Top]:
    """The maximum of each model by simulations from a place near it: each step leads to the maximum of quick frames
    that are right at the last place."""
    tops, rising = list(tops), list(range(len(tops)))
    for _ in range(REFINED):
        if not rising:
            break
        at = [found[i] for i in rising]
        quick = SimulatedPlaces.quick_of_all([each.known for each in at], [tops[i].u[None] for i in rising])
        askings = [
            _shifted(climbing(each.model.noise, tops[i].u[None], budget.steps), tops[i].residual - row[0])
            for each, i, row in zip(at, rising, quick, strict=True)
        ]
        trials = [maxima.u for maxima in _quickly(at, askings)]
        reached = _highest(at, trials)
        higher = [i for i, top in zip(rising, reached, strict=True) if top.height > tops[i].height + 0.1]
        for i, top in zip(rising, reached, strict=True):
            if i in higher:
                tops[i] = top
        rising = higher
    return tops


def _shifted(asking: Requests[T], shift: Floats) -> Requests[T]:
    """A computation to which residuals are sent with this shift (n,)."""
    u = next(asking)
    while True:
        residuals = yield u
        try:
            u = asking.send(residuals + shift)
        except StopIteration as end:
            returned: T = end.value
            return returned


def _with_first_evidence(found: Sampled, budget: Budget) -> Sampled:
    """With a few draws. A poor emulator does not make the evidence too low."""
    quick, correction = found.known.quick, found.known.correction()

    def corrected(u: Floats) -> Floats:
        return quick(u) + correction(u)

    mixture = ridges(corrected, found.model.noise, found.maxima, budget, found.rng, LOOKED_AT, REACH)
    rounds = first_round(mixture, budget.rounds[0], quick, found.rng)
    by_quick_frames, found = _weighed(replace(found, rounds=rounds), CORRECTING, budget)
    return replace(found, log_evidence=max(found.log_evidence, by_quick_frames))


def _weighed(found: Sampled, wanted: int, budget: Budget, share: float = 0.0) -> tuple[float, Sampled]:
    """With so many more draws that are simulated, of the flattened density of corrected quick frames of a model with
    this share of the evidence; and the log evidence by these frames."""
    model, known, rng = found.model, found.known, found.rng
    assert found.rounds is not None
    correction = known.correction()

    def log_density(u: Floats, residuals: Floats) -> Floats:
        return FLATTENED * model.log_posterior(u, residuals + correction(u))

    enough = budget.sampled * max(share, LEAST_PART)
    draws, rounds = sample(known.quick, log_density, found.rounds, budget.rounds, rng, enough, budget.walkers)
    picked, count = np.unique(pick(draws, wanted, rng), return_counts=True)
    order = rng.permutation(len(picked))
    at, log_quick, count = draws.u[picked[order]], draws.log_density[picked[order]], count[order]
    residuals = known.simulate(at)
    log_posterior = model.log_posterior(at, residuals)
    gain = log_posterior - log_quick
    log_mean = float(log_sum(np.log(count) + gain) - np.log(np.sum(count)))
    scatter = float(np.std(np.exp(gain - log_mean)) / np.sqrt(len(at))) if np.isfinite(log_mean) else 0.0
    log_weight = np.log(count) + gain
    if np.isfinite(log_mean):
        log_weight -= log_sum(log_weight)
    part = Weighed(
        model.to_x(at), residuals, log_posterior, log_weight, draws.log_evidence + log_mean,
        float(np.hypot(draws.error, scatter)), min(effective_size(log_weight), effective_size(draws.log_weight)),
    )  # fmt: skip
    parts = (*found.parts, part)
    more = replace(found, rounds=rounds, parts=parts, log_evidence=merged(parts).log_evidence)
    steeper = draws.log_weight + (1.0 / FLATTENED - 1.0) * draws.log_density
    return draws.log_evidence + float(log_sum(steeper)), more


@dataclass(eq=False)
class SimulatedPlaces:
    """The frames of a model, and what simulations tell of the error of the quick ones.

    Attributes:
        model: the model.
        u, difference: places (k, d), and simulated minus quick residuals (k, n) there, of simulations that succeeded.
        count: number of simulations.
    """

    model: Model
    u: list[Floats] = field(default_factory=list)
    difference: list[Floats] = field(default_factory=list)
    count: int = 0

    def quick(self, u: Floats) -> Floats:
        """Quick residuals (k, n) at u (k, d)."""
        return self.quick_of_all([self], [u])[0]

    @staticmethod
    def quick_of_all(known: Sequence[SimulatedPlaces], places: Sequence[Floats]) -> list[Floats]:
        """Quick residuals (k, n) of several models at u (k, d) of each, in one call."""
        return _at(known, places, known[0].model.quick)

    def simulate(self, u: Floats) -> Floats:
        """Simulated residuals (k, n) at u (k, d), which are then known."""
        return self.simulated([self], [u])[0]

    @staticmethod
    def simulated(known: Sequence[SimulatedPlaces], places: Sequence[Floats]) -> list[Floats]:
        """`simulate` of several models at u (k, d) of each, in one call."""
        if not known:
            return []
        found = _at(known, places, known[0].model.simulated)
        emulated = SimulatedPlaces.quick_of_all(known, places)
        for each, u, residuals, quick in zip(known, places, found, emulated, strict=True):
            good = np.isfinite(residuals).all(axis=1)
            each.count += len(u)
            each.u.append(u[good])
            each.difference.append((residuals - quick)[good])
        return found

    def keep_only(self, place: Floats, residual: Floats) -> None:
        """Keep what is known of a place (d,) with this simulated residual (n,) alone."""
        self.u[:], self.difference[:] = [place[None]], [residual - self.quick(place[None])]

    def correction(self) -> Correction:
        """The error as a function of u."""
        return smooth(np.concatenate(self.u), np.concatenate(self.difference))


def _at(known: Sequence[SimulatedPlaces], places: Sequence[Floats], residuals: Frames) -> list[Floats]:
    """Residuals (k, n) at u (k, d) of each model, in one call."""
    x = [each.model.to_x(u) for each, u in zip(known, places, strict=True)]
    return np.split(residuals(np.concatenate(x)), np.cumsum([len(rows) for rows in x])[:-1])


def smooth(u: Floats, difference: Floats) -> Correction:
    """The difference (k, n) of simulated and quick frames as a function of u (k, d): its median; of enough places a
    linear function over the scatter of u, by ridge regression, and a Gaussian process of what this leaves; 0 of none.

    The process halves what is left at 500 places where the emulator is poor, and changes nothing at 100."""
    if not len(u):
        return lambda at: np.zeros((len(at), 1))
    middle, mean, d = u.mean(axis=0), difference.mean(axis=0), u.shape[1]
    if len(u) < 4 * d:
        middle_difference = np.median(difference, axis=0)  # one wild bubble does not count
        return lambda at: np.asarray(middle_difference)
    whiten = np.linalg.inv(np.linalg.cholesky(np.cov(u.T) + 1e-8 * np.eye(d))).T
    z = (u - middle) @ whiten
    slope = np.linalg.solve(z.T @ z + SLOPE_RIDGE * np.eye(d), z.T @ (difference - mean))

    def likeness(at: Floats) -> Floats:
        squares = np.sum(at**2, axis=1)[:, None] + np.sum(z**2, axis=1) - 2.0 * at @ z.T
        return np.asarray(np.exp(-squares / (2.0 * d)))  # of places as far apart as two draws: exp(-1)

    left = np.linalg.solve(likeness(z) + ROUGHNESS * np.eye(len(z)), difference - mean - z @ slope)

    def correction(at: Floats) -> Floats:
        y = (at - middle) @ whiten
        process = [likeness(some) @ left for some in np.array_split(y, len(y) // AT_ONCE + 1)]
        return np.asarray(mean + np.clip(y, -FARTHEST, FARTHEST) @ slope + np.concatenate(process))

    return correction


def pick(draws: Draws, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of `count` equally likely draws, some of them perhaps several times, that are spread as all are by their
    weights: one of each of `count` cells of equal numbers, which are halved along one parameter after the other."""
    levels = (np.arange(SPREAD_OUT) + rng.random()) / SPREAD_OUT
    equal = at_levels(np.exp(draws.log_weight), levels)
    cells: list[NDArray[np.int64]] = [equal]
    axis = 0
    while len(cells) < count:
        halves: list[NDArray[np.int64]] = []
        for cell in cells:
            order = cell[np.argsort(draws.u[cell, axis % draws.u.shape[1]], kind="stable")]
            halves += np.array_split(order, 2)
        cells, axis = halves, axis + 1
    picked = np.array([rng.choice(cell) for cell in cells])
    return rng.permutation(picked)[:count]


def merged(parts: Sequence[Weighed]) -> Weighed:
    """The draws of several parts of one model, each with its share of the effective draws, times its evidence: draws
    of a place that proved to be unlikely do not count."""
    parts = [part for part in parts if part.effective > 0.0] or parts[:1]
    if len(parts) == 1:
        return parts[0]
    share = np.array([part.effective for part in parts])
    return _combined(parts, np.log(share / np.sum(share)))


def _combined(parts: Sequence[Weighed], log_share: Floats) -> Weighed:
    """The draws of all parts, each with its share times its evidence, and the sum of these evidences."""
    evidences = log_share + np.array([part.log_evidence for part in parts])
    log_evidence = float(log_sum(evidences))
    x, residuals, log_posterior = (np.concatenate([part[i] for part in parts]) for i in range(3))
    log_weight = np.concatenate(
        [part.log_weight + log - log_evidence for part, log in zip(parts, evidences, strict=True)]
    )
    error = float(np.linalg.norm(np.exp(evidences - log_evidence) * [part.error for part in parts]))
    return Weighed(x, residuals, log_posterior, log_weight, log_evidence, error, _effective(x, log_weight))


def _effective(x: Floats, log_weight: Floats) -> float:
    """Effective number of different places x (k, d)."""
    _, which = np.unique(x, axis=0, return_inverse=True)
    weight = np.bincount(which.ravel(), np.exp(log_weight - np.max(log_weight)))
    return float(np.sum(weight) ** 2 / np.sum(weight**2))

"""Where to draw: modes, what a surrogate makes of simulations about them, and further modes that turn up on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats, log_sum, unscaled
from cavirheo.inference.verify.mode import Mode, Simulated, Target, same, trust_in
from cavirheo.inference.verify.sampler import (
    Density,
    Mixture,
    Sample,
    effective_size,
    markov_sample,
    tempered,
)
from cavirheo.inference.verify.surrogate import Surrogate, climb_emulated
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.posterior import weighted_quantile
from cavirheo.prior import log_normal


class SurrogateDraws(NamedTuple):
    """Weighted draws of what a surrogate takes for the posterior."""

    surrogate: Surrogate
    sample: Sample

    def chosen(self, count: int, rng: np.random.Generator, power: float = 1.0) -> NDArray[np.int64]:
        """Indices of so many draws of the surrogate, or of this power of it."""
        log_weight = tempered(power * self.sample.log_target - self.sample.log_q, 2.0 * count)
        weight = np.exp(log_weight - log_sum(log_weight))
        count = min(count, int(np.count_nonzero(weight)))
        return np.asarray(rng.choice(len(weight), count, replace=False, p=weight / np.sum(weight)))


def shelves(target: Target, w: Floats, size: int) -> Mixture | None:
    """Of draws w (k, d) whose first `size` coordinates are u: where frames bound one of these from one side only.

    Towards an end of its range a coordinate changes the frames less and less (Target.linear): its posterior is as wide
    as its prior there. The others are where their regression on what the frames see of it tells. A component for each
    end that this regression does not exclude; None without one.
    """
    count, d = w.shape
    linear, mean = target.linear(w[:, :size]), np.mean(w, axis=0)
    off, off_seen = w - mean, linear - np.mean(linear, axis=0)
    variance = np.mean(off_seen**2, axis=0) + 1e-30
    means, covariances = [], []
    for j in range(size):
        slope = off_seen[:, j] @ off / (count * variance[j])
        left = off - np.outer(off_seen[:, j], slope)
        covariance = left.T @ left / count
        covariance[j], covariance[:, j] = 0.0, 0.0
        covariance += np.diag(np.where(np.arange(d) == j, 1.0, 1e-9))
        for end in (-TUNING.shelf_end, TUNING.shelf_end):
            place = mean[None, :size].copy()
            place[0, j] = end
            away = target.linear(place)[0, j] - np.mean(linear[:, j])
            if away**2 < TUNING.shelf_reach**2 * variance[j]:
                means.append(np.where(np.arange(d) == j, 0.0, mean + slope * away))
                covariances.append(covariance)
    return Mixture(np.full(len(means), 1.0 / len(means)), np.array(means), np.array(covariances)) if means else None


class AdaptiveProposal:
    """Draws of the posterior of a shot that learn from every simulation, from its modes on. simulated: what is known;
    about a mode near which little is, a standard deviation on either side is simulated."""

    def __init__(self, target: Target, modes: Sequence[Mode], simulated: Simulated | None = None) -> None:
        self.target = target
        self.u = np.empty((0, len(target.prior.names)))
        self.residual = np.empty((0, target.noise.size))
        self.value = np.empty(0)
        self.modes, self.climbed = list[Mode](), 0
        self.taught: tuple[Surrogate, int] | None = None  # by the first so many simulations
        self.drawn: Sample | None = None  # the last draws of a surrogate
        self.walkers = np.empty((0, 0))  # (k, d + m) u and camera, where the last draws of a surrogate ended
        if simulated:
            self.learn(*simulated)
        self._know(modes)
        self.mixture = self.start

    def also(self, modes: Sequence[Mode]) -> None:
        """Take up further modes that are not known yet; the next draws begin about all of them."""
        if self._know(modes):
            self.mixture = self._wide()

    def _know(self, modes: Sequence[Mode]) -> bool:
        """Take up modes, and simulate about them where little is known. Whether one of them is new."""
        before = len(self.modes)
        for mode in modes:
            if not any(same(mode, earlier) for earlier in self.modes):
                self.modes.append(mode)
                d = len(mode.u)
                if np.count_nonzero(mode.squares(self.u) < TUNING.near_mode**2 * d) <= 2 * d:
                    axes = np.linalg.cholesky(mode.covariance).T
                    self(mode.u + np.concatenate([axes, -axes]))
        return len(self.modes) > before

    @property
    def start(self) -> Mixture:
        """About the modes."""
        heights = np.array([mode.log_evidence for mode in self.modes])
        means, covariances = [mode.u for mode in self.modes], [mode.covariance for mode in self.modes]
        return Mixture.of_modes(means, covariances, heights - np.max(heights))

    def __call__(self, u: Floats) -> None:
        """Simulate u (k, d), which the next surrogate knows."""
        self.learn(*Simulated.at(self.target, u))

    def learn(self, u: Floats, residual: Floats, value: Floats) -> None:
        """Know simulations at u (k, d) with residuals (k, n) and log posterior (k,)."""
        self.u, self.residual, self.value = self.simulated.joined(Simulated(u, residual, value).finite)

    @property
    def simulated(self) -> Simulated:
        """All that is known."""
        return Simulated(self.u, self.residual, self.value)

    @property
    def height(self) -> float:
        """The largest log posterior that was met."""
        return float(max(*(mode.log_posterior for mode in self.modes), np.max(self.value, initial=-np.inf)))

    @property
    def highest(self) -> Floats:
        """(d,) u of the largest log posterior that was met, at a mode or a simulation."""
        mode = max(self.modes, key=lambda mode: mode.log_posterior)
        met = np.max(self.value, initial=-np.inf) > mode.log_posterior
        return np.asarray(self.u[np.argmax(self.value)] if met else mode.u)

    def climb_higher(self) -> None:
        """Climb from the best simulation if it lies above all modes, which must then be beside the highest."""
        highest = max(mode.log_posterior for mode in self.modes)
        if self.climbed == TUNING.modes_climbed or np.max(self.value, initial=-np.inf) < highest + TUNING.other_mode:
            return
        self.climbed += 1
        self.climb_from(self.u[np.argmax(self.value)])

    def climb_from(self, start: Floats) -> None:
        """Climb from a simulated u (d,) and take up the mode that it leads to, if this is a new one."""
        mode, on_the_way = climb_emulated(self.target, self.simulated, start, self.modes)
        self.learn(*on_the_way)
        self.also([mode] if mode else [])

    def emulated(self, rng: np.random.Generator, enough: float = TUNING.pool) -> SurrogateDraws | None:
        """Draws, worth `enough` independent ones, of a surrogate of all simulations so far, and of rough ones about the
        modes where these are too few; None where they still are, or nothing that is drawn is likely."""
        fewest = 2 * (self.u.shape[1] + 1)
        if len(self.u) <= fewest:
            self(self._wide().draw(TUNING.own_draws, rng))
        if len(self.u) <= fewest:
            return None
        if self.taught is None or self.taught[1] != len(self.u):
            self.taught = Surrogate(self.target, self.u, self.residual, self.value), len(self.u)
        surrogate, _ = self.taught
        draws = int(TUNING.emulated_draws * enough)
        walkers = self._begun(surrogate, int(np.clip(draws / 6, *TUNING.walkers)), rng)
        if walkers is None:
            return None
        lift = self._lift()

        def lifted(w: Floats) -> Floats:
            return surrogate(w) + lift(w)

        sample, self.walkers = markov_sample(
            lifted, walkers, lambda w: shelves(self.target, w, self.u.shape[1]), rng, draws, self.target
        )
        u, camera = np.split(sample.u, [self.u.shape[1]], axis=1)
        sample = replace(sample, u=u, camera=camera, log_target=sample.log_target - lift(sample.u))
        self.drawn = sample
        self.mixture = self._through(sample, rng).widened(TUNING.flat_share, TUNING.flat_factor)
        return SurrogateDraws(surrogate, sample)

    def _lift(self) -> Density:
        """By how much the log density of draws is raised at larger values of the law's parameters, of u and camera (k,
        d + m): where the recording bounds one alone, its bound lies where a prior that is uniform in the logarithm has
        few draws. One whose value is known is hardly moved."""
        if self.drawn is None:
            return lambda w: np.zeros(len(w))
        law = self.target.experiment.law
        prior = self.target.prior.of(self.target.prior.names[:law])
        usual = weighted_quantile(prior.to_x(self.drawn.u[:, :law]), np.array([TUNING.lifted]), self.drawn.log_weight)
        return lambda w: np.sum(np.log1p(10.0 ** (prior.to_x(w[:, :law]) - usual)), axis=1)

    def _begun(self, surrogate: Surrogate, count: int, rng: np.random.Generator) -> Floats | None:
        """(count, d + m) where walkers begin: where the last ones ended, and likely places about the modes; None
        without such places."""
        mixture = self._wide()
        u = mixture.draw(TUNING.begun * count, rng)
        middle, spread = self._expected_camera(u)
        off = rng.standard_normal(middle.shape)
        w = np.hstack([u, middle + spread * off])
        log_q = mixture.log_density(u) + log_normal(off) - float(np.sum(np.log(spread)))
        log_weight = tempered(surrogate(w) - log_q, count / 4)
        if not np.any(np.isfinite(log_weight)):
            return None
        new = count - min(int(TUNING.walked_on * count), len(self.walkers))
        chosen = rng.choice(len(w), new, p=unscaled(log_weight) / np.sum(unscaled(log_weight)))
        return np.concatenate([w[chosen], rng.permutation(self.walkers)[: count - new].reshape(-1, w.shape[1])])

    def _expected_camera(self, u: Floats) -> tuple[Floats, Floats]:
        """(k, m) camera z of bubbles at u (k, d) by a line through those of the likely simulations, and the standard
        deviations (m,) of draws about it."""
        z = self.target.camera.z(self.residual)
        trust = trust_in(self.value)
        middle = trust @ self.u / np.sum(trust)
        root = np.sqrt(trust)[:, None]
        line = root * np.column_stack([np.ones(len(z)), self.u - middle])
        firm = np.diag(np.append(0.0, np.full(u.shape[1], 0.1 * np.sum(trust))))
        slopes = np.linalg.solve(line.T @ line + firm, line.T @ (root * z))
        missed = z - slopes[0] - (self.u - middle) @ slopes[1:]
        spread = np.sqrt(trust @ missed**2 / np.sum(trust)) + TUNING.begun_camera
        return slopes[0] + (u - middle) @ slopes[1:], spread

    def _through(self, draws: Sample, rng: np.random.Generator) -> Mixture:
        """A mixture that follows weighted draws, with as many components as they are worth, and the modes."""
        d = draws.u.shape[1]
        log_weight = tempered(draws.log_weight, min(TUNING.adapted * d, 0.25 * len(draws.u)))
        count = int(np.clip(effective_size(log_weight) / (TUNING.adapted_each * d), 1, TUNING.adapted_components))
        mixture = Mixture.through(draws.u, log_weight, count, rng)
        return mixture.mixed_with(self.start, TUNING.adapted_modes).widened()

    def _wide(self) -> Mixture:
        """The mixture with the modes beside it, widened."""
        return self.mixture.mixed_with(self.start, TUNING.modes_share).widened()

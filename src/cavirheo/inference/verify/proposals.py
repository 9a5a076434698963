"""Where to draw: modes, what a surrogate makes of simulations about them, and further modes that turn up on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats, log_sum, unscaled
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, modes, ridge, same
from cavirheo.inference.verify.sampler import (
    Mixture,
    Proposal,
    Sample,
    adapted,
    effective_size,
    few_draws,
    importance_sample,
    sample,
    tempered,
)
from cavirheo.inference.verify.surrogate import Surrogate
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.physics.accuracy import DEFAULT, ROUGH, Accuracy
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


class GuardedProposal:
    """Draws from a mixture, and a share of them from a proposal that knows the whole posterior roughly: no weight can
    be larger than that share allows."""

    def __init__(self, mixture: Mixture, guard: Proposal, share: float) -> None:
        self.mixture, self.guard, self.share = mixture, guard, share

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d)"""
        guards = int(np.ceil(self.share * count))
        return np.concatenate([self.mixture.draw(count - guards, rng), self.guard.draw(guards, rng)])

    def log_density(self, u: Floats) -> Floats:
        """(k,) at u (k, d)."""
        parts = np.log(1.0 - self.share) + self.mixture.log_density(u), np.log(self.share) + self.guard.log_density(u)
        return np.logaddexp(*parts)


class CameraProposal:
    """u from a mixture and, beside it, (k, m) z of the camera from its prior."""

    def __init__(self, mixture: Mixture, size: int) -> None:
        self.mixture, self.size = mixture, size

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d + m)"""
        return np.hstack([self.mixture.draw(count, rng), rng.standard_normal((count, self.size))])

    def log_density(self, w: Floats) -> Floats:
        """(k,) at w (k, d + m)."""
        u, z = np.split(w, [w.shape[1] - self.size], axis=1)
        return self.mixture.log_density(u) + log_normal(z)


def shelves(target: Target, draws: Sample, size: int) -> Mixture | None:
    """Of weighted draws whose first `size` coordinates are u: where frames bound one of these from one side only.

    Towards an end of its range a coordinate changes the frames less and less (Target.linear): its posterior is as wide
    as its prior there. The others are where their regression on what the frames see of it tells. A component for each
    end that this regression does not exclude; None without one.
    """
    d, weight = draws.u.shape[1], unscaled(draws.log_weight)
    weight /= np.sum(weight)
    linear, mean = target.linear(draws.u[:, :size]), weight @ draws.u
    off, off_seen = draws.u - mean, linear - weight @ linear
    variance = weight @ off_seen**2 + 1e-30
    means, covariances = [], []
    for j in range(size):
        slope = (weight * off_seen[:, j]) @ off / variance[j]
        covariance = ((off - np.outer(off_seen[:, j], slope)).T * weight) @ (off - np.outer(off_seen[:, j], slope))
        covariance[j], covariance[:, j] = 0.0, 0.0
        covariance += np.diag(np.where(np.arange(d) == j, 1.0, 1e-9))
        for end in (-TUNING.shelf_end, TUNING.shelf_end):
            place = mean[None, :size].copy()
            place[0, j] = end
            away = target.linear(place)[0, j] - weight @ linear[:, j]
            if away**2 < TUNING.shelf_reach**2 * variance[j]:
                means.append(np.where(np.arange(d) == j, 0.0, mean + slope * away))
                covariances.append(covariance)
    return Mixture(np.full(len(means), 1.0 / len(means)), np.array(means), np.array(covariances)) if means else None


class AdaptiveProposal:
    """Proposals for the posterior of a shot that learn from every simulation, from its modes on. follow: simulate
    around the modes and along their ridges before. network: knows the whole posterior roughly, where modes know a
    part."""

    def __init__(
        self, target: Target, modes: Sequence[Mode], rounds: int = TUNING.learning_rounds, *, follow: bool = True,
        network: Proposal | None = None,
    ) -> None:  # fmt: skip
        self.target, self.rounds, self.follow, self.network = target, rounds, follow, network
        self.u = np.empty((0, len(target.prior.names)))
        self.residual = np.empty((0, target.noise.size))
        self.value = np.empty(0)
        self.modes, self.climbed = list(modes), 0
        self.places: list[Mode] = []
        self.surrogate: Surrogate | None = None  # of the last proposal, and how many simulations it knew
        self.known, self.wrong_surrogates = 0, 0
        self.taught: tuple[Surrogate, int] | None = None  # by the first so many simulations
        for mode in modes:
            self._settle(mode)  # best first
        self.mixture = self.start
        self.joint: Mixture | None = None  # of u and camera, through the draws of the last surrogate

    def _settle(self, mode: Mode) -> None:
        """A mode and the ridge through it become places to draw about, each known a standard deviation around."""
        heights = np.array([place.log_evidence for place in (mode, *self.places)])
        followed = self.follow and heights[0] >= np.max(heights) - TUNING.ridge_worth
        for place in (mode, *(ridge(self.target, mode) if followed else [])):
            if not any(same(place, earlier) for earlier in self.places):
                self.places.append(place)
                axes = np.linalg.cholesky(place.covariance).T
                if self.follow:
                    self(place.u + np.concatenate([axes, -axes]), ROUGH)
        heights = np.array([place.log_evidence for place in self.places])
        means, covariances = [place.u for place in self.places], [place.covariance for place in self.places]
        self.start = Mixture.of_modes(means, covariances, heights - np.max(heights))

    def __call__(self, u: Floats, accuracy: Accuracy = DEFAULT) -> Floats:
        """(k,) log posterior of u (k, d), which the next proposal knows; -inf where the simulation failed."""
        simulated = Simulated.at(self.target, u, accuracy)
        self.learn(*simulated)
        return simulated.value

    def weigh(self, u: Floats) -> Floats:
        """The same with the camera integrated as well as a weight asks for."""
        simulated = self.target.integrated(Simulated.at(self.target, u))
        self.learn(*simulated)
        return simulated.value

    def learn(self, u: Floats, residual: Floats, value: Floats) -> None:
        """Know simulations at u (k, d) with residuals (k, n) and log posterior (k,)."""
        good = np.isfinite(value)
        self.u = np.concatenate([self.u, u[good]])
        self.residual = np.concatenate([self.residual, residual[good]])
        self.value = np.concatenate([self.value, value[good]])

    def thorough(self, rounds: int = 0) -> None:
        """From now on follow ridges, that of the highest simulation first, and learn from so many rough rounds. What a
        mixture has learnt from draws that are worth little is forgotten."""
        self.rounds = rounds
        if not self.follow or self.climbed:
            self.follow, self.places, self.climbed = True, [], 0
            maxima = modes(self.target, [self.u[np.argmax(self.value)], *(mode.u for mode in self.modes)])
            self.modes = maxima or self.modes
            for mode in self.modes:
                self._settle(mode)
            self.mixture, self.joint = self.start, None

    @property
    def highest(self) -> Floats:
        """(d,) u of the largest log posterior that was met, at a mode or a simulation."""
        mode = max(self.modes, key=lambda mode: mode.log_posterior)
        met = np.max(self.value, initial=-np.inf) > mode.log_posterior
        return np.asarray(self.u[np.argmax(self.value)] if met else mode.u)

    def residuals_of(self, u: Floats) -> Floats:
        """(k, size) of what was simulated at u (k, d); NaN where nothing was, or it failed."""
        index = {row.tobytes(): i for i, row in enumerate(self.u)}
        residuals = np.full((len(u), self.residual.shape[1]), np.nan)
        for k, row in enumerate(np.ascontiguousarray(u)):
            if (i := index.get(row.tobytes())) is not None:
                residuals[k] = self.residual[i]
        return residuals

    def also(self, modes: Sequence[Mode]) -> None:
        """Take up further modes that are not known yet."""
        for mode in modes:
            if not any(same(mode, earlier) for earlier in self.modes):
                self.modes.append(mode)
                self._settle(mode)

    def propose(self, rng: np.random.Generator, draws: Sample | None) -> Proposal:
        """The next proposal; before the first, rounds of rough simulations where the posterior and its tails seem to
        be, and one more for each other mode found there."""
        rounds = 0
        if draws is None:
            self.surrogate, self.wrong_surrogates = None, 0
        self._check_surrogate()
        if draws and self.surrogates_fail:
            return self.settled(draws, rng)
        if draws and len(draws.u) > TUNING.lost_after and draws.ess < TUNING.lost * len(draws.u):
            self.thorough()
        while draws is None and rounds < self.rounds + self.climbed:
            emulation = self.emulated(rng)
            if emulation is None:
                u = self._wide().draw(TUNING.learnt_per_round, rng)
            else:
                u = emulation.sample.u[emulation.chosen(TUNING.learnt_per_round, rng, TUNING.flatter)]
            self(u, ROUGH)
            self.climb_higher()
            rounds += 1
        self.climb_higher()
        emulation = self.emulated(rng, TUNING.pool_followed)
        if emulation is None or emulation.sample.ess < TUNING.adapted * self.u.shape[1]:
            return self._wide()
        self.surrogate, self.known = emulation.surrogate, len(self.u)
        return self._through(emulation.sample, rng)

    def sample(self, seed: int, first: tuple[Proposal, Sample] | None = None, **sizes: Any) -> Sample:
        """Weighted draws of the proposals; where these had to follow the draws, of a last one that does not. sizes: of
        `sample` (sampler.py)."""
        draws = sample(self.weigh, self.propose, seed=seed, first=first, **sizes)
        return self.after(draws, seed + 1, **sizes) if self.surrogates_fail else draws

    def after(self, draws: Sample, seed: int, **sizes: Any) -> Sample:
        """Draws of a mixture that follows these draws, and does not change any more: one that follows the draws that it
        weighs takes their tails for too heavy, and makes intervals too narrow by a tenth. Where they are worth too
        little for an interval, and those that it follows are not, these."""
        last = self.settled(draws, np.random.Generator(np.random.Philox(seed)))
        fresh = sample(self.weigh, lambda *_: last, seed=seed, **sizes)
        return draws if fresh.ess < TUNING.effective_fewest <= draws.ess else fresh

    @property
    def surrogates_fail(self) -> bool:
        """Whether too many surrogates were wrong."""
        return self.wrong_surrogates > TUNING.wrong_surrogates

    def _check_surrogate(self) -> None:
        """Count the last surrogate if it was wrong about draws that were made by it."""
        if self.surrogate is not None:
            u, residual, value = self.u[self.known :], self.residual[self.known :], self.value[self.known :]
            good = value > np.max(self.value) - TUNING.flat_height
            camera = self.target.camera.z(residual[good])
            off = self.surrogate(np.hstack([u[good], camera])) - self.target.log_joint(u[good], residual[good], camera)
            if len(off) >= TUNING.wrong_fewest:
                scatter = 1.4826 * float(np.median(np.abs(off - np.median(off))))
                self.wrong_surrogates += scatter > TUNING.wrong_scatter
            self.surrogate = None

    def settled(self, draws: Sample, rng: np.random.Generator) -> Proposal:
        """What has been learnt from weighted draws, as a proposal for others: draws that a proposal was fitted to
        exaggerate their own weight."""
        mixture = self._through(draws, rng)
        return mixture if self.network is None else GuardedProposal(mixture, self.network, TUNING.guard_share)

    def _through(self, draws: Sample, rng: np.random.Generator) -> Mixture:
        """A mixture that follows weighted draws, with as many components as they are worth."""
        return self._followed(draws, rng).mixed_with(self.start, TUNING.adapted_modes).widened()

    def _followed(self, draws: Sample, rng: np.random.Generator, each: float = TUNING.adapted_each) -> Mixture:
        """The same without the modes. each: effective draws for each coordinate that a component takes."""
        d = draws.u.shape[1]
        log_weight = tempered(draws.log_weight, min(TUNING.adapted * d, 0.25 * len(draws.u)))
        count = int(np.clip(effective_size(log_weight) / (each * d), 1, TUNING.adapted_components))
        return Mixture.through(draws.u, log_weight, count, rng)

    def climb_higher(self) -> None:
        """Climb from the best simulation if it lies above all modes, which must then be beside the highest."""
        highest = max(mode.log_posterior for mode in self.modes)
        if self.climbed == TUNING.modes_climbed or np.max(self.value, initial=-np.inf) < highest + TUNING.other_mode:
            return
        self.climbed += 1
        mode = climb(self.target, self.u[np.argmax(self.value)], ROUGH)
        if mode is not None and not any(same(mode, earlier) for earlier in self.modes):
            self.modes.append(mode)
            self._settle(mode)

    def emulated(self, rng: np.random.Generator, enough: float = TUNING.pool, **sizes: Any) -> SurrogateDraws | None:
        """Draws, worth `enough` independent ones, of a surrogate of all simulations so far, and of rough ones about the
        modes where these are too few; None where they still are, or nothing that is drawn is likely. sizes: of
        `importance_sample`."""
        fewest = 2 * (self.u.shape[1] + 1)
        if len(self.u) <= fewest:
            self(self._wide().draw(TUNING.own_draws, rng), ROUGH)
        if len(self.u) <= fewest:
            return None
        if self.taught is None or self.taught[1] != len(self.u):
            self.taught = Surrogate(self.target, self.u, self.residual, self.value), len(self.u)
        surrogate, _ = self.taught
        size = self.target.noise.pulls
        proposal: Proposal = CameraProposal(self.mixture, size)
        if self.joint:
            proposal = GuardedProposal(self.joint, proposal, TUNING.joint_guard)
        sizes = {"each": TUNING.emulated_taught} | sizes
        draws = importance_sample(surrogate, proposal, self._adapted, rng, enough=enough, **sizes)
        if not np.any(np.isfinite(draws.log_weight)):
            return None
        self.joint = self._adapted(draws, rng)
        draws = draws.resampled(int(TUNING.emulated_draws * enough), rng)
        u, camera = np.split(draws.u, [draws.u.shape[1] - size], axis=1)
        draws = replace(draws, u=u, camera=camera)
        self.mixture = self._through(draws, rng).widened(TUNING.flat_share, TUNING.flat_factor)
        return SurrogateDraws(surrogate, draws)

    def _adapted(self, draws: Sample, rng: np.random.Generator) -> Mixture:
        """A mixture through weighted draws of u and camera, wide enough to find what they miss."""
        shelf = shelves(self.target, few_draws(draws, rng), self.u.shape[1])
        mixture = adapted(draws, rng)
        return mixture.mixed_with(shelf, TUNING.shelf_share) if shelf else mixture

    def _wide(self) -> Mixture:
        """The mixture with the modes beside it, widened."""
        return self.mixture.mixed_with(self.start, TUNING.modes_share).widened()

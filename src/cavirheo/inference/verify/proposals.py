"""Where to draw: modes, what a surrogate makes of simulations about them, and further modes that turn up on the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, modes, ridge, same
from cavirheo.inference.verify.sampler import Mixture, Proposal, Sample, effective_size, tempered
from cavirheo.inference.verify.surrogate import Surrogate
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.physics.accuracy import DEFAULT, ROUGH, Accuracy


class SurrogateProposal:
    """Draws from a surrogate, by rejection from a mixture, and from the mixture itself.

    The surrogate over the mixture is cut at a multiple of its mean, which a `pool` (k, d) of the mixture's draws gives.
    """

    def __init__(self, surrogate: Surrogate, mixture: Mixture, pool: Floats, log_surrogate: Floats) -> None:
        self.surrogate, self.mixture = surrogate, mixture
        self.pool, self.log_surrogate, self.log_mixture = pool, log_surrogate, mixture.log_density(pool)
        self.log_weight = log_surrogate - self.log_mixture
        self.log_cut = np.log(TUNING.surrogate_cut) + log_mean(self.log_weight)
        kept = np.minimum(self.log_weight - self.log_cut, 0.0)
        self.log_norm = log_mean(kept)
        # of the part by rejection, which is nearly all of the density where the surrogate is
        self.log_norm_error = float(np.sqrt(max(1.0 / effective_size(kept) - 1.0 / len(kept), 0.0)))

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d)"""
        wanted = count - int(np.ceil(TUNING.mixture_share * count))
        kept = np.empty((0, self.pool.shape[1]))
        while len(kept) < wanted:
            u = self.mixture.draw(TUNING.pool, rng)
            log_chance = self.surrogate(u) - self.mixture.log_density(u) - self.log_cut
            kept = np.concatenate([kept, u[np.log(rng.uniform(size=TUNING.pool)) < log_chance]])
        return np.concatenate([kept[:wanted], self.mixture.draw(count - wanted, rng)])

    def log_density(self, u: Floats) -> Floats:
        """(k,) at u (k, d)."""
        log_mixture = self.mixture.log_density(u)
        log_kept = np.minimum(self.surrogate(u) - self.log_cut, log_mixture) - self.log_norm
        return np.logaddexp(np.log(1.0 - TUNING.mixture_share) + log_kept, np.log(TUNING.mixture_share) + log_mixture)

    def normed(self, count: int, rng: np.random.Generator) -> SurrogateProposal:
        """The same, its norm from `count` more of the mixture's draws."""
        u = self.mixture.draw(count, rng)
        both = np.concatenate([self.pool, u]), np.concatenate([self.log_surrogate, self.surrogate(u)])
        return SurrogateProposal(self.surrogate, self.mixture, *both)

    def training_points(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d) from a flatter surrogate: where it can be wrong."""
        log_weight = TUNING.flatter * self.log_surrogate - self.log_mixture
        weight, free = np.exp(log_weight - log_sum(log_weight)), int(TUNING.taught_share * count)
        chosen = rng.choice(len(weight), free, p=weight, replace=bool(np.count_nonzero(weight) < free))
        return np.concatenate([self.pool[chosen], self.mixture.draw(count - free, rng)])


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


def log_mean(log_value: Floats) -> float:
    """log of the mean of exp(log_value)."""
    return float(log_sum(log_value) - np.log(len(log_value)))


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
        for mode in modes:
            self._settle(mode)  # best first
        self.mixture = self.start

    def _settle(self, mode: Mode) -> None:
        """A mode and the ridge through it become places to draw about, each known a standard deviation around."""
        heights = np.array([place.log_evidence for place in (mode, *self.places)])
        worth = self.follow and heights[0] >= np.max(heights) - TUNING.ridge_worth
        for place in (mode, *(ridge(self.target, mode) if worth else [])):
            if not any(same(place, other) for other in self.places):
                self.places.append(place)
                axes = np.linalg.cholesky(place.covariance).T
                if self.follow:
                    self(place.u + np.concatenate([axes, -axes]), ROUGH)
        heights = np.array([place.log_evidence for place in self.places])
        means, covariances = [place.u for place in self.places], [place.covariance for place in self.places]
        self.start = Mixture.about(means, covariances, heights - np.max(heights))

    def __call__(self, u: Floats, accuracy: Accuracy = DEFAULT) -> Floats:
        """(k,) log posterior of u (k, d), which the next proposal knows; -inf where the simulation failed."""
        found = Simulated.at(self.target, u, accuracy)
        self.learn(*found)
        return found.value

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
            found = modes(self.target, [self.u[np.argmax(self.value)], *(mode.u for mode in self.modes)])
            self.modes = found or self.modes
            for mode in self.modes:
                self._settle(mode)
            self.mixture = self.start

    @property
    def highest(self) -> Floats:
        """(d,) u of the largest log posterior that was met, at a mode or a simulation."""
        mode = max(self.modes, key=lambda mode: mode.log_posterior)
        met = np.max(self.value, initial=-np.inf) > mode.log_posterior
        return np.asarray(self.u[np.argmax(self.value)] if met else mode.u)

    def residuals_of(self, u: Floats) -> Floats:
        """(k, size) of what was simulated at u (k, d); NaN where nothing was, or it failed."""
        known = {row.tobytes(): i for i, row in enumerate(self.u)}
        found = np.full((len(u), self.residual.shape[1]), np.nan)
        for k, row in enumerate(np.ascontiguousarray(u)):
            if (i := known.get(row.tobytes())) is not None:
                found[k] = self.residual[i]
        return found

    def also(self, modes: Sequence[Mode]) -> None:
        """Take up further modes that are not known yet."""
        for mode in modes:
            if not any(same(mode, other) for other in self.modes):
                self.modes.append(mode)
                self._settle(mode)

    def propose(self, rng: np.random.Generator, counted: Sample | None) -> Proposal:
        """The next proposal; before the first, rounds of rough simulations where the posterior and its tails seem to
        be, and one more for each other mode found there."""
        rounds = 0
        if counted is None:
            self.surrogate, self.wrong_surrogates = None, 0
        self._check_surrogate()
        if counted and self.surrogates_fail:
            return self.settled(counted, rng)
        if counted and len(counted.u) > TUNING.lost_after and counted.ess < TUNING.lost * len(counted.u):
            self.thorough()
        while counted is None and rounds < self.rounds + self.climbed:
            known = self._learnt(rng, None)
            draw = known.training_points if isinstance(known, SurrogateProposal) else known.draw
            self(draw(TUNING.learnt_per_round, rng), ROUGH)
            self._other_mode()
            rounds += 1
        self._other_mode()
        proposal = self._learnt(rng, counted)
        if not isinstance(proposal, SurrogateProposal):
            return proposal
        self.surrogate, self.known = proposal.surrogate, len(self.u)
        while (met := effective_size(proposal.log_weight)) < TUNING.norm_enough:
            if len(proposal.pool) >= TUNING.norm_draws:
                break
            proposal = proposal.normed(TUNING.pool, rng)
        return proposal if met > TUNING.norm_met else proposal.mixture

    @property
    def surrogates_fail(self) -> bool:
        """Whether too many surrogates were wrong: the camera may have two solutions for one simulation, and the frames
        then jump from one to the other."""
        return self.wrong_surrogates > TUNING.wrong_surrogates

    def _check_surrogate(self) -> None:
        """Count the last surrogate if it was wrong about draws that were made by it."""
        if self.surrogate is not None:
            u, value = self.u[self.known :], self.value[self.known :]
            good = value > np.max(self.value) - TUNING.flat_height
            off = self.surrogate(u[good]) - value[good]
            if len(off) >= TUNING.wrong_fewest:
                scatter = 1.4826 * float(np.median(np.abs(off - np.median(off))))
                self.wrong_surrogates += scatter > TUNING.wrong_scatter
            self.surrogate = None

    def settled(self, counted: Sample, rng: np.random.Generator) -> Proposal:
        """What has been learnt from weighted draws, as a proposal for others: draws that a proposal was fitted to
        exaggerate their own weight."""
        mixture = self._adapted(counted, rng)
        return mixture if self.network is None else GuardedProposal(mixture, self.network, TUNING.guard_share)

    def _adapted(self, counted: Sample, rng: np.random.Generator) -> Mixture:
        """A mixture that follows the weighted draws themselves, with as many components as they are worth."""
        d = counted.u.shape[1]
        log_weight = tempered(counted.log_weight, min(TUNING.adapted * d, 0.25 * len(counted.u)))
        count = int(np.clip(effective_size(log_weight) / (2.0 * d), 1, TUNING.adapted_components))
        mixture = Mixture.through(counted.u, log_weight, count, rng)
        return mixture.beside(self.start, TUNING.adapted_modes).widened()

    def _other_mode(self) -> None:
        """Climb from the best simulation if it lies above all modes, which must then be beside the highest."""
        highest = max(mode.log_posterior for mode in self.modes)
        if self.climbed == TUNING.modes_climbed or np.max(self.value, initial=-np.inf) < highest + TUNING.other_mode:
            return
        self.climbed += 1
        mode = climb(self.target, self.u[np.argmax(self.value)], ROUGH)
        if mode is not None and not any(same(mode, other) for other in self.modes):
            self.modes.append(mode)
            self._settle(mode)

    def _learnt(self, rng: np.random.Generator, counted: Sample | None) -> SurrogateProposal | Mixture:
        """A proposal from all simulations so far; where they are too few, the modes."""
        mixture = self._wide()
        if len(self.u) <= 2 * (self.u.shape[1] + 1):
            return mixture
        surrogate = Surrogate(self.target, self.u, self.residual, self.value)
        if counted and np.any(np.isfinite(counted.log_weight)):
            mixture = self._wide(counted.u, counted.log_weight)
        for _ in range(TUNING.mixture_fits):
            pool = mixture.draw(TUNING.pool, rng)
            log_surrogate = surrogate(pool)
            if not np.any(np.isfinite(log_surrogate)):
                return mixture
            blend = SurrogateProposal(surrogate, mixture, pool, log_surrogate)
            if effective_size(blend.log_weight) > TUNING.fit_well * TUNING.pool:
                break
            mixture = self._wide(pool, TUNING.flatter * log_surrogate - blend.log_mixture)
        return blend

    def _wide(self, *weighted: Floats) -> Mixture:
        """The mixture, fitted to draws and their log weights if these are given, with the modes beside it, widened."""
        self.mixture = self.mixture.fitted(*weighted) if weighted else self.mixture
        return self.mixture.beside(self.start, TUNING.modes_share).widened()

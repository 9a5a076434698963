"""Level "auto": weighted draws from a few hundred simulations where a network's draws show the way.

The network's own draws are simulated first. They lead to the maximum and to what is around it, and their weights give
an evidence by themselves. A surrogate (surrogate.py) of these simulations is drawn from, and some of its draws are
simulated by the default solver: rounds of these teach it and check it, until it is as good as the simulations. Its own
draws are then the answer. They are trusted if the network's own evidence is not larger than theirs: a surrogate does
not show what no simulation met. (That it is smaller only says that the network misses what they have.) Where no
surrogate is good enough, draws of it, or of mixtures, are simulated, and their weights count.

Most of these are rough simulations plus what they miss of the default ones at likely places, for that hardly changes
across a posterior: the log weights are off by some hundredths, in half the time. Of draws that are simulated, default
simulations of some tell by how much; if it is too much, all that have a weight are simulated anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats, log_sum, unscaled
from cavirheo.errors import SolverError
from cavirheo.inference.budget import Budget
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, modes, secant
from cavirheo.inference.verify.proposals import AdaptiveProposal, SurrogateDraws
from cavirheo.inference.verify.sampler import Proposal, Sample, effective_size, tempered
from cavirheo.inference.verify.surrogate import Surrogate
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.physics.accuracy import BRISK, DEFAULT, Accuracy
from cavirheo.posterior import OtherAnswer


class WeightedDraws(NamedTuple):
    """sample: the weighted draws. residual: (k, size) their extended residuals, of simulations or of a surrogate. best:
    the maximum beside the highest simulation; None if the default one fails there. modes: all maxima. few: whether few
    simulations were enough. evidence_gap: how many standard errors the network's own evidence is above that of the
    others; None if its draws are worth too little. rough: standard deviation of the error of the log weights by rough
    simulations or by a surrogate."""

    sample: Sample
    residual: Floats
    best: Mode | None
    modes: list[Mode]
    few: bool
    evidence_gap: float | None
    rough: float


class TwoFidelityTarget(Target):
    """A target of rough simulations and what they miss of the default ones; accuracies are not told apart."""

    def __init__(self, target: Target) -> None:
        super().__init__(target.experiment, target.whole, target.noise.frames, target.workers)
        self.camera, self.noise = target.camera, target.noise
        self.exact, self.missed, self.rough = target, np.zeros(target.noise.size), True
        self.learnt = np.empty((0, len(target.prior.names)))  # u of what taught it

    def residuals(self, u: Floats, accuracy: Accuracy = BRISK) -> Floats:
        """(k, n) measured minus simulated, over R_max, at u (k, d); NaN where the simulation failed."""
        return self.exact.residuals(u, BRISK) + self.missed if self.rough else self.exact.residuals(u, DEFAULT)

    def correct(self, at: Simulated) -> None:
        """Learn what rough simulations miss, the mean of it at likely places; where it changes too much, no more of
        them."""
        fine, self.learnt = self.exact.residuals(at.u, DEFAULT), at.u
        good = np.all(np.isfinite(fine - at.residual), axis=1)
        self.rough = bool(np.count_nonzero(good) > TUNING.mended / 2)
        if not self.rough:
            return
        u, fine, rough, value = at.u[good], fine[good], at.residual[good], at.value[good]
        trust = np.exp((value - np.max(value)) / TUNING.nugget_height)
        self.missed = np.average(fine - rough, axis=0, weights=trust)
        wrong = self.log_posterior(u, fine) - self.log_posterior(u, rough + self.missed)
        self.rough = bool(np.cov(wrong, aweights=trust) < TUNING.mended_begun**2)

    def corrected(self, u: Floats, residual: Floats) -> Simulated:
        """What was known at u (k, d), with rough residuals (k, n), before something was learnt: with it, or by default
        simulations where rough ones are refused."""
        if not self.rough:
            return Simulated.at(self, u)
        residual = residual + self.missed
        return Simulated(u, residual, self.log_posterior(u, residual))

    def corrected_modes(self, modes: list[Mode]) -> list[Mode]:
        """Modes that were found before something was learnt, with it."""
        now = self.corrected(*(np.array([getattr(mode, name) for mode in modes]) for name in ("u", "residual")))
        return [
            replace(mode, residual=residual, log_posterior=float(value))
            for mode, residual, value in zip(modes, now.residual, now.value, strict=True)
        ]

    def checked(self, draws: Sample, seed: int) -> tuple[Sample, float]:
        """The draws with log targets that default simulations of some agree with, none of which taught the correction,
        and the standard deviation of what these found wrong; all that have a weight are simulated anew if that is too
        much, all if one of them fails."""
        if not self.rough or not np.any(np.isfinite(draws.log_weight)):
            return draws, 0.0
        weight = unscaled(draws.log_weight)
        new = ~np.any(np.all(draws.u[:, None] == self.learnt, axis=2), axis=1)
        chance = np.where(new, weight, 0.0)
        count = min(TUNING.mended_checked, int(np.count_nonzero(chance)))
        rng = np.random.Generator(np.random.Philox(seed))
        wrong, error = np.array([]), np.inf
        if count > 1:
            some = rng.choice(len(weight), count, replace=False, p=chance / np.sum(chance))
            wrong = self._exact_value(draws, some) - draws.log_target[some]
            error = float(np.sqrt(np.mean(wrong**2))) if np.all(np.isfinite(wrong)) else np.inf
        if error <= TUNING.mended_enough:
            common = float(np.hypot(draws.common, error / np.sqrt(count)))
            return replace(draws, log_target=draws.log_target + np.mean(wrong), common=common), error
        heaviest = np.argsort(-weight)
        counted = 1 + np.searchsorted(np.cumsum(weight[heaviest]), TUNING.mended_heavy * np.sum(weight))
        inexact, value = heaviest[:counted] if np.isfinite(error) else heaviest, draws.log_target.copy()
        value[inexact] = self._exact_value(draws, inexact)
        return replace(draws, log_target=value), error

    def _exact_value(self, draws: Sample, which: NDArray[np.int64]) -> Floats:
        """Log target of some of the draws by default simulations."""
        u, camera = draws.u[which], None if draws.camera is None else draws.camera[which]
        simulated = Simulated.at(self.exact, u)
        return (
            self.exact.integrated(simulated).value if camera is None else self.exact.log_joint(*simulated[:2], camera)
        )

    def highest(self, start: Floats, surrogate: Surrogate | None) -> Mode | None:
        """The maximum reached from u (d,), by a surrogate if there is one, with the default simulation there; None if
        one of them failed."""
        mode = climb(Emulated(self, surrogate) if surrogate else self, start, BRISK)
        if mode is None:
            return None
        residual = self.exact.residuals(np.array([mode.u, start]), DEFAULT)
        value, least = self.log_posterior(np.array([mode.u, start]), residual)
        if surrogate and not value >= least:  # it is wrong there
            return self.highest(start, None)
        return replace(mode, residual=residual[0], log_posterior=float(value)) if np.isfinite(value) else None


class Emulated(Target):
    """A target that a surrogate simulates."""

    def __init__(self, target: Target, surrogate: Surrogate) -> None:
        super().__init__(target.experiment, target.whole, target.noise.frames, target.workers)
        self.camera, self.noise, self.surrogate = target.camera, target.noise, surrogate

    def residuals(self, u: Floats, accuracy: Accuracy = BRISK) -> Floats:
        """(k, size) at u (k, d)."""
        shapes = self.surrogate.shapes(u)
        return np.hstack([self.camera.of_shapes(shapes, self.noise.frames), shapes])


def tolerance(share: float) -> float:
    """Standard deviation of what may be wrong in the log weights of a model with this share in the answer."""
    return min(TUNING.emulated_enough / share, TUNING.emulated_worst)


def sizes(share: float) -> dict[str, int]:
    """Of the rounds of draws that are the answer of a model with this share."""
    each = max(round(TUNING.emulated_each * share), TUNING.emulated_taught)
    return {"each": each, "fewest": TUNING.emulated_fewest, "most": TUNING.emulated_most}


class Preview(NamedTuple):
    """What a model answers. answer: to be set beside another's; the error of its evidence is LAPLACE where it is not to
    be relied on. x: (k, all) draws. log_weight: (k,) of them, whose mean is the evidence."""

    answer: OtherAnswer
    x: Floats
    log_weight: Floats


class AdaptiveSampling:
    """The posterior of one model from few simulations: its modes first, then draws of what the simulations teach.

    network: own_draws of it show the way. starts: where to climb from without one; scanned: the same from all over the
    ranges; windowed: where a search over windows that grow ends, for modes that leave more than noise. Raises
    SolverError: no start could be simulated.
    """

    def __init__(
        self, target: Target, network: Proposal | None, starts: Callable[[], list[Floats]],
        scanned: Callable[[], list[Floats]], windowed: Callable[[], list[Floats]] = list, *, seed: int,
        own_draws: int = TUNING.own_draws,
    ) -> None:  # fmt: skip
        self.target, self.network, self.scanned, self.windowed, self.seed = target, network, scanned, windowed, seed
        two_fidelity = TwoFidelityTarget(target)
        simulated, maxima = None, list[Mode]()
        if network:
            u, simulated, mode = _start_by_network(two_fidelity, network, own_draws, seed)
            if mode:
                maxima = [mode, *modes(two_fidelity, _unexpected(mode, simulated))]
        searched = not maxima
        if searched:
            maxima = modes(two_fidelity, starts(), scanned())
        if not maxima:
            raise SolverError(f"no start of {target.experiment.family.name} could be simulated")
        reshaped = target.follow(maxima[0])
        self.two_fidelity = two_fidelity = TwoFidelityTarget(target)
        if reshaped:
            residuals = two_fidelity.residuals(np.array([mode.u for mode in maxima]))
            maxima = [replace(mode, residual=row) for mode, row in zip(maxima, residuals, strict=True)]
            simulated = Simulated.at(two_fidelity, simulated.u) if simulated else None
        two_fidelity.correct(_likely_simulations(two_fidelity, maxima[0], None if searched else simulated, seed))
        self.modes = two_fidelity.corrected_modes(maxima)
        self.explorer = AdaptiveProposal(
            two_fidelity, self.modes, TUNING.auto_learning, follow=searched, network=network
        )
        self.own: Sample | None = None
        self.sample: Sample | None = None
        self.evidence_gap: float | None = None
        self.emulated: SurrogateDraws | None = None
        self.error, self.turns = 0.0, 0  # turns: rounds of surrogates so far
        self.trusted = self.searched = self.ended = False
        if network and simulated:
            simulated = two_fidelity.integrated(two_fidelity.corrected(simulated.u, simulated.residual))
            self.explorer.learn(*simulated)
            self.own = Sample(u, simulated.value[: len(u)], network.log_density(u))

    @property
    def log_laplace(self) -> float:
        """Laplace's log evidence of the modes so far."""
        return float(log_sum(np.array([mode.log_evidence for mode in self.explorer.modes])))

    def emulate(self, enough: float, share: float = 1.0) -> bool:
        """Take draws, worth `enough` independent ones, of a surrogate of the simulations so far and of some of its own
        draws that check it, in a few rounds of these, until it is good enough for a model with this share in the
        answer. Whether there are any."""
        target, explorer = self.two_fidelity.exact, self.explorer
        emulation, self.emulated = None, None
        rng = np.random.Generator(np.random.Philox(self.seed).jumped(self.turns))
        error, last = self.error, min(self.turns + TUNING.emulated_turns, TUNING.emulated_rounds)
        while self.turns < last:
            emulation = explorer.emulated(rng)
            if emulation is None:
                return False
            often = TUNING.emulated_more if error > TUNING.emulated_wrong else 1
            draws, some = emulation.sample, emulation.chosen(often * TUNING.emulated_checked, rng)
            explorer(draws.u[emulation.chosen(TUNING.emulated_flatter, rng, TUNING.flatter)])
            assert draws.camera is not None
            checked, value = target.checks(draws.u[some], draws.camera[some])
            explorer.learn(*checked)
            explorer.climb_higher()
            efficiency = effective_size(value - draws.log_target[some]) / len(some)
            error = float(np.sqrt(max(-np.log(efficiency), 0.0))) if efficiency else np.inf
            self.turns += 1
            if error <= tolerance(share) * (1.0 + (self.turns - 1) / TUNING.emulated_patience):
                break
        self.error = error
        return self._draw(enough, share)

    def _draw(self, enough: float, share: float) -> bool:
        """Take draws of the surrogate of all simulations so far. Whether there are any."""
        rng = np.random.Generator(np.random.Philox(self.seed).jumped(TUNING.emulated_rounds + 1))
        emulation = self.explorer.emulated(rng, TUNING.emulated_worth * enough, **sizes(share))
        if emulation is None:
            return False
        self.emulated = emulation
        unsure = TUNING.emulated_unsure + 0.5 * self.error**2  # what no draw met is missing, too
        self.sample = replace(emulation.sample, common=unsure)
        self.trusted = self._agrees(self.sample)
        return True

    def _weigh_draws(self, enough: float, share: float) -> bool:
        """Take draws of a surrogate that is wrong in places, each simulated and weighed. Whether they are worth
        enough."""
        rng = np.random.Generator(np.random.Philox(self.seed).jumped(TUNING.emulated_rounds))
        emulation = self.explorer.emulated(rng, TUNING.emulated_weighed * share / TUNING.emulated_draws, **sizes(share))
        if emulation is None:
            return False
        order, needed = rng.permutation(len(emulation.sample.u)), min(enough, TUNING.effective_fewest)
        assert emulation.sample.camera is not None
        u, log_q, camera = (
            values[order] for values in (emulation.sample.u, emulation.sample.log_q, emulation.sample.camera)
        )
        value = np.empty(0)
        while len(value) < len(u):
            some = slice(len(value), len(value) + TUNING.draws_per_round)
            self.explorer(u[some])
            residual = self.explorer.residuals_of(u[some])
            value = np.append(value, self.two_fidelity.log_joint(u[some], residual, camera[some]))
            draws = Sample(u[: len(value)], value, log_q[: len(value)], camera=camera[: len(value)])
            if draws.ess >= needed and draws.reliable:
                self.sample, self.trusted, self.emulated, self.error = draws, self._agrees(draws), None, 0.0
                return True
            if draws.ess / len(value) * len(u) < 0.5 * needed:
                break
        return False

    def search_windows(self) -> None:
        """Look for further modes by windows that grow, where the best one leaves more than noise."""
        frames = self.target.noise.split(max(self.modes, key=lambda mode: mode.log_posterior).residual)[0]
        if not self.searched and self.target.experiment.misfit(frames) > TUNING.searched_above:
            self.explorer.also(modes(self.two_fidelity, self.windowed(), maxima=self.explorer.modes))
        self.searched = True

    def short(self, share: float) -> bool:
        """Whether its draws are fewer, or wrong by more, than a model with this share in the answer needs."""
        if self.sample is None:
            return True
        rough = self.error > 2.0 * tolerance(share)
        return not self.ended and (rough or self.sample.ess < TUNING.effective_fewest * share)

    def weigh(self, share: float, budget: Budget) -> None:
        """Take draws that are worth what a model with this share in the answer needs, or that tell this share better:
        of a surrogate; where it has not become good enough, of it and simulated; where these are worth too little or
        not to be trusted, more simulations, of ridges where the share is large, else of a mixture."""
        thorough = share > TUNING.part_thorough
        if thorough:
            self.search_windows()
        enough = max(TUNING.auto_enough * share, TUNING.part_enough)
        needed = max(enough, TUNING.effective_fewest)
        taken = self.turns < TUNING.emulated_rounds and self.emulate(needed, share)
        taken = taken or self._weigh_draws(needed, share)
        if not taken and self.emulated and self.error <= TUNING.emulated_worst:
            taken = self.ended = True
        if taken and (self.trusted or not thorough):
            return
        if thorough:
            self.thorough(budget)
        else:
            most = min(max(round(TUNING.auto_draws * share), TUNING.part_draws), budget.draws)
            self._simulate(enough, most, budget)

    def _simulate(self, enough: float, most: int, budget: Budget) -> None:
        """Take draws that are simulated, until all are worth `enough` independent ones, or it is plain that they will
        not be."""
        how: dict[str, Any] = {"each": budget.each, "fewest": 1, "least": enough, "patience": budget.patience}
        self.sample = self.explorer.sample(self.seed + 2, most=most, enough=enough, **how)
        self.trusted, self.emulated, self.error = self.sample.ess >= enough and self.sample.reliable, None, 0.0

    def _agrees(self, draws: Sample) -> bool:
        """Whether the network's own evidence is not larger than that of the draws."""
        guard, self.evidence_gap = self._guard, None
        if guard and guard[1].ess >= TUNING.own_worth:
            self.evidence_gap = _standard_errors(guard[1], draws)
        return self.evidence_gap is None or self.evidence_gap <= TUNING.agree

    def thorough(self, budget: Budget) -> None:
        """Take draws of a surrogate, or as level "full" has them but of rough simulations, where few cannot be trusted:
        ridges are followed, and modes are looked for all over the ranges."""
        explorer, self.ended = self.explorer, True
        explorer.thorough(budget.learning)
        explorer.also(modes(self.two_fidelity, [], self.scanned()))
        enough = max(min(budget.enough, budget.draws / 4), TUNING.effective_fewest)
        self.turns = TUNING.emulated_rounds - TUNING.emulated_turns
        good = self.emulate(enough) and self.error <= 2.0 * TUNING.emulated_enough
        if not (good and self.trusted) and not self._weigh_draws(enough, 1.0):
            self.emulated, self.error = None, 0.0
            how = {"each": budget.each, "fewest": budget.fewest, "least": budget.least, "enough": enough}
            self.sample = explorer.sample(self.seed + 1, self._guard, most=budget.draws, **how)

    @cached_property
    def weighted(self) -> WeightedDraws:
        """The draws, compared with default simulations. For the last call."""
        assert self.sample is not None
        explorer, emulation = self.explorer, self.emulated
        draws, error = (self.sample, self.error) if emulation else self.two_fidelity.checked(self.sample, self.seed)
        residual = explorer.residuals_of(draws.u)
        if draws.camera is not None:
            shapes = emulation.surrogate.shapes(draws.u) if emulation else self.target.noise.shapes(residual)
            residual = self.target.extended(shapes, draws.camera)
        best = self.two_fidelity.highest(explorer.highest, emulation.surrogate if emulation else None)
        return WeightedDraws(draws, residual, best, explorer.modes, self.trusted, self.evidence_gap, error)

    @property
    def _guard(self) -> tuple[Proposal, Sample] | None:
        return (self.network, self.own) if self.network and self.own is not None else None


def _start_by_network(
    target: TwoFidelityTarget, network: Proposal, count: int, seed: int
) -> tuple[Floats, Simulated, Mode | None]:
    """(u of so many of the network's own draws, their simulations and those on the way to the maximum, that maximum);
    None for it where hardly any could be simulated."""
    u = network.draw(count, np.random.Generator(np.random.Philox(seed).jumped()))
    simulated = Simulated.at(target, u)
    if np.count_nonzero(np.isfinite(simulated.value)) <= 2 * (simulated.u.shape[1] + 1):
        return u, simulated, None
    mode, simulated = secant(target, simulated)
    return u, simulated, mode


def _likely_simulations(target: TwoFidelityTarget, mode: Mode, simulated: Simulated | None, seed: int) -> Simulated:
    """Rough simulations at a mode and where the posterior is: some of the known ones, for it may be curved and
    the Gaussian about its mode then leads far from it."""
    if simulated is None:
        return Simulated.at(target, np.concatenate([mode.u[None], mode.draws(TUNING.mended, seed)]))
    top = np.argmax(simulated.value)
    weight = np.exp(tempered(simulated.value - simulated.value[top], TUNING.mended_spread))
    weight[top] = 0.0
    rng, most = np.random.Generator(np.random.Philox(seed)), min(TUNING.mended, int(np.count_nonzero(weight)))
    chosen = np.append(top, rng.choice(len(weight), most, replace=False, p=weight / np.sum(weight)))
    return Simulated(simulated.u[chosen], simulated.residual[chosen], simulated.value[chosen])


def _unexpected(mode: Mode, simulated: Simulated) -> list[Floats]:
    """The likeliest simulation that the Gaussian about the mode does not expect there, if there is one: on the way to
    another mode."""
    expected = mode.log_posterior - 0.5 * mode.squares(simulated.u)
    unexpected = simulated.value - expected > TUNING.own_unexpected
    likely = np.where(
        unexpected & (simulated.value > mode.log_posterior - TUNING.lowest_mode), simulated.value, -np.inf
    )
    best = int(np.argmax(likely))
    return [simulated.u[best]] if np.isfinite(likely[best]) else []


def _standard_errors(network_draws: Sample, draws: Sample) -> float:
    """By how much the network's evidence is larger than that of the others, which then miss a part of the posterior.
    A smaller one says that the network misses a part: they have it."""
    (a, of_a), (b, of_b) = network_draws.log_evidence, draws.log_evidence
    return (a - b) / float(np.hypot(max(of_a, TUNING.own_error), of_b))

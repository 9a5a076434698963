"""Weighted draws from a few hundred simulations: modes first, then a surrogate of what is simulated about them.

A network's own draws, where there are any, are simulated first. They lead to the maximum and to what is around it, and
their weights give an evidence by themselves. A surrogate (surrogate.py) of these simulations is drawn from, and some of
its draws are simulated by the default solver: rounds of these teach it and check it, until it is as good as the
simulations. Its own draws are then the answer of level "auto". They are trusted if the network's own evidence is not
larger than theirs: a surrogate does not show what no simulation met; else modes are looked for all over the ranges.
(That it is smaller only says that the network misses what they have.) Where no surrogate is good enough, and with level
"full", its draws are simulated by the default solver, and their weights count.

All other simulations are rough ones plus what they miss of the default ones at likely places, which hardly changes
across a posterior: the log weights are off by some hundredths, in half the time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.errors import SolverError
from cavirheo.inference.alternatives import LAPLACE
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, modes
from cavirheo.inference.verify.sampler import Proposal, Sample, effective_size, tempered
from cavirheo.inference.verify.surrogate import AdaptiveProposal, Emulated, Surrogate, climb_emulated
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.physics.accuracy import BRISK, DEFAULT, Accuracy
from cavirheo.posterior import Evidence


class TwoFidelityTarget(Target):
    """A target of rough simulations and what they miss of the default ones; accuracies are not told apart."""

    def __init__(self, target: Target) -> None:
        super().__init__(target.experiment, target.whole, target.noise.frames, target.workers)
        self.camera, self.noise = target.camera, target.noise
        self.exact, self.missed, self.rough = target, np.zeros(target.noise.size), True

    def residuals(self, u: Floats, accuracy: Accuracy = BRISK) -> Floats:
        """(k, n) measured minus simulated, over R_max, at u (k, d); NaN where the simulation failed."""
        return self.exact.residuals(u, BRISK) + self.missed if self.rough else self.exact.residuals(u, DEFAULT)

    def checks(self, u: Floats, z: Floats, *_: Any) -> tuple[Simulated, Floats]:
        """Those of the target, of corrected rough simulations."""
        return self.exact.checks(u, z, BRISK, self.missed) if self.rough else self.exact.checks(u, z)

    def correct(self, at: Simulated) -> None:
        """Learn what rough simulations miss, the mean of it at likely places; where it changes too much, no more of
        them."""
        fine = self.exact.residuals(at.u, DEFAULT)
        good = np.all(np.isfinite(fine - at.residual), axis=1)
        self.rough = bool(np.count_nonzero(good) > TUNING.corrected / 2)
        if not self.rough:
            return
        u, fine, rough, value = at.u[good], fine[good], at.residual[good], at.value[good]
        trust = np.exp(np.maximum((value - np.max(value)) / TUNING.nugget_height, -20.0))  # a scatter needs several
        self.missed = np.average(fine - rough, axis=0, weights=trust)
        wrong = self.log_posterior(u, fine) - self.log_posterior(u, rough + self.missed)
        self.rough = bool(np.cov(wrong, aweights=trust) < TUNING.corrected_scatter**2)

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


def tolerance(share: float) -> float:
    """Standard deviation of what may be wrong in the log weights of a model with this share in the answer."""
    return min(TUNING.emulated_enough / share, TUNING.emulated_worst)


class AdaptiveSampling:
    """The posterior of one model from few simulations: its modes first, then draws of what the simulations teach.

    network: own_draws of it show the way. starts: where to climb from without one; scanned: the same from all over the
    ranges; windowed: where a search over windows that grow ends, for modes that leave more than noise. exact: what
    counts in the answer is simulated, and these modes are looked for at once. Raises SolverError: no start could be
    simulated.
    """

    def __init__(
        self, target: Target, network: Proposal | None, starts: Callable[[], list[Floats]],
        scanned: Callable[[], list[Floats]], windowed: Callable[[], list[Floats]] = list, *, seed: int,
        own_draws: int = TUNING.own_draws, exact: bool = False,
    ) -> None:  # fmt: skip
        self.target, self.scanned, self.windowed, self.seed, self.exact = target, scanned, windowed, seed, exact
        self.two_fidelity = TwoFidelityTarget(target)
        simulated, maxima = None, list[Mode]()
        self.network: tuple[Floats, Floats] | None = None  # u (k, d) of its simulated draws, and their log density
        if network:
            u = network.draw(own_draws, self._rng(1))
            simulated = Simulated.at(self.two_fidelity, u)
            self.network = u, network.log_density(u)
            if len(simulated.finite.u) > 2 * (u.shape[1] + 1):
                maxima, simulated = self._climb_by_draws(simulated)
        self.ranged, self.windows_grown = not maxima, False
        if not maxima:
            maxima = modes(self.two_fidelity, starts(), scanned())
        if not maxima:
            raise SolverError(f"no start of {target.experiment.family.name} could be simulated")
        self.explorer = AdaptiveProposal(self.two_fidelity, maxima, simulated)
        self.refined = False
        self.own: Sample | None = None
        self.sample: Sample | None = None
        self.shapes = np.empty((0, 0))  # (k, numbers) of the draws
        self.surrogate: Surrogate | None = None  # whose draws they are, if they are not weighed
        self.error, self.turns = 0.0, 0  # turns: rounds of surrogates so far
        self.surrogate_evidence = -np.inf  # log evidence of surrogate's draws that too few simulated ones replaced
        self.ended = False

    def refine(self) -> None:
        """Give all that is known what rough simulations miss; a model that is far below the others does without."""
        if self.refined:
            return
        self.refined, maxima, simulated = True, self.explorer.modes, self.explorer.simulated
        if self._follow(maxima[0].u, maxima[0].residual):
            residuals = self.two_fidelity.residuals(np.array([mode.u for mode in maxima]))
            maxima = [replace(mode, residual=row) for mode, row in zip(maxima, residuals, strict=True)]
            simulated = Simulated.at(self.two_fidelity, simulated.u)
        target = self.two_fidelity
        target.correct(_likely_simulations(target, maxima[0], simulated, self.seed))
        simulated = target.integrated(target.corrected(simulated.u, simulated.residual))
        self.explorer = AdaptiveProposal(target, target.corrected_modes(maxima), simulated)
        if self.network and len(simulated.u):
            u, log_q = self.network
            alike = np.all(u[:, None] == simulated.u, axis=2)
            value = np.where(np.any(alike, axis=1), simulated.value[np.argmax(alike, axis=1)], -np.inf)
            self.own = Sample(u, value, log_q)

    def _follow(self, u: Floats, residual: Floats) -> bool:
        """As that of the target, for rough simulations, too."""
        reshaped = self.target.follow(u, residual)
        self.two_fidelity = TwoFidelityTarget(self.target)
        return reshaped

    def _climb_by_draws(self, simulated: Simulated) -> tuple[list[Mode], Simulated]:
        """The maximum, from the likeliest of a network's draws, and another one where one of them is likelier than the
        first lets expect; best first, with all that was simulated."""
        top = int(np.argmax(simulated.value))
        if self._follow(simulated.u[top], simulated.residual[top]):
            simulated = Simulated.at(self.two_fidelity, simulated.u)
        mode, on_the_way = climb_emulated(self.two_fidelity, simulated, simulated.u[top])
        maxima, simulated = [mode] if mode else [], simulated.joined(on_the_way)
        for start in _unexpected(mode, simulated) if mode else []:
            mode, on_the_way = climb_emulated(self.two_fidelity, simulated, start, maxima)
            maxima, simulated = [*maxima, *([mode] if mode else [])], simulated.joined(on_the_way)
        return sorted(maxima, key=lambda mode: -mode.log_posterior), simulated

    @property
    def log_laplace(self) -> float:
        """Laplace's log evidence of the modes so far."""
        return float(log_sum(np.array([mode.log_evidence for mode in self.explorer.modes])))

    def _rng(self, jumps: int) -> np.random.Generator:
        return np.random.Generator(np.random.Philox(self.seed).jumped(jumps))

    def emulate(self, enough: float, share: float) -> bool:
        """Take draws, worth `enough` independent ones, of a surrogate of the simulations so far and of some of its own
        draws that check it, in a few rounds of these, until it is good enough for a model with this share in the
        answer, and what it learnt last has not moved it. Whether there are any."""
        explorer, rng = self.explorer, self._rng(self.turns)
        last = min(self.turns + TUNING.emulated_turns, TUNING.emulated_rounds)
        while self.turns < last:
            emulation = explorer.emulated(rng, settling=TUNING.settling_teaching)
            if emulation is None:
                return False
            often = TUNING.emulated_more if self.error > TUNING.emulated_wrong else 1
            _, draws = emulation
            some = draws.chosen_indices(often * TUNING.emulated_checked, rng)
            explorer(draws.u[draws.chosen_indices(TUNING.emulated_flatter, rng, TUNING.flatter)])
            assert draws.camera is not None
            checked, value = self.two_fidelity.checks(draws.u[some], draws.camera[some])
            explorer.learn(checked)
            explorer.climb_higher()
            wrong = value - draws.log_target[some]
            efficiency = effective_size(wrong) / len(some)
            self.error = float(np.sqrt(max(-np.log(efficiency), 0.0))) if efficiency else np.inf
            self.turns += 1
            patience = 1.0 + (self.turns - 1) / TUNING.emulated_patience
            if self.error > tolerance(share) * patience and self.turns < last:
                continue
            emulation = explorer.emulated(self._rng(self.turns), TUNING.emulated_worth * enough)
            if emulation is None:
                return False
            surrogate, sample = emulation
            expected = draws.log_evidence[0] + float(log_sum(wrong)) - np.log(len(some))
            moved = abs(sample.log_evidence[0] - expected)
            settled = moved < TUNING.emulated_moved / share
            self.error = self.error if settled else max(self.error, moved)
            unsure = TUNING.emulated_unsure + 0.5 * self.error**2  # what no draw met is missing, too
            self.surrogate, self.sample = surrogate, replace(sample, common=float(np.hypot(unsure, sample.common)))
            self.shapes = surrogate.shapes(sample.u)
            if settled:
                break
        return self.sample is not None

    def weigh_draws(self, enough: float, share: float) -> bool:
        """Take draws of a surrogate that are simulated and weighed, until they are worth `enough`; where they will not
        be, they teach the next one. Whether they are worth an interval; if not, they replace a surrogate that is too
        wrong alone."""
        left, needed = round(TUNING.draws * share), min(enough, TUNING.effective_fewest)
        rng, taken = self._rng(TUNING.emulated_rounds + 2), False
        for _ in range(TUNING.weighed_rounds):
            emulation = self.explorer.emulated(rng, left / TUNING.emulated_draws)
            if emulation is None:
                break
            (_, every), shapes = emulation, list[Floats]()
            assert every.camera is not None
            order = rng.permutation(len(every.u))[:left]
            u, log_q, camera, value = every.u[order], every.log_q[order], every.camera[order], np.empty(0)
            for some in np.array_split(np.arange(len(u)), max(len(u) // TUNING.draws_per_round, 1)):
                simulated, log_target = self.target.checks(u[some], camera[some])
                self.explorer.learn(simulated)
                shapes.append(self.target.noise.shapes(simulated.residual))
                value, count = np.append(value, log_target), some[-1] + 1
                draws = Sample(u[:count], value, log_q[:count], camera=camera[:count])
                done = draws.ess >= enough and draws.reliable
                if done or draws.ess / count * len(u) < 0.5 * needed:
                    break
            left -= count
            worth = draws.ess >= needed and draws.reliable
            if worth or not (taken or self.error <= TUNING.emulated_worst):
                if self.sample and not worth:
                    self.surrogate_evidence = max(self.surrogate_evidence, self.sample.log_evidence[0])
                self.sample, self.shapes, self.surrogate, taken = draws, np.concatenate(shapes), None, worth
                self.surrogate_evidence = -np.inf if worth else self.surrogate_evidence
            if done or left <= 0:
                break
        if self.surrogate is None:
            self.error = 0.0
        return taken

    @property
    def misfit(self) -> float:
        """What the best mode leaves beyond the noise, over R_max, RMS."""
        best = max(self.modes, key=lambda mode: mode.log_posterior)
        return self.target.experiment.misfit(self.target.noise.split(best.residual)[0])

    def search_windows(self) -> None:
        """Look for further modes by windows that grow, where the best one leaves more than noise."""
        if not self.windows_grown and self.misfit > TUNING.searched_above:
            self.explorer.also(modes(self.two_fidelity, self.windowed(), maxima=self.modes))
        self.windows_grown = True

    def search_ranges(self) -> None:
        """Look for further modes all over the ranges."""
        if not self.ranged:
            self.explorer.also(modes(self.two_fidelity, self.scanned(), maxima=self.modes))
        self.ranged = True

    @property
    def modes(self) -> list[Mode]:
        """Those so far."""
        return self.explorer.modes

    def short(self, share: float) -> bool:
        """Whether its draws are fewer, or wrong by more, than a model with this share in the answer needs."""
        if self.sample is None:
            return not self.ended
        rough = self.error > 2.0 * tolerance(share) or (self._to_weigh(share) and self.surrogate is not None)
        return not self.ended and (rough or self.sample.ess < TUNING.effective_fewest * share)

    def _to_weigh(self, share: float) -> bool:
        return self.exact and share > TUNING.part_thorough

    def weigh(self, share: float) -> None:
        """Take draws that are worth what a model with this share in the answer needs, or that tell this share better:
        of a surrogate; where it has not become good enough, or all are to be simulated, of it and simulated."""
        self.refine()
        thorough, enough = share > TUNING.part_thorough, max(TUNING.auto_enough * share, TUNING.effective_fewest)
        if thorough:
            self.search_windows()
        if self._to_weigh(share):
            self.search_ranges()
        learning = self.turns < TUNING.emulated_rounds
        if learning:
            emulated = self.emulate(enough, share)
            if thorough and not self._trusted and not self.ranged:
                self.search_ranges()
                emulated = self.emulate(enough, share)
            unfinished = self.turns < TUNING.emulated_rounds and self.error > 2.0 * tolerance(share)
            if not emulated or unfinished or not self._to_weigh(share):
                self.ended = not emulated
                return
        enough = TUNING.effective_enough if self.exact else TUNING.effective_fewest
        self.ended = not self.weigh_draws(enough * share, share)

    @property
    def evidence(self) -> Evidence:
        """Of the draws, or Laplace's without any. Too few simulated draws miss a part of it: then it is not less than
        that of the surrogate's draws that they replaced."""
        if self.sample is None:
            return Evidence(self.log_laplace, LAPLACE)
        log, error = self.sample.log_evidence
        return Evidence(max(log, self.surrogate_evidence), max(error, self.surrogate_evidence - log))

    @property
    def evidence_gap(self) -> float | None:
        """How many standard errors the network's own evidence is above that of the draws, which then miss a part of the
        posterior; below it the network misses one that they have. None where it says little."""
        if self.own is None or self.sample is None or self.own.ess < TUNING.own_worth:
            return None
        (of_network, network_error), (log, error) = self.own.log_evidence, self.sample.log_evidence
        return (of_network - log) / float(np.hypot(max(network_error, TUNING.own_error), error))

    @property
    def _trusted(self) -> bool:
        """Whether the network's own evidence is not larger than that of the draws."""
        gap = self.evidence_gap
        return gap is None or gap <= TUNING.agree

    @cached_property
    def residual(self) -> Floats:
        """(k, size) extended residuals of the draws, of simulations or of a surrogate. For the last call."""
        assert self.sample is not None
        assert self.sample.camera is not None
        return self.target.extended(self.shapes, self.sample.camera)

    @cached_property
    def best(self) -> Mode | None:
        """The maximum beside the highest simulation; None if the default one fails there. For the last call."""
        return self.two_fidelity.highest(self.explorer.highest, self.surrogate)


def _likely_simulations(target: TwoFidelityTarget, mode: Mode, simulated: Simulated, seed: int) -> Simulated:
    """Rough simulations at a mode and where the posterior is: some of the known ones, for it may be curved and
    the Gaussian about its mode then leads far from it."""
    if len(simulated.u) <= TUNING.corrected:
        return Simulated.at(target, np.concatenate([mode.u[None], mode.draws(TUNING.corrected, seed)]))
    top = np.argmax(simulated.value)
    weight = np.exp(tempered(simulated.value - simulated.value[top], TUNING.corrected_spread))
    weight[top] = 0.0
    rng, most = np.random.Generator(np.random.Philox(seed)), min(TUNING.corrected, int(np.count_nonzero(weight)))
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

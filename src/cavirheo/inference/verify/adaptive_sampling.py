"""Weighted draws from a few hundred simulations: first modes, then a surrogate of the simulations about them.

The draws of a network, if there is one, are simulated first. They lead to the maximum, and their weights give an
evidence. Then draws are taken from a surrogate (surrogate.py) of these simulations, and some of its draws are simulated
by the default solver. Rounds of these teach and check the surrogate, until it is as good as the simulations; its draws
are then the answer of level "auto". A surrogate does not know places that no simulation has met. Its draws are
therefore trusted only if the network's evidence is not larger than theirs; otherwise modes are looked for all over the
ranges. (A smaller evidence of the network only says that the network misses a part.) If no surrogate is good enough,
and for level "full", draws of the surrogate are simulated by the default solver and weighted.

All other simulations are rough ones, corrected by their mean difference to default ones at likely places. It hardly
changes across a posterior: log weights are wrong by some hundredths, in half the time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.errors import SolverError
from cavirheo.inference.alternatives import LAPLACE_ERROR
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, modes
from cavirheo.inference.verify.sampler import Proposal, Sample, effective_size, tempered
from cavirheo.inference.verify.surrogate import AdaptiveProposal, Surrogate, SurrogateTarget, climb_by_surrogates
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.physics.accuracy import BRISK, DEFAULT, Accuracy
from cavirheo.posterior import Evidence


class TwoFidelityTarget(Target):
    """A target of rough simulations, corrected by their mean difference to default ones, whatever the accuracy."""

    def __init__(self, target: Target) -> None:
        super().__init__(target.experiment, target.whole, target.noise.frames, target.workers)
        self.camera, self.noise = target.camera, target.noise
        self.exact, self.missed, self.rough = target, np.zeros(target.noise.size), True

    def residuals(self, u: Floats, accuracy: Accuracy = BRISK) -> Floats:
        """Extended residuals (k, n) at u (k, d); NaN where the simulation failed."""
        return self.exact.residuals(u, BRISK) + self.missed if self.rough else self.exact.residuals(u, DEFAULT)

    def checks(self, u: Floats, z: Floats, *_: Any) -> tuple[Simulated, Floats]:
        """As `Target.checks`, of corrected rough simulations."""
        return self.exact.checks(u, z, BRISK, self.missed) if self.rough else self.exact.checks(u, z)

    def correct(self, at: Simulated) -> None:
        """Find the mean difference of default and rough simulations at likely places; use default simulations alone if
        it changes too much between these."""
        fine = self.exact.residuals(at.u, DEFAULT)
        good = np.all(np.isfinite(fine - at.residual), axis=1)
        self.rough = bool(np.count_nonzero(good) > TUNING.correction_places / 2)
        if not self.rough:
            return
        u, fine, rough, value = at.u[good], fine[good], at.residual[good], at.value[good]
        trust = np.exp(np.maximum((value - np.max(value)) / TUNING.nugget_depth, -20.0))  # a scatter needs several
        self.missed = np.average(fine - rough, axis=0, weights=trust)
        wrong = self.log_posterior(u, fine) - self.log_posterior(u, rough + self.missed)
        self.rough = bool(np.cov(wrong, aweights=trust) < TUNING.correction_scatter**2)

    def corrected(self, u: Floats, residual: Floats) -> Simulated:
        """Simulations at u (k, d) with uncorrected rough residuals (k, n), corrected; or default simulations there, if
        rough ones are not used."""
        if not self.rough:
            return Simulated.at(self, u)
        residual = residual + self.missed
        return Simulated(u, residual, self.log_posterior(u, residual))

    def corrected_modes(self, modes: list[Mode]) -> list[Mode]:
        """Modes with uncorrected rough residuals, corrected."""
        now = self.corrected(*(np.array([getattr(mode, name) for mode in modes]) for name in ("u", "residual")))
        return [
            replace(mode, residual=residual, log_posterior=float(value))
            for mode, residual, value in zip(modes, now.residual, now.value, strict=True)
        ]

    def highest(self, start: Floats, surrogate: Surrogate | None) -> Mode | None:
        """The maximum that is reached from u (d,), on a surrogate if there is one, with the default simulation there;
        None if one of these failed."""
        mode = climb(SurrogateTarget(self, surrogate) if surrogate else self, start, BRISK)
        if mode is None:
            return None
        residual = self.exact.residuals(np.array([mode.u, start]), DEFAULT)
        value, least = self.log_posterior(np.array([mode.u, start]), residual)
        if surrogate and not value >= least:  # it is wrong there
            return self.highest(start, None)
        return replace(mode, residual=residual[0], log_posterior=float(value)) if np.isfinite(value) else None


def tolerance(share: float) -> float:
    """Largest standard deviation of errors in the log weights of a model with this share in the answer."""
    return min(TUNING.surrogate_error / share, TUNING.surrogate_error_most)


class AdaptiveSampling:
    """The posterior of one model from few simulations: first its modes, then draws of a surrogate.

    network: its first `network_draws` draws lead to the modes. starts: places to climb from without a network. scanned:
    such places from all over the ranges. windowed: the places where a search over growing windows ends, for a best mode
    that leaves more than noise. exact: draws that count in the answer are simulated, and further modes are looked for
    at once. Raises SolverError: no start could be simulated.
    """

    def __init__(
        self, target: Target, network: Proposal | None, starts: Callable[[], list[Floats]],
        scanned: Callable[[], list[Floats]], windowed: Callable[[], list[Floats]] = list, *, seed: int,
        network_draws: int = TUNING.network_draws, exact: bool = False,
    ) -> None:  # fmt: skip
        self.target, self.scanned, self.windowed, self.seed, self.exact = target, scanned, windowed, seed, exact
        self.two_fidelity = TwoFidelityTarget(target)
        simulated, maxima = None, list[Mode]()
        self.network: tuple[Floats, Floats] | None = None  # u (k, d) of its simulated draws, and their log density
        if network:
            u = network.draw(network_draws, self._rng(1))
            simulated = Simulated.at(self.two_fidelity, u)
            self.network = u, network.log_density(u)
            if len(simulated.finite.u) > 2 * (u.shape[1] + 1):
                maxima, simulated = self._climb_by_draws(simulated)
        self.ranged, self.windows_grown = not maxima, False
        if not maxima:
            maxima = modes(self.two_fidelity, starts(), scanned())
        if not maxima:
            raise SolverError(f"no start of {target.experiment.family.name} could be simulated")
        self.proposal = AdaptiveProposal(self.two_fidelity, maxima, simulated)
        self.refined = False
        self.network_sample: Sample | None = None
        self.sample: Sample | None = None
        self.shapes = np.empty((0, 0))  # (k, numbers) of the draws
        self.surrogate: Surrogate | None = None  # of which `sample` has draws that are not simulated
        self.error, self.rounds = 0.0, 0  # standard deviation of errors in log weights; rounds of surrogates so far
        self.surrogate_evidence = (
            -np.inf
        )  # log evidence of a surrogate whose draws were replaced by too few simulated ones
        self.ended = False

    def refine(self) -> None:
        """Correct all rough simulations so far; a model far below the others needs no correction."""
        if self.refined:
            return
        self.refined, maxima, simulated = True, self.proposal.modes, self.proposal.simulated
        if self._adapt_shapes(maxima[0].u, maxima[0].residual):
            residuals = self.two_fidelity.residuals(np.array([mode.u for mode in maxima]))
            maxima = [replace(mode, residual=row) for mode, row in zip(maxima, residuals, strict=True)]
            simulated = Simulated.at(self.two_fidelity, simulated.u)
        target = self.two_fidelity
        target.correct(_likely_simulations(target, maxima[0], simulated, self.seed))
        simulated = target.integrated(target.corrected(simulated.u, simulated.residual))
        maxima = [mode for mode in target.corrected_modes(maxima) if np.isfinite(mode.log_posterior)]
        if not maxima:
            raise SolverError(f"no mode of {target.experiment.family.name} could be simulated")
        self.proposal = AdaptiveProposal(target, maxima, simulated)
        if self.network and len(simulated.u):
            u, log_q = self.network
            alike = np.all(u[:, None] == simulated.u, axis=2)
            value = np.where(np.any(alike, axis=1), simulated.value[np.argmax(alike, axis=1)], -np.inf)
            self.network_sample = Sample(u, value, log_q)

    def _adapt_shapes(self, u: Floats, residual: Floats) -> bool:
        """As `Target.adapt_shapes`, for rough simulations, too."""
        reshaped = self.target.adapt_shapes(u, residual)
        self.two_fidelity = TwoFidelityTarget(self.target)
        return reshaped

    def _climb_by_draws(self, simulated: Simulated) -> tuple[list[Mode], Simulated]:
        """The maximum that is reached from the likeliest of a network's draws, and others that are reached from draws
        that are likelier than the Gaussian about the first expects; the best first, with all simulations."""
        top = int(np.argmax(simulated.value))
        if self._adapt_shapes(simulated.u[top], simulated.residual[top]):
            simulated = Simulated.at(self.two_fidelity, simulated.u)
        mode, simulated_on_way = climb_by_surrogates(self.two_fidelity, simulated, simulated.u[top])
        maxima, simulated = [mode] if mode else [], simulated.joined(simulated_on_way)
        for start in _unexpected(mode, simulated) if mode else []:
            mode, simulated_on_way = climb_by_surrogates(self.two_fidelity, simulated, start, maxima)
            maxima, simulated = [*maxima, *([mode] if mode else [])], simulated.joined(simulated_on_way)
        return sorted(maxima, key=lambda mode: -mode.log_posterior), simulated

    @property
    def log_laplace(self) -> float:
        """Laplace's log evidence of the modes so far."""
        return float(log_sum(np.array([mode.log_evidence for mode in self.proposal.modes])))

    def _rng(self, jumps: int) -> np.random.Generator:
        return np.random.Generator(np.random.Philox(self.seed).jumped(jumps))

    def sample_surrogate(self, enough: float, share: float) -> bool:
        """Take draws, worth `enough` independent ones, of a surrogate of the simulations so far. In each of a few
        rounds, simulations of some of its draws check and teach it, until it is good enough for a model with this share
        in the answer, and the last round has hardly changed its evidence. Whether there are draws."""
        proposal, rng = self.proposal, self._rng(self.rounds)
        last = min(self.rounds + TUNING.surrogate_turn, TUNING.surrogate_rounds)
        while self.rounds < last:
            emulation = proposal.surrogate_draws(rng, settling=TUNING.fits_teaching)
            if emulation is None:
                return False
            often = TUNING.wrong_factor if self.error > TUNING.wrong_surrogate else 1
            _, draws = emulation
            some = draws.chosen_indices(often * TUNING.checked_draws, rng)
            proposal(draws.u[draws.chosen_indices(TUNING.flat_draws, rng, TUNING.flat_power)])
            assert draws.camera is not None
            checked, value = self.two_fidelity.checks(draws.u[some], draws.camera[some])
            proposal.learn(checked)
            proposal.climb_higher()
            wrong = value - draws.log_target[some]
            efficiency = effective_size(wrong) / len(some)
            self.error = float(np.sqrt(max(-np.log(efficiency), 0.0))) if efficiency else np.inf
            self.rounds += 1
            patience = min(1.0 + (self.rounds - 1) / TUNING.surrogate_patience, 2.0)
            if self.error > tolerance(share) * patience and self.rounds < last:
                continue
            emulation = proposal.surrogate_draws(self._rng(self.rounds), TUNING.effective_margin * enough)
            if emulation is None:
                return False
            surrogate, sample = emulation
            expected = draws.log_evidence[0] + float(log_sum(wrong)) - np.log(len(some))
            moved = abs(sample.log_evidence[0] - expected)
            settled = moved < TUNING.evidence_change / share
            self.error = self.error if settled else max(self.error, moved)
            unsure = (
                TUNING.surrogate_evidence_error + 0.5 * self.error**2
            )  # a surrogate that is wrong also misses likely places
            self.surrogate, self.sample = surrogate, replace(sample, common=float(np.hypot(unsure, sample.common)))
            self.shapes = surrogate.shapes(sample.u)
            if settled:
                break
        return self.sample is not None

    def weigh_draws(self, enough: float, share: float) -> bool:
        """Simulate and weigh draws of a surrogate until they are worth `enough` independent ones; if they will not be,
        they teach the next surrogate. Whether they are worth an interval; if not, they only replace the draws of a
        surrogate that is too wrong."""
        left, needed = round(TUNING.draws * share), min(enough, TUNING.effective_fewest)
        rng, taken = self._rng(TUNING.surrogate_rounds + 2), False
        for _ in range(TUNING.weighted_rounds):
            emulation = self.proposal.surrogate_draws(rng, left / TUNING.draws_per_effective)
            if emulation is None:
                break
            (_, every), shapes = emulation, list[Floats]()
            assert every.camera is not None
            order = rng.permutation(len(every.u))[:left]
            u, log_q, camera, value = every.u[order], every.log_q[order], every.camera[order], np.empty(0)
            for some in np.array_split(np.arange(len(u)), max(len(u) // TUNING.draws_per_round, 1)):
                simulated, log_target = self.target.checks(u[some], camera[some])
                self.proposal.learn(simulated)
                shapes.append(self.target.noise.shapes(simulated.residual))
                value, count = np.append(value, log_target), some[-1] + 1
                draws = Sample(u[:count], value, log_q[:count], camera=camera[:count])
                done = draws.ess >= enough and draws.reliable
                if done or draws.ess / count * len(u) < 0.5 * needed:
                    break
            left -= count
            worth = draws.ess >= needed and draws.reliable
            if worth or not (taken or self.error <= TUNING.surrogate_error_most):
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
        """RMS over R_max of what the best mode leaves beyond the noise."""
        best = max(self.modes, key=lambda mode: mode.log_posterior)
        return self.target.experiment.misfit(self.target.noise.split(best.residual)[0])

    def search_windows(self) -> None:
        """Look for further modes by windows that grow, if the best mode leaves more than noise."""
        if not self.windows_grown and self.misfit > TUNING.large_misfit:
            self.proposal.add_modes(modes(self.two_fidelity, self.windowed(), maxima=self.modes))
        self.windows_grown = True

    def search_ranges(self) -> None:
        """Look for further modes all over the ranges."""
        if not self.ranged:
            self.proposal.add_modes(modes(self.two_fidelity, self.scanned(), maxima=self.modes))
        self.ranged = True

    @property
    def modes(self) -> list[Mode]:
        """The modes so far."""
        return self.proposal.modes

    def needs_draws(self, share: float) -> bool:
        """Whether a model with this share in the answer needs more draws, or better ones."""
        if self.sample is None:
            return not self.ended
        rough = self.error > 2.0 * tolerance(share) or (self._to_weigh(share) and self.surrogate is not None)
        return not self.ended and (rough or self.sample.ess < TUNING.effective_fewest * share)

    def _to_weigh(self, share: float) -> bool:
        return self.exact and share > TUNING.share_large

    def weigh(self, share: float) -> None:
        """Take as many draws as a model with this share in the answer needs, or draws that tell this share better. They
        are draws of a surrogate, or simulated ones if no surrogate is good enough or all are to be simulated."""
        self.refine()
        thorough, enough = share > TUNING.share_large, max(TUNING.effective_auto * share, TUNING.effective_fewest)
        if thorough:
            self.search_windows()
        if self._to_weigh(share):
            self.search_ranges()
        learning = self.rounds < TUNING.surrogate_rounds
        if learning:
            emulated = self.sample_surrogate(enough, share)
            if thorough and not self._trusted and not self.ranged:
                self.search_ranges()
                emulated = self.sample_surrogate(enough, share)
            unfinished = self.rounds < TUNING.surrogate_rounds and self.error > 2.0 * tolerance(share)
            if not emulated or unfinished or not self._to_weigh(share):
                self.ended = not emulated
                return
        enough = TUNING.effective_full if self.exact else TUNING.effective_fewest
        self.ended = not self.weigh_draws(enough * share, share)

    @property
    def evidence(self) -> Evidence:
        """The evidence of the draws, or Laplace's without draws. Too few simulated draws miss a part of it: it is not
        less than the evidence of the surrogate's draws that they replaced."""
        if self.sample is None:
            return Evidence(self.log_laplace, LAPLACE_ERROR)
        log, error = self.sample.log_evidence
        return Evidence(max(log, self.surrogate_evidence), max(error, self.surrogate_evidence - log))

    @property
    def evidence_gap(self) -> float | None:
        """How many standard errors the network's evidence lies above that of the draws, which miss a part of the
        posterior if it is far above. None if the network has too few effective draws."""
        if self.network_sample is None or self.sample is None or self.network_sample.ess < TUNING.network_effective:
            return None
        (of_network, network_error), (log, error) = self.network_sample.log_evidence, self.sample.log_evidence
        return (of_network - log) / float(np.hypot(max(network_error, TUNING.network_error), error))

    @property
    def _trusted(self) -> bool:
        """Whether the network's evidence is not larger than that of the draws."""
        gap = self.evidence_gap
        return gap is None or gap <= TUNING.network_agreement

    @cached_property
    def residual(self) -> Floats:
        """Extended residuals (k, size) of the draws, of simulations or of a surrogate. Call it when all are taken."""
        assert self.sample is not None
        assert self.sample.camera is not None
        return self.target.extended(self.shapes, self.sample.camera)

    @cached_property
    def best(self) -> Mode | None:
        """The maximum near the highest simulation; None if the default one fails there. Call it after all draws."""
        return self.two_fidelity.highest(self.proposal.highest, self.surrogate)


def _likely_simulations(target: TwoFidelityTarget, mode: Mode, simulated: Simulated, seed: int) -> Simulated:
    """Rough simulations at a mode and at likely places, which are some of the simulations so far, if there are enough:
    the Gaussian about the mode of a curved posterior has draws far from it."""
    if len(simulated.u) <= TUNING.correction_places:
        return Simulated.at(target, np.concatenate([mode.u[None], mode.draws(TUNING.correction_places, seed)]))
    top = np.argmax(simulated.value)
    weight = np.exp(tempered(simulated.value - simulated.value[top], TUNING.correction_effective))
    weight[top] = 0.0
    rng = np.random.Generator(np.random.Philox(seed))
    most = min(TUNING.correction_places, int(np.count_nonzero(weight)))
    chosen = np.append(top, rng.choice(len(weight), most, replace=False, p=weight / np.sum(weight)))
    return Simulated(simulated.u[chosen], simulated.residual[chosen], simulated.value[chosen])


def _unexpected(mode: Mode, simulated: Simulated) -> list[Floats]:
    """The likeliest simulation that lies far above the Gaussian about the mode, if there is one: it belongs to another
    mode."""
    expected = mode.log_posterior - 0.5 * mode.squares(simulated.u)
    unexpected = simulated.value - expected > TUNING.network_unexpected
    likely = np.where(unexpected & (simulated.value > mode.log_posterior - TUNING.mode_depth), simulated.value, -np.inf)
    best = int(np.argmax(likely))
    return [simulated.u[best]] if np.isfinite(likely[best]) else []

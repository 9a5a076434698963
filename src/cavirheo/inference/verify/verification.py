"""Settings of a verification, and the estimation of the posterior of one curve."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from cavirheo.arrays import Floats, log_sum, relative_weights
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError, expect, expect_whole, require
from cavirheo.inference.alternatives import LAPLACE_ERROR, LEAST_PROBABILITY, averaged, model_of
from cavirheo.inference.assumptions import FREE, SCALE_BOUND, Family, Options
from cavirheo.inference.experiment import Experiment, Simulations
from cavirheo.inference.posterior_network import PosteriorModel
from cavirheo.inference.search import LIMITS, STARTS, LeastSquares, Scan, Search
from cavirheo.inference.verify.adaptive_sampling import AdaptiveSampling
from cavirheo.inference.verify.mode import INSIDE, Mode, Target, answer_at, climb, modes, same
from cavirheo.inference.verify.sampler import Proposal, Sample
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.messages import Message
from cavirheo.parallel import cores
from cavirheo.parameters import CAMERA, PARAMETERS, natural_name, units
from cavirheo.physics.accuracy import DEFAULT, ROUGH
from cavirheo.physics.bubble import FIELD, REAL, Bubble, rival_of
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as named
from cavirheo.posterior import Diagnostics, Evidence, OtherAnswer, Posterior, Verdict, intervals
from cavirheo.prior import log_normal

_log = logging.getLogger(__name__)
_CARRIED = ("cavirheo", "model", "model_sha256", "problem_id", "source_sha256", "windows", "options")

SCALED = 0.002  # relative change of R_max, for the slope of G

Level = Literal["auto", "map", "full"]


@dataclass(frozen=True)
class Verification:
    """How an answer is verified. The window and the model of the bubble are the answer's own.

    Attributes:
        stretch: as in `fit_many`.
        free: as in `fit_many`; clock, scale and R_max are free by default.
        t0_bound: as in `fit_many`.
        scale_bound: as in `fit_many`.
        level: "map" (maximum and Laplace's Gaussian), "auto" (draws of a surrogate that simulations agree with), or
            "full" (draws that are simulated).
        medium: as in `fit_many`.
        discrepancy: allow for differences that no simulation follows (noise.py); without it the law is taken as exact.
        search: begin with searches over growing windows; the answer gives law, bubble and window alone.
        weights: weights of frames of a fit, "learnt" or "equal" (fitting.py); None for no fit.
        rival: whether a fit also answers by the other of the real and the field's bubble.
        ranges: of the priors, {"shear_modulus": [low, high] in SI}; default those that a fit searches.
        seed: seed of the draws.
        network: network whose draws lead to the modes, if it can read the curve.
        network_draws: number of its draws that are simulated.
        scanned: number of coarse simulations that look for other modes.
        workers: threads that simulate draws of level "full"; threads do not make other levels faster.

    Raises:
        InputError: a setting that is none of these.
    """

    stretch: float | str | None = None
    free: Sequence[str] | str = tuple(FREE)
    t0_bound: float | None = None
    scale_bound: float = SCALE_BOUND
    level: Level = "full"
    medium: Medium = WATER
    discrepancy: bool = True
    search: bool = False
    weights: str | None = None
    rival: bool = False
    ranges: Mapping[str, Sequence[float]] | None = None
    seed: int = 0
    network: PosteriorModel | None = None
    network_draws: int = TUNING.network_draws
    scanned: int = TUNING.scan_points
    workers: int | None = None

    def __post_init__(self) -> None:
        valid = self.level in ("auto", "map", "full")
        require(valid, f"verify must be auto, map or full, got {self.level!r}", "option.verify")
        object.__setattr__(self, "medium", named(self.medium))
        expect_whole(self.seed, "seed", 0, "option.seed")
        expect(self.ranges or {}, Mapping, 'ranges such as {"shear_modulus": [1e2, 1e5]}')
        self.options(None, FIELD)

    def options(self, end: float | None, bubble: Bubble) -> Options:
        """Options of the experiment on a window that ends at `end`, s. Raises InputError."""
        weights = self.weights or "learnt"
        return Options(None, end, self.stretch, self.free, self.t0_bound, self.scale_bound, weights, bubble)


class Estimation:
    """The posterior of one curve, from settings, an experiment, its target, and an answer to begin with."""

    method = "verified"  # of an answer with weighted draws

    def __init__(self, settings: Verification, curve: RadiusCurve, answer: Posterior) -> None:
        self.settings = settings
        scale, end = settings.medium.time_scale(curve.max_radius), answer.checks.t_star_end
        options = settings.options(None if end is None else end * scale * (1.0 + 1e-9), answer.bubble)
        diagnostics = answer.diagnostics
        simulations = Simulations(diagnostics.simulations or 0, diagnostics.failed_simulations or 0)
        self.shot = Experiment(curve, Family(answer.material), settings.medium, options, simulations=simulations)
        self.answer = answer
        self.prior = self.shot.prior(settings.ranges)
        noise = self.shot.noise(settings.discrepancy)
        workers = cores(settings.workers) if settings.level == "full" else 1
        self.target = Target(self.shot, self.prior, noise, workers)
        self.noise = self.target.noise  # the noise by which the answer is judged
        self.messages: list[Message] = []
        self.log_prior = 0.0  # log of the prior probability of this model
        self.failure: Exception | None = None  # why this model has no answer
        self._climbed_from: Floats | None = None  # u of another model, from which the last climb began

    def laplace(self) -> Posterior:
        """The answer of level "map"."""
        climbed = self.answer.method == "laplace"  # its modes are already those of a scan
        maxima = modes(self.target, self.starts(), [] if climbed else self.scanned())
        if not maxima:
            raise SolverError(f"no start of {self.shot.family.name} could be simulated")
        best = self._best(maxima)
        u = best.draws(TUNING.draws, self.settings.seed)
        u = u[self.target.holds(u)]
        evidence = Evidence(float(log_sum([mode.log_evidence for mode in maxima])))
        return self._answer((u, np.tile(best.residual, (len(u), 1))), None, best, evidence, maxima, {})

    @cached_property
    def sampling(self) -> AdaptiveSampling:
        """The simulations of levels "auto" and "full". Raises SolverError: no start could be simulated."""
        climbed = self.answer.method == "laplace"
        windowed = list if climbed or self.answer.method == "least_squares" else self.windowed  # its windows have grown
        scanned = list if climbed else self.scanned
        settings = self.settings
        return AdaptiveSampling(
            self.target, self.network, self.starts, scanned, windowed, seed=settings.seed,
            network_draws=settings.network_draws, exact=settings.level == "full",
        )  # fmt: skip

    def rival(self) -> Estimation | None:
        """The estimation by the field's bubble if this one is real, or by the real one if it is not; None if the
        network does not know it."""
        rival, settings = rival_of(self.answer.bubble), self.settings
        if settings.network is None or rival is None:
            return None
        names, ranges = (*self.shot.family.parameters, "stretch"), settings.ranges or {}
        ranges = {name: pair for name, pair in ranges.items() if name in names}
        draws = min(settings.network_draws, TUNING.network_draws_each)
        settings = replace(settings, ranges=ranges, network_draws=draws)
        estimation = Estimation(settings, self.shot.curve, replace(self.answer, bubble=rival))
        return estimation if estimation.network else None

    def weighted_answer(self, needed: float, limit: Estimation | None) -> Posterior:
        """The answer of the weighted draws. needed: effective draws that an interval needs. limit: the rival."""
        sampling, sample = self.sampling, self.sampling.sample
        if sample is None:
            raise SolverError(f"too few bubbles of {self.shot.family.name} about its maximum can be simulated")
        sample = replace(sample, log_target=np.where(self.target.holds(sample.u), sample.log_target, -np.inf))
        best = sampling.best or self._best(sampling.modes)
        summary = {"evidences_apart_in_standard_errors": sampling.evidence_gap, "log_weight_error": sampling.error}
        draws = sample.u, sampling.residual
        if distrust := sample.distrust(needed):
            self.messages.append(distrust)
            draws = best.u[None], best.residual[None]
        return self._answer(draws, sample, best, sampling.evidence, sampling.modes, summary, limit)

    def preview(self) -> tuple[OtherAnswer, Floats, Floats]:
        """The answer of the weighted draws, or of the Gaussian about the maximum without draws, to stand beside another
        model's answer; x (k, all) of the draws, and log weights (k,) whose mean is the evidence."""
        target, sampling, sample = self.target, self.sampling, self.sampling.sample
        if sample is None:
            mode = max(sampling.modes, key=lambda mode: mode.log_posterior)
            u, z = mode.draws(TUNING.draws, self.settings.seed), target.camera.z(mode.residual)
            u = u[target.holds(u)]
            x, log_weight = target.with_camera(u, np.tile(z, (len(u), 1))), np.full(len(u), sampling.log_laplace)
            return replace(answer_at(target, mode), evidence=sampling.evidence), x, log_weight
        x, _ = target.add_camera(sample.u, target.camera.z(sampling.residual))
        quantiles = intervals(*self.shot.to_theta(x), sample.log_weight)
        answer = answer_at(target, sampling.best or sampling.modes[0])
        return replace(answer, intervals=quantiles, evidence=sampling.evidence), x, sample.log_weight

    @property
    def log_probability(self) -> float:
        """Of the evidence, as far as it is known, times the probability of the model before the curve is seen; -inf if
        the model failed."""
        return -np.inf if self.failure else self.sampling.evidence.log + self.log_prior

    def climb_where_best(self, other: Estimation) -> None:
        """Climb from the best place of another model if this is far above all simulations of this model: laws contain
        each other, and the search may have missed a mode. If one is found, draws that missed it are dropped."""
        proposal, highest = self.sampling.proposal, other.sampling.proposal.highest
        already_climbed = self._climbed_from is not None and np.array_equal(highest, self._climbed_from)
        height = proposal.height
        if other.sampling.proposal.height - height < TUNING.other_model_height or already_climbed:
            return
        self._climbed_from = highest
        start = self.start_at(other.shot.all_values(other.target.with_camera(highest[None])[0]))
        proposal(start[None])
        proposal.climb_from(start)
        if proposal.height - height > TUNING.other_model_height:
            self.sampling.sample = None

    def _best(self, maxima: Sequence[Mode]) -> Mode:
        """The highest of the modes that the default solver can simulate, climbed with it."""
        for maximum in sorted(maxima, key=lambda mode: -mode.log_posterior):
            if mode := climb(self.target, maximum.u, DEFAULT):
                return mode
        raise SolverError(f"no mode of {self.shot.family.name} could be simulated")

    def _alternatives(self, best: Mode, maxima: Sequence[Mode]) -> tuple[OtherAnswer, ...]:
        """The answers of other models so far, and of all modes but the best.

        The evidence of these models allows for differences that no simulation follows, so it is left out for an exact
        law.
        """
        models = [model for model in self.answer.others if model_of(model) != model_of(self.answer)]
        if not self.settings.discrepancy:
            models = [replace(model, evidence=None) for model in models]
        return *models, *(answer_at(self.target, mode) for mode in maxima if not same(mode, best))

    def starts(self) -> list[Floats]:
        """u (d,) of the answer, of its other windows and of other modes of its model. Parameters of bubble and camera
        that it does not give are at their middle."""
        answer, starts, free = self.answer, list[Floats](), self.shot.free
        medians = {"stretch": answer.stretch} | {name: answer.median(name) for name in answer.parameters}
        points = [medians, answer.best, *(window.best for window in answer.windows.values())]
        points += [x.best for x in answer.others if (x.material, x.bubble) == (answer.material, answer.bubble)]
        of_bubble = [name for name in self.shot.log_names if name != "stretch"]
        usual: dict[str, Any] = {name: 10.0 ** np.mean(PARAMETERS[name].start_range or 0.0) for name in of_bubble}
        for point in (usual | {**best} for best in points):
            values = [1.0 if name in free else point.get(name) or 0.0 for name in self.prior.names]
            if all(value > 0 for value in values):
                x = self.shot.starts(np.log10(values))
                for i, name in enumerate(self.prior.names):
                    if name in free and (value := point.get(name)) is not None:
                        x[i] = np.clip((value - free[name][0]) / free[name][1], -0.8, 0.8)  # its bounds may be others
                u = self.target.start(x)
                if all(np.max(np.abs(u - start)) > TUNING.start_distance for start in starts):
                    starts.append(u)
        needed, available = (*self.shot.family.parameters, "stretch"), ", ".join(answer.parameters)
        require(bool(starts), f"the answer that is to be verified must give {', '.join(needed)}; it gives {available}")
        return starts

    def start_at(self, best: Mapping[str, float]) -> Floats:
        """u (d,) of the place nearest to another model with these natural values: parameters that only this model has
        are almost zero."""
        viscosity = best.get("viscosity", best.get("reference_viscosity", 1.0))
        nothing = {"viscosity": viscosity, "reference_viscosity": viscosity, "stiffening": 1e-9, "shear_modulus": 1e-9}
        return self.target.start(self.shot.from_best({**nothing, **best}))

    def scanned(self) -> list[Floats]:
        """u (d,) of the likeliest of coarse simulations all over the ranges, which may lead to a higher mode."""
        fit = LeastSquares(self.shot)
        try:
            scan = Scan(fit, self.settings.scanned, STARTS)  # a fit takes other points
        except SolverError as error:
            _log.debug("%s: no scan of %s", self.shot.curve.name, self.shot.family.name, exc_info=error)
            return []
        counted = self.shot.counted
        measured = self.shot.measured[counted]
        failed = np.full(len(measured), np.nan)
        frames = [failed if p is None else p.radius[counted] for p in scan.predictions]
        u = self.target.start(scan.points)
        value = self.target.noise.frames.log_density(measured - np.array(frames)) + log_normal(u)
        climbed = int(TUNING.scan_climbed * len(value))
        return [u[i] for i in np.argsort(-value)[:climbed] if np.isfinite(value[i])]

    def windowed(self) -> list[Floats]:
        """u (d,) of the minima that a search over windows that grow by a collapse finds: a long window has many minima,
        because a rebound can be shifted by a period."""
        try:
            minima = Search(self.shot).minima()
        except SolverError as error:
            _log.debug("%s: no search of %s", self.shot.curve.name, self.shot.family.name, exc_info=error)
            return []
        return [self.target.start(minimum.x) for minimum in minima]

    @cached_property
    def network(self) -> Proposal | None:
        """A rough posterior: that of the network. None, with a message, if it cannot read the curve."""
        network, settings = self.settings.network, self.settings
        try:
            return network.proposal(self.shot, self.target.prior, settings.discrepancy) if network else None
        except InputError as outside:
            self.messages.append(Message("search.over_ranges", {"reason": outside.message}))
            return None

    def _answer(
        self, draws: tuple[Floats, Floats], sample: Sample | None, best: Mode, evidence: Evidence,
        maxima: Sequence[Mode], more: Mapping[str, Any], limit: Estimation | None = None,
    ) -> Posterior:  # fmt: skip
        """The Posterior of draws u (k, d) with extended residuals: weighted draws, the maximum if they cannot be
        trusted, or a Gaussian. limit: the estimation by the rival bubble; if this is the field's, its draws are
        averaged with these."""
        shot, prior, noise, settings, target = self.shot, self.prior, self.noise, self.settings, self.target
        (u, residuals), z = draws, target.camera.z(best.residual)
        (at,) = target.with_camera(best.u[None], z[None])
        x, log_camera = at[None], np.zeros(1)
        if len(u) > 1:
            z = target.camera.z(residuals)
            x, log_camera = target.add_camera(u, z) if sample else target.draw_camera(u, z, best.u, settings.seed)
        trusted = sample if len(u) > 1 else None
        over_scale = self._modulus_over_scale(best, trusted, residuals)
        log_q = log_weight = None
        alternatives = self._alternatives(best, maxima)
        if trusted:  # from u to the parameters of the answer
            log_weight = trusted.log_weight
            log_q = trusted.log_q + target.prior.log_density(target.prior.to_x(u)) - log_normal(u)
            log_q += log_camera - shot.log_jacobian(shot.to_theta(x)[1])
        if limit:
            rival, rival_x, rival_weight = limit.preview()
            real = self.answer.bubble == REAL
            if log_weight is not None and rival.evidence and rival.evidence.error != LAPLACE_ERROR and real:
                average = averaged(log_weight, evidence, rival_weight, rival.evidence)
                rival = replace(rival, weight=average.probability)
                if average.probability > LEAST_PROBABILITY:
                    evidence, log_weight, log_q = average.evidence, average.log_weight, None
                    if average.probability > 0.5:
                        sampling = limit.sampling
                        nearest = sampling.best or sampling.modes[0]
                        over_scale = limit._modulus_over_scale(nearest, sampling.sample, sampling.residual)
                    x = np.concatenate([x, shot.as_limit(rival_x, limit.shot.names)])
            alternatives = (*alternatives, rival)
        summary: dict[str, Any] = {"modes": len(maxima), **more}
        sample_quality: dict[str, Any] = {}
        if sample is None:
            summary["log_evidence_laplace"] = evidence.log
        else:
            summary |= {"log_evidence": evidence.log, "log_evidence_error": evidence.error}
            sample_quality = {"draws": len(sample.u), "effective_sample_size": sample.ess, "tail_index": sample.tail[0]}
        names, theta = shot.to_theta(x)
        frames, slopes = noise.split(best.residual)[0], noise.split(best.jacobian.T)[0].T
        predictive = predictive_check(frames, slopes, noise.frames.deviation, settings.seed)
        excess = shot.misfit(frames)
        if predictive and predictive["p_value"] < TUNING.p_rejected:  # find how near the model can come
            at, least_excess = self._nearest(at)
            excess = min(excess, least_excess)
        values = shot.all_values(at)
        diagnostics = {
            "stretch_source": shot.stretch_source(),
            "systematic_misfit_over_rmax": excess,
            "simulations": shot.simulations.runs, "failed_simulations": shot.simulations.failures, **sample_quality,
        }  # fmt: skip
        diagnostics |= {"predictive": predictive} if predictive else {}
        diagnostics |= {
            "modulus_over_scale": over_scale,
            "at_bound": tuple(name for name in self._pulled(at) if name in CAMERA),
            "frames_left_out": int(np.count_nonzero(~shot.counted)),
        }
        provenance = {key: value for key, value in self.answer.provenance.items() if key in _CARRIED}
        provenance |= diagnostics | summary | noise.describe(best.residual) | {
            "verify": settings.level, "discrepancy": settings.discrepancy, "prior": prior.to_dict(),
            "exposure_s": shot.exposure, "proposal": self.answer.method, "best": values, "stretch": values["stretch"],
            "before": {n: self.answer.median(natural_name(n)) for n in self.answer.names if len(self.answer.theta)},
            "seed": settings.seed,
        }  # fmt: skip
        verdict = self._verdict(at, predictive, excess, x, log_weight, alternatives[-1].weight if limit else 0.0)
        verdict = "no_interval" if sample and not trusted and verdict == "ok" else verdict
        checks = shot.checks(at, verdict, self.messages)
        return Posterior(
            names, units(names), theta, checks, shot.family.name, self.method if sample else "laplace", provenance,
            log_q, log_weight, best=values, stretch=values["stretch"], windows=self.answer.windows,
            evidence=evidence, diagnostics=Diagnostics(**diagnostics), bubble=self.answer.bubble, medium=shot.medium,
            others=alternatives, prior=shot.law_prior(prior), stretch_prior=shot.stretch_prior,
        )  # fmt: skip

    def _modulus_over_scale(self, best: Mode, sample: Sample | None, residuals: Floats) -> float | None:
        """Relative change of G over that of R_max. Frames of a larger bubble are nearer to R_max in units of t_c; the
        draws with extended residuals (k, size) are weighted by frames that are moved in this way, with the camera
        refitted. Without draws, those of the Gaussian about the maximum are taken, with frames linear in u. None for a
        law without G, or if a simulation failed."""
        shot, target, names = self.shot, self.target, self.prior.names
        if "shear_modulus" not in names:
            return None
        camera, noise = target.camera, target.noise.frames
        bubble = shot.solve_on_grid(target.with_camera(best.u[None])[0], camera)
        if bubble is None:
            return None
        u = sample.u if sample else best.draws(TUNING.draws, self.settings.seed)
        log_weight = sample.log_weight if sample else np.zeros(len(u))
        residuals = residuals if sample else best.residual - (u - best.u) @ best.jacobian.T
        sides = [replace(camera, time=camera.time * (1.0 + side * SCALED)) for side in (-0.5, 0.5)]
        nearer, farther = (side.extended(bubble, noise)[0] for side in sides)
        counted = np.isfinite(log_weight)
        u, residuals, weight = u[counted], residuals[counted], relative_weights(log_weight[counted])
        gain = target.log_posterior(u, residuals + nearer - farther) - target.log_posterior(u, residuals)
        modulus = 10.0 ** target.prior.to_x(u)[:, target.prior.names.index("shear_modulus")]
        moved = np.average(modulus, weights=weight * np.exp(gain)) / np.average(modulus, weights=weight)
        return float(moved - 1.0) / SCALED

    def _nearest(self, x: Floats) -> tuple[Floats, float]:
        """x (all,) of least squares from x, or x itself if that is nearer, and its misfit beyond noise, by which the
        model is judged."""
        shot = self.shot
        fit = LeastSquares(shot)
        minimum = fit.minimise(np.clip(x, *fit.bounds.T), ROUGH, {**LIMITS, "max_nfev": TUNING.nearest_steps}).x
        differences = [shot.difference(point) for point in (x, minimum)]
        nearest = int(np.argmin(np.nan_to_num([np.mean(difference**2) for difference in differences], nan=np.inf)))
        return (x, minimum)[nearest], shot.misfit(differences[nearest])

    def _verdict(
        self,
        at: Floats,
        predictive: dict[str, Any] | None,
        excess: float,
        x: Floats,
        log_weight: Floats | None,
        limit_weight: float,
    ) -> Verdict:
        verdict: Verdict = "ok"
        if unbounded := self.shot.bound_messages(x, self.prior.low, self.prior.high, log_weight):
            verdict = "undetermined"
            self.messages += unbounded
        if predictive and predictive["p_value"] < TUNING.p_rejected:
            exact = not self.settings.discrepancy
            if exact or excess > TUNING.misfit_rejected:
                verdict = "model_does_not_fit"
            limits = {"detectable": TUNING.misfit_seen, "limit": TUNING.misfit_rejected, "exact": exact}
            chance = {"p_value": predictive["p_value"], "least": predictive["least"]}
            self.messages.append(Message("misfit.systematic", {"excess": excess, **limits, **chance}))
        below = dict(zip(self.prior.names, self.prior.cdf(at), strict=True))
        mostly_limit = limit_weight > 0.5  # most of the answer is the field's bubble, without parameters
        for name in (name for name in self._pulled(at) if name in CAMERA or not mostly_limit):
            self.messages.append(Message(f"prior_end.{name}.{'lower' if below[name] < 0.5 else 'upper'}"))
        self.messages += self.shot.messages
        return verdict

    def _pulled(self, x: Floats) -> tuple[str, ...]:
        """Names of the free parameters of bubble and camera that are at the end of their prior at x (all,)."""
        u = zip(self.prior.names, self.prior.to_u(x, INSIDE), strict=True)
        return tuple(name for name, value in u if name in self.shot.free and abs(value) > TUNING.prior_end)


def statistics(residuals: Floats) -> dict[str, Floats]:
    """Three statistics (k,) of residuals (k, n), n >= 9, each over its assumed deviation, which do not depend on the
    size of this deviation: level (standard deviation over the noise of third differences, which cancel a smooth
    misfit), correlation (of neighbours) and run (the longest with one sign)."""
    k, n = residuals.shape
    rough = 1.4826 * np.median(np.abs(np.diff(residuals, 3, axis=1)), axis=1) / np.sqrt(20.0)
    r = residuals - np.mean(residuals, axis=1, keepdims=True)
    power = np.sum(r**2, axis=1)
    longest, run = np.ones(k), np.ones(k)
    for i in range(1, n):
        run = np.where((residuals[:, i] > 0) == (residuals[:, i - 1] > 0), run + 1.0, 1.0)
        longest = np.maximum(longest, run)
    return {
        "level": np.sqrt(np.mean(residuals**2, axis=1)) / rough,
        "correlation": np.sum(r[:, 1:] * r[:, :-1], axis=1) / power,
        "run": longest,
    }


def predictive_check(residual: Floats, jacobian: Floats, deviation: Floats, seed: int) -> dict[str, Any] | None:
    """Posterior predictive check of residuals (n,) at a maximum, with the derivatives of the frames (n, d) there and
    their assumed deviations (n,), against white noise; None for fewer than 9 frames.

    Replicates are independent noise z, refitted as the measurement was: the residual is (1 - J (J'J + ridge)^-1 J') z,
    which costs no simulation. p is the part of the replicates that is as extreme. Gelman, Meng and Stern 1996,
    Statistica Sinica 6, 733; with refitting the check is not conservative (Robins, van der Vaart and Ventura 2000,
    doi:10.1080/01621459.2000.10474310).
    """
    n, d = jacobian.shape
    if n < max(9, d + 3):
        return None
    scaled, J = residual / deviation, jacobian / deviation[:, None]
    variance = float(scaled @ scaled) / max(n - d, 1)
    fitted = np.linalg.solve(J.T @ J + variance * np.eye(d), J.T)
    noise = np.random.Generator(np.random.Philox(seed)).standard_normal((TUNING.replicates, n))
    replicated = statistics(noise - (noise @ fitted.T) @ J.T)
    observed = {name: float(value[0]) for name, value in statistics(scaled[None]).items()}
    extreme = {name: np.count_nonzero(values >= observed[name]) for name, values in replicated.items()}
    p = {name: float((1 + count) / (1 + TUNING.replicates)) for name, count in extreme.items()}
    worst = min(1.0, len(p) * min(p.values()))  # Bonferroni's correction for three statistics
    return {"p": p, "observed": observed, "p_value": worst, "least": len(p) / (1 + TUNING.replicates)}

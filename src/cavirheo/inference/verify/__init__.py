"""Verification: draws of any proposal weighted by the likelihood of the full simulation (docs/method/posterior.md).

| module | does |
|---|---|
| mode | the posterior as a function of u, its maxima, Laplace |
| surrogate | the posterior that a few hundred simulations let expect |
| explore | where to draw: from the surrogate, about the modes, in valleys found on the way |
| sampler | importance weights, effective size, evidence: of any density |
| predictive | could this law have left these residuals? |
| evidence | which of several laws |
| tuning | the numbers that decide |
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.experiment import (
    FINE,
    FREE,
    NARROWEST,
    QUICK,
    SCALE_BOUND,
    Experiment,
    Options,
    misfit_of,
)
from cavirheo.inference.fit.least_squares import LeastSquares
from cavirheo.inference.fit.starts import Scan
from cavirheo.inference.law import Family
from cavirheo.inference.verify.explore import Explorer
from cavirheo.inference.verify.mode import Mode, Target, climb, modes
from cavirheo.inference.verify.predictive import Predictive, predictive_check, systematic
from cavirheo.inference.verify.sampler import Sample, sample
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.parallel import cores, each
from cavirheo.parameters import natural_name, units
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Diagnostics, Evidence, Posterior, Verdict
from cavirheo.prior import log_normal

__all__ = ["Verification", "verify", "verify_many"]

Level = Literal["map", "full"]
_CARRIED = ("cavirheo", "medium", "model", "model_sha256", "problem_id", "source_sha256", "windows", "options")


@dataclass(frozen=True)
class Verification:
    """How an answer is verified.

    level: "map" (maximum and Laplace's Gaussian) or "full" (weighted draws). stretch, free, t0_bound, scale_bound: as
    in `fit_many`; free clock, scale and R_max by default. discrepancy: allow for what no simulation follows (noise.py);
    without it the law is taken as exact. ranges: of the priors, {"shear_modulus": [low, high] in SI}; default those
    that a fit searches. draws: at most so many weighted ones.

    Raises:
        InputError: a setting is out of its domain.
    """

    level: Level = "full"
    medium: Medium = WATER
    stretch: float | str | None = None
    free: tuple[str, ...] = tuple(FREE)
    t0_bound: float | None = None
    scale_bound: float = SCALE_BOUND
    discrepancy: bool = True
    ranges: Mapping[str, Sequence[float]] | None = None
    draws: int = TUNING.draws
    seed: int = 0
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.level not in ("map", "full"):
            raise InputError(f"verify must be none, map or full, got {self.level!r}", "option.verify")
        if self.draws < 10:
            raise InputError(f"a posterior needs at least 10 draws, got {self.draws}", "option.draws")
        self.options(None, None)

    def options(self, end: float | None, t0_bound: float | None) -> Options:
        """Of an experiment whose window ends at `end`. Raises InputError."""
        clock = self.t0_bound or t0_bound
        return Options(None, end, self.stretch, tuple(self.free), clock, self.scale_bound, windows=False)


def verify(curve: RadiusCurve, answer: Posterior, **settings: Any) -> Posterior:
    """An answer brought to the maximum of the posterior and, with level "full", replaced by draws that the likelihood
    has weighted; `settings` are those of `Verification`.

    The answer may come from any method; it needs a value for the law's parameters and for the stretch. The law and the
    window are the answer's. A failed answer stays as it is; one whose verification fails keeps its values, loses its
    interval, and says so.
    """
    return _verified(curve, answer, Verification(**settings))


def verify_many(
    curves: Sequence[RadiusCurve],
    answers: Sequence[Posterior],
    *,
    workers: int | None = None,
    done: Callable[[], None] | None = None,
    **settings: Any,
) -> list[Posterior]:
    """`verify` of each answer on all cores, in their order; `done` is called after each."""
    inner = max(cores(workers) // max(len(curves), 1), 1)
    chosen = Verification(workers=inner, **settings)
    # BLAS' own threads would only wait for each other beside these
    with threadpool_limits(1, "blas"):
        return each(lambda pair: _verified(*pair, chosen), zip(curves, answers, strict=True), workers, done)


def _verified(curve: RadiusCurve, answer: Posterior, settings: Verification) -> Posterior:
    if answer.checks.verdict == "failed":
        return answer
    began = time.perf_counter()
    try:
        found = _Work(settings, curve, answer).posterior()
    except (InputError, SolverError, np.linalg.LinAlgError) as error:  # of this shot alone
        message = "; ".join(filter(None, [answer.checks.message, f"not verified: {error}"]))
        found = replace(answer, checks=replace(answer.checks, message=message))
    return replace(found, seconds=answer.seconds + time.perf_counter() - began)


class _Work:
    """The work on one curve."""

    def __init__(self, settings: Verification, curve: RadiusCurve, answer: Posterior) -> None:
        self.settings, self.answer, self.seed = settings, answer, settings.seed
        scale, frame = settings.medium.time_scale(curve.max_radius), float(np.median(np.diff(curve.time)))
        end = answer.checks.t_star_end
        options = settings.options(
            None if end is None else end * scale * (1.0 + 1e-9), max(0.5 * frame, NARROWEST * scale)
        )
        exposure = float(curve.exposure or 0.0)
        family = Family(answer.material)
        self.shot = Experiment(curve, family, settings.medium, options, exposure=exposure)
        self.prior = self.shot.prior(settings.ranges)
        noise = self.shot.noise(settings.discrepancy)
        self.target = Target(self.shot, self.prior, noise, cores(settings.workers))
        self.messages: list[str] = []

    def posterior(self) -> Posterior:
        found = modes(self.target, self._starts(), QUICK, self._scanned())
        if not found:
            raise SolverError(f"no start of {self.shot.family.name} could be simulated")
        if self.settings.level == "map":
            best = self._best(found)
            about: dict[str, Any] = {"log_evidence_laplace": best.log_evidence, "modes": len(found)}
            drawn = Sample(_gaussian(best, self.settings.draws, self.seed), np.empty(0), np.empty(0))
            return self._answer(drawn, best, about, Evidence(best.log_evidence), "laplace")
        explorer, most = Explorer(self.target, found, QUICK, FINE), self.settings.draws
        few = min(TUNING.draws_per_round, most)
        drawn = sample(explorer, explorer.propose, seed=self.seed, each=few, most=most, enough=TUNING.effective_enough)
        best = self._best(explorer.modes)
        log_evidence, error = drawn.log_evidence
        about = {"log_evidence": log_evidence, "log_evidence_error": error, "modes": len(explorer.modes)}
        return self._answer(drawn, best, about, Evidence(log_evidence, error), "verified")

    def _best(self, found: Sequence[Mode]) -> Mode:
        """The highest of rough modes that the default solver can simulate, at its maximum."""
        for rough in sorted(found, key=lambda mode: -mode.log_posterior):
            mode = climb(self.target, rough.u, FINE)
            if mode is not None:
                return mode
        raise SolverError(f"no mode of {self.shot.family.name} could be simulated")

    def _values(self, given: Mapping[str, Any]) -> Floats | None:
        """u from natural values by name; nuisances that are not among them at their middle. None if one is missing."""
        x = np.zeros(len(self.prior.names))
        for i, name in enumerate(self.prior.names):
            if name not in FREE.values():
                if given.get(name) is None or not given[name] > 0:
                    return None
                x[i] = np.log10(given[name])
        return self.prior.start(x)

    def _starts(self) -> list[Floats]:
        """The answer, and those of its other windows, for they may be other valleys."""
        answer = self.answer
        names = [natural_name(name) for name in answer.names]
        here = {"stretch": answer.stretch} | {name: answer.median(name) for name in names}
        found: list[Floats] = []
        for values in (here, answer.best, *(window.best for window in answer.windows.values())):
            u = self._values(values)
            if u is not None and all(np.max(np.abs(u - other)) > TUNING.same_start for other in found):
                found.append(u)
        if not found:
            needed = ", ".join((*self.shot.family.parameters, "stretch"))
            raise InputError(f"the answer that is to be verified must give {needed}; it gives {', '.join(names)}")
        return found

    def _scanned(self) -> list[Floats]:
        """Where coarse simulations all over the ranges of a fit are most likely: neither a network's answer nor least
        squares need lie in the highest valley."""
        fit = LeastSquares([self.shot], self.target.workers)
        try:
            scan = Scan(fit, TUNING.scanned)
        except SolverError:
            return []
        self.target.runs += fit.runs
        self.target.failures += fit.failures
        counted = self.shot.counted
        measured = self.shot.measured[counted]
        missed = np.full(len(measured), np.nan)
        frames = [missed if p is None else p.radius[counted] for p in scan.found]
        u = self.prior.start(scan.points)
        value = self.target.log_posterior(u, measured - np.array(frames))
        return [u[i] for i in np.argsort(-value)[: TUNING.scanned_climbed] if np.isfinite(value[i])]

    def _answer(self, drawn: Sample, best: Mode, about: dict[str, Any], evidence: Evidence, method: str) -> Posterior:
        shot, prior, noise, weighted = self.shot, self.prior, self.target.noise, method == "verified"
        log_q, log_weight = (drawn.log_q, drawn.log_weight) if weighted else (None, None)
        worth: dict[str, Any] = {}
        if weighted:
            worth = {"draws": len(drawn.u), "effective_sample_size": drawn.ess, "tail_index": drawn.tail[0]}
            if drawn.ess < TUNING.effective_fewest or not drawn.reliable:
                self._refuse_interval(drawn)
                drawn, log_q, log_weight = Sample(best.u[None], np.empty(0), np.empty(0)), None, None
        x = prior.to_x(drawn.u)
        names, theta = shot.answer(x)
        if log_q is not None:  # from u to the answer's parameters
            log_q = log_q + prior.log_density(x) - log_normal(drawn.u)
            log_q -= np.sum(np.log(shot.half_widths))
            if "stretch" in shot.own:
                log_q -= np.log(theta[:, shot.law] * np.log(10.0))
        predictive = predictive_check(best.residual, best.jacobian, noise.deviation, self.seed)
        excess = systematic(best.residual, shot.curve.noise / shot.max_radius)
        at = prior.to_x(best.u)
        values = shot.best(at)
        diagnostics = Diagnostics(
            stretch_source="given" if shot.stretch else "inferred with the other parameters",
            predictive=vars(predictive) | {"p_value": predictive.p_value} if predictive else None,
            systematic_misfit_over_rmax=excess,
            simulations=self.target.runs, failed_simulations=self.target.failures, **worth,
        )  # fmt: skip
        verdict = self._verdict(at, predictive, excess, x, log_weight)
        seen = shot.overlaid(at)
        if misfit := misfit_of(seen):
            verdict = "model_does_not_fit"
            self.messages[:0] = misfit
        told = ("stretch_source", "predictive", "systematic_misfit_over_rmax", "simulations", "failed_simulations")
        provenance = {key: value for key, value in self.answer.provenance.items() if key in _CARRIED}
        provenance |= {key: value for key in (*told, *worth) if (value := getattr(diagnostics, key)) is not None}
        provenance |= about | noise.describe(best.residual[None], np.ones(1)) | {
            "verify": self.settings.level, "discrepancy": self.settings.discrepancy, "prior": prior.to_dict(),
            "exposure_s": shot.exposure, "proposal": self.answer.method, "best": values, "stretch": values["stretch"],
            "before": {name: self.answer.median(natural_name(name)) for name in self.answer.names}, "seed": self.seed,
        }  # fmt: skip
        return Posterior(
            names, units(names), theta, seen.checks(shot.view, shot.time_scale, verdict, self.messages),
            shot.family.name, method, provenance, log_q, log_weight, best=values, stretch=values["stretch"],
            windows=self.answer.windows, evidence=evidence, diagnostics=diagnostics,
        )  # fmt: skip

    def _refuse_interval(self, drawn: Sample) -> None:
        self.messages.append(
            f"the interval is not to be trusted and left out: {len(drawn.u)} weighted draws are worth {drawn.ess:.0f} "
            f"(at least {TUNING.effective_fewest:.0f} are needed; tail index {drawn.tail[0]:.2f}, at most "
            f"{TUNING.tail_reliable} unless at most {TUNING.tail_unseen:.0%} of the weight is still to be met, here "
            f"{drawn.tail[1]:.1%})"
        )

    def _verdict(
        self, at: Floats, predictive: Predictive | None, excess: float, x: Floats, log_weight: Floats | None
    ) -> Verdict:
        verdict: Verdict = "ok"
        if ends := self.shot.open_ends(x, self.prior.low, self.prior.high, log_weight):
            verdict = "outside_training_range"
            named = ", ".join(ends.values())
            self.messages.append(f"the curve does not bound {named}: there the prior's range does")
        if predictive and predictive.rejected:
            which = min(predictive.p, key=lambda name: predictive.p[name])
            seen = excess >= TUNING.systematic_seen
            size = f"a systematic misfit of {excess:.1%} of R_max" if seen else "though no larger than noise"
            text = f"residuals are not independent noise ({which}, p = {predictive.p_value:.2g}): {size}"
            if not self.settings.discrepancy:
                verdict = "model_does_not_fit"
                text += "; the law was taken as exact, so the interval is too narrow"
            elif excess > TUNING.systematic:
                verdict = "model_does_not_fit"
                text += f" (limit {TUNING.systematic:.0%})"
            elif seen:
                text += ", which the interval allows for"
            self.messages.append(text)
        u_best, below = self.prior.to_u(at), self.prior.cdf(at)
        for i, name in enumerate(self.prior.names):
            if name in FREE.values() and abs(u_best[i]) > TUNING.pulled:
                self.messages.append(f"{name} is pulled to the end of its prior ({below[i]:.1%} below it)")
        if self.shot.spikes:
            self.messages.append(f"{self.shot.spikes} frames above both neighbours by 20 % of R_max do not count")
        return verdict


def _gaussian(mode: Mode, count: int, seed: int) -> Floats:
    """(count, d) draws of Laplace's Gaussian, in pairs opposite to each other."""
    rng = np.random.Generator(np.random.Philox(seed))
    half = rng.standard_normal((count // 2, len(mode.u))) @ np.linalg.cholesky(mode.covariance).T
    return np.asarray(mode.u + np.concatenate([half, -half]))

"""A posterior that the physics has signed: the true likelihood weighs the draws of any proposal (docs/posterior.md).

| module | does |
|---|---|
| prior | proper priors; the coordinates u in which each is the standard normal |
| likelihood | camera model, noise of unknown size, discrepancy |
| mode | the maximum of the posterior, Laplace |
| surrogate | the posterior that a few hundred simulations let expect |
| explore | where to draw: from the surrogate, about the modes, in valleys found on the way |
| sampler | importance weights, effective size, evidence: of any density |
| predictive | could this law have left these residuals? |
| evidence | which of several laws |
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.fit import fit_many, overlaid
from cavirheo.inference.fit.parameters import FREE, SCALE_BOUND, Family, Settings, units
from cavirheo.inference.fit.search import Fit, Scan
from cavirheo.inference.fit.shots import FINE, QUICK, Shot
from cavirheo.inference.reconstruct import MISFIT
from cavirheo.inference.verify.explore import Explorer
from cavirheo.inference.verify.likelihood import Likelihood
from cavirheo.inference.verify.mode import Mode, Target, climb, modes
from cavirheo.inference.verify.predictive import Predictive, predictive_check, systematic
from cavirheo.inference.verify.prior import prior_of
from cavirheo.inference.verify.sampler import RELIABLE, UNSEEN, Sample, sample
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Posterior, Verdict
from cavirheo.prior import log_normal

__all__ = ["Estimator", "LeastSquares", "Verified", "verify_many"]

Floats = NDArray[np.float64]
Level = Literal["map", "full"]

DRAWS = 1800  # most simulations whose weights count
EACH = 200  # a round
ENOUGH = 400.0  # effective draws at which sampling ends
FEWEST = 100.0  # effective draws below which no interval is given
NARROWEST = 0.02  # t_c: half-width of the time origin's range where half a frame is less; R_max is hardly seen sooner
SYSTEMATIC = 0.03  # of R_max: misfit beyond noise above which a law is rejected although some is allowed for
SEEN = 5e-4  # of R_max: misfit below which none is stated
PULLED = 2.3  # in u: a nuisance that far from its middle has 1 % of its prior beyond it
SCANNED, CLIMBED = 96, 3  # coarse simulations all over the ranges, and how many of them are climbed from
SAME = 0.005  # in u: starts nearer to each other than this are one
AT_END = 0.25  # of an interval's width: an end nearer to that of the prior's range is the prior's, not the curve's


class Estimator(Protocol):
    """Whatever answers a curve: a network, a fit, this wrapper."""

    def infer(self, curve: RadiusCurve) -> Posterior: ...


@dataclass(frozen=True)
class LeastSquares:
    """Estimator: the conventional fit of a law, with its options (`fit_many`)."""

    material: str
    medium: Medium = WATER
    options: Mapping[str, Any] | None = None

    def infer(self, curve: RadiusCurve) -> Posterior:
        return fit_many([curve], self.material, medium=self.medium, **(self.options or {}))[0]


@dataclass(frozen=True)
class Verified:
    """Estimator: another's answer, brought to the maximum of the posterior and, with level "full", replaced by draws
    that the likelihood has weighted. The law, the window and the medium are those of the other's answer.

    estimator: its answer needs a value for the law's parameters and for the stretch (in its draws or its provenance).
    level: "map" (maximum and Laplace) or "full". stretch, free, t0_bound, scale_bound: as in `fit_many`; free clock,
    scale and R_max by default. discrepancy: allow for what no simulation follows (likelihood.py); without it the law
    is taken as exact. ranges: of the priors, {"shear_modulus": [low, high] in SI}; default those that a fit searches.
    adapt: without it the other's own draws are weighted as they are, by its log_q, which shows what they are worth.

    Raises:
        InputError: a setting is out of its domain.
    """

    estimator: Estimator
    medium: Medium = WATER
    level: Level = "full"
    stretch: float | str | None = None
    free: tuple[str, ...] = tuple(FREE)
    t0_bound: float | None = None
    scale_bound: float = SCALE_BOUND
    discrepancy: bool = True
    ranges: Mapping[str, Sequence[float]] | None = None
    adapt: bool = True
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.level not in ("map", "full"):
            raise InputError(f"verify must be none, map or full, got {self.level!r}")
        Settings(None, None, self.stretch, self.free, self.t0_bound, self.scale_bound)

    def infer(self, curve: RadiusCurve, *, draws: int = DRAWS, seed: int = 0) -> Posterior:
        """The verified answer for one curve, from at most so many weighted draws."""
        return self.check(curve, self.estimator.infer(curve), draws=draws, seed=seed)

    def check(self, curve: RadiusCurve, answer: Posterior, *, draws: int = DRAWS, seed: int = 0) -> Posterior:
        """The same where the other's answer is known. A failed answer stays as it is; one whose verification fails
        keeps its values, loses its interval, and says so."""
        if draws < 10:
            raise InputError(f"a posterior needs at least 10 draws, got {draws}")
        if answer.checks.verdict == "failed":
            return answer
        began = time.perf_counter()
        try:
            found = _Work(self, curve, answer, seed).posterior(draws)
        except (InputError, SolverError) as error:
            message = "; ".join(filter(None, [answer.checks.message, f"not verified: {error}"]))
            found = replace(answer, checks=replace(answer.checks, message=message))
        return replace(found, seconds=answer.seconds + time.perf_counter() - began)


def verify_many(
    curves: Sequence[RadiusCurve],
    answers: Sequence[Posterior],
    *,
    level: Level = "full",
    medium: Medium = WATER,
    draws: int = DRAWS,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[], None] | None = None,
    **options: Any,
) -> list[Posterior]:
    """`Verified.check` of each answer, in their order; `options` are the other settings of `Verified`."""
    cores = workers or os.cpu_count() or 1
    inner = max(cores // max(len(curves), 1), 1)
    wrapper = Verified(_Nobody(), medium, level, workers=inner, **options)

    def one(pair: tuple[RadiusCurve, Posterior]) -> Posterior:
        found = wrapper.check(*pair, draws=draws, seed=seed)
        if done:
            done()
        return found

    # BLAS' own threads would only wait for each other beside these
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(cores) as pool:
        return list(pool.map(one, zip(curves, answers, strict=True)))


class _Nobody:
    def infer(self, curve: RadiusCurve) -> Posterior:
        raise NotImplementedError("only answers that are there already are checked")


class _Work:
    """The work on one curve."""

    def __init__(self, settings: Verified, curve: RadiusCurve, answer: Posterior, seed: int) -> None:
        self.settings, self.answer, self.seed = settings, answer, seed
        self.family = Family(answer.material)
        scale, frame = settings.medium.time_scale(curve.max_radius), float(np.median(np.diff(curve.time)))
        end = answer.checks.t_star_end
        window = Settings(
            None, None if end is None else end * scale * (1.0 + 1e-9), settings.stretch, settings.free,
            settings.t0_bound or max(0.5 * frame, NARROWEST * scale), settings.scale_bound, windows=False,
        )  # fmt: skip
        self.shot = Shot(curve, self.family, settings.medium, window)
        self.prior = prior_of(self.shot, self.family, settings.ranges)
        self.likelihood = Likelihood(self.shot, settings.discrepancy)
        self.target = Target(self.likelihood, self.prior, settings.workers or os.cpu_count() or 1)
        self.messages: list[str] = []

    def posterior(self, draws: int) -> Posterior:
        found = modes(self.target, self._starts(), QUICK, self._scanned())
        if not found:
            raise SolverError(f"no start of {self.family.name} could be simulated")
        about: dict[str, Any] = {
            "verify": self.settings.level, "discrepancy": self.settings.discrepancy, "prior": self.prior.to_dict(),
            "exposure_s": self.likelihood.exposure, "proposal": self.answer.method,
        }  # fmt: skip
        if self.settings.level == "map":
            best = self._best(found)
            about |= {"log_evidence_laplace": best.log_evidence, "modes": len(found)}
            return self._answer(_gaussian(best, draws, self.seed), None, None, best, about, "least_squares")
        if self.settings.adapt:
            explorer = Explorer(self.target, found, QUICK, FINE)
            drawn = sample(explorer, explorer.propose, seed=self.seed, each=min(EACH, draws), most=draws, enough=ENOUGH)
            found = explorer.modes
        else:
            drawn = self._weighted(draws)
        best = self._best(found)
        log_evidence, error = drawn.log_evidence
        about |= {
            "effective_sample_size": drawn.ess, "draws": len(drawn.u), "tail_index": drawn.tail[0],
            "log_evidence": log_evidence, "log_evidence_error": error, "modes": len(found),
        }  # fmt: skip
        if drawn.ess < FEWEST or not drawn.reliable:
            self.messages.append(
                f"the interval is not to be trusted and left out: {len(drawn.u)} weighted draws are worth "
                f"{drawn.ess:.0f} (at least {FEWEST:.0f} are needed; tail index {drawn.tail[0]:.2f}, at most {RELIABLE}"
                f" unless at most {UNSEEN:.0%} of the weight is still to be met, here {drawn.tail[1]:.1%})"
            )
            return self._answer(best.u[None], None, None, best, about, "verified")
        return self._answer(drawn.u, drawn.log_q, drawn.log_weight, best, about, "verified")

    def _best(self, found: Sequence[Mode]) -> Mode:
        """The highest of rough modes that the default solver can simulate, at its maximum."""
        for rough in sorted(found, key=lambda mode: -mode.log_posterior):
            mode = climb(self.target, rough.u, FINE)
            if mode is not None:
                return mode
        raise SolverError(f"no mode of {self.family.name} could be simulated")

    def _values(self, given: Mapping[str, Any]) -> Floats | None:
        """u from natural values by name; nuisances that are not among them at their middle. None if one is missing."""
        x = np.zeros(len(self.prior.names))
        for i, name in enumerate(self.prior.names):
            if name in (*self.family.parameters, "stretch"):
                if given.get(name) is None or not given[name] > 0:
                    return None
                x[i] = np.log10(given[name])
        return self.prior.start(x)

    def _starts(self) -> list[Floats]:
        """The answer, and those of its other windows, for they may be other valleys."""
        about = self.answer.provenance
        names = [name.removeprefix("log10_") for name in self.answer.names]
        here = {"stretch": about.get("stretch")} | {name: self.answer.median(name) for name in names}
        given = [here, about.get("best") or {}, *(about.get("windows") or {}).values()]
        found: list[Floats] = []
        for values in given:
            u = self._values(values)
            if u is not None and all(np.max(np.abs(u - other)) > SAME for other in found):
                found.append(u)
        if not found:
            needed = ", ".join((*self.family.parameters, "stretch"))
            raise InputError(f"the answer that is to be verified must give {needed}; it gives {', '.join(names)}")
        return found

    def _scanned(self) -> list[Floats]:
        """Where coarse simulations all over the ranges of a fit are most likely: neither a network's answer nor least
        squares need lie in the highest valley."""
        fit, likelihood = Fit(self.family, [self.shot], self.target.workers), self.likelihood
        try:
            scan = Scan(fit, SCANNED)
        except SolverError:
            return []
        self.target.runs += fit.runs
        self.target.failures += fit.failures
        missed = np.full(len(likelihood.measured), np.nan)
        frames = [missed if p is None else p.radius[~self.shot.spikes] for p in scan.found]
        u = self.prior.start(scan.points)
        value = self.target.log_posterior(u, likelihood.measured - np.array(frames))
        return [u[i] for i in np.argsort(-value)[:CLIMBED] if np.isfinite(value[i])]

    def _weighted(self, draws: int) -> Sample:
        """The other's own draws; parameters that it does not have are drawn from their priors."""
        answer, prior = self.answer, self.prior
        if answer.log_q is None or len(answer.theta) < 2:
            raise InputError("draws can only be weighted as they are if their density is known (log_q)")
        theta, log_q = answer.theta[:draws], answer.log_q[:draws]
        u = np.random.Generator(np.random.Philox(self.seed)).standard_normal((len(theta), len(prior.names)))
        log_q_u = log_normal(u)
        for i, name in enumerate(prior.names):
            for column, given in enumerate(answer.names):
                if given.removeprefix("log10_") != name:
                    continue
                x, jacobian = theta[:, column], np.zeros(len(theta))
                if name in FREE.values():
                    k = len(self.shot.own.free) - len(prior.names) + i
                    width = self.shot.own.half_widths[k]
                    x, jacobian = (x - (0.0 if name == "time_origin" else 1.0)) / width, np.full(len(x), np.log(width))
                elif not given.startswith("log10_"):
                    x, jacobian = np.log10(x), np.log(x * np.log(10.0))
                log_q_u -= -0.5 * (u[:, i] ** 2 + np.log(2.0 * np.pi))
                one = prior.part(i)
                u[:, i] = one.to_u(x[:, None])[:, 0]
                with np.errstate(invalid="ignore"):
                    log_q_u += jacobian - 0.5 * (u[:, i] ** 2 + np.log(2.0 * np.pi)) - one.log_density(x[:, None])
        log_q_u += log_q
        inside = np.all(np.isfinite(u), axis=1)
        target = np.full(len(u), -np.inf)
        target[inside] = self.target(u[inside], FINE)
        return Sample(np.where(inside[:, None], u, 0.0), target, np.where(inside, log_q_u, 0.0))

    def _answer(
        self, u: Floats, log_q: Floats | None, log_weight: Floats | None, best: Mode, about: dict[str, Any], method: str
    ) -> Posterior:
        shot, law = self.shot, len(self.family.parameters)
        x = self.prior.to_x(u)
        own = shot.own.natural(x[:, law:].T)
        names = (*(f"log10_{name}" for name in self.family.parameters), *shot.own.names)
        theta = np.column_stack([x[:, :law], *(own[name] for name in shot.own.names)])
        at = self.prior.to_x(best.u)
        natural = shot.own.natural(at[law:])
        if log_q is not None:  # from u to the answer's parameters
            log_q = log_q + self.prior.log_density(x) - log_normal(u)
            log_q -= np.sum(np.log(shot.own.half_widths))
            if "stretch" in shot.own.names:
                log_q -= np.log(own["stretch"] * np.log(10.0))
        noise = self.likelihood.noise
        predictive = predictive_check(best.residual, best.jacobian, noise.deviation, self.seed)
        about |= noise.describe(best.residual[None], np.ones(1))
        excess = systematic(best.residual, shot.curve.noise / shot.max_radius)
        about["systematic_misfit_over_rmax"] = excess
        if predictive:
            about["predictive"] = {"p_value": predictive.p_value, "p": predictive.p, "observed": predictive.observed}
        verdict = self._verdict(at, predictive, excess, u, log_weight)
        seen = overlaid(Fit(self.family, [shot]), at, 0)
        if seen.rmse > MISFIT:
            verdict = "model_does_not_fit"
            self.messages.insert(
                0, f"the simulation misses the measurement by {seen.rmse:.1%} of R_max RMS (limit {MISFIT:.0%})"
            )
        shared = ("cavirheo", "medium", "model", "model_sha256", "problem_id", "source_sha256", "windows", "options")
        provenance = {key: value for key, value in self.answer.provenance.items() if key in shared} | about | {
            "best": dict(zip(self.family.parameters, (10.0 ** at[:law]).tolist(), strict=True))
            | {name: float(value) for name, value in natural.items()},
            "stretch": float(natural["stretch"]),
            "stretch_source": "given" if shot.own.stretch else "inferred with the other parameters",
            "before": {name: self.answer.median(name.removeprefix("log10_")) for name in self.answer.names},
            "simulations": self.target.runs,
            "failed_simulations": self.target.failures,
            "seed": self.seed,
        }  # fmt: skip
        return Posterior(
            names, units(names), theta, seen.checks(shot.view, shot.time_scale, verdict, self.messages),
            self.family.name, method, provenance, log_q, log_weight,
        )  # fmt: skip

    def _verdict(
        self, at: Floats, predictive: Predictive | None, excess: float, u: Floats, log_weight: Floats | None
    ) -> Verdict:
        verdict: Verdict = "ok"
        open_ends = self._open_ends(u, log_weight)
        if open_ends:
            verdict = "outside_training_range"
            self.messages.append("the curve does not bound " + ", ".join(open_ends) + ": there the prior's range does")
        if predictive and predictive.rejected:
            which = min(predictive.p, key=lambda name: predictive.p[name])
            size = f"a systematic misfit of {excess:.1%} of R_max" if excess >= SEEN else "though no larger than noise"
            text = f"residuals are not independent noise ({which}, p = {predictive.p_value:.2g}): {size}"
            if not self.settings.discrepancy:
                verdict = "model_does_not_fit"
                text += "; the law was taken as exact, so the interval is too narrow"
            elif excess > SYSTEMATIC:
                verdict = "model_does_not_fit"
                text += f" (limit {SYSTEMATIC:.0%})"
            elif excess >= SEEN:
                text += ", which the interval allows for"
            self.messages.append(text)
        u_best = self.prior.to_u(at)
        for i, name in enumerate(self.prior.names):
            if name in FREE.values() and abs(u_best[i]) > PULLED:
                self.messages.append(f"{name} is pulled to the end of its prior ({self.prior.cdf(at)[i]:.1%} below it)")
        if self.shot.spikes.any():
            count = np.count_nonzero(self.shot.spikes)
            self.messages.append(f"{count} frames above both neighbours by 20 % of R_max do not count")
        return verdict

    def _open_ends(self, u: Floats, log_weight: Floats | None) -> list[str]:
        """Parameters of the law and the stretch, one end of whose interval is the end of the prior's range."""
        from cavirheo.posterior import weighted_quantile

        if len(u) < 2:
            return []
        found = []
        x = self.prior.to_x(u)
        for i, name in enumerate(self.prior.names):
            if name in FREE.values():
                continue
            low, high = weighted_quantile(x[:, i], np.array([0.05, 0.95]), log_weight)
            if low - self.prior.low[i] < AT_END * (high - low):
                found.append(f"{name} from below")
            if self.prior.high[i] - high < AT_END * (high - low):
                found.append(f"{name} from above")
        return found


def _gaussian(mode: Mode, count: int, seed: int) -> Floats:
    """(count, d) draws of Laplace's Gaussian, in pairs opposite to each other."""
    rng = np.random.Generator(np.random.Philox(seed))
    half = rng.standard_normal((count // 2, len(mode.u))) @ np.linalg.cholesky(mode.covariance).T
    return np.asarray(mode.u + np.concatenate([half, -half]))

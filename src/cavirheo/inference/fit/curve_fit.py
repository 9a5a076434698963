"""The fit of one curve by itself: search, other windows, valleys and their evidence, the answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cavirheo.arrays import Floats, unscaled
from cavirheo.inference import input_checks
from cavirheo.inference.experiment import FINE, QUICK, Experiment
from cavirheo.inference.fit.covariance import Laplace, draws, laplace
from cavirheo.inference.fit.least_squares import LeastSquares, Minimum
from cavirheo.inference.fit.search import Search
from cavirheo.inference.noise import Noise
from cavirheo.inference.options import FREE
from cavirheo.inference.verify.mode import Mode, Target, climb, modes, same, valley
from cavirheo.inference.verify.proposals import Explorer
from cavirheo.inference.verify.sampler import Sample, sample
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.parameters import LOG10, units
from cavirheo.posterior import Checks, Diagnostics, Evidence, OtherAnswer, Posterior, Verdict, WindowAnswer
from cavirheo.writing import digits

LIQUIDS = ("newtonian", "power-law")  # laws to try where there may be no shear modulus
DRAWS = 4096
EACH, MOST = 60, 1200  # weighted draws: of a round, in all
LEARNING = 2  # rounds of simulations before, that learn where to draw
AS_NEAR = 1.5  # costs of minima, below which the evidence chooses between them
FAR = 3.0  # standard deviations of the draws: a minimum so far from them is of another solution
AT_BOUND = 1e-3  # of a range: nearer to its end is "at the bound"

_Beside = tuple[Minimum, Mode]  # and the maximum of the posterior beside it


class Alone:
    """found: the minimum. laplace: what it is worth. evidence: of the model. valleys: other minima that follow the
    frames nearly as well, as answers. windows: what other windows answer. `starts`: where minima may be. Without
    `draws` only found and valleys, both rough: a verification goes on from there."""

    laplace: Laplace | None = None
    sample: Sample | None = None  # weighted draws, and all parameters (k, d) of each
    drawn: Floats | None = None
    evidence: Evidence | None = None

    def __init__(
        self, shot: Experiment, workers: int, starts: Sequence[Floats] = (), seed: int = 0, draws: bool = True
    ) -> None:
        self.shot, self.fit = shot, LeastSquares([shot], workers)
        end = shot.cut[1]
        shorter = [(n, end) for n in range(1, min(shot.view.collapses, 3) + 1) if (n, end) != shot.cut]
        search = Search(self.fit, [*shorter, shot.cut], starts, once=not draws)
        self.search, best = search.counts, search.minima[0].x
        self.windows: dict[str, WindowAnswer] = {}
        for cut, x in search.stages.items() if shot.options.windows else ():
            shot.set_window(*cut)
            lower = min((x, best), key=lambda one: float(np.sum(self.fit.residuals(one, QUICK) ** 2)))
            self.windows[str(cut[0] or "all")] = self._window_answer(lower)
        shot.set_window(*shot.cut)
        if not draws:
            self.found = search.minima[0]
            known = shot.family.name, shot.options.bubble
            self.valleys = [OtherAnswer(*known, shot.best(one.x), {}, None, None) for one in search.minima[1:]]
            return
        enough = np.count_nonzero(shot.counted) >= 3
        target = Target(shot, shot.prior(), shot.noise(discrepancy=True), workers) if enough else None
        weighed = self._weighed(target, search.minima) if target else []
        chosen = max(
            (one for one in weighed if one[0].cost < AS_NEAR * search.minima[0].cost),
            key=lambda one: one[1].log_evidence, default=None,
        )  # fmt: skip
        self.found = self.fit.polish(chosen[0].x if chosen else best)
        if enough:
            self._sampled(seed, [minimum.x for minimum in search.minima])
        if target and chosen and self.sample and not _among(target.start(self.found.x), self.sample):
            # the best values must be those of the solution that has the interval; the minimum before is a valley
            assert self.drawn is not None
            self.found = self.fit.polish(self.drawn[np.argmax(self.sample.log_target)])
            if mode := climb(target, target.start(self.found.x), QUICK):
                chosen = next((one for one in weighed if same(mode, one[1])), (self.found, mode))
        self.laplace = laplace(self.fit, self.found.x)
        if chosen:
            self.evidence = Evidence(chosen[1].log_evidence)
        others = [mode for _, mode in weighed if chosen and mode is not chosen[1]]
        self.valleys = [valley(target, mode) for mode in others] if target else []

    def _weighed(self, target: Target, minima: Sequence[Minimum]) -> list[_Beside]:
        """The minima, each with the maximum of the posterior beside it; those that share one are one."""
        found: list[_Beside] = []
        for minimum in minima:
            mode = climb(target, target.start(minimum.x), QUICK, known=[mode for _, mode in found])
            if mode and not any(same(mode, other) for _, other in found):
                found.append((minimum, mode))
        return found

    def _sampled(self, seed: int, beside: Sequence[Floats]) -> None:
        """Find draws weighted by the likelihood of rough simulations, of weights that are known now but for a factor.

        A Gaussian would be too narrow: what a shift of the clock does to the frames beside a collapse is far from
        linear, so posteriors are curved and have shelves. A shelf, such as a viscosity that may be as small as it
        likes, is found by what is learnt from simulations (proposals.py), not by following a maximum. None are kept if
        they are not worth an interval.
        """
        shot = self.shot
        deviation = (shot.sigma * shot.noise_factor)[shot.counted]
        noise = Noise(deviation, shot.since[shot.counted], shot.time_scale, discrepancy=False)
        target = Target(shot, shot.prior(), noise, self.fit.workers)
        there = [target.start(x) for x in (self.found.x, *beside)]
        maxima = modes(target, there[:1], there[1:])
        if not maxima:
            return
        explorer = Explorer(target, maxima, LEARNING, follow=False)
        found = sample(
            lambda u: explorer(u, QUICK), explorer.propose, seed=seed, each=EACH, most=MOST,
            enough=TUNING.auto_enough, fewest=2,
        )  # fmt: skip
        if found.distrust:
            return
        self.sample = found
        z = target.camera.z(explorer.residuals_of(found.u))
        self.drawn, _ = target.completed(found.u, z, explorer.highest, seed)

    def doubts(self) -> list[str]:
        """About the curve, whether or not it was fitted with others."""
        return [*input_checks.plain(self.shot.curve, self.shot.medium), *input_checks.of_walls(self.shot)]

    def _window_answer(self, x: Floats) -> WindowAnswer:
        shot = self.shot
        (seen,) = self.fit.at(x, FINE)
        rmse = None if seen is None else float(np.sqrt(np.mean((shot.measured - seen.radius) ** 2)))
        best = {name: value for name, value in shot.best(x).items() if name not in FREE.values()}
        return WindowAnswer(best, float(shot.view.end / shot.time_scale), rmse, tuple(at_bound(self.fit, x, 0)))


def _among(u: Floats, drawn: Sample) -> bool:
    """Whether a minimum (d,) is where the weighted draws are."""
    weight = unscaled(drawn.log_weight)
    middle = np.average(drawn.u, weights=weight, axis=0)
    spread = np.sqrt(np.average((drawn.u - middle) ** 2, weights=weight, axis=0))
    return bool(np.all(np.abs(u - middle) < FAR * spread))


def at_bound(fit: LeastSquares, x: Floats, k: int) -> dict[str, str]:
    """Of the parameters of shot k that ended at a bound: by name, which."""
    found = {}
    shot, x = fit.shots[k], x[fit.columns[k]]
    low, high = fit.bounds[fit.columns[k]].T
    for i, name in enumerate(shot.names):
        for side, ends in (("lower", low), ("upper", high)):
            if abs(x[i] - ends[i]) < AT_BOUND * (high[i] - low[i]):
                found[name] = f"{name} at its {side} bound ({shot.best(ends)[name]:.4g})"
    return found


def posterior(
    fit: LeastSquares, found: Minimum, worth: Laplace | None, k: int, alone: Alone, common: Mapping[str, Any], seed: int
) -> Posterior:
    """The answer for shot k at a minimum; a point, where it is not known what that is worth. The draws of the material
    are the same for all shots of a joint fit, which has no evidence and no valleys: those of `alone` are of a shot with
    a material of its own."""
    shot, columns, joint = fit.shots[k], fit.columns[k], len(fit.shots) > 1
    weighted = None if joint else alone.sample
    x, log_weight = found.x[columns], weighted.log_weight if weighted else None
    covariance = worth.covariance[np.ix_(columns, columns)] if worth else None
    if weighted and alone.drawn is not None:
        drawn = alone.drawn
        covariance = np.cov(drawn.T, aweights=unscaled(weighted.log_weight))
    elif worth is None or not joint or not found.converged:
        drawn = x[None]  # no interval about a point that is no minimum, or without draws that are worth one
    else:
        drawn = draws(found.x, worth.covariance, fit.bounds, DRAWS, seed, worth.freedom)[:, columns]
    names, theta = shot.answer(drawn)
    best, bound = shot.best(x), at_bound(fit, found.x, k)
    diagnostics = Diagnostics(
        stretch_source=shot.stretch_source("fitted"),
        free={name: best[name] for name in shot.free if name in FREE.values()},
        **_widths(shot, covariance),
        frames=len(shot.measured),
        frames_per_independent_residual=worth.correlation[k] if worth else None,
        at_bound=tuple(bound),
        simulations=shot.runs,
        failed_simulations=shot.failures,
    )
    windows = {key: {**one.best, **vars(one)} for key, one in alone.windows.items()}
    for window in windows.values():
        del window["best"]
    told = {name: value for name, value in vars(diagnostics).items() if value is not None}
    provenance = dict(common) | told | {
        "source_sha256": shot.curve.source_sha256, "best": best, "stretch": best["stretch"],
        "windows": windows, "search": alone.search, "draws_seed": seed,
        "residual_variance_over_assumed": worth.variance[k] if worth else None,
    }  # fmt: skip
    checks = _checks(fit, found, k, bound, drawn, log_weight)
    if len(drawn) == 1 and worth is not None and checks.verdict == "ok":
        told_why = "; ".join(filter(None, [checks.message, "the weighted draws are worth too little for an interval"]))
        checks = replace(checks, verdict="no_interval", message=told_why)
    return Posterior(
        names, units(names), theta, checks, fit.family.name, "least_squares", provenance,
        best=best, stretch=best["stretch"], windows=alone.windows, diagnostics=diagnostics, log_weight=log_weight,
        bubble=shot.options.bubble, evidence=None if joint else alone.evidence,
        others=() if joint else tuple(alone.valleys), prior=shot.of_law(shot.prior()),
        stretch_prior=shot.stretch_prior,
    )  # fmt: skip


def _widths(shot: Experiment, covariance: Floats | None) -> dict[str, Any]:
    """one_sigma and correlations as in Diagnostics, as far as they are known."""
    if covariance is None:
        return {}
    sigma = np.sqrt(np.diag(covariance))
    shown = {name: (name, shot.free[name][1]) if name in shot.free else (LOG10 + name, 1.0) for name in shot.names}
    one_sigma = {key: float(one) * width for one, (key, width) in zip(sigma, shown.values(), strict=True)}
    correlations = {
        f"{other}, {name}": float(covariance[i, j] / (sigma[i] * sigma[j]))
        for i, name in enumerate(shot.names)
        for j, other in enumerate(shot.names[:i])
    }
    return {"one_sigma": one_sigma, "correlations": correlations}


def _checks(
    fit: LeastSquares, found: Minimum, k: int, bound: dict[str, str], drawn: Floats, log_weight: Floats | None
) -> Checks:
    """The same check as that of `infer`: the answer simulated anew and laid over the window."""
    shot, columns = fit.shots[k], fit.columns[k]
    low, high = fit.bounds[columns].T
    unbounded = shot.unbounded(drawn, low, high, log_weight)
    at_end = unbounded or set(bound) & {*shot.family.parameters, "stretch"}
    verdict: Verdict = "undetermined" if at_end else "ok"
    messages = [text for name, text in bound.items() if name not in unbounded]
    messages += [digits.unbounded(name, value) for name, value in unbounded.items()]
    if "shear_modulus" in unbounded and unbounded["shear_modulus"].bound != "lower":
        messages.append("the shear modulus may be nothing: for a liquid try " + " or ".join(LIQUIDS))
    if shot.options.stretch == "plateau" and not shot.stretch_prior:
        messages.append("the curve has no late plateau: the stretch was fitted freely")
    messages += shot.left_out
    if not found.converged:
        no_interval = ": no interval" if len(fit.shots) > 1 else ""
        messages.append(f"the search stopped at its limit of iterations{no_interval}")
        verdict = "model_does_not_fit" if no_interval else verdict
    if len(fit.shots) > 1:
        messages.append(f"joint fit of {len(fit.shots)} shots with one material")
    return shot.checks(found.x[columns], verdict, messages)

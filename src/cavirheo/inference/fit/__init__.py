"""The field's conventional fit: least squares of simulated on measured radius histories (docs/method/fit.md)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from itertools import pairwise
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve, several
from cavirheo.errors import expect_whole, require
from cavirheo.inference import check_level, doubts
from cavirheo.inference.experiment import FINE, FREE, QUICK, SCALE_BOUND, Experiment, Options
from cavirheo.inference.fit.covariance import Laplace, draws, laplace
from cavirheo.inference.fit.least_squares import SEARCH, LeastSquares, Minimum
from cavirheo.inference.fit.starts import Scan
from cavirheo.inference.law import Family
from cavirheo.parallel import cores, each
from cavirheo.parameters import LOG10, units
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as named
from cavirheo.physics.scales import inertia_of
from cavirheo.posterior import BubbleModel, Checks, Diagnostics, Posterior, Verdict, WindowAnswer

__all__ = ["fit", "fit_many"]

DRAWS = 4096
WINDOWS = (1, 2, 3, None)  # collapses; None: all that was recorded
BEST = 3  # rough simulations from which a search is started
FOLLOWED = 1.0  # residual variance over the assumed one, at which one start is enough
LOWER = 0.95  # of a minimum's cost, that another must reach to replace it
AT_BOUND = 1e-3  # of a range: nearer to its end is "at the bound"


def fit(curve: RadiusCurve, material: str = "nhkv", **options: Any) -> Posterior:
    """The parameters of a law whose simulation follows one measured curve best; options as `fit_many`."""
    return fit_many([curve], material, **options)[0]


def fit_many(
    curves: Sequence[RadiusCurve],
    material: str = "nhkv",
    *,
    medium: Medium | str = WATER,
    window: int | str | None = None,
    end: float | None = None,
    stretch: float | str | None = None,
    free: Sequence[str] | str = (),
    t0_bound: float | None = None,
    scale_bound: float = SCALE_BOUND,
    weights: str = "motion",
    windows: bool = True,
    contents: str = "equilibrium",
    accommodation: float | str = "free",
    damage: str = "none",
    wall_inertia: float | str = 0.0,
    wall_distance: float | None = None,
    vapour_excess: float | str = 0.0,
    joint: bool = False,
    trust_input: bool = False,
    verify: str = "none",
    discrepancy: bool = True,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """Nonlinear least squares on the simulated radius, from many starts; one answer per curve, in their order.

    Args:
        material: a law of `cavirheo laws` all of whose parameters are then fitted ("nhkv", "qkv", "zener", ...).
        medium: constants of the liquid or gel, or the name of a set.
        window: collapses that are fitted, up to the rebound's maximum after the last; "all" for the whole recording.
            Default: 3, or as many as there are, unless `end` is given.
        end: s after R_max at which the window ends at the latest.
        stretch: R_max/R_0 where it is known; "plateau": free, with the late plateau as prior; default: free.
        free: of "t0" (the clock: true time of R_max minus fitted one), "scale" (radius calibration: true radius over
            measured one) and "rmax" (R_max of the motion over that read off the curve, the calibration being right).
        t0_bound: s, largest |t0|; default half a frame interval. scale_bound: largest deviation of the others from 1.
        weights: "motion" (frames count less where the wall moves fast) or "equal".
        windows: fit windows of 1, 2, 3 and all collapses too, for comparison: `Posterior.windows`.
        contents: of the bubble, "equilibrium" (the field's model) or "kinetic" (vapour condenses at a finite rate).
        accommodation: of kinetic contents, above 0 and at most 10, or "free", from 0.01 to 1.
        damage: "none", or "first-rebound": from there on the law has another modulus and stress-free radius.
        wall_inertia, wall_distance, vapour_excess: as in `simulate`; the first and the last may be "free".
        joint: curves of one group (meta "group") share the material; stretch and what is free are each shot's own.
        trust_input: doubts about the recording or its settings are said, but decide no verdict.
        verify, discrepancy: as those of `infer`; not of a joint fit, for it looks at each shot by itself.
        seed: of the draws, which are the Gaussian about the minimum (fit/covariance.py).
        done: called with the index of each curve and its answer (with `joint` that by itself) as it is found.

    A curve that cannot be fitted gives a Posterior without draws whose checks.message says why.

    Raises:
        InputError: unknown material or a setting out of its domain.
    """
    check_level(verify)
    told = "a verification looks at each shot by itself: leave out joint, or verify"
    require(not joint or verify == "none", told, "option.joint")
    expect_whole(seed, "seed", 0, "option.seed")
    curves, medium, family = several(curves), named(medium), Family(material)
    bubble = BubbleModel(contents, accommodation, damage, wall_inertia, wall_distance, vapour_excess)
    options = Options(window, end, stretch, free, t0_bound, scale_bound, weights, windows, bubble)
    solid = f"damage needs a law with an elastic part, {material} has none: leave out damage, or add a spring"
    require(damage == "none" or family.elastic, solid, "physics.damage_without_elasticity")
    if wall_distance is not None:  # too near for every curve; for some, those fail
        inertia_of(
            wall_distance, min((float(np.max(c.radius, initial=0.0, where=c.radius > 0)) for c in curves), default=0)
        )
    threads = cores(workers)
    inner = max(threads // max(len(curves), 1), 1)
    ranges = dict(zip(family.parameters, (10.0 ** family.bounds()).tolist(), strict=True))
    common = {
        "cavirheo": version("cavirheo"), "medium": asdict(medium), "options": asdict(options), "ranges": ranges
    }  # fmt: skip

    def doubted(answer: Posterior, alone: _Alone) -> Posterior:
        return replace(answer, checks=doubts.doubted(answer.checks, alone.doubts(), trust_input))

    def one(curve: RadiusCurve) -> tuple[Posterior, _Alone | None]:
        began = time.perf_counter()
        try:
            alone = _Alone(Experiment(curve, family, medium, options), inner)
            answer = doubted(_posterior(alone.fit, alone.found, alone.laplace, 0, alone, common, seed), alone)
        except Exception as error:  # of this curve alone
            names = tuple(LOG10 + name for name in family.parameters)
            nothing, checks = np.empty((0, len(names))), doubts.failed(error, curve, medium)
            told, alone = common | {"source_sha256": curve.source_sha256}, None
            answer = Posterior(
                names, units(names), nothing, checks, family.name, "least_squares", told, bubble=bubble
            )  # fmt: skip
        return replace(answer, seconds=time.perf_counter() - began), alone

    said = (lambda index, found: done(index, found[0])) if done and verify == "none" else None
    answered = each(one, curves, workers, said)
    answers = [answer for answer, _ in answered]
    groups: dict[Any, dict[int, _Alone]] = {}
    for i, (curve, (_, single)) in enumerate(zip(curves, answered, strict=True)):
        if joint and single:
            groups.setdefault((curve.group, curve.group_source), {})[i] = single
    for members in groups.values():
        began = time.perf_counter()
        together = _joint(list(members.values()), common, seed, threads)
        seconds = (time.perf_counter() - began) / len(members)
        for i, answer in zip(members, together, strict=True):
            before, checks = answers[i], answers[i].checks
            by_itself = {"verdict": checks.verdict, "rmse_over_rmax": checks.rmse_over_rmax, "best": before.best}
            provenance = answer.provenance | {"alone": by_itself}
            answer = replace(answer, provenance=provenance, seconds=before.seconds + seconds)
            answers[i] = doubted(answer, members[i])
    if verify == "none":
        return answers
    from cavirheo.inference.verify import verify_many

    camera: dict[str, Any] = {"t0_bound": t0_bound, "scale_bound": scale_bound} | ({"free": free} if free else {})
    settings: dict[str, Any] = {"level": verify, "medium": medium, "stretch": stretch, "discrepancy": discrepancy}
    return verify_many(curves, answers, seed=seed, workers=workers, done=done, **settings, **camera)


class _Alone:
    """The fit of one curve by itself: every window from the starts of one scan and from the answer of the window
    before it, for the first collapses leave fewer minima than the long window, where a rebound can slip by a period."""

    def __init__(self, shot: Experiment, workers: int) -> None:
        self.shot = shot
        self.fit = LeastSquares([shot], workers)
        cuts: list[Any] = [(n, None) for n in WINDOWS if n is None or n <= shot.shown] if shot.options.windows else []
        shot.set_window(*(cuts[-1] if cuts else shot.cut))
        scan = Scan(self.fit)
        self.search = scan.counts
        found: dict[Any, tuple[Minimum, Floats]] = {}  # minimum and sigma of each window
        every = list(dict.fromkeys([*cuts, shot.cut]))
        before: list[Floats] = []
        for cut in every:
            shot.set_window(*cut)
            starts = [*before, *scan.best(shot, 2 if before else BEST)]
            minimum = self.fit.settle(starts, enough=FOLLOWED if before else 0.0)
            found[cut], before = (minimum, shot.sigma), [minimum.x]
        for cut, longer in reversed(list(pairwise(every))):  # a few frames may have held a search in a side valley
            shot.set_window(*cut)
            found[cut] = self._better(*found[cut], found[longer][0].x)
        self.windows: dict[str, WindowAnswer] = {}
        for cut in cuts:
            shot.set_window(*cut)
            self.windows[str(cut[0] or "all")] = self._window_answer(found[cut][0].x)
        shot.set_window(*shot.cut)
        self.found, shot.sigma = found[shot.cut]
        self.laplace = laplace(self.fit, self.found.x)

    def doubts(self) -> list[str]:
        """About the curve, whether or not it was fitted with others."""
        shot, x, said = self.shot, self.found.x, doubts.plain(self.shot.curve, self.shot.medium)
        if shot.free.get("time_origin", (0.0, 0.0))[1] >= shot.frame:  # the interval holds such a clock already
            return said
        for difference, other in doubts.readings(shot.curve, spikes=False):  # spikes do not count in a fit
            there = Experiment(other, shot.family, shot.medium, shot.options)
            there.set_window(None, (shot.view.end + shot.frame) * (1.0 + 1e-9))  # to the same frame
            # one Gauss-Newton step from the minimum to that of the same frames on the other clock
            slope, seen, moved = self.fit.jacobian(x, FINE, central=False), shot.predict(x), there.predict(x)
            if seen and moved:
                frames = len(seen.radius)
                change = (moved.radius[-frames:] - seen.radius) / (shot.sigma * shot.noise_factor)
                step = np.linalg.lstsq(slope[:frames], change, rcond=None)[0]
                factors = dict(zip(shot.family.parameters, (10.0**step).tolist(), strict=False))
                said += doubts.moved(difference, factors)
        return said

    def _better(self, minimum: Minimum, sigma: Floats, start: Floats) -> tuple[Minimum, Floats]:
        """The minimum with its weights, or the one found from `start` if it is lower (both with measured weights)."""
        fit, shot = self.fit, self.shot
        here, there = (0.5 * float(np.sum(fit.residuals(x, QUICK) ** 2)) for x in (minimum.x, start))
        if there < here or here > 0.5 * FOLLOWED * len(shot.measured):
            other = fit.minimise(start, QUICK, SEARCH, [minimum.x])
            if other.cost < LOWER * here:
                return fit.settle([other.x]), shot.sigma
        return minimum, sigma

    def _window_answer(self, x: Floats) -> WindowAnswer:
        shot = self.shot
        (seen,) = self.fit.at(x, FINE)
        rmse = None if seen is None else float(np.sqrt(np.mean((shot.measured - seen.radius) ** 2)))
        best = {name: value for name, value in shot.best(x).items() if name not in FREE.values()}
        return WindowAnswer(best, float(shot.view.end / shot.time_scale), rmse, tuple(_at_bound(self.fit, x, 0)))


def _joint(singles: list[_Alone], common: dict[str, Any], seed: int, workers: int) -> list[Posterior]:
    """One material for all shots, each with the noise that its own fit left (variance times correlation time)."""
    law = singles[0].fit.common
    for single in singles:
        left = single.laplace.variance[0] * single.laplace.correlation[0]
        single.shot.noise_factor = max(1.0, float(np.sqrt(left)))  # no shot is believed more than its frames
    fit = LeastSquares([single.shot for single in singles], workers)
    alone = np.array([single.found.x[:law] for single in singles])
    own = np.concatenate([single.found.x[law:] for single in singles])
    starts = [np.concatenate([material, own]) for material in (np.median(alone, axis=0), np.mean(alone, axis=0))]
    found = fit.settle(starts, enough=1.5)
    worth = laplace(fit, found.x)
    spread = {
        name: {"mean": float(np.mean(values)), "std": float(np.std(values, ddof=1)) if len(values) > 1 else None}
        for name, values in zip(fit.family.parameters, (10.0**alone).T, strict=True)
    }
    together = common | {"joint": {"shots": len(singles), "alone": spread}}
    return [_posterior(fit, found, worth, k, single, together, seed) for k, single in enumerate(singles)]


def _at_bound(fit: LeastSquares, x: Floats, k: int) -> dict[str, str]:
    """Of the parameters of shot k that ended at a bound: by name, which."""
    found = {}
    shot, x = fit.shots[k], x[fit.columns[k]]
    low, high = fit.bounds[fit.columns[k]].T
    for i, name in enumerate(shot.names):
        for side, ends in (("lower", low), ("upper", high)):
            if abs(x[i] - ends[i]) < AT_BOUND * (high[i] - low[i]):
                found[name] = f"{name} at its {side} bound ({shot.best(ends)[name]:.4g})"
    return found


def _posterior(
    fit: LeastSquares, found: Minimum, worth: Laplace, k: int, alone: _Alone, common: dict[str, Any], seed: int
) -> Posterior:
    """The answer for shot k at a minimum; the draws of the material are the same for all shots of a joint fit."""
    shot, columns = fit.shots[k], fit.columns[k]
    x, covariance = found.x[columns], worth.covariance[np.ix_(columns, columns)]
    drawn = draws(found.x, worth.covariance, fit.bounds, DRAWS, seed, worth.freedom)[:, columns]
    names, theta = shot.answer(drawn)
    best, sigma = shot.best(x), np.sqrt(np.diag(covariance))
    bound = _at_bound(fit, found.x, k)
    one_sigma, correlations = {}, {}
    for i, name in enumerate(shot.names):
        free = name in shot.free
        one_sigma[name if free else LOG10 + name] = float(np.std(theta[:, i]) if free else sigma[i])
        for j, other in enumerate(shot.names[:i]):
            correlations[f"{other}, {name}"] = float(covariance[i, j] / (sigma[i] * sigma[j]))
    diagnostics = Diagnostics(
        stretch_source=_stretch_source(shot),
        free={name: best[name] for name in shot.free},
        one_sigma=one_sigma,
        correlations=correlations,
        frames=len(shot.measured),
        frames_per_independent_residual=worth.correlation[k],
        at_bound=tuple(bound),
        simulations=fit.runs,
        failed_simulations=fit.failures,
    )
    windows = {key: {**one.best, **vars(one)} for key, one in alone.windows.items()}
    for window in windows.values():
        del window["best"]
    told = {name: value for name, value in vars(diagnostics).items() if value is not None}
    provenance = common | told | {
        "source_sha256": shot.curve.source_sha256, "best": best, "stretch": best["stretch"],
        "windows": windows, "search": alone.search, "draws_seed": seed,
        "residual_variance_over_assumed": worth.variance[k],
    }  # fmt: skip
    return Posterior(
        names, units(names), theta, _checks(fit, found, k, bound, drawn), fit.family.name, "least_squares", provenance,
        best=best, stretch=best["stretch"], windows=alone.windows, diagnostics=diagnostics,
        bubble=shot.options.bubble,
    )  # fmt: skip


def _stretch_source(shot: Experiment) -> str:
    if shot.stretch:
        return "given"
    if shot.stretch_prior:
        value, deviation = shot.stretch_prior
        return f"fitted, with the late plateau ({value:.3g} ± {deviation:.2g}) as prior"
    return "fitted"


def _checks(fit: LeastSquares, found: Minimum, k: int, bound: dict[str, str], drawn: Floats) -> Checks:
    """The same check as that of `infer`: the answer simulated anew and laid over the window."""
    shot, columns = fit.shots[k], fit.columns[k]
    ends = shot.open_ends(drawn, *fit.bounds[columns].T)
    outside = ends or set(bound) & {*shot.family.parameters, "stretch"}
    verdict: Verdict = "outside_training_range" if outside else "ok"
    messages = list(bound.values())
    if wide := [text for name, text in ends.items() if name not in bound]:
        messages.append(f"the interval reaches the end of the range searched: {', '.join(wide)}")
    if shot.options.stretch == "plateau" and not shot.stretch_prior:
        messages.append("the curve has no late plateau: the stretch was fitted freely")
    messages += shot.spikes
    if not found.converged:
        messages.append("the search stopped at its limit of iterations")
    if len(fit.shots) > 1:
        messages.append(f"joint fit of {len(fit.shots)} shots with one material")
    return shot.checks(found.x[columns], verdict, messages)

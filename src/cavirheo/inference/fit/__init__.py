"""The field's conventional fit: least squares of simulated on measured radius histories (docs/method/fit.md)."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from itertools import product
from typing import Any, Concatenate, ParamSpec, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from cavirheo.curve import RadiusCurve, several
from cavirheo.errors import expect_whole, require
from cavirheo.inference import AUTO, check_level, input_checks
from cavirheo.inference.alternatives import chosen_among, compared, contenders, itself, judged, model_of
from cavirheo.inference.experiment import QUICK, Experiment
from cavirheo.inference.fit.covariance import laplace
from cavirheo.inference.fit.curve_fit import Alone, posterior
from cavirheo.inference.fit.least_squares import SEARCH, LeastSquares
from cavirheo.inference.law import Family, softened
from cavirheo.inference.options import FREED, SCALE_BOUND, Options, check_wall
from cavirheo.parallel import cores, each
from cavirheo.parameters import LOG10, units
from cavirheo.physics.bubble import Bubble, Requested, bubbles_of, rival_of
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as named
from cavirheo.posterior import Posterior

__all__ = ["fit", "fit_many"]

TOGETHER: dict[str, Any] = {**SEARCH, "max_nfev": 40}  # limits of a joint fit: it has many parameters
_TRIED = 6  # materials of single shots, at most, from which a joint fit is started


def fit_many(
    curves: Sequence[RadiusCurve],
    material: str = "nhkv",
    *,
    medium: Medium | str = WATER,
    window: int | str | None = None,
    end: float | None = None,
    stretch: float | str | None = None,
    free: Sequence[str] | str | None = None,
    t0_bound: float | None = None,
    scale_bound: float = SCALE_BOUND,
    weights: str = "learnt",
    windows: bool = True,
    bubble: Requested = "real",
    others: bool = True,
    draws: bool = True,
    joint: bool = False,
    trust_input: bool = False,
    verify: str = "none",
    discrepancy: bool = True,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """Nonlinear least squares on the simulated radius, from many starts.

    Args:
        curves: R(t), s and m.
        material: a law of `cavirheo laws` all of whose parameters are then fitted ("nhkv", "qkv", "zener", ...);
            "auto": the simplest of AUTO that the evidence does not reject, the others being in `Posterior.others`.
        medium: constants of the liquid or gel, or the name of a set.
        window: collapses that are fitted, up to the rebound's maximum after the last, at most a period; "all" for the
            whole recording. Default: 3, or as many as there are, unless `end` is given.
        end: s after R_max at which the window ends at the latest.
        stretch: R_max/R_0 where it is known; "plateau": free, with the late plateau as prior; "free"; default: free,
            with the stretch that the file states, if it does, as prior.
        free: of "t0" (the clock: true time of R_max minus fitted one), "scale" (radius calibration: true radius over
            measured one) and "rmax" (R_max of the motion over that read off the curve, the calibration being right);
            default: "t0,rmax", and all three in a verification.
        t0_bound: s, largest |t0|; default half a frame interval. scale_bound: largest deviation of the others from 1.
        weights: "equal", "motion" (frames count less where the wall moves fast) or "learnt" (the residuals tell).
        windows: fit windows of 1, 2, 3 and all collapses too, for comparison: `Posterior.windows`.
        bubble: "real" (vapour condenses at a finite rate, and the surroundings damp the motion), "field" (equilibrium
            contents, unbounded liquid), "auto" (both, and the evidence chooses as for materials), or a `Bubble`.
        others: fit the other of these two bubbles, too; what it and other valleys answer is in `Posterior.others`.
        draws: without them a point alone, from one round of the search: where a verification can begin.
        joint: curves of one group (meta "group") share the material; stretch and what is free are each shot's own.
        trust_input: doubts about the recording or its settings are said, but decide no verdict.
        verify: as that of `infer`; not of a joint fit, for it looks at each shot by itself.
        discrepancy: as that of `infer`.
        seed: of the draws, which are the Gaussian about the minimum (fit/covariance.py).
        workers: threads; default: all cores. The answers do not depend on it.
        done: called with the index of each curve and its answer (with `joint` that by itself) as it is found.

    Returns:
        An answer for each curve, in their order, SI. A curve that cannot be fitted gives a Posterior without draws
        whose checks.message says why.

    Raises:
        InputError: unknown material or a setting out of its domain.

    Source: docs/method/fit.md.
    """
    check_level(verify)
    told = "a verification looks at each shot by itself: leave out joint, or verify"
    require(not joint or verify == "none", told, "option.joint")
    expect_whole(seed, "seed", 0, "option.seed")
    curves, medium = several(curves), named(medium)
    bubbles = bubbles_of(bubble)
    told = "a joint fit is of one law and one bubble: leave out joint, or auto"
    several_models = material == "auto" or len(bubbles) > 1
    require(not joint or not several_models, told, "option.joint_auto")
    told = "without draws there is no evidence to choose by: leave out draws=False, or joint and auto"
    require(draws or not (joint or several_models), told, "option.draws")

    def options_of(bubble: Bubble) -> Options:
        clock = FREED if free is None else free
        return Options(window, end, stretch, clock, t0_bound, scale_bound, weights, windows, bubble)

    laws = softened(AUTO if material == "auto" else (material,), bubbles[0].damage)
    models = [(Family(law), options_of(one)) for law, one in product(laws, bubbles)]
    for kind in bubbles:
        check_wall(kind, curves)
    threads = cores(workers)
    inner = max(threads // max(len(curves), 1), 1)

    def common(shot: Experiment) -> dict[str, Any]:
        family = shot.family
        ranges = dict(zip(family.parameters, (10.0 ** family.bounds()).tolist(), strict=True))
        about = {"medium": asdict(medium), "options": asdict(shot.options), "ranges": ranges}
        return {"cavirheo": version("cavirheo"), **about}

    def doubted(answer: Posterior, alone: Alone) -> Posterior:
        return replace(answer, checks=input_checks.doubted(answer.checks, alone.doubts(), trust_input))

    def one(curve: RadiusCurve) -> tuple[Posterior, Alone | None]:
        began = time.perf_counter()
        try:
            alone, rest = _simplest(_fitted(curve, models, medium, inner, seed, draws=draws))
            rejected = len(rest)
            rival = rival_of(alone.shot.options.bubble) if others and alone.evidence else None
            unasked = [rival] if rival and rival not in bubbles else []
            more = [(alone.shot.family, replace(options_of(one), windows=False)) for one in unasked]
            rest += _fitted(curve, more, medium, inner, seed, alone)
            answer = posterior(alone.fit, alone.found, alone.laplace, 0, alone, common(alone.shot), seed)
            beside = [posterior(one.fit, one.found, one.laplace, 0, one, {}, seed) for one in rest]
            answer = replace(answer, others=(*answer.others, *map(itself, beside)))
            checks = judged(answer, chosen_among(answer, beside[:rejected]))
            answer = doubted(replace(answer, checks=checks), alone)
        except Exception as error:  # of this curve alone
            family, options = models[0]
            names = tuple(LOG10 + name for name in family.parameters)
            nothing, checks = np.empty((0, len(names))), input_checks.failed(error, curve, medium)
            about = {"medium": asdict(medium), "options": asdict(options), "source_sha256": curve.source_sha256}
            alone, bubble = None, options.bubble
            answer = Posterior(
                names, units(names), nothing, checks, family.name, "least_squares", about, bubble=bubble
            )  # fmt: skip
        return replace(answer, seconds=time.perf_counter() - began), alone

    said = (lambda index, found: done(index, found[0])) if done and verify == "none" else None
    with threadpool_limits(1, "blas"):  # BLAS' own threads would only wait for each other beside these
        answered = each(one, curves, workers, said)
    answers = [answer for answer, _ in answered]
    groups: dict[Any, dict[int, Alone]] = {}
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
            rivals = tuple(one for one in before.others if model_of(one) != model_of(before))
            told = "; ".join(f"{said}, of this shot by itself" for said in compared(replace(before, others=rivals)))
            checks = replace(answer.checks, message="; ".join(filter(None, [answer.checks.message, told])))
            about: Any = {"checks": checks, "others": (*answer.others, *rivals), "provenance": provenance}
            answers[i] = doubted(replace(answer, seconds=before.seconds + seconds, **about), members[i])
    if verify == "none":
        return answers
    from cavirheo.inference.verify import verify_many

    camera: dict[str, Any] = {"t0_bound": t0_bound, "scale_bound": scale_bound} | (
        {} if free is None else {"free": free}
    )
    settings: dict[str, Any] = {"level": verify, "medium": medium, "stretch": stretch, "discrepancy": discrepancy}
    return verify_many(curves, answers, seed=seed, workers=workers, done=done, **settings, **camera)


P = ParamSpec("P")


class OfOne(Protocol[P]):
    """To type checkers: a function of one curve with the options of one of many."""

    def __call__(self, curve: RadiusCurve, *args: P.args, **kwargs: P.kwargs) -> Posterior: ...


def _with_options_of(
    many: Callable[Concatenate[Sequence[RadiusCurve], P], list[Posterior]],
) -> Callable[[Callable[..., Posterior]], OfOne[P]]:
    return lambda one: one


@_with_options_of(fit_many)
def fit(curve: RadiusCurve, material: str = "nhkv", **options: Any) -> Posterior:
    """The parameters of a law whose simulation follows one measured curve best.

    Args:
        curve: R(t), s and m.
        material: a law of `cavirheo laws`, or "auto".
        options: those of `fit_many`.

    Returns:
        The answer, SI; one without draws says in its checks.message why it failed.

    Raises:
        InputError: as `fit_many`.

    Source: docs/method/fit.md.
    """
    return fit_many([curve], material, **options)[0]


def _fitted(
    curve: RadiusCurve,
    models: Sequence[tuple[Family, Options]],
    medium: Medium,
    workers: int,
    seed: int,
    near: Alone | None = None,
    draws: bool = True,
) -> list[Alone]:
    """The fits of these models; one that fails is left out, unless all do. `near`: a fit of the same law."""
    found: list[Alone] = []
    for number, (family, options) in enumerate(models):
        try:
            shot = Experiment(curve, family, medium, options)
            starts = [] if near is None else [shot.from_best(near.shot.best(near.found.x))]
            found.append(Alone(shot, workers, starts, seed, draws))
        except Exception:
            if not found and near is None and number == len(models) - 1:
                raise
    return found


def _simplest(fits: list[Alone]) -> tuple[Alone, list[Alone]]:
    """The fit with the fewest parameters of those that the evidence cannot tell from the best, and the others."""
    if len(fits) == 1:
        return fits[0], []
    chosen, *_ = contenders([one.evidence for one in fits], [len(one.shot.names) for one in fits]) or [0]
    return fits[chosen], [single for i, single in enumerate(fits) if i != chosen]


def _joint(
    singles: list[Alone], common: Callable[[Experiment], Mapping[str, Any]], seed: int, workers: int
) -> list[Posterior]:
    """One material for all shots, each with the noise that a fit leaves in it."""
    law = singles[0].fit.common
    fit = LeastSquares([single.shot for single in singles], workers)
    alone = np.array([single.found.x[:law] for single in singles])
    own = np.concatenate([single.found.x[law:] for single in singles])
    materials = [np.median(alone, axis=0), np.mean(alone, axis=0), *alone[:: len(alone) // _TRIED + 1]]
    starts = [np.concatenate([material, own]) for material in materials]
    starts.sort(key=lambda x: float(np.sum(fit.residuals(x, QUICK) ** 2)))
    found = min((fit.minimise(x, QUICK, TOGETHER) for x in starts[:2]), key=lambda minimum: minimum.cost)
    found = fit.polish(found.x, TOGETHER)
    worth = laplace(fit, found.x)
    spread = {
        name: {"mean": float(np.mean(values)), "std": float(np.std(values, ddof=1)) if len(values) > 1 else None}
        for name, values in zip(fit.family.parameters, (10.0**alone).T, strict=True)
    }
    joint = {"joint": {"shots": len(singles), "alone": spread}}
    return [
        posterior(fit, found, worth, k, single, {**common(single.shot), **joint}, seed)
        for k, single in enumerate(singles)
    ]

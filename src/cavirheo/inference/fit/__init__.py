"""The field's conventional fit: least squares of simulated on measured radius histories (docs/fit.md).

| module | does |
|---|---|
| parameters | the law's and the shots' parameters, their ranges; the options |
| shots | frames, weights, simulation at the frames |
| search | starts, residuals, finite differences, the minimum |
| covariance | what the minimum is worth, draws |
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from importlib.metadata import version
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.fit.covariance import Laplace, draws, laplace
from cavirheo.inference.fit.parameters import AT_BOUND, SCALE_BOUND, Family, Settings, units
from cavirheo.inference.fit.search import SEARCH, Fit, Minimum, Scan
from cavirheo.inference.fit.shots import FINE, QUICK, Shot
from cavirheo.inference.reconstruct import MISFIT, Reconstruction, Window, reconstruct
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Checks, Posterior, Verdict

__all__ = ["fit", "fit_many", "overlaid"]

DRAWS = 4096
WINDOWS: tuple[int | None, ...] = (1, 2, 3, None)  # collapses; None: all that was recorded
BEST = 3  # rough simulations from which a search is started
FOLLOWED = 1.0  # residual variance over the assumed one below which one start is enough
LOWER = 0.95  # of a minimum's cost, that another minimum must reach to replace it

Floats = NDArray[np.float64]


def fit(curve: RadiusCurve, material: str = "nhkv", **options: Any) -> Posterior:
    """The parameters of a law whose simulation follows one measured curve best; options as `fit_many`."""
    return fit_many([curve], material, **options)[0]


def fit_many(
    curves: Sequence[RadiusCurve],
    material: str = "nhkv",
    *,
    medium: Medium = WATER,
    window: int | str | None = None,
    end: float | None = None,
    stretch: float | str | None = None,
    free: Sequence[str] = (),
    t0_bound: float | None = None,
    scale_bound: float = SCALE_BOUND,
    weights: str = "motion",
    windows: bool = True,
    joint: bool = False,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[], None] | None = None,
) -> list[Posterior]:
    """Nonlinear least squares on the simulated radius, from many starts; one answer per curve, in their order.

    Args:
        material: a law of `cavirheo laws` all of whose parameters are then fitted ("nhkv", "newtonian", "qkv",
            "zener", ...).
        medium: constants of the liquid or gel.
        window: collapses that are fitted, up to the rebound's maximum after the last; "all" for the whole recording.
            Default: 3, or as many as there are, unless `end` is given.
        end: s after R_max at which the window ends at the latest.
        stretch: R_max/R_0 where it is known; "plateau": free, with the late plateau as prior; default: free.
        free: of "t0" (the clock: true time of R_max minus fitted one), "scale" (radius calibration: true radius over
            measured one) and "rmax" (R_max of the motion over that read off the curve, the calibration being right).
        t0_bound: s, largest |t0|; default half a frame interval. scale_bound: largest deviation of the others from 1.
        weights: "motion" (frames count less where the wall moves fast; fit/shots.py) or "equal".
        windows: fit windows of 1, 2, 3 and all collapses too, for comparison: provenance["windows"].
        joint: curves of one group (meta "group") share the material; stretch and what is free are each shot's own.
        seed: of the draws, which are the Gaussian about the minimum (fit/covariance.py).
        done: called after each curve.

    A curve that cannot be fitted gives a Posterior without draws whose checks.message says why.

    Raises:
        InputError: unknown material or a setting out of its domain.
    """
    family = Family(material)
    settings = Settings(window, end, stretch, tuple(free), t0_bound, scale_bound, weights, windows)
    cores = workers or os.cpu_count() or 1
    inner = max(cores // max(len(curves), 1), 1)
    common = _common_provenance(family, settings, medium)

    def one(curve: RadiusCurve) -> tuple[Posterior, Single | None]:
        began = time.perf_counter()
        single = None
        try:
            single = Single(Shot(curve, family, medium, settings), inner)
            answer = single.posterior(common, seed)
        except (InputError, SolverError) as error:
            single, answer = None, _failed(family, curve, common, str(error))
        if done:
            done()
        return replace(answer, seconds=time.perf_counter() - began), single

    with ThreadPoolExecutor(min(cores, max(len(curves), 1))) as pool:
        answered = list(pool.map(one, curves))
    answers = [answer for answer, _ in answered]
    groups: dict[Any, list[int]] = {}
    for i, (curve, (_, single)) in enumerate(zip(curves, answered, strict=True)):
        if joint and single is not None:
            groups.setdefault((curve.group, curve.group_source), []).append(i)
    for members in groups.values():
        began = time.perf_counter()
        together = _joint([single for i in members if (single := answered[i][1])], common, seed, cores)
        each = (time.perf_counter() - began) / len(members)
        for i, answer in zip(members, together, strict=True):
            checks = answers[i].checks
            alone = {"verdict": checks.verdict, "rmse_over_rmax": checks.rmse_over_rmax}
            provenance = answer.provenance | {"alone": alone | {"best": answers[i].provenance["best"]}}
            answers[i] = replace(answer, provenance=provenance, seconds=answers[i].seconds + each)
    return answers


class Single:
    """The fit of one curve by itself: every window from the starts of one scan and from the answer of the window
    before it, for the first collapses leave fewer minima than the long window, where a rebound can slip by a period."""

    def __init__(self, shot: Shot, workers: int) -> None:
        self.shot = shot
        self.fit = Fit(shot.family, [shot], workers)
        settings = shot.settings
        self.cut = shot.cut
        cuts = [(n, None) for n in shot.candidates(WINDOWS)] if settings.windows else []
        shot.set_window(*((None, None) if settings.windows else self.cut))
        scan = Scan(self.fit)
        found: dict[Any, tuple[Minimum, Floats]] = {}  # minimum and sigma of each window
        x: Floats | None = None
        every = list(dict.fromkeys([*cuts, self.cut]))
        for cut in every:
            shot.set_window(*cut)
            if x is None:
                minimum = self.fit.settle(scan.best(shot, BEST))
            else:
                minimum = self.fit.settle([x, *scan.best(shot, 2)], enough=FOLLOWED)
            found[cut], x = (minimum, shot.sigma), minimum.x
        for cut, longer in reversed(list(pairwise(every))):  # a few frames may have held a search in a side valley
            shot.set_window(*cut)
            found[cut] = self._better(*found[cut], found[longer][0].x)
        self.others: dict[str, Any] = {}
        for cut in cuts:
            shot.set_window(*cut)
            self.others["all" if cut[0] is None else str(cut[0])] = _summary(self.fit, found[cut][0].x)
        shot.set_window(*self.cut)
        self.found, shot.sigma = found[self.cut]
        self.laplace = laplace(self.fit, self.found.x)
        self.starts = scan.provenance

    def _better(self, minimum: Minimum, sigma: Floats, start: Floats) -> tuple[Minimum, Floats]:
        """The minimum with its weights, or the one found from `start` if it is lower (both with measured weights)."""
        fit, shot = self.fit, self.shot
        here = 0.5 * float(np.sum(fit.residuals(minimum.x, QUICK) ** 2))
        there = 0.5 * float(np.sum(fit.residuals(start, QUICK) ** 2))
        if there < here or here > 0.5 * FOLLOWED * len(shot.measured):
            other = fit.minimise(start, QUICK, SEARCH, [minimum.x])
            if other.cost < LOWER * here:
                return fit.settle([other.x]), shot.sigma
        return minimum, sigma

    def posterior(self, common: dict[str, Any], seed: int) -> Posterior:
        return _posterior(
            self.fit, self.found, self.laplace, 0, common | {"windows": self.others, "search": self.starts}, seed
        )


def _joint(singles: list[Single], common: dict[str, Any], seed: int, workers: int) -> list[Posterior]:
    """One material for all shots, each with the noise that its own fit left (variance times correlation time)."""
    law = singles[0].fit.common
    for single in singles:
        left = single.laplace.variance[0] * single.laplace.correlation[0]
        single.shot.noise_factor = max(1.0, float(np.sqrt(left)))  # no shot is believed more than its frames
    fit = Fit(singles[0].shot.family, [single.shot for single in singles], workers)
    alone = np.array([single.found.x[:law] for single in singles])
    own = np.concatenate([single.found.x[law:] for single in singles])
    starts = [np.concatenate([material, own]) for material in (np.median(alone, axis=0), np.mean(alone, axis=0))]
    found = fit.settle(starts, enough=1.5)
    worth = laplace(fit, found.x)
    spread = {
        name: {"mean": float(np.mean(values)), "std": float(np.std(values, ddof=1)) if len(values) > 1 else None}
        for name, values in zip(fit.family.parameters, (10.0**alone).T, strict=True)
    }
    joint = {"shots": len(singles), "alone": spread}
    return [
        _posterior(
            fit, found, worth, k, common | {"windows": single.others, "search": single.starts, "joint": joint}, seed
        )
        for k, single in enumerate(singles)
    ]


def _summary(fit: Fit, x: Floats) -> dict[str, Any]:
    """The answer of another window, SI: parameters, RMSE over R_max, and which are at a bound."""
    (shot,) = fit.shots
    (prediction,) = fit.predictions([(shot, x)], FINE)
    natural = shot.own.natural(x[fit.common :])
    rmse = None if prediction is None else float(np.sqrt(np.mean((shot.measured - prediction.radius) ** 2)))
    return {
        **dict(zip(fit.family.parameters, (10.0 ** x[: fit.common]).tolist(), strict=True)),
        "stretch": float(natural["stretch"]),
        "t_star_end": float(shot.view.end / shot.time_scale),
        "rmse_over_rmax": rmse,
        "at_bound": list(_at_bound(fit, x, 0)),
    }


def _at_bound(fit: Fit, x: Floats, k: int) -> dict[str, str]:
    """Names of the parameters of shot k that ended at a bound, and which bound."""
    found = {}
    own = fit.shots[k].own
    for name, column in zip([*fit.family.parameters, *own.names], fit.columns(k), strict=True):
        low, high = fit.bounds[column]
        for end, side in ((low, "lower"), (high, "upper")):
            if abs(x[column] - end) < AT_BOUND * (high - low):
                at = fit.bounds[:, 0 if side == "lower" else 1][fit.columns(k)]
                value = own.natural(at[fit.common :])[name] if name in own.names else 10.0**end
                found[name] = f"{name} at its {side} bound ({value:.4g})"
    return found


def _posterior(fit: Fit, found: Minimum, worth: Laplace, k: int, provenance: dict[str, Any], seed: int) -> Posterior:
    """The answer for shot k at a minimum; the draws of the material are the same for all shots of a joint fit."""
    shot, law = fit.shots[k], fit.common
    columns = fit.columns(k)
    x, covariance = found.x[columns], worth.covariance[np.ix_(columns, columns)]
    drawn = draws(found.x, worth.covariance, fit.bounds, DRAWS, seed, worth.freedom)[:, columns]
    natural = shot.own.natural(x[law:])
    own = shot.own.natural(drawn[:, law:].T)
    names = (*(f"log10_{name}" for name in fit.family.parameters), *shot.own.names)
    theta = np.column_stack([drawn[:, :law], *(own[name] for name in shot.own.names)])
    sigma = np.sqrt(np.diag(covariance))
    plain = [name.removeprefix("log10_") for name in names]
    log10 = [*fit.family.parameters, "stretch"]
    one_sigma = {
        (f"log10_{name}" if name in log10 else name): float(value if name in log10 else np.std(own[name]))
        for name, value in zip(plain, sigma, strict=True)
    }
    pairs = [(i, j) for i in range(len(plain)) for j in range(i)]
    bound = _at_bound(fit, found.x, k)
    best = dict(zip(fit.family.parameters, (10.0 ** x[:law]).tolist(), strict=True))
    return Posterior(
        names, units(names), theta, _checks(fit, found, k, bound), fit.family.name, "least_squares",
        provenance | {
            "source_sha256": shot.curve.source_sha256,
            "best": best | {name: float(value) for name, value in natural.items()},
            "stretch": float(natural["stretch"]),
            "stretch_source": _stretch_source(shot),
            "free": {name: float(natural[name]) for name in shot.own.names if name != "stretch"},
            "one_sigma": one_sigma,
            "correlations": {
                f"{plain[j]}, {plain[i]}": float(covariance[i, j] / (sigma[i] * sigma[j])) for i, j in pairs
            },
            "residual_variance_over_assumed": worth.variance[k],
            "frames": len(shot.measured),
            "frames_per_independent_residual": worth.correlation[k],
            "at_bound": list(bound),
            "simulations": fit.runs,
            "failed_simulations": fit.failures,
            "draws_seed": seed,
        },
    )  # fmt: skip


def _stretch_source(shot: Shot) -> str:
    if not shot.settings.stretch_free:
        return "given"
    if shot.stretch_prior:
        value, deviation = shot.stretch_prior
        return f"fitted, with the late plateau ({value:.3g} ± {deviation:.2g}) as prior"
    return "fitted"


def _checks(fit: Fit, found: Minimum, k: int, bound: dict[str, str]) -> Checks:
    """The same check as that of `infer`: the answer simulated anew and laid over the window."""
    shot = fit.shots[k]
    seen = overlaid(fit, found.x, k)
    verdict: Verdict = "ok"
    messages = []
    if seen.rmse > MISFIT:
        verdict = "model_does_not_fit"
        messages.append(f"the simulation misses the measurement by {seen.rmse:.1%} of R_max RMS (limit {MISFIT:.0%})")
    if bound:
        messages.append("; ".join(bound.values()))
        if verdict == "ok" and any(name in bound for name in (*fit.family.parameters, "stretch")):
            verdict = "outside_training_range"
    if shot.settings.stretch == "plateau" and not shot.stretch_prior:
        messages.append("the curve has no late plateau: the stretch was fitted freely")
    if shot.spikes.any():
        messages.append(f"{np.count_nonzero(shot.spikes)} frames above both neighbours by 20 % of R_max do not count")
    if not found.converged:
        messages.append("the search stopped at its limit of iterations")
    if len(fit.shots) > 1:
        messages.append(f"joint fit of {len(fit.shots)} shots with one material")
    return seen.checks(shot.view, shot.time_scale, verdict, messages)


def overlaid(fit: Fit, x: Floats, k: int) -> Reconstruction:
    """`reconstruct` on the fitted clock and scale; what is drawn is put back on those of the measurement."""
    shot = fit.shots[k]
    natural = shot.own.natural(fit.of_shot(x, k)[fit.common :])
    scale, origin = natural["radius_scale"], natural["time_origin"]
    cut = shot.view.curve
    start = shot.max_radius * scale * natural["max_radius_factor"]
    maximum = (cut.time_of_max + origin, start)
    moved = replace(cut, radius=cut.radius * scale, radius_std=cut.radius_std * scale, maximum=maximum)
    view = Window(moved, shot.view.end - origin, shot.view.collapses)
    found = reconstruct(view, fit.family.material(x[: fit.common]), shot.medium, natural["stretch"])
    return replace(found, drawn_radius=found.drawn_radius / scale)


def _common_provenance(family: Family, settings: Settings, medium: Medium) -> dict[str, Any]:
    ranges = {name: (10.0**bounds).tolist() for name, bounds in zip(family.parameters, family.bounds(), strict=True)}
    return {"cavirheo": version("cavirheo"), "medium": asdict(medium), "options": asdict(settings), "ranges": ranges}


def _failed(family: Family, curve: RadiusCurve, common: dict[str, Any], message: str) -> Posterior:
    names = tuple(f"log10_{name}" for name in family.parameters)
    return Posterior(
        names, units(names), np.empty((0, len(names))), Checks("failed", message), family.name, "least_squares",
        common | {"source_sha256": curve.source_sha256},
    )  # fmt: skip

"""The field's conventional fit: least squares of simulated on measured radius histories (docs/method/fit.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Concatenate, ParamSpec, Protocol

from cavirheo.curve import RadiusCurve
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.options import FREED, SCALE_BOUND
from cavirheo.physics.bubble import Requested
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Posterior

__all__ = ["fit", "fit_many"]


def fit_many(
    curves: Sequence[RadiusCurve],
    material: str = "nhkv",
    *,
    medium: Medium | str = WATER,
    window: int | str | None = None,
    end: float | None = None,
    stretch: float | str | None = None,
    free: Sequence[str] | str = FREED,
    t0_bound: float | None = None,
    scale_bound: float = SCALE_BOUND,
    weights: str = "learnt",
    bubble: Requested = "real",
    others: bool = True,
    trust_input: bool = False,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """Nonlinear least squares on the simulated radius, from many starts, with weighted draws about the best.

    Args:
        curves: R(t), s and m.
        material: a law of `cavirheo laws` all of whose parameters are then fitted ("nhkv", "qkv", "zener", ...);
            "auto": the simplest of AUTO that the evidence does not reject, the others being in `Posterior.others`.
        medium: constants of the liquid or gel, or the name of a set.
        window: collapses that are fitted, up to the middle of the rebound after the last; "all" for the
            whole recording. Default: 3, or as many as there are, unless `end` is given.
        end: s after R_max at which the window ends at the latest.
        stretch: R_max/R_0 where it is known; "plateau": free, with the late plateau as prior; "free"; default: free,
            with the stretch that the file states, if it does, as prior.
        free: of "t0" (the clock: true time of R_max minus fitted one), "scale" (radius calibration: true radius over
            measured one) and "rmax" (R_max of the motion over that read off the curve, the calibration being right).
        t0_bound: s, largest |t0|; default: all times of R_max that the frames near it leave possible.
        scale_bound: largest deviation of the others from 1.
        weights: "learnt" (the residuals tell how much less frames count where the wall moves fast) or "equal".
        bubble: "real" (vapour condenses at a finite rate, and the surroundings damp the motion), "field" (equilibrium
            contents, unbounded liquid), "auto" (both, and the evidence chooses as for materials), or a `Bubble`.
        others: look at the other of these two bubbles, too; what it and other modes answer is in `Posterior.others`.
        trust_input: warnings on the recording or its settings are said, but decide no verdict.
        seed: of the draws.
        workers: threads; default: all cores. The answers do not depend on it.
        done: called with the index of each curve and its answer as it is found.

    Returns:
        An answer for each curve, in their order, SI. A curve that cannot be fitted gives a Posterior without draws
        whose checks.messages say why.

    Raises:
        InputError: unknown material or a setting out of its domain.

    Source: docs/method/fit.md.
    """
    camera: dict[str, Any] = {"free": free, "t0_bound": t0_bound, "scale_bound": scale_bound}
    cut: dict[str, Any] = {"window": window, "end": end, "stretch": stretch, "weights": weights}
    how: dict[str, Any] = {"medium": medium, "others": others, "trust_input": trust_input, "seed": seed}
    return Analysis("fit", material=material, bubble=bubble, **camera, **cut, **how).run(curves, workers, done)


P = ParamSpec("P")


class OfOne(Protocol[P]):
    """To type checkers: a function of one curve with the options of one of many."""

    def __call__(self, curve: RadiusCurve, *args: P.args, **kwargs: P.kwargs) -> Posterior: ...


def _with_options_of(
    many: Callable[Concatenate[Sequence[RadiusCurve], P], list[Posterior]],
) -> Callable[[Callable[..., Posterior]], OfOne[P]]:
    return lambda function: function


@_with_options_of(fit_many)
def fit(curve: RadiusCurve, material: str = "nhkv", **options: Any) -> Posterior:
    """The parameters of a law whose simulation follows one measured curve best.

    Args:
        curve: R(t), s and m.
        material: a law of `cavirheo laws`, or "auto".
        options: those of `fit_many`.

    Returns:
        The answer, SI; one without draws says in its checks.messages why it failed.

    Raises:
        InputError: as `fit_many`.

    Source: docs/method/fit.md.
    """
    return fit_many([curve], material, **options)[0]

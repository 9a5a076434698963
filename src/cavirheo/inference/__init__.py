"""RadiusCurve -> Posterior: `infer`, and the field's conventional fit, least squares of simulated on measured radius
histories (docs/method/fit.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, Protocol

from cavirheo.curve import RadiusCurve
from cavirheo.inference.analysis import AUTO, DEFAULT, Analysis
from cavirheo.inference.assumptions import FREED, SCALE_BOUND
from cavirheo.physics.bubble import Requested
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Posterior

__all__ = ["AUTO", "DEFAULT", "Analysis", "fit", "fit_many", "infer", "infer_many"]


def infer(
    curve: RadiusCurve,
    *,
    model: str | Path = DEFAULT,
    material: str | None = None,
    medium: Medium | str = WATER,
    stretch: float | str | None = None,
    window: int | None = None,
    trust_input: bool = False,
    bubble: Requested | None = None,
    verify: str = "auto",
    discrepancy: bool = True,
    seed: int = 0,
) -> Posterior:
    """The material's parameters from one measured curve, with checks that tell whether to trust them.

    Args:
        curve: R(t), s and m.
        model: a shipped model (`cavirheo models`) or the path of an .onnx file with its card. "posterior" gives draws
            and needs no other; "bdt-viscoelastic" and "bdt-viscous" are the paper's networks, which give one value.
        material: a law of `cavirheo laws`; default "auto": the average over nhkv, newtonian, power-law and fung +
            newtonian, each by its evidence ("nhkv" with verify "none").
        medium: constants of the liquid or gel, or the name of a set; its density sets G of soft gels as much as
            anything.
        stretch: R_max/R_0 if it is known; otherwise fitted, and what the file states of it is its prior; "free":
            without this prior.
        window: collapses over which answer and measurement are compared (and the stretch fitted); default: all that
            the network reads.
        trust_input: warnings on the recording or its settings are said, but decide no verdict.
        bubble: "real" (the default: vapour condenses at a finite rate, and the surroundings damp the motion), "field"
            (the default of the paper's networks: equilibrium contents, unbounded liquid), "auto" (both, and the
            evidence chooses), or a `Bubble`. With one that the network does not know the search begins all over the
            ranges, and takes some seconds. Beside the answer of the real bubble stands that of the field's, and the
            other way round.
        verify: "auto" (the default): the network's draws lead to a few hundred simulations that weigh draws by the
            likelihood, and to as many as "full" has where these cannot be trusted; "none": the network's own draws;
            "map": the posterior's maximum and the Gaussian about it; "full": more weighted draws, from starts all over
            the ranges. For a network that gives one value, "auto" is "none".
        discrepancy: whether the verification (inference/verify) allows for what no simulation follows.
        seed: of its draws.

    Returns:
        The answer, SI. A curve that cannot be answered gives a Posterior without draws whose checks.messages say why.

    Raises:
        InputError: unknown model, or a setting out of its domain.

    Source: docs/method/posterior.md.
    """
    analysis = Analysis(
        "infer", model, material, bubble, medium, stretch, window, trust_input, verify, discrepancy, seed=seed
    )
    return analysis.run([curve])[0]


def infer_many(
    curves: Sequence[RadiusCurve],
    *,
    model: str | Path = DEFAULT,
    material: str | None = None,
    medium: Medium | str = WATER,
    stretch: float | str | None = None,
    window: int | None = None,
    trust_input: bool = False,
    bubble: Requested | None = None,
    verify: str = "auto",
    discrepancy: bool = True,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """`infer` for many curves on all cores; what is not named here is as there.

    Args:
        curves: R(t), s and m.
        workers: cores that are used, by default all that this process may use: from two curves on, by a process
            each. The answers do not depend on it.
        done: called with the index and the answer of each curve as it is found, verified if that is asked.

    Returns:
        An answer for each curve, in their order.

    Raises:
        InputError: as `infer`.

    Source: docs/method/posterior.md.
    """
    analysis = Analysis(
        "infer", model, material, bubble, medium, stretch, window, trust_input, verify, discrepancy, seed=seed
    )
    return analysis.run(curves, workers, done)


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
        workers: cores that are used, by default all that this process may use: from two curves on, by a process
            each. The answers do not depend on it.
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

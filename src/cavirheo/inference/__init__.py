"""From a RadiusCurve to a Posterior: `infer`, and `fit`, the same under the noise of the field's conventional
least-squares fit (docs/method/fit.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, Protocol

from cavirheo.curve import RadiusCurve
from cavirheo.inference.analysis import DEFAULT, Analysis
from cavirheo.inference.assumptions import FREE_BY_DEFAULT, SCALE_BOUND
from cavirheo.physics.bubble import Requested
from cavirheo.physics.media import Medium
from cavirheo.posterior import Posterior

__all__ = ["DEFAULT", "Analysis", "fit", "fit_many", "infer", "infer_many"]


def infer(
    curve: RadiusCurve,
    *,
    model: str | Path = DEFAULT,
    material: str | None = None,
    medium: Medium | str | None = None,
    stretch: float | str | None = None,
    window: int | None = None,
    trust_input: bool = False,
    bubble: Requested | None = None,
    discrepancy: bool = True,
    seed: int = 0,
) -> Posterior:
    """The material's parameters from one measured curve, with checks that tell whether to trust them.

    Args:
        curve: R(t), in s and m.
        model: "posterior" (the default: draws of an emulator, each weighed by a simulation), or "bdt-viscoelastic" or
            "bdt-viscous", the paper's networks, which give one value without an interval; a network of one's own is
            named by the folder of its run of `cavirheo train`, or by its .npz file.
        material: a law of `cavirheo laws`. Default "auto": a neo-Hookean spring beside a dashpot, in which G may be
            exactly 0 (a liquid) and the spring may stiffen; `Posterior.switches` has the probabilities.
        medium: constants of the liquid or gel, or the name of a set. Default: water, with the constants that the file
            of the curve states. G of soft gels depends strongly on the density.
        stretch: R_max/R_0 if it is known. Otherwise it is inferred, with the value that the file states as prior;
            "free": without this prior.
        window: number of collapses that are compared. Default: 3, or as many as there are; for a network, all that it
            reads.
        trust_input: input warnings are in the messages, but do not change the verdict.
        bubble: "real" (the default: vapour condenses at a finite rate, and the surroundings damp the motion; with the
            probability `switches["field_bubble"]` it is the field's), "field" (the default of the paper's networks:
            equilibrium contents, unbounded liquid), or a `Bubble`.
        discrepancy: whether the likelihood allows for differences that no simulation follows (inference/noise.py).
        seed: random seed of the draws.

    Returns:
        The answer in SI units. If the curve cannot be answered, it has no draws, and its checks.messages say why.

    Raises:
        InputError: unknown model, or a setting outside its domain.

    Source: docs/method/posterior.md.
    """
    analysis = Analysis("infer", model, material, bubble, medium, stretch, window, trust_input, discrepancy, seed)
    return analysis.run([curve])[0]


def infer_many(
    curves: Sequence[RadiusCurve],
    *,
    model: str | Path = DEFAULT,
    material: str | None = None,
    medium: Medium | str | None = None,
    stretch: float | str | None = None,
    window: int | None = None,
    trust_input: bool = False,
    bubble: Requested | None = None,
    discrepancy: bool = True,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """`infer` for many curves on all cores; arguments that are not listed are those of `infer`.

    Args:
        curves: R(t), in s and m.
        workers: number of cores; default: all that this process may use. From two curves on, each core runs a process.
            The answers do not depend on this number.
        done: called with the index and the finished answer of each curve when it is ready.

    Returns:
        An answer for each curve, in their order.

    Raises:
        InputError: as `infer`.

    Source: docs/method/posterior.md.
    """
    analysis = Analysis("infer", model, material, bubble, medium, stretch, window, trust_input, discrepancy, seed)
    return analysis.run(curves, workers, done)


def fit_many(
    curves: Sequence[RadiusCurve],
    material: str = "nhkv",
    *,
    medium: Medium | str | None = None,
    window: int | str | None = None,
    end: float | None = None,
    stretch: float | str | None = None,
    free: Sequence[str] | str = FREE_BY_DEFAULT,
    t0_bound: float | None = None,
    scale_bound: float = SCALE_BOUND,
    bubble: Requested = "real",
    trust_input: bool = False,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """The posterior under white noise of unknown size, as a least-squares fit takes it, with its best value.

    Args:
        curves: R(t), in s and m.
        material: a law of `cavirheo laws` ("nhkv", "qkv", "zener", ...), all of whose parameters are fitted, or "auto".
        medium: as in `infer`.
        window: number of collapses that are fitted, up to the middle of the rebound after the last one; "all": the
            whole recording. Default: 3, or as many as there are, unless `end` is given.
        end: latest end of the window, s after R_max.
        stretch: R_max/R_0 if it is known; "plateau": fitted, with the late plateau as prior; "free": fitted; default:
            fitted, with the stretch that the file states, if any, as prior.
        free: which of these are fitted: "t0" (clock: true time of R_max minus fitted one), "scale" (radius calibration:
            true radius over measured one) and "rmax" (R_max of the motion over that of the curve, at the right scale).
        t0_bound: largest |t0|, s; default: all times of R_max that the frames near it allow.
        scale_bound: largest deviation of scale and rmax from 1; that of rmax is larger if the noise requires it.
        bubble: as of `infer`.
        trust_input: input warnings are in the messages, but do not change the verdict.
        seed: random seed of the draws.
        workers: number of cores; default: all that this process may use. From two curves on, each core runs a process.
            The answers do not depend on this number.
        done: called with the index and the answer of each curve when it is ready.

    Returns:
        An answer for each curve, in their order, in SI units. If a curve cannot be fitted, its answer has no draws, and
        its checks.messages say why.

    Raises:
        InputError: unknown material or a setting outside its domain.

    Source: docs/method/fit.md.
    """
    camera: dict[str, Any] = {"free": free, "t0_bound": t0_bound, "scale_bound": scale_bound}
    cut: dict[str, Any] = {"window": window, "end": end, "stretch": stretch}
    general: dict[str, Any] = {"medium": medium, "trust_input": trust_input, "seed": seed}
    return Analysis("fit", material=material, bubble=bubble, **camera, **cut, **general).run(curves, workers, done)


P = ParamSpec("P")


class CurveFunction(Protocol[P]):
    """The type of a function of one curve that takes the options of a function of many curves."""

    def __call__(self, curve: RadiusCurve, *args: P.args, **kwargs: P.kwargs) -> Posterior: ...


def _with_options_of(
    many: Callable[Concatenate[Sequence[RadiusCurve], P], list[Posterior]],
) -> Callable[[Callable[..., Posterior]], CurveFunction[P]]:
    return lambda function: function


@_with_options_of(fit_many)
def fit(curve: RadiusCurve, material: str = "nhkv", **options: Any) -> Posterior:
    """The parameters of a law whose simulation follows one measured curve best.

    Args:
        curve: R(t), in s and m.
        material: a law of `cavirheo laws`, or "auto".
        options: those of `fit_many`.

    Returns:
        The answer in SI units. If the fit failed, it has no draws, and its checks.messages say why.

    Raises:
        InputError: as `fit_many`.

    Source: docs/method/fit.md.
    """
    return fit_many([curve], material, **options)[0]

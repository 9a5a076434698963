"""From a RadiusCurve to a Posterior: `infer`, and `fit`, the same under the noise of the field's conventional
least-squares fit (docs/method/posterior.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Unpack

from cavirheo.curve import RadiusCurve
from cavirheo.inference.analysis import DEFAULT, Analysis, FitSettings, InferSettings, takes_settings
from cavirheo.posterior import Posterior

__all__ = ["DEFAULT", "Analysis", "fit", "fit_many", "infer", "infer_many"]


@takes_settings(InferSettings)
def infer(curve: RadiusCurve, **settings: Unpack[InferSettings]) -> Posterior:
    """The material's parameters from one measured curve, with checks that tell whether to trust them.

    Args:
        curve: R(t), in s and m.
        settings: keywords:

            - model: "posterior" (the default: draws of an emulator, each weighed by a simulation), or
              "bdt-viscoelastic" or "bdt-viscous", the paper's networks, which give one value without an interval; a
              network of one's own is named by the folder of its run of `cavirheo train`, or by its .npz file.
            - material: a law of `cavirheo laws`. Default "auto": a neo-Hookean spring beside a dashpot, in which G may
              be exactly 0 (a liquid), the spring may stiffen, and a liquid may thin by a power law (its viscosity is
              that at 1e5 1/s); `Posterior.switches` has the probabilities.
            - medium: constants of the liquid or gel, or the name of a set. Default: water, with the constants that the
              file of the curve states. G of soft gels depends strongly on the density.
            - stretch: R_max/R_0 if it is known. Otherwise it is inferred, with the value that the file states as prior;
              "free": without this prior.
            - window: number of collapses that are compared. Default: 3, or as many as there are; for a network, all
              that it reads.
            - trust_input: input warnings are in the messages, but do not change the verdict.
            - bubble: "real" (the default: vapour condenses at a finite rate, and walls damp it and add inertia; with
              the probability `switches["field_bubble"]` it is the field's), "field" (the default of the paper's
              networks: equilibrium contents, unbounded liquid), or a `Bubble`.
            - discrepancy: whether the likelihood allows for differences that no simulation follows
              (inference/noise.py).
            - seed: random seed of the draws.

    Returns:
        The answer in SI units. If the curve cannot be answered, it has no draws, and its checks.messages say why.

    Raises:
        InputError: unknown model, or a setting outside its domain.

    Source: docs/method/posterior.md.
    """
    return Analysis("infer", **settings).run([curve])[0]


@takes_settings(InferSettings)
def infer_many(
    curves: Sequence[RadiusCurve],
    *,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
    **settings: Unpack[InferSettings],
) -> list[Posterior]:
    """`infer` for many curves on all cores.

    Args:
        curves: R(t), in s and m.
        workers: number of cores; default: all that this process may use. From two curves on, each core runs a process.
            The answers do not depend on this number.
        done: called with the index and the finished answer of each curve when it is ready.
        settings: keywords of `infer`.

    Returns:
        An answer for each curve, in their order.

    Raises:
        InputError: as `infer`.
    """
    return Analysis("infer", **settings).run(curves, workers, done)


@takes_settings(FitSettings)
def fit(curve: RadiusCurve, material: str = "nhkv", **settings: Unpack[FitSettings]) -> Posterior:
    """The posterior of one curve under white noise of unknown size, as a least-squares fit takes it, with its best
    value.

    Args:
        curve: R(t), in s and m.
        material: a law of `cavirheo laws` ("nhkv", "qkv", "zener", ...), all of whose parameters are fitted, or "auto".
        settings: keywords:

            - medium, trust_input, bubble, seed: as of `infer`.
            - window: number of collapses that are fitted, up to the middle of the rebound after the last one; "all":
              the whole recording. Default: 3, or as many as there are, unless `end` is given.
            - end: latest end of the window, s after R_max.
            - stretch: R_max/R_0 if it is known; "plateau": fitted, with the late plateau as prior; "free": fitted;
              default: fitted, with the stretch that the file states, if any, as prior.
            - free: which of these are fitted: "t0" (clock: true time of R_max minus fitted one), "scale" (radius
              calibration: true radius over measured one) and "rmax" (R_max of the motion over that of the curve, at the
              right scale). Default: t0 and rmax.

    Returns:
        The answer in SI units. If the fit failed, it has no draws, and its checks.messages say why.

    Raises:
        InputError: unknown material or a setting outside its domain.

    Source: docs/method/posterior.md.
    """
    return Analysis("fit", material=material, **settings).run([curve])[0]


@takes_settings(FitSettings)
def fit_many(
    curves: Sequence[RadiusCurve],
    material: str = "nhkv",
    *,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
    **settings: Unpack[FitSettings],
) -> list[Posterior]:
    """`fit` for many curves on all cores. workers, done: as of `infer_many`. settings: keywords of `fit`.

    Returns an answer for each curve, in their order. Raises InputError: as `fit`.
    """
    return Analysis("fit", material=material, **settings).run(curves, workers, done)

"""RadiusCurve -> Posterior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.inference.analysis import AUTO, DEFAULT, LEVELS, Analysis
from cavirheo.physics.bubble import Requested
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Posterior

__all__ = ["AUTO", "DEFAULT", "LEVELS", "Analysis", "infer", "infer_many"]


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
        workers: threads; default: all cores. The answers do not depend on it.
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

"""RadiusCurve -> Posterior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cavirheo.curve import RadiusCurve, several
from cavirheo.errors import expect_whole, require
from cavirheo.inference.amortised import Amortised
from cavirheo.inference.model import DEFAULT, load
from cavirheo.parallel import each
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as named
from cavirheo.posterior import CONTENTS, Posterior

__all__ = ["check_contents", "check_level", "infer", "infer_many"]

LEVELS = ("none", "map", "full")  # of verification (inference/verify)


def check_level(level: str) -> None:
    """Raises InputError for a level of verification that does not exist."""
    require(level in LEVELS, f"verify must be none, map or full, got {level!r}", "option.verify")


def check_contents(contents: str, verify: str) -> None:
    """Raises InputError for unknown contents of the bubble, or for some that no network was trained on."""
    told = f"contents must be {', '.join(CONTENTS)} or auto, got {contents!r}"
    require(contents in (*CONTENTS, "auto"), told, "option.contents")
    known = contents == "equilibrium" or verify != "none"
    require(known, "the networks know equilibrium contents: give verify map or full as well", "option.contents")


def infer(
    curve: RadiusCurve,
    *,
    model: str | Path = DEFAULT,
    medium: Medium | str = WATER,
    stretch: float | None = None,
    window: int | None = None,
    trust_input: bool = False,
    contents: str = "equilibrium",
    verify: str = "none",
    discrepancy: bool = True,
    seed: int = 0,
) -> Posterior:
    """The material's parameters from one measured curve, with the checks that sign or refuse them.

    Args:
        model: a shipped model (`cavirheo models`) or the path of an .onnx file with its card.
        medium: constants of the liquid or gel, or the name of a set; its density sets G of soft gels as much as
            anything.
        stretch: R_max/R_0 if it is known; fitted otherwise.
        window: collapses over which answer and measurement are compared (and the stretch fitted); default: all that
            the network reads.
        trust_input: doubts about the recording or its settings are said, but decide no verdict.
        contents: of the bubble, "equilibrium" (the field's model), "kinetic" (vapour condenses at a finite rate) or
            "auto": both, and the evidence chooses; the last two need a verification.
        verify: "map" (the posterior's maximum and the Gaussian about it) or "full" (draws weighted by full
            simulations); "none" leaves the network's answer.
        discrepancy, seed: of the verification (inference/verify): whether it allows for what no simulation follows,
            and of its draws.

    A curve that cannot be answered gives a Posterior without draws whose checks.message says why.

    Raises:
        InputError: unknown model, or a setting out of its domain.
    """
    settings: Any = {"trust_input": trust_input, "verify": verify, "discrepancy": discrepancy, "seed": seed}
    settings["contents"] = contents
    return infer_many([curve], model=model, medium=medium, stretch=stretch, window=window, **settings)[0]


def infer_many(
    curves: Sequence[RadiusCurve],
    *,
    model: str | Path = DEFAULT,
    medium: Medium | str = WATER,
    stretch: float | None = None,
    window: int | None = None,
    trust_input: bool = False,
    contents: str = "equilibrium",
    verify: str = "none",
    discrepancy: bool = True,
    seed: int = 0,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """`infer` for many curves on all cores, in their order; `done` is called with the index and the answer of each as
    it is found, verified if that is asked."""
    check_level(verify)
    check_contents(contents, verify)
    expect_whole(seed, "seed", 0, "option.seed")
    curves, liquid = several(curves), named(medium)
    estimator = Amortised(load(str(model)), liquid, stretch, window, trust_input)
    if verify == "none":
        return each(estimator.infer, curves, workers, done)
    from cavirheo.inference.verify import verify_many

    settings: Any = {"medium": liquid, "stretch": stretch, "discrepancy": discrepancy, "seed": seed}
    settings["contents"] = contents
    answers = each(estimator.infer, curves, workers)
    return verify_many(curves, answers, level=verify, workers=workers, done=done, **settings)

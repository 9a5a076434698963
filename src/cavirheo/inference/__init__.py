"""RadiusCurve -> Posterior."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from cavirheo.curve import RadiusCurve
from cavirheo.errors import require
from cavirheo.inference.amortised import Amortised
from cavirheo.inference.model import DEFAULT, load
from cavirheo.parallel import each
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import Posterior

__all__ = ["check_level", "infer", "infer_many"]

LEVELS = ("none", "map", "full")  # of verification (inference/verify)


def check_level(level: str) -> None:
    """Raises InputError for a level of verification that does not exist."""
    require(level in LEVELS, f"verify must be none, map or full, got {level!r}", "option.verify")


def infer(
    curve: RadiusCurve,
    *,
    model: str = DEFAULT,
    medium: Medium = WATER,
    stretch: float | None = None,
    window: int | None = None,
    trust_input: bool = False,
) -> Posterior:
    """The material's parameters from one measured curve, with the checks that sign or refuse them.

    Args:
        model: a shipped model (`cavirheo models`) or the path of an .onnx file with its card.
        medium: constants of the liquid or gel; its density sets G of soft gels as much as anything.
        stretch: R_max/R_0 if it is known; fitted otherwise.
        window: collapses over which answer and measurement are compared (and the stretch fitted); default: all that
            the network reads.
        trust_input: doubts about the recording or its settings are said, but decide no verdict.

    A curve that cannot be answered gives a Posterior without draws whose checks.message says why.

    Raises:
        InputError: unknown model, or a setting out of its domain.
    """
    return infer_many([curve], model=model, medium=medium, stretch=stretch, window=window, trust_input=trust_input)[0]


def infer_many(
    curves: Sequence[RadiusCurve],
    *,
    model: str = DEFAULT,
    medium: Medium = WATER,
    stretch: float | None = None,
    window: int | None = None,
    trust_input: bool = False,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """`infer` for many curves on all cores, in their order; `done` is called with the index and the answer of each as
    it is found."""
    estimator = Amortised(load(model), medium, stretch, window, trust_input)
    return each(estimator.infer, curves, workers, done)

"""RadiusCurve -> Posterior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from cavirheo.curve import RadiusCurve, several
from cavirheo.errors import expect_whole, require
from cavirheo.inference.bdt import Amortised
from cavirheo.inference.budget import POSTERIOR, Budget
from cavirheo.inference.law import softened
from cavirheo.inference.model import Network, card, path_of
from cavirheo.inference.options import Options, check_wall
from cavirheo.parallel import each
from cavirheo.physics.bubble import FIELD, Bubble, Requested, bubbles_of
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as named
from cavirheo.posterior import Posterior

__all__ = ["check_level", "check_models", "infer", "infer_many"]

DEFAULT = "posterior"  # model
AUTO = ("nhkv", "newtonian", "power-law", "fung + newtonian")  # laws of material="auto": gels and liquids
KNOWN_BUBBLES = "the real and the field's bubble, without damage, confinement inertia or excess of vapour"
LEVELS = ("auto", "none", "map", "full")  # of verification (inference/verify)


def check_level(level: str) -> None:
    """Raises InputError for a level of verification that does not exist."""
    require(level in LEVELS, f"verify must be auto, none, map or full, got {level!r}", "option.verify")


def bubbles_for(model: str | Path, requested: Requested | None) -> tuple[Bubble, ...]:
    """What is assumed of the bubble, by this network: the real one unless told, the field's by the paper's networks.

    Raises:
        InputError: no such bubble.
    """
    usual = "field" if card(path_of(str(model)))["kind"] == "point" else "real"
    return bubbles_of(usual if requested is None else requested)


def check_models(
    model: str | Path, material: str | None, bubble: Requested | None, verify: str, stretch: float | str | None = None
) -> None:
    """Raises InputError for a law, or a bubble, that cannot be or that this network cannot answer at this level of
    verification."""
    bubbles = bubbles_for(model, bubble)
    about = card(path_of(str(model)))
    for one in bubbles:
        check_wall(one)
        Options(bubble=one, stretch=stretch)
    if about["kind"] == "point":
        known = bubbles == (FIELD,) or verify not in ("auto", "none")
        message = f"the model {model} knows the field's bubble alone: leave out bubble or the model, or give verify map"
        require(known, message, "option.bubble")
        message = f"the model {model} answers {about['material']}: leave out material {material!r}, or the model"
        require(material in (None, about["material"]), message, "option.material")
        return
    message = "auto compares models by their evidence, which a verification finds: leave out --verify none"
    require(verify != "none" or (material != "auto" and len(bubbles) == 1), message, "option.auto")
    if material is not None:
        softened(_laws(material), bubbles[0].damage)
    if verify == "none":
        from cavirheo.inference.flow import kind_of

        message = f"the network by itself knows {KNOWN_BUBBLES}: leave out verify none"
        require(all(map(kind_of, bubbles)), message, "option.bubble")


def _laws(material: str | None) -> Sequence[str]:
    return AUTO if material == "auto" else (material or "nhkv",)


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
        material: a law of `cavirheo laws`, default "nhkv"; "auto": the simplest of nhkv, newtonian, power-law and
            fung + newtonian that the evidence does not reject.
        medium: constants of the liquid or gel, or the name of a set; its density sets G of soft gels as much as
            anything.
        stretch: R_max/R_0 if it is known; otherwise fitted, and what the file states of it is its prior; "free":
            without this prior.
        window: collapses over which answer and measurement are compared (and the stretch fitted); default: all that
            the network reads.
        trust_input: doubts about the recording or its settings are said, but decide no verdict.
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
        The answer, SI. A curve that cannot be answered gives a Posterior without draws whose checks.message says why.

    Raises:
        InputError: unknown model, or a setting out of its domain.

    Source: docs/method/posterior-network.md; of the paper's networks docs/method/amortised.md.
    """
    settings: Any = {"trust_input": trust_input, "verify": verify, "discrepancy": discrepancy, "seed": seed}
    settings |= {"material": material, "bubble": bubble}
    return infer_many([curve], model=model, medium=medium, stretch=stretch, window=window, **settings)[0]


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
    budget: Budget = POSTERIOR,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
) -> list[Posterior]:
    """`infer` for many curves on all cores; what is not named here is as there.

    Args:
        curves: R(t), s and m.
        budget: of weighted draws.
        workers: threads; default: all cores. The answers do not depend on it.
        done: called with the index and the answer of each curve as it is found, verified if that is asked.

    Returns:
        An answer for each curve, in their order.

    Raises:
        InputError: as `infer`.

    Source: docs/method/posterior-network.md.
    """
    check_level(verify)
    check_models(model, material, bubble, verify, stretch)
    expect_whole(seed, "seed", 0, "option.seed")
    curves, liquid, bubbles = several(curves), named(medium), bubbles_for(model, bubble)
    settings: Any = {"medium": liquid, "stretch": stretch, "discrepancy": discrepancy, "seed": seed}
    from cavirheo.inference.posterior_model import network_of

    network = network_of(str(model))
    if isinstance(network, Network):
        known: Any = None if stretch == "free" else stretch
        estimator = Amortised(network, liquid, known, window, trust_input)
        if verify in ("auto", "none"):
            return each(estimator.infer, curves, workers, done)
        from cavirheo.inference.verify import verify_many

        answers, settings["level"] = each(estimator.infer, curves, workers), verify
        return verify_many(curves, answers, bubble=bubbles, workers=workers, done=done, **settings)
    from cavirheo.inference.network_answer import Networked

    laws = softened(_laws(material), bubbles[0].damage)
    alone: Any = settings | {"window": window, "trust_input": trust_input, "checked": verify == "none"}
    estimators = [Networked(network, law, one, **alone) for law, one in product(laws, bubbles)]
    if verify == "none":
        return each(estimators[0].infer, curves, workers, done)
    from cavirheo.inference.verify import verify_many

    candidates = each(lambda curve: [one.infer(curve) for one in estimators], curves, workers)
    settings |= {"level": verify, "budget": budget}
    return verify_many(curves, candidates, network=network, workers=workers, done=done, **settings)

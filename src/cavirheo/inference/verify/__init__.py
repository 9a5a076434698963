"""Verification: draws of any proposal weighted by the likelihood of the full simulation (docs/method/posterior.md)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypedDict, Unpack

import numpy as np

from cavirheo.curve import RadiusCurve, several
from cavirheo.errors import expect
from cavirheo.inference.alternatives import as_alternative, chosen_among, contenders, judged, model_of
from cavirheo.inference.budget import Budget
from cavirheo.inference.input_checks import ERRORS, warned
from cavirheo.inference.law import Family
from cavirheo.inference.law_average import averaged_over_laws, comparable
from cavirheo.inference.posterior_network import PosteriorModel
from cavirheo.inference.verify.fitting import FitEstimation, SearchedEstimation
from cavirheo.inference.verify.model_average import answers_of
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.inference.verify.verification import Estimation, Level, Verification
from cavirheo.messages import Message, of_error
from cavirheo.parallel import cores, each
from cavirheo.physics.bubble import DAMAGED, REAL, Bubble, Requested, bubbles_of, rival_of
from cavirheo.physics.media import Medium
from cavirheo.posterior import Diagnostics, OtherAnswer, Posterior, Verdict

_log = logging.getLogger(__name__)
__all__ = ["Verification", "VerificationOptions", "verify", "verify_many"]


class VerificationOptions(TypedDict, total=False):
    """The fields of `Verification` but for its threads."""

    stretch: float | str | None
    free: Sequence[str] | str
    t0_bound: float | None
    scale_bound: float
    level: Level
    medium: Medium | str
    discrepancy: bool
    search: bool
    weights: str | None
    rival: bool
    ranges: Mapping[str, Sequence[float]] | None
    budget: Budget
    seed: int
    network: PosteriorModel | None
    scanned: int


def verify(
    curve: RadiusCurve,
    answer: Posterior,
    *,
    bubble: Requested | None = None,
    workers: int | None = None,
    **settings: Unpack[VerificationOptions],
) -> Posterior:
    """`verify_many` of one curve."""
    return verify_many([curve], [answer], bubble=bubble, workers=workers, **settings)[0]


def verify_many(
    curves: Sequence[RadiusCurve],
    answers: Sequence[Posterior | Sequence[Posterior]],
    *,
    bubble: Requested | None = None,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
    **settings: Unpack[VerificationOptions],
) -> list[Posterior]:
    """Answers of any method brought to the maximum of the posterior and, with level "full", replaced by draws that the
    likelihood has weighted; on all cores, in their order. `settings` are those of `Verification`.

    `done` is called with the index and the answer of each as it is found. Law and window are the answer's. A failed
    answer stays as it is; one whose verification fails says so. bubble: as of `infer`, instead of the answer's. Of
    several answers for a curve, or several bubbles, the simplest is given whose evidence is not smaller than the
    largest by more than 3.
    """
    curves = several(curves)
    candidates: list[Any] = [list(one) if isinstance(one, list | tuple) else [one] for one in answers]
    for answer in (one for ones in candidates for one in ones):
        expect(answer, Posterior, "a Posterior to be verified, of infer or fit, for each curve")
    inner = max(cores(workers) // max(len(curves), 1), 1)
    how: dict[str, Any] = {**settings}  # a medium by its name, too
    chosen = Verification(workers=inner, **how)
    estimation = FitEstimation if chosen.weights else SearchedEstimation if chosen.search else Estimation
    bubbles = () if bubble is None else bubbles_of(bubble)

    def verified(pair: tuple[RadiusCurve, list[Posterior]]) -> Posterior:
        (curve, given), began = pair, time.perf_counter()
        models = [replace(answer, bubble=kind) for answer in given for kind in bubbles] or given
        found, problems = list[Posterior](), list[Posterior]()
        estimations = list[Estimation]()
        for model in models:
            if model.checks.verdict == "failed":
                problems.append(model)
                continue
            try:
                one = estimation(chosen, curve, model)
                if chosen.level == "auto":
                    estimations.append(one)
                else:
                    found.append(one.posterior())
            except ERRORS as error:  # of this shot alone
                problems.append(_failed(chosen, model, error))
        apart = bool(chosen.weights) or chosen.search  # a fit, and a law that is searched, are sampled by themselves
        for some in [[one] for one in estimations] if apart else [estimations] * bool(estimations):
            try:
                found += answers_of(some, chosen.budget)
            except ERRORS as error:  # of this shot alone
                problems.append(_failed(chosen, some[0].answer, error))
        if not found:
            return replace(problems[0], seconds=problems[0].seconds + time.perf_counter() - began)
        if len(models) == 1 and chosen.level == "auto" and not chosen.weights:
            (best,) = found
            found = [best, *_damaged(chosen, curve, best)]
        best = averaged_over_laws(found) if comparable(found) else _simplest(found)
        if chosen.rival:
            best = replace(best, others=(*best.others, *_rival(chosen, curve, best)))
        own = next((model for model in models if model_of(model) == model_of(best)), given[0])
        checked = own.checks.verdict != "check_input"
        said = [] if best.laws else chosen_among(best, found)
        checks = warned(judged(best, said), own.checks.warnings, trust_input=checked)
        before = sum(answer.seconds for answer in given)
        return replace(best, checks=checks, seconds=before + time.perf_counter() - began)

    return each(verified, zip(curves, candidates, strict=True), workers, done)


def _failed(settings: Verification, answer: Posterior, error: Exception) -> Posterior:
    """The answer with the reason why it could not be verified."""
    _log.debug("no answer by %s", answer.material, exc_info=error)
    why = of_error(error)
    if not settings.weights:
        why = Message("answer.unverified", {"reason": why.text})
    verdict: Verdict = "failed" if settings.level == "auto" else answer.checks.verdict
    checks = replace(answer.checks, verdict=verdict, messages=(*answer.checks.messages, why))
    return replace(answer, checks=checks)


def _simplest(found: Sequence[Posterior]) -> Posterior:
    """The simplest of those that the evidence cannot tell from the best, with what the others answer."""
    chosen, *_ = contenders([one.evidence for one in found], [len(one.names) for one in found]) or [0]
    best, rest = found[chosen], [one for i, one in enumerate(found) if i != chosen]
    known = {model_of(one) for one in found}
    modes = [one for one in best.others if model_of(one) == model_of(best)]
    others = [one for one in best.others if model_of(one) not in known]
    return replace(best, others=(*modes, *others, *map(as_alternative, rest)))


def _damaged(settings: Verification, curve: RadiusCurve, answer: Posterior) -> list[Posterior]:
    """The answer with damage by strain, where the real bubble in an elastic law leaves more than noise, and where
    Laplace's evidence of damage is not the smaller one: strong gels break in the first collapse
    (docs/real-bubbles.md)."""
    asked = answer.bubble == REAL and Family(answer.material).elastic and "shear_modulus" in answer.parameters
    left = answer.diagnostics.systematic_misfit_over_rmax or 0.0
    if not asked or left < TUNING.searched_above or len(answer.theta) < 2 or answer.bound("shear_modulus"):
        return []
    without = answer.evidence.log if answer.evidence else -np.inf
    return _again(replace(settings, network=None), curve, answer, DAMAGED, without)


def _rival(settings: Verification, curve: RadiusCurve, answer: Posterior) -> list[OtherAnswer]:
    """What the other of the real and the field's bubble answers beside a fit: its maximum, and the Gaussian there."""
    rival = rival_of(answer.bubble)
    if rival is None or any(model_of(one) == (answer.material, rival.name) for one in answer.others):
        return []
    how = replace(settings, level="map", weights=None, scanned=TUNING.rival_scanned)
    return [as_alternative(one) for one in _again(how, curve, answer, rival)]


def _again(
    settings: Verification, curve: RadiusCurve, answer: Posterior, bubble: Bubble, least: float = -np.inf
) -> list[Posterior]:
    """The answer once more, of another bubble; none where that fails, or where Laplace's log evidence of level "auto"
    is smaller than `least`."""
    other = replace(answer, bubble=bubble, others=(), windows={}, diagnostics=Diagnostics())
    try:
        estimation = Estimation(settings, curve, other)
        if settings.level == "map":
            return [estimation.posterior()]
        estimation.sampling.search_windows()
        return answers_of([estimation], settings.budget) if estimation.sampling.log_laplace >= least else []
    except ERRORS as error:
        _log.debug("%s has no answer of the %s", curve.name, bubble.title, exc_info=error)
        return []

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
from cavirheo.inference.alternatives import (
    as_alternative,
    averaged_over_laws,
    chosen_among,
    comparable,
    contenders,
    judged,
    model_of,
)
from cavirheo.inference.assumptions import Family
from cavirheo.inference.checks import ERRORS, warned
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
    seed: int
    network: PosteriorModel | None
    own_draws: int
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
    candidates: list[Any] = [list(item) if isinstance(item, list | tuple) else [item] for item in answers]
    for answer in (answer for starts in candidates for answer in starts):
        expect(answer, Posterior, "a Posterior to be verified, of infer or fit, for each curve")
    threads = max(cores(workers) // max(len(curves), 1), 1)
    arguments: dict[str, Any] = {**settings}  # a medium by its name, too
    verification = Verification(workers=threads, **arguments)
    estimator = FitEstimation if verification.weights else SearchedEstimation if verification.search else Estimation
    bubbles = () if bubble is None else bubbles_of(bubble)

    def verified(pair: tuple[RadiusCurve, list[Posterior]]) -> Posterior:
        (curve, starts), began = pair, time.perf_counter()
        models = [replace(answer, bubble=kind) for answer in starts for kind in bubbles] or starts
        posteriors, problems = list[Posterior](), list[Posterior]()
        estimations = list[Estimation]()
        settings = verification if len(models) == 1 else replace(verification, own_draws=TUNING.own_draws_each)
        for model in models:
            if model.checks.verdict == "failed":
                problems.append(model)
                continue
            try:
                estimation = estimator(settings, curve, model)
                if verification.level == "map":
                    posteriors.append(estimation.laplace())
                else:
                    estimations.append(estimation)
            except ERRORS as error:  # of this shot alone
                problems.append(_failed(verification, model, error))
        independent = bool(verification.weights) or verification.search  # a fit and a searched law are sampled alone
        for batch in [[estimation] for estimation in estimations] if independent else [estimations] * bool(estimations):
            try:
                posteriors += answers_of(batch)
            except ERRORS as error:  # of this shot alone
                problems.append(_failed(verification, batch[0].answer, error))
        if not posteriors:
            return replace(problems[0], seconds=problems[0].seconds + time.perf_counter() - began)
        if len(models) == 1 and verification.level != "map" and not verification.weights:
            (best,) = posteriors
            posteriors = [best, *_damaged(verification, curve, best)]
        best = averaged_over_laws(posteriors) if comparable(posteriors) else _simplest(posteriors)
        if verification.rival:
            best = replace(best, others=(*best.others, *_rival(verification, curve, best)))
        start = next((model for model in models if model_of(model) == model_of(best)), starts[0])
        checked = start.checks.verdict != "check_input"
        messages = [] if best.laws else chosen_among(best, posteriors)
        checks = warned(judged(best, messages), start.checks.warnings, trust_input=checked)
        before = sum(answer.seconds for answer in starts)
        return replace(best, checks=checks, seconds=before + time.perf_counter() - began)

    return each(verified, zip(curves, candidates, strict=True), workers, done)


def _failed(settings: Verification, answer: Posterior, error: Exception) -> Posterior:
    """The answer with the reason why it could not be verified."""
    _log.debug("no answer by %s", answer.material, exc_info=error)
    why = of_error(error)
    if not settings.weights:
        why = Message("answer.unverified", {"reason": why.text})
    verdict: Verdict = "failed" if settings.level != "map" else answer.checks.verdict
    checks = replace(answer.checks, verdict=verdict, messages=(*answer.checks.messages, why))
    return replace(answer, checks=checks)


def _simplest(answers: Sequence[Posterior]) -> Posterior:
    """The simplest of those that the evidence cannot tell from the best, with what the others answer."""
    chosen, *_ = contenders([answer.evidence for answer in answers], [len(answer.names) for answer in answers]) or [0]
    best, alternatives = answers[chosen], [answer for i, answer in enumerate(answers) if i != chosen]
    models = {model_of(answer) for answer in answers}
    modes = [mode for mode in best.others if model_of(mode) == model_of(best)]
    further_models = [alternative for alternative in best.others if model_of(alternative) not in models]
    return replace(best, others=(*modes, *further_models, *map(as_alternative, alternatives)))


def _damaged(settings: Verification, curve: RadiusCurve, answer: Posterior) -> list[Posterior]:
    """The answer with damage by strain, where the real bubble in an elastic law leaves more than noise, and where
    Laplace's evidence of damage is not the smaller one: strong gels break in the first collapse
    (docs/real-bubbles.md)."""
    damageable = answer.bubble == REAL and Family(answer.material).elastic and "shear_modulus" in answer.parameters
    misfit = answer.diagnostics.systematic_misfit_over_rmax or 0.0
    if not damageable or misfit < TUNING.searched_above or len(answer.theta) < 2 or answer.bound("shear_modulus"):
        return []
    log_undamaged = answer.evidence.log if answer.evidence else -np.inf
    return _verify_with_bubble(replace(settings, network=None), curve, answer, DAMAGED, log_undamaged)


def _rival(settings: Verification, curve: RadiusCurve, answer: Posterior) -> list[OtherAnswer]:
    """What the other of the real and the field's bubble answers beside a fit: its maximum, and the Gaussian there."""
    rival = rival_of(answer.bubble)
    if rival is None or any(model_of(alternative) == (answer.material, rival.name) for alternative in answer.others):
        return []
    map_settings = replace(settings, level="map", weights=None, scanned=TUNING.rival_scanned)
    return [as_alternative(posterior) for posterior in _verify_with_bubble(map_settings, curve, answer, rival)]


def _verify_with_bubble(
    settings: Verification, curve: RadiusCurve, answer: Posterior, bubble: Bubble, least: float = -np.inf
) -> list[Posterior]:
    """The answer once more, of another bubble; none where that fails, or where Laplace's log evidence is
    smaller than `least`."""
    start = replace(answer, bubble=bubble, others=(), windows={}, diagnostics=Diagnostics())
    try:
        estimation = Estimation(settings, curve, start)
        if settings.level == "map":
            return [estimation.laplace()]
        estimation.sampling.search_windows()
        return answers_of([estimation]) if estimation.sampling.log_laplace >= least else []
    except ERRORS as error:
        _log.debug("%s has no answer of the %s", curve.name, bubble.title, exc_info=error)
        return []

"""Verification: draws of any proposal weighted by the likelihood of the full simulation (docs/method/posterior.md)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.curve import RadiusCurve, as_curves
from cavirheo.errors import SolverError, expect
from cavirheo.inference.alternatives import (
    LEAST_PROBABILITY,
    LIMIT_PRIOR,
    as_alternative,
    averaged_over_laws,
    choice_messages,
    comparable,
    contenders,
    judged,
    model_of,
)
from cavirheo.inference.assumptions import Family
from cavirheo.inference.checks import ANALYSIS_ERRORS, MISFIT, warned
from cavirheo.inference.verify.fitting import FitEstimation, SearchedEstimation
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.inference.verify.verification import Estimation, Verification
from cavirheo.messages import Message, message_of_error
from cavirheo.parallel import one_blas_thread
from cavirheo.physics.bubble import DAMAGED, REAL, Bubble, Requested, bubbles_of, rival_of
from cavirheo.posterior import Diagnostics, OtherAnswer, Posterior

_log = logging.getLogger(__name__)
__all__ = ["Verification", "verify"]
_REPEATED = 4  # further turns, at most, after the last round of surrogates


@one_blas_thread
def verify(
    curve: RadiusCurve,
    answer: Posterior | Sequence[Posterior],
    *,
    bubble: Requested | None = None,
    workers: int | None = None,
    **settings: Any,
) -> Posterior:
    """The posterior of a curve, beginning with an answer of any method: with level "map" the maximum and the Gaussian
    about it, and otherwise draws that are weighted by the likelihood. `settings` are those of `Verification`.

    Law and window are those of the answer. A failed answer stays as it is; one whose verification fails has a message.
    bubble: as of `infer`, in place of the answer's. Of several laws the average is returned if all have weighted draws;
    of other models the simplest that the evidence does not reject. Raises InputError: no answer, or a setting out of
    its domain.
    """
    began, (curve,) = time.perf_counter(), as_curves([curve])
    starts: list[Any] = list(answer) if isinstance(answer, list | tuple) else [answer]
    for start in starts:
        expect(start, Posterior, "a Posterior to be verified, of infer or fit")
    verification = Verification(workers=workers, **settings)
    bubbles = () if bubble is None else bubbles_of(bubble)
    models = [replace(start, bubble=kind) for start in starts for kind in bubbles] or starts
    posteriors, problems = _answers(verification, curve, models)
    if not posteriors:
        return replace(problems[0], seconds=problems[0].seconds + time.perf_counter() - began)
    if len(models) == 1 and verification.level != "map" and not verification.weights:
        posteriors += _damaged(verification, curve, posteriors[0])
    best = averaged_over_laws(posteriors) if comparable(posteriors) else _simplest(posteriors)
    if verification.rival:
        best = replace(best, others=(*best.others, *_rival(verification, curve, best)))
    start = next((model for model in models if model_of(model) == model_of(best)), starts[0])
    messages = [] if best.laws else choice_messages(best, posteriors)
    checked = start.checks.verdict != "check_input"
    checks = warned(judged(best, messages), start.checks.warnings, trust_input=checked)
    before = sum(start.seconds for start in starts)
    return replace(best, checks=checks, seconds=before + time.perf_counter() - began)


def _answers(
    verification: Verification, curve: RadiusCurve, models: Sequence[Posterior]
) -> tuple[list[Posterior], list[Posterior]]:
    """The answers of the models, and the first answers, with a message, of the models that could not be verified."""
    posteriors, problems, estimations = list[Posterior](), list[Posterior](), list[Estimation]()
    estimator = FitEstimation if verification.weights else SearchedEstimation if verification.search else Estimation
    settings = verification if len(models) == 1 else replace(verification, network_draws=TUNING.network_draws_each)
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
        except ANALYSIS_ERRORS as error:  # of this shot alone
            problems.append(_failed(verification, model, error))
    independent = bool(verification.weights) or verification.search  # fits and searched laws are sampled one by one
    for batch in [[estimation] for estimation in estimations] if independent else [estimations] * bool(estimations):
        try:
            posteriors += answers_of(batch)
        except ANALYSIS_ERRORS as error:  # of this shot alone
            problems.append(_failed(verification, batch[0].answer, error))
    return posteriors, problems


def _failed(settings: Verification, answer: Posterior, error: Exception) -> Posterior:
    """The failed answer with a message on why it could not be verified; for level "map", an answer with draws keeps
    them."""
    _log.debug("no answer by %s", answer.material, exc_info=error)
    why = message_of_error(error)
    if not settings.weights:
        why = Message("answer.unverified", {"reason": why.text})
    if settings.level != "map" or not len(answer.theta):
        return answer.without_draws(why)
    return replace(answer, checks=replace(answer.checks, messages=(*answer.checks.messages, why)))


def _simplest(answers: Sequence[Posterior]) -> Posterior:
    """The simplest answer that the evidence does not reject, with the answers of the other models beside it."""
    chosen, *_ = contenders([answer.evidence for answer in answers], [len(answer.names) for answer in answers]) or [0]
    best, alternatives = answers[chosen], [answer for i, answer in enumerate(answers) if i != chosen]
    models = {model_of(answer) for answer in answers}
    modes = [mode for mode in best.others if model_of(mode) == model_of(best)]
    further_models = [alternative for alternative in best.others if model_of(alternative) not in models]
    return replace(best, others=(*modes, *further_models, *map(as_alternative, alternatives)))


def _damaged(settings: Verification, curve: RadiusCurve, answer: Posterior) -> list[Posterior]:
    """The answer with damage by strain, if the real bubble in an elastic law leaves more than noise and Laplace's
    evidence is not smaller with damage: strong gels break in the first collapse (docs/real-bubbles.md)."""
    damageable = answer.bubble == REAL and Family(answer.material).elastic and "shear_modulus" in answer.parameters
    misfit = answer.diagnostics.systematic_misfit_over_rmax or 0.0
    if not damageable or misfit < TUNING.large_misfit or len(answer.theta) < 2 or answer.bound("shear_modulus"):
        return []
    log_undamaged = answer.evidence.log if answer.evidence else -np.inf
    return _verify_with_bubble(replace(settings, network=None), curve, answer, DAMAGED, log_undamaged)


def _rival(settings: Verification, curve: RadiusCurve, answer: Posterior) -> list[OtherAnswer]:
    """The answer of the other of the real and the field's bubble beside a fit: the Gaussian about its maximum."""
    rival = rival_of(answer.bubble)
    if rival is None or any(model_of(alternative) == (answer.material, rival.name) for alternative in answer.others):
        return []
    map_settings = replace(settings, level="map", weights=None, scanned=TUNING.rival_scan_points)
    return [as_alternative(posterior) for posterior in _verify_with_bubble(map_settings, curve, answer, rival)]


def _verify_with_bubble(
    settings: Verification, curve: RadiusCurve, answer: Posterior, bubble: Bubble, least: float = -np.inf
) -> list[Posterior]:
    """The answer by another bubble; none if that fails, or if Laplace's log evidence is smaller than `least`."""
    start = replace(answer, bubble=bubble, others=(), windows={}, diagnostics=Diagnostics())
    try:
        estimation = Estimation(settings, curve, start)
        if settings.level == "map":
            return [estimation.laplace()]
        estimation.sampling.search_windows()
        estimation.sampling.refine()
        return answers_of([estimation]) if estimation.sampling.log_laplace >= least else []
    except ANALYSIS_ERRORS as error:
        _log.debug("%s has no answer of the %s", curve.name, bubble.title, exc_info=error)
        return []


def answers_of(estimations: Sequence[Estimation]) -> list[Posterior]:
    """The answer of each law, whose share in the average follows from its evidence; a law that is far less likely than
    the best has no answer.

    The real bubble has a limit, the field's bubble, in which condensation meets no resistance. A few simulations first
    give a rough evidence of each model. Models whose share is not negligible are then sampled, each with as many draws
    as its share needs (Hoeting et al. 1999, doi:10.1214/ss/1009212519).

    Answers have a message on each law that failed. Raises one of ANALYSIS_ERRORS: all laws failed.
    """
    laws = [law for law in estimations if _attempt(law, partial(getattr, law, "sampling"))]
    _refine(laws)
    laws = [law for law in laws if law.failure is None]
    if not laws:
        raise estimations[0].failure or SolverError("no law has an answer")
    if len(laws) > 1 and max(laws, key=lambda law: law.log_probability).sampling.misfit > MISFIT:
        for law in laws:  # a better mode may exist
            law.sampling.search_windows()
    limits: dict[int, Estimation] = {}
    by_share = sorted(enumerate(_shares(laws) if len(laws) > 1 else [1.0]), key=lambda pair: -pair[1])
    for i, share in by_share:
        law, real = laws[i], laws[i].answer.bubble == REAL
        above = [laws[k].log_probability - limit.log_probability for k, limit in limits.items()]
        unlike = max(above, default=-np.inf) > TUNING.limit_unlike
        limit = law.rival() if share > TUNING.share_small and not unlike else None
        if limit and _attempt(limit, partial(getattr, limit, "sampling")):
            limit.log_prior = np.log(LIMIT_PRIOR) if real else -np.inf
            limits[i] = limit
            _refine([law, limit])
        if real and (unlike or i in limits):
            law.log_prior = np.log(1.0 - LIMIT_PRIOR)
    counted = [law for law in (*laws, *limits.values()) if np.isfinite(law.log_prior)]
    _sample(counted)
    limits = {i: limit for i, limit in limits.items() if limit.failure is None}
    answers = []
    whole = dict(zip(map(id, counted), _shares(counted), strict=True))
    for i, law in enumerate(laws):
        share = whole[id(law)]
        of_law = share + (whole.get(id(limits[i]), 0.0) if i in limits else 0.0)
        if law.failure or (law.sampling.sample is None and of_law < LEAST_PROBABILITY):
            continue
        try:
            if law.sampling.sample is None:
                law.sampling.weigh(max(float(share), TUNING.share_least))
            needed = TUNING.effective_fewest * float(share) * (1.0 - 1e-9)
            answers.append(law.weighted_answer(needed, limits.get(i)))
        except ANALYSIS_ERRORS as error:  # of this law alone
            law.failure = error
    failures = {law.shot.family.name: law.failure for law in estimations if law.failure}
    if not answers:
        raise next(iter(failures.values()))
    why = [Message("model.failed", {"material": law, "reason": str(error)}) for law, error in failures.items()]
    checks = [replace(answer.checks, messages=(*answer.checks.messages, *why)) for answer in answers]
    return [replace(answer, checks=each) for answer, each in zip(answers, checks, strict=True)]


def _attempt(model: Estimation, work: Callable[[], object]) -> bool:
    """Do a part of the work on a model, which fails alone if it fails. Whether it did not fail."""
    try:
        work()
    except ANALYSIS_ERRORS as error:
        model.failure = error
    return model.failure is None


def _refine(models: Sequence[Estimation]) -> None:
    """Correct the rough simulations of all models that are not far below the likeliest."""
    top = max((model.log_probability for model in models), default=-np.inf)
    for model in models:
        if model.log_probability > top - TUNING.evidence_hopeless:
            _attempt(model, model.sampling.refine)


def _shares(models: Sequence[Estimation]) -> Floats:
    """Probabilities (n,) of the models by their evidence so far."""
    logs = np.array([model.log_probability for model in models])
    return np.asarray(np.exp(logs - log_sum(logs)))


def _sample(models: Sequence[Estimation]) -> None:
    """Sample all models whose share is not negligible, in rounds, until each has the draws that its share needs."""
    for _ in range(TUNING.surrogate_rounds + _REPEATED):
        highest = max(models, key=lambda model: model.sampling.proposal.height)
        for model in models:
            model.climb_where_best(highest)
        _refine(models)
        top = max(model.log_probability for model in models)
        waiting = []
        for model, share in zip(models, _shares(models), strict=True):
            error = model.sampling.evidence.error or 0.0
            in_reach = model.log_probability + min(error, TUNING.evidence_reach) > top + np.log(TUNING.share_least)
            large_or_unsure = share > TUNING.share_small or error > TUNING.evidence_known
            if in_reach and large_or_unsure and model.sampling.needs_draws(float(share)):
                waiting.append((float(share), model))
        if not waiting:
            return
        for share, model in waiting:
            _attempt(model, partial(model.sampling.weigh, share))

"""The answers of several laws for one curve as one: each law has the part in it that its evidence gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.inference.alternatives import LEAST_PROBABILITY, as_alternative, model_of
from cavirheo.messages import Message, of_bound
from cavirheo.parameters import LOG10, natural_name, of_the_law, parameter_of, units
from cavirheo.posterior import Checks, Posterior, intervals

ELASTIC = 0.05  # probability of the laws with a shear modulus, from which the answer has one
_MODULUS = LOG10 + "shear_modulus"
# a viscosity of a law with an exponent is that at 1e5 1/s
_SAME = {"viscosity": "reference_viscosity", "reference_viscosity": "viscosity"}
_NEWTONIAN = {"exponent": 0.0}  # log10 of what a law without it has; any other parameter is at the end of its range


def comparable(answers: Sequence[Posterior]) -> bool:
    """Whether answers are of several laws and one bubble, with draws and evidences whose errors are known."""
    laws = {answer.material for answer in answers}
    usable = all(answer.evidence and answer.evidence.error is not None and len(answer.theta) > 1 for answer in answers)
    return len(laws) == len(answers) > 1 and len({answer.bubble for answer in answers}) == 1 and usable


def averaged_over_laws(answers: Sequence[Posterior]) -> Posterior:
    """The answer of the likeliest law with the draws of the others beside its own, each law by its probability; the
    laws are equally likely before the curve is seen (Hoeting et al. 1999, doi:10.1214/ss/1009212519).

    answers: those that are `comparable`. A parameter that a law lacks has the value at which the likeliest law becomes
    it: no modulus, an exponent of 1. A law with a modulus adds it to the answer. The answer of each law by itself is in
    `laws`.
    """
    logs = np.array([answer.evidence.log for answer in answers if answer.evidence])
    share = dict(zip((answer.material for answer in answers), np.exp(logs - log_sum(logs)).tolist(), strict=True))
    top = max(answers, key=lambda answer: share[answer.material])
    counted = [answer for answer in answers if share[answer.material] > LEAST_PROBABILITY]
    elastic = sum(share[answer.material] for answer in counted if _MODULUS in answer.names)
    names, prior = top.names, dict(top.prior)
    if _MODULUS not in names and elastic > ELASTIC:
        names = (_MODULUS, *names)
        prior[_MODULUS] = next(answer.prior[_MODULUS] for answer in counted if _MODULUS in answer.prior)
    theta = np.concatenate([_as(answer, names, prior) for answer in counted])
    weight = np.concatenate([np.log(answer.weights + 1e-300) + np.log(share[answer.material]) for answer in counted])
    rivals = [replace(as_alternative(answer), weight=share[answer.material]) for answer in answers if answer is not top]
    laws = {answer.material: answer for answer in counted}
    models = {model_of(rival) for rival in rivals}
    alternatives = (*(mode for mode in top.others if model_of(mode) not in models), *rivals)
    average = replace(
        top, names=names, units=units(names), theta=theta, log_weight=weight, log_q=None, others=alternatives,
        prior=prior, laws=laws,
    )  # fmt: skip
    return replace(average, checks=_checks(average, share))


def _checks(answer: Posterior, share: dict[str, float]) -> Checks:
    """Those of the likeliest law, with what the average bounds in place of what this law bounds, and the share of each
    law."""
    checks, bounds = answer.checks, list[Message]()
    for name, ends in intervals(answer.names, answer.theta, answer.log_weight).items():
        if (of_the_law(name) or name == "stretch") and (bound := answer.bound(name)):
            bounds.append(of_bound(name, bound, ends))
    without_bounds = [message for message in checks.messages if not message.code.startswith("bound.")]
    verdict = checks.verdict
    if verdict in ("ok", "undetermined"):
        verdict = "undetermined" if bounds else "ok"
    messages = (*bounds, *without_bounds, Message("model.averaged", {"laws": share}))
    return replace(checks, verdict=verdict, messages=messages)


def of_one_law(answers: Sequence[Posterior]) -> list[Posterior]:
    """The answers of shots of one material, each average over laws replaced by its answer by the law with the largest
    evidence of all such shots together; a shot that has no draws of this law stays as it is."""
    several = [answer for answer in answers if answer.laws]
    evidences = [_log_evidence(answer) for answer in several]
    laws = {law for answer in several for law in answer.laws}
    total = {law: sum(logs.get(law, min(logs.values())) for logs in evidences) for law in sorted(laws)}
    best = max(total, key=lambda law: total[law], default="")
    return [answer.laws.get(best, answer) for answer in answers]


def _log_evidence(answer: Posterior) -> dict[str, float]:
    """Of each law with the bubble of an average over laws."""
    log = {mode.material: mode.evidence.log for mode in answer.others if mode.evidence and mode.bubble == answer.bubble}
    return log | {law: part.evidence.log for law, part in answer.laws.items() if part.evidence}


def _as(answer: Posterior, names: Sequence[str], prior: dict[str, tuple[float, ...]]) -> Floats:
    """(draws, names) of an answer in the parameters of another law."""
    columns = []
    for name in names:
        plain = natural_name(name)
        same = LOG10 + _SAME.get(plain, plain)
        source = name if name in answer.names else same
        if source in answer.names:
            columns.append(answer.theta[:, answer.names.index(source)])
            continue
        assert of_the_law(name)
        low = prior[name][0] if name in prior else (parameter_of(name).searched or (0.0, 0.0))[0]
        columns.append(np.full(len(answer.theta), _NEWTONIAN.get(plain, low)))
    return np.column_stack(columns)

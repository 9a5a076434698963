"""The answers of several laws for one curve as one: each law has the part in it that its evidence gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.inference.alternatives import SEEN, itself, model_of
from cavirheo.parameters import LOG10, about, natural_name, of_the_law, units
from cavirheo.posterior import Posterior

ELASTIC = 0.05  # probability of the laws with a shear modulus, from which the answer has one
_MODULUS = LOG10 + "shear_modulus"
_SAME = {
    "viscosity": "reference_viscosity",
    "reference_viscosity": "viscosity",
}  # at 1e5 1/s, of a law with an exponent
_NEWTONIAN = {"exponent": 0.0}  # log10 of what a law without it has; any other parameter is at the end of its range


def comparable(answers: Sequence[Posterior]) -> bool:
    """Whether answers are of several laws and one bubble, with draws and evidences whose errors are known."""
    laws = {one.material for one in answers}
    known = all(one.evidence and one.evidence.error is not None and len(one.theta) > 1 for one in answers)
    return len(laws) == len(answers) > 1 and len({one.bubble for one in answers}) == 1 and known


def averaged_over_laws(answers: Sequence[Posterior]) -> Posterior:
    """The answer of the likeliest law with the draws of the others beside its own, each law by its probability; the
    laws are equally likely before the curve is seen (Hoeting et al. 1999, doi:10.1214/ss/1009212519).

    answers: those that are `comparable`. A parameter that a law lacks has the value at which the likeliest law becomes
    it: no modulus, an exponent of 1. A law with a modulus adds it to the answer. The answer of each law by itself is in
    `laws`.
    """
    logs = np.array([one.evidence.log for one in answers if one.evidence])
    probability = np.exp(logs - log_sum(logs))
    top = answers[int(np.argmax(probability))]
    counted = [(one, float(p)) for one, p in zip(answers, probability, strict=True) if p > SEEN]
    elastic = sum(p for one, p in counted if _MODULUS in one.names)
    names, prior = top.names, dict(top.prior)
    if _MODULUS not in names and elastic > ELASTIC:
        names = (_MODULUS, *names)
        prior[_MODULUS] = next(one.prior[_MODULUS] for one, _ in counted if _MODULUS in one.prior)
    theta = np.concatenate([_as(one, names, prior) for one, _ in counted])
    weight = np.concatenate([np.log(one.weights + 1e-300) + np.log(p) for one, p in counted])
    rest = [
        replace(itself(one), weight=float(p)) for one, p in zip(answers, probability, strict=True) if one is not top
    ]
    laws = {one.material: one for one, _ in counted}
    known = {model_of(one) for one in rest}
    others = (*(one for one in top.others if model_of(one) not in known), *rest)
    return replace(
        top, names=names, units=units(names), theta=theta, log_weight=weight, log_q=None, others=others, prior=prior,
        laws=laws,
    )  # fmt: skip


def _as(answer: Posterior, names: Sequence[str], prior: dict[str, tuple[float, ...]]) -> Floats:
    """(draws, names) of an answer in the parameters of another law."""
    columns = []
    for name in names:
        plain = natural_name(name)
        same = LOG10 + _SAME.get(plain, plain)
        known = name if name in answer.names else same
        if known in answer.names:
            columns.append(answer.theta[:, answer.names.index(known)])
            continue
        assert of_the_law(name)
        low = prior[name][0] if name in prior else (about(name).searched or (0.0, 0.0))[0]
        columns.append(np.full(len(answer.theta), _NEWTONIAN.get(plain, low)))
    return np.column_stack(columns)

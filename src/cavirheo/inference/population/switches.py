"""Shots of one material share the switches of the default family: all shots together decide whether the material is a
liquid, whether it stiffens, and which bubble it needs; then each shot counts by its draws in that state alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Bools, relative_weights
from cavirheo.inference.assumptions import AUTO, LIQUID, PLAIN
from cavirheo.inference.experiment import FIELD_PROBABILITY
from cavirheo.parameters import LOG10
from cavirheo.physics.bubble import FIELD
from cavirheo.posterior import TRUSTED, Posterior

_MODULUS, _STIFFENING = LOG10 + "shear_modulus", LOG10 + "stiffening"
_LAWS = {"liquid": "newtonian", "gel": "nhkv", "stiffening gel": "fung + newtonian"}


class State(NamedTuple):
    """The switches of a material: kind ("liquid", "gel" or "stiffening gel"), and whether the bubble is the field's."""

    kind: str
    field: bool


_PRIOR = {"liquid": LIQUID, "gel": (1.0 - LIQUID) * PLAIN, "stiffening gel": (1.0 - LIQUID) * (1.0 - PLAIN)}
PRIOR = {
    State(kind, field): share * (FIELD_PROBABILITY if field else 1.0 - FIELD_PROBABILITY)
    for (kind, share), field in product(_PRIOR.items(), (False, True))
}


def in_state(answer: Posterior, state: State) -> Bools:
    """(draws,) which draws of an answer by the default family have these switches."""
    columns = dict(zip(answer.names, answer.theta.T, strict=True))
    liquid = np.isneginf(columns[_MODULUS])
    plain = ~liquid & np.isneginf(columns[_STIFFENING])
    kinds = {"liquid": liquid, "gel": plain, "stiffening gel": ~liquid & ~plain}
    field = np.full(len(liquid), answer.bubble == FIELD)
    if "confinement_damping" in columns:
        field = columns["confinement_damping"] == 0.0
    return np.asarray(kinds[state.kind] & (field == state.field))


def share_switches(answers: Sequence[Posterior], *, only_trusted: bool) -> tuple[list[Posterior], dict[str, float]]:
    """(the answers of shots of one material, the probability of each switch by all of them together). Answers by the
    default family have the draws in the state that all of them together make most probable, and are of its law."""
    several = [answer for answer in answers if _is_default(answer) and len(answer.theta) > 1]
    votes = [answer for answer in several if not only_trusted or answer.checks.verdict in TRUSTED]
    if not votes:
        return list(answers), {}
    log_probability = {state: float(np.log(prior)) for state, prior in PRIOR.items()}
    for answer in votes:
        weight = relative_weights(np.zeros(len(answer.theta)) if answer.log_weight is None else answer.log_weight)
        least = 0.5 * float(np.sum(weight**2)) / float(np.sum(weight)) ** 2  # half a draw: none is no proof
        for state, prior in PRIOR.items():
            share = float(weight @ in_state(answer, state)) / float(np.sum(weight))
            log_probability[state] += float(np.log((share + least) / prior))
    best = max(log_probability, key=lambda state: log_probability[state])
    conditioned = [_conditioned(answer, best) if _is_default(answer) else answer for answer in answers]
    return conditioned, _switches(log_probability)


def _switches(log_probability: Mapping[State, float]) -> dict[str, float]:
    """The probability of each switch from that of each state."""
    top = max(log_probability.values())
    weight = {state: float(np.exp(log - top)) for state, log in log_probability.items()}
    total = sum(weight.values())
    on: dict[str, Callable[[State], bool]] = {
        "liquid": lambda state: state.kind == "liquid",
        "stiffening": lambda state: state.kind == "stiffening gel",
        "field_bubble": lambda state: state.field,
    }
    return {name: sum(weight[state] for state in weight if holds(state)) / total for name, holds in on.items()}


def _is_default(answer: Posterior) -> bool:
    """Whether an answer is by the default family; another law has at most the switch of its bubble."""
    return answer.material == AUTO and bool(answer.switches)


def _conditioned(answer: Posterior, state: State) -> Posterior:
    """The answer by the law of a state, with the draws in this state."""
    left_out = {"liquid": (_MODULUS, _STIFFENING), "gel": (_STIFFENING,)}.get(state.kind, ())
    kept = [k for k, name in enumerate(answer.names) if name not in left_out]
    rows = in_state(answer, state) if len(answer.theta) > 1 else np.zeros(len(answer.theta), dtype=bool)
    names = tuple(answer.names[k] for k in kept)
    return replace(
        answer,
        names=names,
        units=tuple(answer.units[k] for k in kept),
        theta=answer.theta[rows][:, kept],
        log_weight=None if answer.log_weight is None else answer.log_weight[rows],
        material=_LAWS[state.kind],
        bubble=FIELD if state.field else answer.bubble,
        prior={name: ends for name, ends in answer.prior.items() if name in names},
        switches={},
    )

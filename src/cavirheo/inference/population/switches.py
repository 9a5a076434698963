"""Shots of one material share the switches of the default family: all shots together decide whether the material is a
liquid, whether it stiffens, and which bubble it needs; then each shot counts by its draws in that state alone.

The evidence of a state is the product of its evidence in each shot. In a gel each shot has a modulus of its own there,
and so each pays for the wide prior of G, which one modulus of all shots pays for once; with r_i(g) the posterior
density of log10 G of a shot over its prior, the evidence of one modulus is larger by the mean of prod r_i(g) over the
prior. Without it ten shots of a soft gel would be a liquid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Bools, Floats, log_sum
from cavirheo.inference.assumptions import AUTO, LIQUID, PLAIN
from cavirheo.inference.experiment import FIELD_PROBABILITY
from cavirheo.parameters import LOG10
from cavirheo.physics.bubble import FIELD
from cavirheo.posterior import TRUSTED, Posterior

_MODULUS, _STIFFENING = LOG10 + "shear_modulus", LOG10 + "stiffening"
ONE_MODULUS = 0.5  # prior probability that all shots have one modulus, and not each its own
BANDWIDTH = 0.15  # decades; of the density of log10 G of a shot
LIKELY = 0.05  # probability of a liquid up to which G is a value, and of a gel up to which there is none
POINTS = 201  # of the grid of log10 G
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


class Shared(NamedTuple):
    """answers: of the shots; those by the default family have the draws in the state that all of them together make
    most probable, and are of its law. switches: the probability of each by all shots. modulus_limit: 95 % limit of G of
    a gel, Pa, by all shots, where the material may be a liquid but need not be one."""

    answers: list[Posterior]
    switches: dict[str, float]
    modulus_limit: float | None


def share_switches(answers: Sequence[Posterior], *, only_trusted: bool) -> Shared:
    """What the shots of one material share."""
    several = [answer for answer in answers if _is_default(answer) and len(answer.theta) > 1]
    votes = [answer for answer in several if not only_trusted or answer.checks.verdict in TRUSTED]
    if not votes:
        return Shared(list(answers), {}, None)
    low, high = votes[0].prior[_MODULUS]
    grid = np.linspace(low, high, POINTS)
    log_probability = {state: float(np.log(prior)) for state, prior in PRIOR.items()}
    log_ratios = {state: np.zeros(POINTS) for state in PRIOR if state.kind != "liquid"}
    for answer in votes:
        weight = answer.weights
        least = 0.5 * float(np.sum(weight**2))  # half a draw: none is no proof
        for state, prior in PRIOR.items():
            inside = in_state(answer, state)
            share = float(np.sum(weight[inside]))
            log_probability[state] += float(np.log((share + least) / prior))
            if state in log_ratios:
                modulus = answer.theta[inside, answer.names.index(_MODULUS)]
                density = _over_prior(modulus, weight[inside], grid) if share else np.ones(POINTS)
                log_ratios[state] += np.log((share * density + least) / (share + least))
    for state, log_ratio in log_ratios.items():
        of_one = np.log(ONE_MODULUS) + float(log_sum(log_ratio)) - np.log(POINTS)
        log_probability[state] += float(np.logaddexp(np.log(1.0 - ONE_MODULUS), of_one))
    best = max(log_probability, key=lambda state: log_probability[state])
    conditioned = [_conditioned(answer, best) if _is_default(answer) else answer for answer in answers]
    switches = {name: on for name, on in _switches(log_probability).items() if name in votes[0].switches}
    limit = None
    if LIKELY < switches["liquid"] < 1.0 - LIKELY:
        gel = max(log_ratios, key=lambda state: log_probability[state])
        density = np.exp(log_ratios[gel] - np.max(log_ratios[gel])) * 10.0**grid  # flat in G, as `upper_limit`
        limit = float(10.0 ** np.interp(0.95, np.cumsum(density) / np.sum(density), grid))
    return Shared(conditioned, switches, limit)


def _over_prior(modulus: Floats, weight: Floats, grid: Floats) -> Floats:
    """Density on a grid of weighted draws of log10 G over that of its flat prior; draws are mirrored at its ends."""
    mirrored = np.concatenate([modulus, 2.0 * grid[0] - modulus, 2.0 * grid[-1] - modulus])
    density = np.exp(-0.5 * ((grid[:, None] - mirrored) / BANDWIDTH) ** 2) @ np.tile(weight, 3)
    return np.asarray(density / np.mean(density))


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

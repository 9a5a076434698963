"""Shots of one material share the switches of the default family: all shots together decide whether the material is a
liquid, whether it stiffens or thins, and which bubble it needs; then each shot counts by its draws in that state alone.

The evidence of a state is the product of its evidence in each shot. In a gel each shot pays there for the wide prior of
G, which one modulus of all shots pays for once (docs/method/population.md): without this, ten shots of a soft gel would
be a liquid. So it is with the thinning of a liquid that thins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Bools, Floats, log_sum
from cavirheo.inference.assumptions import AUTO, LIQUID, NEWTONIAN, PLAIN, Family
from cavirheo.inference.experiment import FIELD_PROBABILITY
from cavirheo.inference.population.hierarchy import likelihood
from cavirheo.parameters import LOG10, UNLIKELY, is_law_parameter, units
from cavirheo.physics.bubble import FIELD
from cavirheo.posterior import TRUSTED, Posterior
from cavirheo.prior import Prior

_MODULUS, _STIFFENING, _THINNING = LOG10 + "shear_modulus", LOG10 + "stiffening", LOG10 + "thinning"
ONE_VALUE = 0.5  # prior probability that all shots have one modulus, or thinning, and not each its own
SCATTER = 0.15  # decades; of the shots about this value
PLACES = 201  # of the prior of this value


class Kind(NamedTuple):
    """A kind of material: its law, its prior probability, and the parameter of which all shots may have one value."""

    law: str
    probability: float
    of_one_value: str | None = None

    @property
    def is_gel(self) -> bool:
        """Whether it has a modulus."""
        return self.of_one_value == _MODULUS


class State(NamedTuple):
    """The switches of a material: its kind (of KINDS), and whether the bubble is the field's."""

    kind: str
    field: bool


KINDS = {
    "liquid": Kind("newtonian", LIQUID * NEWTONIAN),
    "thinning liquid": Kind("power-law", LIQUID * (1.0 - NEWTONIAN), _THINNING),
    "gel": Kind("nhkv", (1.0 - LIQUID) * PLAIN, _MODULUS),
    "stiffening gel": Kind("fung + newtonian", (1.0 - LIQUID) * (1.0 - PLAIN), _MODULUS),
}
PRIOR = {
    State(name, field): kind.probability * (FIELD_PROBABILITY if field else 1.0 - FIELD_PROBABILITY)
    for (name, kind), field in product(KINDS.items(), (False, True))
}


def in_state(answer: Posterior, state: State) -> Bools:
    """(draws,) which draws of an answer by the default family have these switches."""
    columns = dict(zip(answer.names, answer.theta.T, strict=True))
    liquid = np.isneginf(columns[_MODULUS])
    thinning, stiffening = np.isfinite(columns[_THINNING]), np.isfinite(columns[_STIFFENING])
    kinds = {"liquid": liquid & ~thinning, "thinning liquid": thinning}
    kinds |= {"gel": ~liquid & ~stiffening, "stiffening gel": stiffening}
    field = np.full(len(liquid), answer.bubble == FIELD)
    if "confinement_damping" in columns:
        field = columns["confinement_damping"] == 0.0
    return np.asarray(kinds[state.kind] & (field == state.field))


class Shared(NamedTuple):
    """answers: of the shots; those by the default family have the draws in the state that all of them together make
    most probable, and are of its law. switches: the probability of each by all shots. modulus_limit: 95 % limit of G,
    Pa, by all shots, where the material may be a liquid; 0 if it hardly can be a gel."""

    answers: list[Posterior]
    switches: dict[str, float]
    modulus_limit: float | None = None


def share_switches(answers: Sequence[Posterior], *, only_trusted: bool) -> Shared:
    """What the shots of one material share."""
    several = [answer for answer in answers if _is_default(answer) and len(answer.theta) > 1]
    votes = [answer for answer in several if not only_trusted or answer.checks.verdict in TRUSTED]
    if not votes:
        return Shared(list(answers), {})
    log_probability, log_ratios = dict[State, float](), dict[State, Floats]()
    for state, prior in PRIOR.items():
        kind = KINDS[state.kind]
        shares = [float(np.sum(answer.weights[in_state(answer, state)])) for answer in votes]
        least = [0.5 * float(np.sum(answer.weights**2)) for answer in votes]  # half a draw: none is no proof
        probabilities = np.add(shares, least)
        log_probability[state] = float(np.log(prior) + np.sum(np.log(probabilities / prior)))
        if kind.of_one_value:
            low, high = votes[0].prior[kind.of_one_value]
            places = np.linspace(low, high, PLACES)
            ratios = [
                (share * _ratio(answer, state, kind.of_one_value, places) + half) / (share + half)
                for answer, share, half in zip(votes, shares, least, strict=True)
            ]
            log_ratios[state] = np.sum(np.log(ratios), axis=0)
            of_one = float(log_sum(log_ratios[state])) - np.log(PLACES)
            log_probability[state] += np.logaddexp(np.log(1.0 - ONE_VALUE), np.log(ONE_VALUE) + of_one)
    chosen = _chosen(log_probability)
    conditioned = [_conditioned(answer, chosen) if _is_default(answer) else answer for answer in answers]
    switches = {name: on for name, on in _switches(log_probability).items() if name in votes[0].switches}
    if switches["liquid"] <= UNLIKELY:
        return Shared(conditioned, switches)
    if switches["liquid"] >= 1.0 - UNLIKELY:
        return Shared(conditioned, switches, 0.0)
    gel = max((state for state in PRIOR if KINDS[state.kind].is_gel), key=lambda state: log_probability[state])
    low, high = votes[0].prior[_MODULUS]
    moduli = np.linspace(low, high, PLACES)
    density = np.exp(log_ratios[gel] - np.max(log_ratios[gel])) * 10.0**moduli  # flat in G, as `upper_limit`
    limit = np.interp(0.95, np.cumsum(density) / np.sum(density), moduli)
    return Shared(conditioned, switches, float(10.0**limit))


def _chosen(log_probability: Mapping[State, float]) -> dict[State, float]:
    """The state in which the shots count, the most probable one of gels, or of liquids if these are more probable; of a
    liquid that may thin and may not the states of both, with their probabilities."""
    gels, liquids = ([state for state in PRIOR if KINDS[state.kind].is_gel == gel] for gel in (True, False))
    side = max(gels, liquids, key=lambda states: float(log_sum([log_probability[state] for state in states])))
    best = max(side, key=lambda state: log_probability[state])
    both = [state for state in liquids if state.field == best.field] if best in liquids else [best]
    total = log_sum([log_probability[state] for state in both])
    shares = {state: float(np.exp(log_probability[state] - total)) for state in both}
    return shares if min(shares.values()) > UNLIKELY else {best: 1.0}


def _ratio(answer: Posterior, state: State, name: str, places: Floats) -> Floats:
    """(k,) how many times as likely a shot is with a parameter about each of these values, log10, as with its prior; 1
    where too few of its draws are in this state."""
    rows = in_state(answer, state)
    log_weight = None if answer.log_weight is None else answer.log_weight[rows]
    values = answer.theta[rows][:, [answer.names.index(name)]]
    prior = Prior((name,), places[[0]], places[[-1]])
    shot = likelihood(values, log_weight, prior) if rows.any() else None
    if shot is None:
        return np.ones(len(places))
    return np.exp(shot.log_size + shot.log_integral(places[:, None], np.full((1, 1), SCATTER**2)))


def _switches(log_probability: Mapping[State, float]) -> dict[str, float]:
    """The probability of each switch from that of each state."""
    total = log_sum([*log_probability.values()])
    states = {state: float(np.exp(log_p - total)) for state, log_p in log_probability.items()}
    return {
        "liquid": sum(p for state, p in states.items() if not KINDS[state.kind].is_gel),
        "stiffening": sum(p for state, p in states.items() if state.kind == "stiffening gel"),
        "thinning": sum(p for state, p in states.items() if state.kind == "thinning liquid"),
        "field_bubble": sum(p for state, p in states.items() if state.field),
    }


def _is_default(answer: Posterior) -> bool:
    """Whether an answer is by the default family; another law has at most the switch of its bubble."""
    return answer.material == AUTO and bool(answer.switches)


def _conditioned(answer: Posterior, states: Mapping[State, float]) -> Posterior:
    """The answer by the law of these states, with the draws in them, by the probability of each; of a liquid that may
    thin by its viscosity alone."""
    first, *more = states
    law = "newtonian" if more else KINDS[first.kind].law
    log_weight = np.full(len(answer.theta), -np.inf)
    for state, share in states.items() if len(answer.theta) > 1 else ():
        rows = in_state(answer, state) & (answer.weights > 0.0)
        log_weight[rows] = np.log(share * answer.weights[rows] / np.sum(answer.weights[rows]))
    rows = np.isfinite(log_weight)
    log_weight, theta = log_weight[rows], answer.theta[rows]
    names, prior = list(answer.names), dict(answer.prior)
    if law == "power-law":  # by its exponent n = 1 - thinning, with a prior that is flat in log10 n
        column, exponent = names.index(_THINNING), LOG10 + "exponent"
        thinning = 10.0 ** theta[:, column]
        names[column], theta[:, column] = exponent, np.log10(1.0 - thinning)
        low, high = 10.0 ** np.array(prior[_THINNING])
        prior[exponent] = tuple(np.log10([1.0 - high, 1.0 - low]).tolist())
        log_weight -= np.log((1.0 - thinning) / thinning)
    of_law = [LOG10 + name for name in Family(law).parameters]
    kept = [k for k, name in enumerate(names) if name in of_law or not is_law_parameter(name)]
    names = [names[k] for k in kept]
    return replace(
        answer,
        names=tuple(names),
        units=units(tuple(names)),
        theta=theta[:, kept],
        log_weight=log_weight,
        material=law,
        bubble=FIELD if first.field else answer.bubble,
        prior={name: ends for name, ends in prior.items() if name in names},
        switches={},
    )

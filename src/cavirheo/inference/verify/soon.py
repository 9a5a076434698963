"""Level "auto": weighted draws from a few hundred simulations where a network's draws show the way.

The network's own draws are simulated first. They lead to the maximum and to what is around it, and their weights give
an evidence by themselves. The draws that count come from what the simulations teach (explore.py). They are trusted if
they are worth enough and if the network's own evidence is not larger than theirs: an effective size alone does not show
what a proposal never met. (That it is smaller only says that the network misses what they have.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import SolverError
from cavirheo.inference.verify.explore import Explorer
from cavirheo.inference.verify.mode import Mode, Simulated, Target, modes, secant
from cavirheo.inference.verify.sampler import Proposal, Sample, sample
from cavirheo.inference.verify.tuning import TUNING


class Weighed(NamedTuple):
    """drawn: the weighted draws. modes: all that were found. few: whether few simulations were enough. apart: how many
    standard errors the network's own evidence is above that of the others; None if its draws are worth too little."""

    drawn: Sample
    modes: list[Mode]
    few: bool
    apart: float | None


def weighed(
    target: Target, network: Proposal | None, starts: Callable[[], list[Floats]],
    scanned: Callable[[], list[Floats]], *, draws: int, seed: int,
) -> Weighed:  # fmt: skip
    """Draws from few simulations if they can be trusted, else from as many as level "full" has.

    starts: where to climb from without a network; scanned: the same from all over the ranges. draws: at most so many
    with weights. Raises SolverError: no start could be simulated.
    """
    own, known, found = None, None, list[Mode]()
    if network:
        u = network.draw(TUNING.own_draws, np.random.Generator(np.random.Philox(seed).jumped()))
        known = Simulated.at(target, u)
        own = Sample(u, known.value, network.log_density(u))
    if known and np.count_nonzero(np.isfinite(known.value)) > 2 * (known.u.shape[1] + 1):
        mode, known = secant(target, known)
        found = [mode, *modes(target, _beyond(mode, known))]
    searched = not found
    if searched:
        found = modes(target, starts(), scanned())
    if not found:
        raise SolverError(f"no start of {target.experiment.family.name} could be simulated")
    explorer = Explorer(target, found, TUNING.auto_learning, follow=searched)
    if known:
        explorer.learn(*known)
    guard = (network, own) if network and own is not None else None
    sizes: dict[str, Any] = {"each": TUNING.auto_per_round, "most": min(TUNING.auto_draws, draws)}
    enough = min(TUNING.auto_enough, draws / 2)
    drawn = sample(explorer, explorer.propose, seed=seed, enough=enough, fewest=1, first=guard, **sizes)
    apart = None
    if own is not None and own.ess >= TUNING.own_worth:
        rest = Sample(*(values[len(own.u) :] for values in (drawn.u, drawn.log_target, drawn.log_q)))
        apart = _standard_errors(own, rest)
    if drawn.ess >= enough and drawn.reliable and (apart is None or apart <= TUNING.agree):
        return Weighed(drawn, explorer.modes, True, apart)
    explorer.thorough(TUNING.learning_rounds)
    explorer.also(modes(target, [], scanned()))
    enough = max(min(TUNING.effective_enough, draws / 4), TUNING.effective_fewest)
    sizes = {"each": TUNING.draws_per_round, "most": draws, "enough": enough}
    drawn = sample(explorer, explorer.propose, seed=seed + 1, first=guard, **sizes)
    return Weighed(drawn, explorer.modes, False, apart)


def _beyond(mode: Mode, known: Simulated) -> list[Floats]:
    """The likeliest simulation that the Gaussian about the mode does not expect there, if there is one: on the way to
    another valley."""
    off = known.u - mode.u
    expected = mode.log_posterior - 0.5 * np.einsum("ki,ij,kj->k", off, np.linalg.inv(mode.covariance), off)
    unexpected = known.value - expected > TUNING.own_unexpected
    likely = np.where(unexpected & (known.value > mode.log_posterior - TUNING.lowest_mode), known.value, -np.inf)
    best = int(np.argmax(likely))
    return [known.u[best]] if np.isfinite(likely[best]) else []


def _standard_errors(own: Sample, rest: Sample) -> float:
    """By how much the network's evidence is larger than that of the others, which then miss a part of the posterior.
    A smaller one says that the network misses a part: they have it."""
    (a, of_a), (b, of_b) = own.log_evidence, rest.log_evidence
    return (a - b) / float(np.hypot(of_a, of_b) + 1e-9)

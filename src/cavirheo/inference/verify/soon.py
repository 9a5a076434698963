"""Level "auto": weighted draws from a few hundred simulations where a network's draws show the way.

The network's own draws are simulated first. From the likeliest of them the climb begins, and their weights give an
evidence by themselves. The draws that count come from what the simulations teach (explore.py). They are trusted if they
are worth enough and if both evidences agree: an effective size alone does not show what a proposal never met.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import SolverError
from cavirheo.inference.experiment import FINE
from cavirheo.inference.verify.explore import Explorer
from cavirheo.inference.verify.mode import Mode, Target, modes
from cavirheo.inference.verify.sampler import Proposal, Sample, sample
from cavirheo.inference.verify.tuning import TUNING


class Weighed(NamedTuple):
    """drawn: the weighted draws. modes: all that were found. few: whether few simulations were enough. apart: how many
    standard errors the network's own evidence is from that of the others; None where its draws are worth too little."""

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
    found, own, residual = list[Mode](), None, np.empty((0, target.noise.size))
    if network:
        u = network.draw(TUNING.own_draws, np.random.Generator(np.random.Philox(seed).jumped()))
        residual = target.residuals(u, FINE)
        own = Sample(u, target.log_posterior(u, residual), network.log_density(u))
        first, *others = _apart(own) or [u[0]]
        found = modes(target, [first], others)
    if not found:
        found = modes(target, starts(), scanned())
    if not found:
        raise SolverError(f"no start of {target.experiment.family.name} could be simulated")
    explorer = Explorer(target, found, TUNING.auto_learning)
    if own is not None:
        explorer.learn(own.u, residual, own.log_target)
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
    explorer.also(modes(target, [], scanned()))
    explorer.rounds = TUNING.learning_rounds
    enough = max(min(TUNING.effective_enough, draws / 4), TUNING.effective_fewest)
    sizes = {"each": TUNING.draws_per_round, "most": draws, "enough": enough}
    drawn = sample(explorer, explorer.propose, seed=seed + 1, first=guard, **sizes)
    return Weighed(drawn, explorer.modes, False, apart)


def _apart(own: Sample) -> list[Floats]:
    """The likeliest draws, each away from those before it."""
    inverse = np.linalg.pinv(np.cov(own.u.T))
    found: list[Floats] = []
    for i in np.argsort(-own.log_target, kind="stable"):
        off = [own.u[i] - other for other in found]
        if np.isfinite(own.log_target[i]) and all(one @ inverse @ one > TUNING.own_apart**2 for one in off):
            found.append(own.u[i])
        if len(found) == TUNING.own_starts:
            break
    return found


def _standard_errors(one: Sample, other: Sample) -> float:
    """How far two evidences are apart."""
    (a, of_a), (b, of_b) = one.log_evidence, other.log_evidence
    return abs(a - b) / float(np.hypot(of_a, of_b) + 1e-9)

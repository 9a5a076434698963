"""The answer of several models of one curve: each has the part in it that its evidence gives.

A law of the real bubble has a limit, the field's bubble, in which nothing resists. All models are looked at by few
simulations. Those whose part may be seen are then sampled, each by as many draws as its part in the average asks for:
a model that hardly counts needs no interval of its own (Hoeting et al. 1999, doi:10.1214/ss/1009212519).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cavirheo.arrays import Floats, log_sum
from cavirheo.errors import SolverError
from cavirheo.inference.alternatives import LEAST_PROBABILITY, LIMIT
from cavirheo.inference.checks import MISFIT
from cavirheo.inference.verify.adaptive_sampling import AdaptiveSampling, Preview
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.inference.verify.verification import Estimation
from cavirheo.parallel import each
from cavirheo.physics.bubble import REAL
from cavirheo.posterior import Evidence, Posterior

_REPEATED = 4  # times at most that a part is sampled anew after the last round of its surrogates


class Part:
    """A model that may have a part in an answer. prior: log of its probability before the curve is seen. Raises
    SolverError: no start of it could be simulated."""

    def __init__(self, estimation: Estimation, prior: float) -> None:
        self.estimation, self.prior = estimation, prior
        self._looked: Floats | None = None  # u of another one, last looked at
        self.sampling: AdaptiveSampling = estimation.sampling

    @property
    def view(self) -> Preview:
        """Its weighted draws, or what its maximum tells."""
        return self.estimation.as_part(self.sampling.weighted) if self.sampling.sample else self.estimation.at_maximum()

    @property
    def evidence(self) -> Evidence:
        """As far as it is known."""
        return self.sampling.evidence

    @property
    def log(self) -> float:
        """Of the evidence times the prior probability."""
        return self.evidence.log + self.prior

    def look_where(self, other: Part) -> None:
        """Climb from where another model is best, if that is above all that is known of this one: laws contain each
        other, and a search may have missed there what the other's has found. Draws that have missed it do not count."""
        explorer, highest = self.sampling.explorer, other.sampling.explorer.highest
        looked_at = self._looked is not None and np.array_equal(highest, self._looked)
        height = explorer.height
        if other.sampling.explorer.height - height < TUNING.other_law or looked_at:
            return
        self._looked = highest
        best = other.estimation.shot.best(other.estimation.target.with_camera(highest[None])[0])
        start = self.estimation.start_at(best)
        explorer(start[None])
        explorer.climb_from(start)
        if explorer.height - height > TUNING.other_law:
            self.sampling.sample = None


def _part(estimation: Estimation, prior: float) -> Part | SolverError:
    """A model, or why it could not be simulated."""
    try:
        return Part(estimation, prior)
    except SolverError as error:
        return error


def shares(parts: Sequence[Part]) -> Floats:
    """(n,) probabilities of the parts, as far as they are known."""
    logs = np.array([part.log for part in parts])
    return np.asarray(np.exp(logs - log_sum(logs)))


def sample_parts(parts: Sequence[Part]) -> None:
    """Sample all parts whose share may be seen, at once, and those again whose share has become larger."""
    for _ in range(TUNING.emulated_rounds + _REPEATED):
        highest = max(parts, key=lambda part: part.sampling.explorer.height)
        for part in parts:
            part.look_where(highest)
        probabilities, top = shares(parts), max(part.log for part in parts)
        waiting = []
        for part, share in zip(parts, probabilities, strict=True):
            error = part.evidence.error or 0.0
            in_reach = part.log + min(error, TUNING.part_unsure) > top + np.log(TUNING.part_seen)
            large_or_unsure = share > TUNING.part_small or error > TUNING.part_known
            if in_reach and large_or_unsure and part.sampling.short(float(share)):
                waiting.append((float(share), part.sampling))
        if not waiting:
            return
        each(lambda pair: pair[1].weigh(pair[0]), waiting, parts[0].estimation.target.workers)


def answers_of(estimations: Sequence[Estimation]) -> list[Posterior]:
    """The answer of each law; one that is far from the likeliest has no interval.

    Raises SolverError: none of them could be simulated.
    """
    workers = estimations[0].target.workers
    looked_at = each(lambda estimation: _part(estimation, 0.0), estimations, workers)
    laws = [part for part in looked_at if isinstance(part, Part)]
    problems = [error for error in looked_at if isinstance(error, SolverError)]
    if not laws:
        raise problems[0]
    if len(laws) > 1 and max(laws, key=lambda part: part.log).sampling.misfit > MISFIT:
        each(lambda part: part.sampling.search_windows(), laws, workers)  # before it is said that none of them fits
    limits: dict[int, Part] = {}
    by_share = sorted(enumerate(shares(laws) if len(laws) > 1 else [1.0]), key=lambda pair: -pair[1])
    for i, share in by_share:
        part, real = laws[i], laws[i].estimation.answer.bubble == REAL
        unlike = any(laws[k].log - limit.log > TUNING.part_unlike for k, limit in limits.items())
        rival = part.estimation.rival() if share > TUNING.part_small and not unlike else None
        limit = _part(rival, np.log(LIMIT) if real else -np.inf) if rival else None
        if isinstance(limit, Part):
            limits[i] = limit
        if real and (unlike or i in limits):
            part.prior = np.log(1.0 - LIMIT)
    counted = [part for part in (*laws, *limits.values()) if np.isfinite(part.prior)]
    sample_parts(counted)
    answers = []
    whole = dict(zip(map(id, counted), shares(counted), strict=True))
    for i, part in enumerate(laws):
        share = whole[id(part)]
        of_law = share + (whole.get(id(limits[i]), 0.0) if i in limits else 0.0)
        if part.sampling.sample is None and of_law < LEAST_PROBABILITY:
            continue
        if part.sampling.sample is None:
            part.sampling.weigh(max(float(share), TUNING.part_seen))
        if part.sampling.sample is None:
            why = f"too few bubbles of {part.estimation.shot.family.name} about its maximum can be simulated"
            problems.append(SolverError(why))
            continue
        needed = TUNING.effective_fewest * float(share) * (1.0 - 1e-9)
        answers.append(part.estimation.weighted_answer(part.sampling.weighted, needed, limits.get(i)))
    if not answers:
        raise problems[0]
    return answers

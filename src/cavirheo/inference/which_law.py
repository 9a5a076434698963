"""Comparison of laws by their evidence, p(frames | law), the integral of the likelihood over the prior of each law.

A parameter that is not needed costs log(prior width/posterior width). The comparison of nested laws is therefore only
as good as the prior ranges (docs/method/posterior.md). Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import softmax

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve, as_curves
from cavirheo.errors import require
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.population import Population, population
from cavirheo.posterior import Evidence, Pair, Posterior

DECISIVE = 3.0  # log evidence (a factor of 20) by which a law must be larger to be preferred; below, it is possible
DISTRUSTED = 1.0  # standard error of a log evidence if its weights are not to be trusted


@dataclass(frozen=True, eq=False)
class Ranking:
    """The laws of one curve, or of the shots of a group: the sum over its shots, each with parameters of its own.

    Attributes:
        name: name of the curve or group.
        members: indices of the curves.
        curves: the curves.
        answers: answer of each curve by law.
    """

    name: str
    members: tuple[int, ...]
    curves: Sequence[RadiusCurve]
    answers: Mapping[str, Sequence[Posterior]]

    @cached_property
    def _logs(self) -> Floats:
        """(2, laws, curves) log evidence and its standard error; NaN without one."""
        found = [[_log_evidence(answer) for answer in answers] for answers in self.answers.values()]
        return np.moveaxis(np.array(found), 2, 0)

    @cached_property
    def _summed(self) -> Bools:
        """(curves,) for which every law has an evidence, apart from laws that have none for any curve."""
        known = np.isfinite(self._logs[0])
        return known[known.any(axis=1)].all(axis=0) & known.any()

    @property
    def shots(self) -> int:
        """Number of curves that are summed."""
        return int(np.sum(self._summed))

    @property
    def evidence(self) -> dict[str, Evidence | None]:
        """Evidence by law; None for a law without one."""
        totals = np.sum(self._logs[0][:, self._summed], axis=1), np.linalg.norm(self._logs[1][:, self._summed], axis=1)
        found = zip(self.answers, *(total.tolist() for total in totals), strict=True)
        return {law: Evidence(log, error) if self.shots and np.isfinite(log) else None for law, log, error in found}

    @property
    def probability(self) -> dict[str, float]:
        """Probability of the laws that have an evidence, if all are equally likely a priori."""
        logs = {law: evidence.log for law, evidence in self.evidence.items() if evidence}
        return dict(zip(logs, softmax(list(logs.values())).tolist(), strict=True)) if logs else {}

    @property
    def contenders(self) -> list[str]:
        """The laws that the evidence does not reject, those with the fewest parameters first. Their log evidence is
        below the largest one by no more than DECISIVE plus the standard error of the difference."""
        known = {law: evidence for law, evidence in self.evidence.items() if evidence}
        if not known:
            return []
        top = max(known.values(), key=lambda evidence: evidence.log)
        errors = {law: np.hypot(evidence.error or 0.0, top.error or 0.0) for law, evidence in known.items()}
        close = [law for law, evidence in known.items() if top.log - evidence.log <= DECISIVE + errors[law]]
        return sorted(close, key=lambda law: (len(self.answers[law][0].names), -known[law].log))

    @property
    def chosen(self) -> str | None:
        """The simplest law that the evidence does not reject."""
        return next(iter(self.contenders), None)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """Each law of a group with each worse one."""
        summed = zip(self.answers, self._logs[0][:, self._summed], strict=True)
        logs = {law: values for law, values in summed if len(values) > 1 and np.isfinite(values).all()}
        pairs = []
        for first, second in combinations(sorted(logs, key=lambda law: -float(np.sum(logs[law]))), 2):
            differences = logs[first] - logs[second]
            shots = int(np.sum(differences > 0)), int(np.sum(differences < 0))
            error = float(np.std(differences, ddof=1) * np.sqrt(len(differences)))
            pairs.append(Pair(first, second, float(np.sum(differences)), error, shots))
        return tuple(pairs)

    @cached_property
    def populations(self) -> dict[str, Population]:
        """One material with its scatter by law, for the summed shots of a group."""
        if len(self.curves) < 2:
            return {}
        summed = np.flatnonzero(self._summed).tolist()
        names = [self.curves[k].name for k in summed]
        laws = [law for law, evidence in self.evidence.items() if evidence]
        answers = {law: [self.answers[law][k] for k in summed] for law in laws}
        return {law: population(answers[law], names=names, only_trusted=False) for law in laws}


def plans(laws: Sequence[str], **options: Any) -> dict[str, Analysis]:
    """The analysis that gives the evidence of every law.

    `options` are those of an `Analysis`. Raises InputError: fewer than two laws, a law twice, an unknown law, or a
    setting out of its domain.
    """
    laws = [laws] if isinstance(laws, str) else laws
    message = f"give two or more different laws to choose from, got {', '.join(laws) or 'none'}"
    require(len({*laws}) == len(laws) > 1, message, "option.laws")
    return {law: Analysis("infer", material=law, **options) for law in laws}


def rank_laws(
    curves: Sequence[RadiusCurve],
    laws: Sequence[str],
    *,
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
    **options: Any,
) -> tuple[list[Ranking], list[Ranking]]:
    """The ranking of laws for each curve, and for each group of two or more.

    `options` (those of `infer` but model and material) and errors are those of `plans`. `done` is called with the index
    of the curve and the answer of each law as it is found.
    """
    curves = as_curves(curves)
    analyses = plans(laws, **options)
    return ranked(curves, {law: analysis.run(curves, workers, done) for law, analysis in analyses.items()})


def ranked(
    curves: Sequence[RadiusCurve], by_law: Mapping[str, Sequence[Posterior]]
) -> tuple[list[Ranking], list[Ranking]]:
    """As `rank_laws`, from the answers by law, in the order of the curves."""

    def of(name: str, members: Sequence[int]) -> Ranking:
        answers = {law: [answers[i] for i in members] for law, answers in by_law.items()}
        return Ranking(name, tuple(members), [curves[i] for i in members], answers)

    groups: dict[Any, list[int]] = {}
    for i, curve in enumerate(curves):
        groups.setdefault((curve.group, curve.group_source), []).append(i)
    singles = [of(curve.name, [i]) for i, curve in enumerate(curves)]
    return singles, [of(str(name), members) for (name, _), members in groups.items() if len(members) > 1]


def choose_answers(singles: Sequence[Ranking], groups: Sequence[Ranking]) -> list[Posterior]:
    """The answer of each curve by the law that `ranked` chose for its group if it has one, else for the curve itself. A
    curve without an evidence has the answer of its first law."""
    by_group = {
        i: group.chosen for group in groups for i in group.members if group.chosen and singles[i].evidence[group.chosen]
    }
    laws = [by_group.get(i) or ranking.chosen or next(iter(ranking.answers)) for i, ranking in enumerate(singles)]
    return [ranking.answers[law][0] for ranking, law in zip(singles, laws, strict=True)]


def _log_evidence(answer: Posterior) -> tuple[float, float]:
    """Log evidence and its standard error, which is larger if there are no weights that can be trusted; NaN without
    one."""
    evidence = answer.evidence
    if evidence is None or not np.isfinite(evidence.log):
        return np.nan, np.nan
    least = DISTRUSTED if answer.log_weight is None else 0.0
    return evidence.log, max(evidence.error or 0.0, least)

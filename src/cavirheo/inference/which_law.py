"""Comparison of laws by their evidence, p(frames | law), the integral of the likelihood over the prior of each law.

A parameter that is not needed costs log(prior width/posterior width). The comparison of nested laws is therefore only
as good as the prior ranges (docs/method/posterior.md). Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.special import softmax

from cavirheo.curve import RadiusCurve, as_curves
from cavirheo.errors import require
from cavirheo.inference.alternatives import contenders
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.assumptions import Family, Options
from cavirheo.inference.population import Population, with_slope_if_any
from cavirheo.physics.bubble import REAL, Bubble, Requested, bubbles_of
from cavirheo.posterior import Evidence, Pair, Posterior


@dataclass(frozen=True, eq=False)
class Ranking:
    """The laws of one curve or group.

    Attributes:
        name: name of the curve or group.
        evidence: evidence by law; None for a law without one.
        shots: number of curves that are summed.
        answers: answers by law; empty for a group.
        pairs: each law of a group with each worse one.
        populations: one material with its scatter by law, for a group; its `evidence` is that of the law for the
            whole group.
        column: column along which the material may change.
        members: indices of the curves.
        sizes: number of parameters of each law with its bubble.
    """

    name: str
    evidence: dict[str, Evidence | None]
    shots: int
    answers: dict[str, Posterior]
    pairs: tuple[Pair, ...] = ()
    populations: Mapping[str, Population] = field(default_factory=dict)
    column: str = ""
    members: tuple[int, ...] = ()
    sizes: Mapping[str, int] = field(default_factory=dict)

    @property
    def probability(self) -> dict[str, float]:
        """Probability of the laws that have an evidence, if all are equally likely a priori."""
        logs = {law: evidence.log for law, evidence in self.evidence.items() if evidence}
        return dict(zip(logs, softmax(list(logs.values())).tolist(), strict=True)) if logs else {}

    @property
    def contenders(self) -> list[str]:
        """The laws that the evidence does not reject, the simplest first (`alternatives.contenders`)."""
        laws = list(self.evidence)
        return [laws[i] for i in contenders(list(self.evidence.values()), [self.sizes.get(law, 0) for law in laws])]

    @property
    def chosen(self) -> str | None:
        """The simplest law that the evidence does not reject."""
        return self.contenders[0] if self.contenders else None


Model = tuple[str, Bubble]  # law and bubble
DISTRUSTED = 1.0  # standard error of a log evidence if its weights are not to be trusted


def models(laws: Sequence[str], bubbles: Sequence[Bubble] = (REAL,)) -> dict[str, Model]:
    """Every law with every bubble, by its name in a ranking: "nhkv", or "nhkv, real" if there are several bubbles.

    A law without an elastic part is not combined with damage. Raises InputError: fewer than two models, a model twice,
    an unknown law, or a number of a bubble out of its domain.
    """
    words = ", ".join([*laws, *(bubble.name for bubble in bubbles)]) or "none"
    message = f"give two or more different models to choose from, got {words}"
    distinct = all(len(set(choices)) == len(choices) > 0 for choices in (laws, bubbles))
    candidates: dict[str, Model] = {}
    for law, bubble in product(laws, bubbles) if distinct else ():
        Options(bubble=bubble)
        if Family(law).elastic or bubble.damage == "none":
            candidates[f"{law}, {bubble.name}" if len(bubbles) > 1 else law] = law, bubble
    require(len(candidates) >= 2, message, "option.laws")
    return candidates


def rank_laws(
    curves: Sequence[RadiusCurve],
    laws: Sequence[str],
    *,
    bubble: Requested = "real",
    workers: int | None = None,
    done: Callable[[int, Posterior], None] | None = None,
    **options: Any,
) -> tuple[list[Ranking], list[Ranking]]:
    """The ranking of laws for each curve, and for each group of two or more: the sum over its shots, each with
    parameters of its own. bubble: as of `infer`; each law is taken with each of several bubbles (`models`).

    `options` are those of an `Analysis`. `done` is called with the index of the curve and the answer of each law as it
    is found. Raises InputError: fewer than two laws, one unknown, or a setting out of its domain.
    """
    laws = [laws] if isinstance(laws, str) else laws
    curves = as_curves(curves)
    analyses = plans(models(laws, bubbles_of(bubble)), **options)
    by_law = {law: analysis.run(curves, workers, done) for law, analysis in analyses.items()}
    return ranked(curves, by_law)


def plans(chosen: Mapping[str, Model], **options: Any) -> dict[str, Analysis]:
    """The analysis that gives the evidence of each of `models`, by name. options: of `Analysis`."""
    return {name: Analysis("infer", material=law, bubble=bubble, **options) for name, (law, bubble) in chosen.items()}


def ranked(
    curves: Sequence[RadiusCurve], by_law: Mapping[str, Sequence[Posterior]]
) -> tuple[list[Ranking], list[Ranking]]:
    """As `rank_laws`, from the answers by law, in the order of the curves."""
    singles = []
    for i, curve in enumerate(curves):
        answers = {law: answers[i] for law, answers in by_law.items()}
        evidence = {law: _evidence(answer) for law, answer in answers.items()}
        sizes = {law: len(answer.names) for law, answer in answers.items()}
        singles.append(Ranking(curve.name, evidence, 1, answers, members=(i,), sizes=sizes))
    title = next((name for curve in curves for name in curve.column), "")
    groups: dict[Any, list[int]] = {}
    for i, curve in enumerate(curves):
        groups.setdefault((curve.group, curve.group_source), []).append(i)
    along = [curve.column.get(title, np.nan) for curve in curves]
    return singles, [
        replace(_rank_group(str(key[0]), [(singles[i], along[i]) for i in members], title), members=tuple(members))
        for key, members in groups.items()
        if len(members) > 1
    ]


def choose_answers(singles: Sequence[Ranking], groups: Sequence[Ranking]) -> list[Posterior]:
    """The answer of each curve by the law that `ranked` chose for its group if it has one, else for the curve itself. A
    curve without an evidence has the answer of its first law."""
    by_group = {
        i: group.chosen for group in groups for i in group.members if group.chosen and singles[i].evidence[group.chosen]
    }
    return [
        ranking.answers[by_group.get(i) or ranking.chosen or next(iter(ranking.answers))]
        for i, ranking in enumerate(singles)
    ]


def _evidence(answer: Posterior) -> Evidence | None:
    """The evidence with a larger standard error if there are no weights that can be trusted; None without one."""
    evidence = answer.evidence
    if evidence is None or not np.isfinite(evidence.log):
        return None
    if answer.log_weight is None:
        return Evidence(evidence.log, max(evidence.error or 0.0, DISTRUSTED))
    return evidence


def _rank_group(name: str, members: list[tuple[Ranking, float]], column: str) -> Ranking:
    """The ranking by the sum over the shots for which every law has an evidence, except laws that have none for any
    shot; and one material by each law for these shots, with its slope along the column if this has several values."""
    laws = [law for law in members[0][0].evidence if any(ranking.evidence[law] for ranking, _ in members)]
    whole = [(ranking, value) for ranking, value in members if all(ranking.evidence[law] for law in laws)]
    complete = [ranking.evidence for ranking, _ in whole]
    evidence: dict[str, Evidence | None] = dict.fromkeys(members[0][0].evidence)
    for law in laws if complete else ():
        terms = [term for by_law in complete if (term := by_law[law])]
        error = np.sqrt(sum((term.error or 0.0) ** 2 for term in terms))
        evidence[law] = Evidence(float(sum(term.log for term in terms)), float(error))
    logs = {law: np.array([by_law[law].log for by_law in complete]) for law in laws}  # type: ignore[union-attr]
    order = sorted(logs, key=lambda law: -float(np.sum(logs[law])))
    pairs = []
    for first, second in combinations(order, 2) if len(complete) > 1 else ():
        differences = logs[first] - logs[second]
        shots = int(np.sum(differences > 0)), int(np.sum(differences < 0))
        error = float(np.std(differences, ddof=1) * np.sqrt(len(differences)))
        pairs.append(Pair(first, second, float(np.sum(differences)), error, shots))
    names, values = [ranking.name for ranking, _ in whole], [value for _, value in whole]
    materials = {
        law: with_slope_if_any(
            [ranking.answers[law] for ranking, _ in whole], names, values if column else None, only_trusted=False
        )
        for law in (laws if complete else ())
    }
    return Ranking(name, evidence, len(complete), {}, tuple(pairs), materials, column, sizes=members[0][0].sizes)

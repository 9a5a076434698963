"""The evidence of several laws for the shots of a group, in result.json, on a terminal and in the report."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from cavirheo.parameters import is_law_parameter, parameter_of
from cavirheo.posterior import Pair, Posterior
from cavirheo.writing import digits
from cavirheo.writing.document import Finite, Record

if TYPE_CHECKING:
    from cavirheo.inference.which_law import Ranking


class LawOfGroup(Record):
    """The evidence of one law for the shots of a group; null where there is none.

    Attributes:
        log_evidence: sum over the shots of the natural logarithm of p(frames | law).
        standard_error: standard error of log_evidence.
        probability: probability of the law among those that have an evidence, if all are equally likely in advance.
        material: the shots as one material by this law, in a sentence, or why there is none; of a single shot its
            values.
        material_log_evidence: log evidence of the law with one material and its scatter; null where a shot has none.
    """

    log_evidence: Finite = None
    standard_error: Finite = None
    probability: Finite = None
    material: str = ""
    material_log_evidence: Finite = None


class LawsOfGroup(Record):
    """The laws that were compared for the shots of a group.

    Attributes:
        shots: number of shots over which the evidence is summed: those for which all laws have one.
        chosen: simplest law that the evidence does not reject; null where no law has an evidence.
        contenders: laws that the evidence does not reject, the simplest first.
        laws: the laws by name.
        pairs: comparisons of each law with each worse one.
    """

    shots: int
    chosen: str | None
    contenders: list[str]
    laws: dict[str, LawOfGroup]
    pairs: list[Pair] = []

    @property
    def rows(self) -> list[list[str]]:
        """Rows of a table: law, log evidence below the best, probability, and that with one material."""
        best = max((law.log_evidence for law in self.laws.values() if law.log_evidence is not None), default=0.0)
        heights = [law.material_log_evidence for law in self.laws.values() if law.material_log_evidence is not None]
        rows = []
        for name, law in self.laws.items():
            mark = ("→ " if name == self.chosen else "") + name + ("*" if name in self.contenders else "")
            evidence, together = digits.MISSING, digits.MISSING
            if law.log_evidence is not None:
                evidence = f"{law.log_evidence - best:.1f} ± {law.standard_error or 0.0:.1f}"
            if law.material_log_evidence is not None:
                together = f"{law.material_log_evidence - max(heights):.1f}"
            probability = digits.MISSING if law.probability is None else f"{law.probability:.3f}"
            rows.append([mark, evidence, probability, together])
        return rows

    @property
    def sentences(self) -> list[str]:
        """How strongly the evidence prefers the best law to each other law; then the material by each law."""
        preferences = [
            f"{pair.first} before {pair.second} by {pair.difference:.1f} ± {pair.error:.1f} in log evidence (scatter "
            f"over the shots); {pair.shots[0]} shots for, {pair.shots[1]} against"
            for pair in self.pairs[: len(self.laws) - 1]  # those with the best law come first
        ]
        return preferences + [f"{name}: {law.material}" for name, law in self.laws.items() if law.material]


LAW_HEADS = ["law", "log evidence", "probability", "of one material"]
LAWS_TITLE = "log evidence below the best; *: cannot be told from it; →: the simplest of these"


def laws_by_curve(rankings: Iterable[Ranking]) -> dict[int, LawsOfGroup]:
    """The laws of curves and groups by the index of their first curve; of two rankings with one, those of the later."""
    found = {}
    for ranking in rankings:
        laws = {}
        for name, evidence in ranking.evidence.items():
            material = ranking.populations.get(name)
            alone = ranking.answers[name][0] if len(ranking.members) == 1 else None
            together = material.evidence if material and not material.left_out else None  # of the same shots
            laws[name] = LawOfGroup(
                log_evidence=evidence.log if evidence else None,
                standard_error=evidence.error if evidence else None,
                probability=ranking.probability.get(name),
                material=material.line if material else _values_in_words(alone) if alone else "",
                material_log_evidence=together.log if together else None,
            )
        ranked = {key: getattr(ranking, key) for key in ("shots", "chosen", "contenders", "pairs")}
        found[ranking.members[0]] = LawsOfGroup(laws=laws, **ranked)
    return found


def _values_in_words(answer: Posterior) -> str:
    """'G 5.1 kPa (4.8 to 5.5), µ 0.021 Pa s (0.018 to 0.024), RMSE 1.2 %'."""
    values = {name: answer.quantity(name) for name in answer.parameters if is_law_parameter(name)}
    words = []
    for name, value in values.items():
        factor, unit = digits.unit_for(parameter_of(name).unit, value.largest)
        words.append(f"{parameter_of(name).symbol} {digits.quantity(value, factor, unit=unit)}")
    return ", ".join([*words, f"RMSE {digits.percent(answer.checks.rmse_over_rmax)} %"])

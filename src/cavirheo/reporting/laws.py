"""laws.json: the evidence of several laws for the same curves, and its table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from cavirheo.inference.which_law import Pair, Ranking
from cavirheo.reporting.answer import CurveRecord, curve_record
from cavirheo.reporting.group import size_trends
from cavirheo.reporting.material import PopulationRecord, population_record
from cavirheo.reporting.screen import value_parts
from cavirheo.reporting.table import input_warnings
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Record

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve

_TITLE = "log evidence below the best; *: cannot be told from it; →: the simplest of these"


class WeighedLaw(Record):
    """The evidence of one law; null where there is none.

    Attributes:
        log_evidence: natural logarithm of p(frames | law); for a group, the sum over its shots.
        standard_error: standard error of log_evidence.
        probability: probability of the law among those that have an evidence, if all are equally likely in advance.
        answer: the answer by this law as in result.json; null for a group.
        population: for a group, its material by this law with the scatter of the shots and the evidence of the law;
            left out where there is none.
    """

    log_evidence: float | None
    standard_error: float | None
    probability: float | None
    answer: CurveRecord | None = None
    population: PopulationRecord | None = None
    _omitted_if_empty = ("population",)


class WeighedLaws(Record):
    """The laws of one curve, or of a group.

    Attributes:
        name: name of the curve or group.
        shots: number of shots over which the evidence is summed: those for which all laws have one; 1 for a curve.
        chosen: simplest law that the evidence does not reject; null where no law has an evidence.
        contenders: laws that the evidence does not reject, the simplest first.
        laws: the laws by name.
        pairs: comparisons of each law of a group with each worse one; empty for a curve.
    """

    name: str
    shots: int
    chosen: str | None
    contenders: list[str]
    laws: dict[str, WeighedLaw]
    pairs: list[Pair] = []


class Laws(Document):
    """The evidence of several laws for the same curves.

    Attributes:
        curves: the laws of each curve.
        groups: the laws of each group of two shots or more.
    """

    kind: Literal["laws"] = "laws"
    curves: list[WeighedLaws]
    groups: list[WeighedLaws]


def law_records(
    curves: Sequence[RadiusCurve], singles: Sequence[Ranking], groups: Sequence[Ranking]
) -> tuple[list[WeighedLaws], list[WeighedLaws]]:
    """The records of the curves and of their groups for the document, from their rankings."""
    by_curve = [
        _record_of(ranking, {law: {"answer": curve_record(curve, answer)} for law, answer in ranking.answers.items()})
        for curve, ranking in zip(curves, singles, strict=True)
    ]
    by_group = []
    for group in groups:
        fields: dict[str, dict[str, Any]] = {}
        for law in group.evidence:
            fields[law] = {"population": population_record(group.populations.get(law), group.column)}
        by_group.append(_record_of(group, fields))
    return by_curve, by_group


def _record_of(ranking: Ranking, fields: Mapping[str, Mapping[str, Any]]) -> WeighedLaws:
    """The record of a ranking for the document. fields: by law, the fields of its record other than the evidence."""
    laws, names = {}, ("name", "shots", "chosen", "contenders", "pairs")
    for law, value in ranking.log_evidence.items():
        error, probability = ranking.error[law], ranking.probability.get(law)
        laws[law] = WeighedLaw(log_evidence=value, standard_error=error, probability=probability, **fields[law])
    return WeighedLaws(**{name: getattr(ranking, name) for name in names}, laws=laws)


def print_table(document: Laws) -> None:
    """Print a line per law of each curve, then of each group; then input warnings, remarks on groups, and notes."""
    heads = ("law", "log evidence", "probability", "G Pa", "µ Pa s", "RMSE %", "verdict")
    answers = [law.answer for laws in document.curves for law in laws.laws.values() if law.answer]
    bubbles = ", ".join(dict.fromkeys(answer.bubble.title for answer in answers))
    title = f"{_TITLE}; {bubbles}" if bubbles else _TITLE
    table = terminal.table("curve", heads, left=("law", "verdict"), title=title)
    names = digits.distinct_names([laws.name for laws in document.curves])
    rows = [(laws, name, "") for laws, name in zip(document.curves, names, strict=True)]
    rows += [(laws, f"{laws.name}: {laws.shots} shots", "bold") for laws in document.groups]
    for laws, name, style in rows:
        best = max((law.log_evidence for law in laws.laws.values() if law.log_evidence is not None), default=0.0)
        for law, entry in laws.laws.items():
            mark = ("→ " if law == laws.chosen else "") + law + ("*" if law in laws.contenders else "")
            table.add_row(name if law == next(iter(laws.laws)) else "", mark, *_law_cells(entry, best), style=style)
        table.add_section()
    console = terminal.console()
    console.print(table)
    terminal.print_warnings(console, input_warnings(answers))
    lines = [*_failure_lines(document), *preference_lines(document)]
    for group in document.groups:
        for law in group.laws:
            answers_by_law = [laws.laws[law].answer for laws in document.curves if law in laws.laws]
            if trends := size_trends(shot for shot in answers_by_law if shot and shot.group == group.name):
                lines.append(f"{group.name}, {law}: {', '.join(trends)} with R_max, which a constant does not")
        lines += _material_lines(group)
    terminal.print_remarks(console, {}, [*lines, *document.notes])


def _failure_lines(document: Laws) -> list[str]:
    """A line for each law of a curve that has no answer, with the reason."""
    pairs = [(laws.name, law, entry.answer) for laws in document.curves for law, entry in laws.laws.items()]
    return [f"{curve}, {law}: {answer.message}" for curve, law, answer in pairs if answer and not answer.has_answer]


def preference_lines(document: Laws) -> list[str]:
    """Lines on how strongly the evidence of each group prefers its best law to each other law."""
    return [
        f"{group.name}: {pair.first} before {pair.second} by {pair.difference:.1f} ± {pair.error:.1f} in log evidence "
        f"(scatter over the shots); {pair.shots[0]} shots for, {pair.shots[1]} against"
        for group in document.groups
        for pair in group.pairs[: len(group.laws) - 1]  # those with the best law come first
    ]


def _material_lines(group: WeighedLaws) -> list[str]:
    """A line for each law, best first: its log evidence with one material minus the best one, and that material."""
    materials = {law: entry.population for law, entry in group.laws.items() if entry.population}
    whole = {law: material for law, material in materials.items() if not material.left_out}  # these use the same shots
    heights = {law: material.log_evidence for law, material in whole.items() if material.log_evidence is not None}
    top, lines = max(heights.values(), default=0.0), []
    for law in sorted(materials, key=lambda law: -heights.get(law, float("-inf"))):
        material = materials[law]
        error = "" if material.log_evidence_error is None else f" ± {material.log_evidence_error:.1f}"
        height = f"log evidence {heights[law] - top:.1f}{error}; " if law in heights else ""
        lines.append(f"{group.name}, one material, {law}: {height}{material.line}")
    return lines


def _law_cells(law: WeighedLaw, best: float) -> list[str]:
    texts = [digits.MISSING, digits.MISSING]
    if law.log_evidence is not None:
        error = "" if law.standard_error is None else f" ± {law.standard_error:.1f}"
        texts = [f"{law.log_evidence - best:.1f}{error}", f"{law.probability or 0.0:.3f}"]
    if (answer := law.answer) is not None:
        for value in (answer.shear_modulus_Pa, answer.viscosity):
            middle, bound = value_parts(value, 1.0)
            texts.append(middle or bound)
        texts += [digits.percent(answer.rmse_over_rmax), digits.VERDICT_WORDS[answer.verdict]]
    return texts

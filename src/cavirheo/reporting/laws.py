"""laws.json: the evidence of several laws for the same curves, and its table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from cavirheo.inference.verify.evidence import Pair, Ranking
from cavirheo.reporting.answer import CurveRecord, curve_record
from cavirheo.reporting.group import Slope, in_words, sloped, slopes
from cavirheo.reporting.material import PopulationRecord, population_record
from cavirheo.reporting.table import warnings
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Record

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve

_TITLE = "log evidence below the best; *: cannot be told from it; →: the simplest of these"


class WeighedLaw(Record):
    """One law; null where there is no evidence.

    Attributes:
        log_evidence: natural logarithm of p(frames | law); of a group, the sum over its shots.
        standard_error: of the log evidence.
        probability: of the laws that have an evidence, all being equally likely before.
        answer: the row that result.json would have; for a curve alone.
        slopes: for a group of five shots or more, d ln(value)/d ln R_max of what should be a constant, by natural name;
            left out where there is none.
        population: for a group, one material with its scatter, and the evidence of the law so; left out where there is
            none.
    """

    log_evidence: float | None
    standard_error: float | None
    probability: float | None
    answer: CurveRecord | None = None
    slopes: dict[str, Slope] = {}
    population: PopulationRecord | None = None
    _if_any = ("slopes", "population")


class WeighedLaws(Record):
    """The laws of one curve, or of a group.

    Attributes:
        name: of the curve or group.
        shots: over how many the evidence is summed; 1 for a curve.
        chosen: the simplest law that is not clearly worse than the best; null where no law has an evidence.
        contenders: laws that cannot be told from the best, simplest first.
        laws: by name.
        pairs: of a group, every law and each worse one.
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
        curves: an entry for each curve.
        groups: an entry for each group.
    """

    kind: Literal["laws"] = "laws"
    curves: list[WeighedLaws]
    groups: list[WeighedLaws]


def records(
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
            shots = sloped([answer for i in group.members if (answer := by_curve[i].laws[law].answer)])
            material = population_record(group.populations.get(law), group.column)
            fields[law] = {"slopes": slopes(shots, shots), "population": material}
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
    rows = [(laws, laws.name, "") for laws in document.curves]
    rows += [(laws, f"{laws.name}: {laws.shots} shots", "bold") for laws in document.groups]
    for (laws, _, style), name in zip(rows, digits.shortened([name for _, name, _ in rows]), strict=True):
        best = max((law.log_evidence for law in laws.laws.values() if law.log_evidence is not None), default=0.0)
        for law, entry in laws.laws.items():
            mark = ("→ " if law == laws.chosen else "") + law + ("*" if law in laws.contenders else "")
            table.add_row(name, mark, *_texts(entry, best), style=style)
            name = ""
        table.add_section()
    console = terminal.console()
    console.print(table)
    terminal.print_warnings(console, warnings(answers))
    lines = firmly(document)
    for group in document.groups:
        lines += [f"{group.name}, {law}: {in_words(laws.slopes)}" for law, laws in group.laws.items() if laws.slopes]
        lines += _materials(group)
    terminal.print_remarks(console, {}, [*lines, *document.notes])


def firmly(document: Laws) -> list[str]:
    """Lines on how strongly the evidence of each group prefers its best law to each other law."""
    return [
        f"{group.name}: {pair.first} before {pair.second} by {pair.difference:.1f} ± {pair.error:.1f} in log evidence "
        f"(scatter over the shots); {pair.shots[0]} shots for, {pair.shots[1]} against"
        for group in document.groups
        for pair in group.pairs[: len(group.laws) - 1]  # those with the best law come first
    ]


def _materials(group: WeighedLaws) -> list[str]:
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


def _texts(law: WeighedLaw, best: float) -> list[str]:
    texts = [digits.MISSING, digits.MISSING]
    if law.log_evidence is not None:
        error = "" if law.standard_error is None else f" ± {law.standard_error:.1f}"
        texts = [f"{law.log_evidence - best:.1f}{error}", f"{law.probability or 0.0:.3f}"]
    if (answer := law.answer) is not None:
        texts += [digits.number(answer.shear_modulus_Pa.median), digits.number(answer.viscosity.median)]
        texts += [digits.percent(answer.rmse_over_rmax), digits.LOOKS[answer.verdict].words]
    return texts

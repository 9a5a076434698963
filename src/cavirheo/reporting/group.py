"""The shots of one file or folder: the answer for their material, its verdict, and what a user must know of it.

The verdict of a group obeys its rows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cavirheo.messages import Message
from cavirheo.parameters import BUBBLE, CAMERA, VISCOSITY_AT_RATE, is_law_parameter, parameter_of
from cavirheo.posterior import Verdict
from cavirheo.reporting.answer import CurveRecord, Sentence
from cavirheo.reporting.laws import LawsOfGroup
from cavirheo.reporting.material import (
    MAIN_FIELDS,
    WIDE_SCATTER,
    PopulationRecord,
    Systematic,
    population_record,
    slopes_in_words,
    systematic_of,
)
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Record, Spread

if TYPE_CHECKING:
    from cavirheo.inference.population import Population

MIN_TREND_SHOTS = 5  # least number of shots in which a trend with R_max is looked for
LEAST_RANGES = 0.1, 1e-6  # of ln R_max, over which its own error shows no trend; and of the logarithm of the values
MATERIAL_CONSTANTS = ("viscosity", VISCOSITY_AT_RATE, "shear_modulus")
OUR_METHOD = "cavirheo"  # name of the answers of this program beside the values of other methods
TWO_SIDED_99 = 2.58  # standard deviations
DECIDING_SHARE = 0.5  # share of the shots of a group, above which they decide its verdict
MISFIT_SHARE = 0.25  # share of shots that do not fit, above which the others are a choice of those that the law suits


class PublishedValue(Spread):
    """The value of a parameter by another method.

    Attributes:
        source: publication of the value; left out where it is not known.
    """

    source: str = ""
    _omitted_if_empty = ("source",)


Published = Mapping[str, Mapping[str, PublishedValue]]  # by method and parameter, SI


class GroupRecord(Record):
    """The shots of one file or folder, and the answer for their material.

    Attributes:
        name: name of the file or folder.
        n: number of shots with an answer.
        n_counted: number of shots that count in the answer.
        n_failed: number of shots without an answer.
        population: the answer for the material; of a single shot that counts, its own answer. Its values are null where
            there is none.
        systematic: what errors that all shots share do to it; empty where that is not known.
        verdict: "ok", or what is wrong (docs/method/verdicts.md).
        messages: reasons for the verdict first, then remarks.
        verdicts: number of curves by verdict.
        published: values of other methods, by method and parameter, SI; left out unless they were given. The parameter
            viscosity_at_1_rad_per_s is the viscosity by a rheometer at this angular frequency.
        laws: the laws that were compared by their evidence; left out unless they were (`which-law`).
    """

    name: str
    n: int
    n_counted: int
    n_failed: int
    population: PopulationRecord = PopulationRecord()
    systematic: Systematic = Systematic()
    verdict: Verdict
    messages: list[Sentence] = []
    verdicts: dict[str, int]
    published: dict[str, dict[str, PublishedValue]] = {}
    laws: LawsOfGroup | None = None
    _omitted_if_empty = ("published", "laws")

    def value(self, name: str) -> Quantity:
        """The group's answer for a parameter by its natural name; an empty one if there is none."""
        return self.population.value(name)

    @property
    def viscosity(self) -> Quantity:
        """The viscosity, or that at 1e5 1/s of a law without a constant viscosity."""
        return self.population.viscosity

    @property
    def has_answer(self) -> bool:
        """Whether any parameter of the material has a value or a bound."""
        return any(self.value(name).known for name in MAIN_FIELDS) or self.viscosity.known

    @property
    def doubts(self) -> list[Sentence]:
        """The messages because of which no line of this group is to be used without a second look."""
        return [message for message in self.messages if message.code.startswith("group.doubt.")]

    @property
    def facts(self) -> list[Sentence]:
        """The messages on what could be wrong."""
        return [message for message in self.messages if message not in self.doubts]

    @property
    def change_by_scale(self) -> float | None:
        """Change of G, %, by 1 % in scale or frame rate; None where it is not known."""
        return self.systematic.slopes.get("shear_modulus", {}).get("scale")


def size_trends(shots: Iterable[CurveRecord]) -> list[str]:
    """Which parameters rise or fall with R_max over these shots, 'µ rises', by more than chance (1 in 100). Shots that
    the model does not fit are among them. Ranks decide (Spearman's), so that few shots in a false mode hardly count."""
    followed = [shot for shot in shots if shot.trusted or shot.verdict == "does_not_fit"]
    trends = list[str]()
    for name in MATERIAL_CONSTANTS:
        pairs = np.array([(shot.max_radius_m, shot.value(name).median) for shot in followed], dtype=float)
        logs = np.log(pairs[np.all(pairs > 0.0, axis=-1)]).reshape(-1, 2)
        if len(logs) < MIN_TREND_SHOTS or np.any(np.ptp(logs, axis=0) < LEAST_RANGES):
            continue
        ranks = np.argsort(np.argsort(logs, axis=0), axis=0)
        correlation = np.clip(np.asarray(np.corrcoef(ranks.T))[0, 1], -0.999999, 0.999999)
        if abs(np.arctanh(correlation)) * np.sqrt((len(logs) - 3) / 1.06) > TWO_SIDED_99:
            trends.append(f"{parameter_of(name).symbol} {'rises' if correlation > 0 else 'falls'}")
    return trends


def group_record(
    name: str, members: Sequence[CurveRecord], material: Population | None = None, column: str = ""
) -> GroupRecord:
    """The record of a group, from the records of its curves and from its material. column: title of the column along
    which the material may change."""
    shots = [record for record in members if record.has_answer]
    population, systematic = population_record(material, column), systematic_of(material)
    if len(members) == 1 and members[0].verdict in ("ok", "bound", "unverified"):
        population, systematic = _of_one_shot(members[0])
    doubts = _doubts(shots, population)
    facts = [*_facts(shots, systematic), *_of_population(population, members)]
    if material and population.has_material:
        facts += [Message("group.rough", {"text": warning}) for warning in material.warnings]
    return GroupRecord(
        name=name,
        n=len(shots),
        n_counted=population.n if population.line else sum(record.trusted for record in members),
        n_failed=len(members) - len(shots),
        population=population,
        systematic=systematic,
        verdict=_verdict(shots, doubts, population),
        messages=[Sentence(code=message.code, text=message.text) for message in (*doubts, *facts)],
        verdicts=dict(Counter(record.verdict for record in members)),
    )


def _of_one_shot(row: CurveRecord) -> tuple[PopulationRecord, Systematic]:
    """The answer of a single shot as that of its group."""
    names = [name for name in (*MAIN_FIELDS, *row.other_parameters) if name in MAIN_FIELDS or is_law_parameter(name)]
    values = PopulationRecord.fields_of({name: row.value(name) for name in names})
    change = row.diagnostics.modulus_over_scale
    slopes = {} if change is None else {"shear_modulus": {"scale": change}}
    population = PopulationRecord(line="a single shot", model=row.model, n=1, switches=row.switches, **values)
    return population, Systematic(slopes=slopes)


def _most(count: int, of: int) -> bool:
    return count > DECIDING_SHARE * of


def _doubts(shots: Sequence[CurveRecord], population: PopulationRecord) -> list[Message]:
    """Why the answer of a group is not to be used without a second look."""
    messages = []
    total = len(shots)
    doubted = [record for record in shots if record.verdict == "check_input"]
    if total > 1 and _most(len(doubted), total):
        counts = {"count": len(doubted), "total": total}
        messages.append(Message("group.doubt.input", {**counts, "reason": _reason(doubted)}))
    for code, names in (("group.doubt.ends", CAMERA), ("group.doubt.bubble", tuple(BUBBLE))):
        ends = [{*names} & {*record.diagnostics.at_bound} for record in shots]
        pulled = sum(map(bool, ends))
        if total > 1 and _most(pulled, total):
            found = sorted(set().union(*ends))
            messages.append(Message(code, {"count": pulled, "total": total, "names": found}))
    for name, heaps in population.heaps.items():
        messages.append(Message("group.doubt.heaps", {"name": name, "heaps": heaps}))
    for name, scatter in population.wide_scatters.items():
        messages.append(Message("group.doubt.scatter", {"name": name, "scatter": scatter, "limit": WIDE_SCATTER}))
    misfits = sum(record.verdict == "does_not_fit" for record in shots)
    if total > 1 and misfits > MISFIT_SHARE * total:
        messages.append(Message("group.doubt.misfits", {"count": misfits, "total": total}))
    if trends := size_trends(shots):
        messages.append(Message("group.doubt.trend", {"trends": trends}))
    return messages


def _of_population(population: PopulationRecord, members: Sequence[CurveRecord]) -> list[Message]:
    """Messages on shots that do not count, on shots that are unlike the others, and on the slope along a column."""
    messages = list[Message]()
    if population.left_out:
        messages.append(Message("group.left_out", {"counts": population.left_out}))
    if population.outliers:
        names = [record.name for record in members]
        short = dict(zip(names, digits.distinct_names(names), strict=True))
        probabilities = {short[name]: probability for name, probability in population.outliers.items()}
        messages.append(Message("group.outliers", {"probabilities": probabilities}))
    if population.slopes_decades:
        words = slopes_in_words(population.column, population.column_at or 0.0, population.slopes_decades)
        messages.append(Message("group.slope", {"text": words}))
    return messages


def _reason(doubted: Sequence[CurveRecord]) -> str:
    """The input warning that most of these shots have; of the first of them, if its numbers differ."""
    names = digits.distinct_names([record.name for record in doubted])
    shots = zip(names, doubted, strict=True)
    warnings = [(name, message) for name, record in shots for message in record.warnings or record.messages]
    if not warnings:
        return "see each shot"
    code = Counter(message.code for _, message in warnings).most_common(1)[0][0]
    name, text = next((name, message.text) for name, message in warnings if message.code == code)
    return text if len({message.text for _, message in warnings if message.code == code}) == 1 else f"{name}: {text}"


def _verdict(shots: Sequence[CurveRecord], doubts: Sequence[Message], population: PopulationRecord) -> Verdict:
    """The verdict of a group. It obeys its rows; with a material it is about the material's G and mu."""
    if not shots:
        return "failed"
    if len(shots) == 1:
        return shots[0].verdict
    codes = {message.code for message in doubts}
    wrong_law = {"group.doubt.bubble", "group.doubt.misfits"}
    if codes - wrong_law - {"group.doubt.trend"}:
        return "check_input"
    if codes & wrong_law:
        return "does_not_fit"
    if codes:
        return "check_input"
    if not population.has_material:
        return Counter(record.verdict for record in shots).most_common(1)[0][0]
    values = [population.value(name) for name in MAIN_FIELDS]
    return "bound" if any(value.bound and not value.is_zero for value in values) else "ok"


def _facts(shots: Sequence[CurveRecord], systematic: Systematic) -> list[Message]:
    """Messages on what 1 % of scale or rate does to G, and on the constants that neither a file nor the user gave."""
    messages = list[Message]()
    change = systematic.slopes.get("shear_modulus", {}).get("scale")
    if change is not None:
        messages.append(Message("group.scale", {"change": change}))
    values = {name: value for record in shots for name, value in record.provenance.get("assumed", {}).items()}
    if values:
        messages.append(Message("group.not_given", {"values": values}))
    return messages

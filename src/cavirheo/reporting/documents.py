"""From answers to the document of a run: a row for each curve, and for each group of shots the answer for their
material, its verdict, which obeys the rows, and what a user must know of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from datetime import datetime
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtr

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, expect
from cavirheo.messages import Message
from cavirheo.parameters import BUBBLE, CAMERA, VISCOSITY_AT_RATE, is_at_rate, is_law_parameter, symbol, wide_bound
from cavirheo.posterior import Posterior, Verdict, viscosity_at_rate
from cavirheo.reporting.record import (
    MAIN_FIELDS,
    WIDE_SCATTER,
    CurveRecord,
    GroupRecord,
    LawOfGroup,
    LawsOfGroup,
    MaterialRatio,
    PopulationRecord,
    Result,
    Systematic,
    json_data,
    members_of,
)
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Record, finite

if TYPE_CHECKING:
    from cavirheo.inference.population import CommonErrors, Population
    from cavirheo.inference.which_law import Ranking

Pairs = Sequence[tuple[RadiusCurve, Posterior]]
MIN_TREND_SHOTS = 5  # least number of shots in which a trend with R_max is looked for
LEAST_RANGES = 0.1, 1e-6  # of ln R_max, over which its own error shows no trend; and of the logarithm of the values
MATERIAL_CONSTANTS = ("viscosity", VISCOSITY_AT_RATE, "shear_modulus")
CHANCE = 0.01  # probability of a trend by chance
DECIDING_SHARE = 0.5  # share of the shots of a group, above which they decide its verdict
LEAST_CHANGE = 1.0  # % of G by 1 % in scale or frame rate, from which on it is said
MISFIT_SHARE = 0.15  # share of shots that do not fit, above which the others are a choice of those that the law suits
SHARED_WARNINGS = {"check_input.walls": 1.0 / 3.0, "check_input.late_start": MISFIT_SHARE}
"""Share of the shots of a group with an input warning beyond which it holds for all: they have one vessel and scale,
or are cut alike, and others only show it less. Of simulated shots 7 % are said to need walls."""
_MAX_COMPARED = 6  # most groups that are compared, each with each


def result(
    pairs: Pairs,
    command: str,
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
    errors: CommonErrors | None = None,
) -> Result:
    """The document of all curves, in the given order, and of their groups.

    Args:
        pairs: (curve, answer), in the order of the rows.
        command: the command that was run, as text.
        date: date of the run; default: the present time.
        notes: notes on the run as a whole (files that could not be read, ...).
        errors: relative standard deviations of the errors that all shots of a group share; default: those of
            `population`.
    """
    rows = [curve_record(curve, answer) for curve, answer in pairs]
    date = date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    answers = [answer for _, answer in pairs]
    return result_of(rows, answers, errors, command=command, date=date, notes=list(notes))


def result_of(
    rows: Sequence[CurveRecord],
    answers: Sequence[Posterior] = (),
    errors: CommonErrors | None = None,
    **head: Any,
) -> Result:
    """The result of these records of curves, and of their groups. answers: those of the curves; without them groups
    have no material. errors: as of `result`. head: fields of a `Document`."""
    groups = list[GroupRecord]()
    materials: dict[str, Population] = {}
    for name, indices in members_of(rows):
        members, own = [rows[i] for i in indices], [answers[i] for i in indices if answers]
        if len(own) > 1 and any(len(answer.theta) > 1 for answer in own):
            from cavirheo.inference.population import population

            materials[name] = population(own, names=[row.name for row in members], errors=errors)
        groups.append(group_record(name, members, materials.get(name), errors))
    return Result(curves=list(rows), groups=groups, differences=differences(materials), **head)


def table(answers: Sequence[Posterior]) -> Any:
    """The answers as a pandas.DataFrame: a row for each, with the columns of result.csv in SI ("name", "max_radius_m",
    "shear_modulus_Pa", "shear_modulus_Pa_q05", ..., "verdict", "message").

    A failed answer has NaN. So has the median of a bound: its limit is in the column _q95 if the value is below it, in
    _q05 if above, and _bound says which.

    Args:
        answers: as `infer_many` or `fit_many` give them.

    Raises:
        InputError: no answers, an answer without its curve, or pandas is missing.
    """
    expected = "a list of answers of infer_many or fit_many"
    expect(answers, Iterable, expected)
    if isinstance(answers, Result):
        raise InputError(f"expected {expected}; a Result has to_dataframe()", "input.type")
    rows = []
    for answer in answers:
        expect(answer, Posterior, expected)
        if answer.curve is None:
            message = "an answer has no curve to name its row: set one, dataclasses.replace(answer, curve=curve)"
            raise InputError(message, "posterior.no_curve")
        rows.append(curve_record(answer.curve, answer))
    return result_of(rows, command="cavirheo.table").to_dataframe()


def curve_record(curve: RadiusCurve, posterior: Posterior) -> CurveRecord:
    """The row of one curve."""
    posterior = _failed_if_invalid(posterior)
    checks, prior = posterior.checks, posterior.stretch_prior
    values = {name: posterior.quantity(name) for name in posterior.parameters}
    assumed = {name: posterior.best.get(name) for name in BUBBLE if name not in values}
    values |= {name: Quantity(median=value) for name, value in assumed.items() if value}
    draws = {name: posterior.draws(name) for name in posterior.parameters}
    if at_rate := viscosity_at_rate(posterior.material, draws, posterior.log_weight):
        values[VISCOSITY_AT_RATE] = at_rate
    if "stretch" not in values:  # it is given, or was fitted to a network's answer
        values["stretch"] = Quantity(median=finite(posterior.stretch))
    differing: dict[str, Any] = {
        "name": curve.name,
        **dict.fromkeys(("max_radius_m", "time_of_max_s", "strain_rate_per_s")),
        "best": {} if checks.reconstruction_time is None else posterior.best,
        "window": checks,
        "messages": checks.messages,
        "stretch_prior": {"mean": prior[0], "std": prior[1]} if prior else {},
        "seconds": finite(posterior.seconds) or 0.0,
        "diagnostics": json_data(posterior.diagnostics),
        "provenance": json_data(posterior.provenance),
    }
    with suppress(InputError):  # no R_max, or no collapse after it
        differing |= {"max_radius_m": curve.max_radius, "time_of_max_s": curve.time_of_max}
        differing["strain_rate_per_s"] = curve.strain_rate()
    return CurveRecord(**same_fields(CurveRecord, curve, posterior, checks) | differing | CurveRecord.fields_of(values))


def same_fields(kind: type[Record], *owners: Any) -> dict[str, Any]:
    """The values of a record's fields that these objects have under the same names; those of a later one count."""
    return {name: getattr(owner, name) for owner in owners for name in kind.model_fields if hasattr(owner, name)}


def _failed_if_invalid(posterior: Posterior) -> Posterior:
    """The answer; a failed one, or one without draws that are finite, becomes "failed" with reasons and no values."""
    if posterior.checks.verdict == "failed" or not posterior.theta.size:
        reasons = () if posterior.checks.messages else (Message("answer.none"),)
        return posterior.without_draws(*reasons)
    broken = ", ".join(name for name in posterior.parameters if not np.all(np.isfinite(posterior.draws(name))))
    return posterior.without_draws(Message("answer.not_finite", {"parameters": broken})) if broken else posterior


def group_record(
    name: str,
    members: Sequence[CurveRecord],
    material: Population | None = None,
    errors: CommonErrors | None = None,
) -> GroupRecord:
    """The record of a group by those of its curves and by its material. errors: of a single shot, as of `result`."""
    shots = [record for record in members if record.has_answer]
    population, systematic = _of_material(material) if material else (PopulationRecord(), Systematic())
    if len(members) == 1 and members[0].verdict in ("ok", "bound", "unverified"):
        population, systematic = _of_one_shot(members[0], errors)
    elif not population.has_material:
        changes = [row.diagnostics.modulus_over_scale for row in shots if row.trusted]
        known = [change for change in changes if change is not None]
        systematic.slopes |= {"shear_modulus": {"scale": float(np.mean(known))}} if known else {}
    doubts = _doubts(shots, population)
    messages: Any = doubts + _facts(members, population, systematic)
    if material and population.has_material:
        messages += [Message("group.rough", {"text": warning}) for warning in material.warnings]
    return GroupRecord(
        name=name,
        n=len(shots),
        n_counted=population.n if population.line else sum(record.trusted for record in members),
        population=population,
        systematic=systematic,
        verdict=_verdict(shots, doubts, population),
        messages=messages,
        verdicts=dict(Counter(record.verdict for record in members)),
    )


def _of_one_shot(row: CurveRecord, errors: CommonErrors | None) -> tuple[PopulationRecord, Systematic]:
    """The answer of a single shot as that of its group, whose common errors it has, too."""
    from cavirheo.inference.population.material import CommonErrors, slopes, widened, widened_limit

    errors = errors or CommonErrors()
    over = {"shear_modulus": row.diagnostics.modulus_over_scale, "viscosity": row.diagnostics.viscosity_over_scale}
    values = {name: row.value(name) for name in (*MAIN_FIELDS, *row.other_parameters) if is_law_parameter(name)}
    systematic = Systematic(errors=asdict(errors))
    for name, change in over.items():
        value = values[name]
        if change is not None and value.median and value.q05 and value.q95:
            systematic.slopes[name] = slopes(name, change)
            systematic.statistics[name] = value
            low, high = widened((value.q05, value.median, value.q95), systematic.slopes[name], errors)
            values[name] = Quantity.from_interval(low, value.median, high, wide_bound(name, low, high))
    modulus = values["shear_modulus"]
    stretch = row.stretch.median or row.best.get("stretch")
    if modulus.bound == "upper" and row.medium and stretch:
        limit = widened_limit(modulus.q95 or 0.0, errors, row.medium.pressure, stretch)
        values["shear_modulus"] = modulus.model_copy(update={"q95": limit})
    fields = PopulationRecord.fields_of(values)
    fields |= {"line": "a single shot", "model": f"{row.material}, {row.bubble.name}", "n": 1}
    return PopulationRecord(switches=row.switches, **fields), systematic


def _doubts(shots: Sequence[CurveRecord], population: PopulationRecord) -> list[Message]:
    """Why the answer of a group is not to be used without a second look."""
    messages = []
    total = len(shots)
    most = max(DECIDING_SHARE * total, 1)
    doubted = [record for record in shots if record.verdict == "check_input"]
    suspects = doubted if len(doubted) > most else []
    for code, share in SHARED_WARNINGS.items():
        shown = [record for record in doubted if code in [one.code for one in record.warnings]]
        if len(shown) > max(share * total, 1):
            suspects = shown
    if suspects:
        values = {"count": len(suspects), "total": total, "reason": _reason(suspects)}
        messages.append(Message("group.doubt.input", values))
    for code, names in (("group.doubt.ends", CAMERA), ("group.doubt.bubble", tuple(BUBBLE))):
        ends = [found for shot in shots if (found := {*names} & {*shot.diagnostics.at_bound})]
        if len(ends) > most:
            values = {"count": len(ends), "total": total, "names": sorted(set().union(*ends))}
            messages.append(Message(code, values))
    for name, heaps in population.heaps.items():
        messages.append(Message("group.doubt.heaps", {"name": name, "heaps": heaps}))
    for name, scatter in population.wide_scatters.items():
        messages.append(Message("group.doubt.scatter", {"name": name, "scatter": scatter, "limit": WIDE_SCATTER}))
    misfits = sum(record.verdict == "does_not_fit" for record in shots) if total > 1 else 0
    apart = population.left_out.get("other_switches", 0)
    for code, count in (("group.doubt.misfits", misfits), ("group.doubt.switches", apart)):
        if count > MISFIT_SHARE * total:
            messages.append(Message(code, {"count": count, "total": total}))
    if trends := size_trends(shots):
        messages.append(Message("group.doubt.trend", {"trends": trends}))
    return messages


def _reason(doubted: Sequence[CurveRecord]) -> str:
    """The input warning that most of these shots have; of the first of them, if its numbers differ."""
    names = digits.distinct_names([record.name for record in doubted])
    warnings = [(name, message) for name, shot in zip(names, doubted, strict=True) for message in shot.warnings]
    (code, _), *_ = Counter(message.code for _, message in warnings).most_common(1)
    texts = {name: message.text for name, message in warnings if message.code == code}
    name, text = next(iter(texts.items()))
    return text if len({*texts.values()}) == 1 else f"{name}: {text}"


def _verdict(shots: Sequence[CurveRecord], doubts: Sequence[Message], population: PopulationRecord) -> Verdict:
    """The verdict of a group. It obeys its rows; with a material it is about the material's G and mu."""
    if not shots:
        return "failed"
    values = [population.value(name) for name in MAIN_FIELDS]
    bounded = any(value.bound and not value.is_zero for value in values)
    if len(shots) == 1:
        return "bound" if bounded and shots[0].verdict == "ok" else shots[0].verdict
    codes = {message.code for message in doubts} - {"group.doubt.trend"}
    if codes and codes <= {"group.doubt.bubble", "group.doubt.misfits", "group.doubt.switches"}:
        return "does_not_fit"
    if doubts:
        return "check_input"
    if not population.has_material:
        return Counter(record.verdict for record in shots).most_common(1)[0][0]
    return "bound" if bounded else "ok"


def _facts(members: Sequence[CurveRecord], population: PopulationRecord, systematic: Systematic) -> list[Message]:
    """Messages on stiffening that a late start may feign, on a liquid with one collapse, on what 1 % of scale or rate
    does to G, on constants that nobody gave, and on shots that do not count or are unlike the others."""
    messages = list[Message]()
    late = sum("stiffening.late_start" in [message.code for message in record.messages] for record in members)
    if late:
        messages.append(Message("group.late_start", {"count": late, "total": len(members)}))
    collapses = [record.window.collapses or 0 for record in members if record.trusted]
    is_liquid = not population.shear_modulus_Pa.known or population.switches.get("liquid", 0.0) >= 0.5
    if collapses and max(collapses) < 2 and is_liquid:
        messages.append(Message("group.one_collapse"))
    change = systematic.slopes.get("shear_modulus", {}).get("scale")
    if change is not None and abs(change) >= LEAST_CHANGE:
        messages.append(Message("group.scale", {"change": change}))
    assumed = [record.provenance.get("assumed", {}) for record in members if record.has_answer]
    values = {name: value for constants in assumed for name, value in constants.items()}
    ignored = {name for record in members if record.has_answer for name in record.provenance.get("ignored", ())}
    for code, used in (("group.not_given", False), ("group.not_used", True)):
        if said := {name: value for name, value in values.items() if (name in ignored) is used}:
            messages.append(Message(code, {"values": said}))
    if population.left_out:
        messages.append(Message("group.left_out", {"counts": population.left_out}))
    if population.outliers:
        names = [record.name for record in members]
        short = dict(zip(names, digits.distinct_names(names), strict=True))
        probabilities = {short[name]: probability for name, probability in population.outliers.items()}
        messages.append(Message("group.outliers", {"probabilities": probabilities}))
    return messages


def size_trends(shots: Iterable[CurveRecord]) -> list[str]:
    """Which parameters rise or fall with R_max over these shots, 'µ rises', by more than chance (1 in 100). Shots that
    the model does not fit are among them. Ranks decide (Spearman's), so that few shots in a false mode hardly count."""
    followed = [shot for shot in shots if shot.trusted or shot.verdict == "does_not_fit"]
    trends = list[str]()
    for name in MATERIAL_CONSTANTS:
        pairs = np.array([(shot.max_radius_m, shot.value(name).median) for shot in followed], dtype=float)
        logs = np.log(pairs[np.all(pairs > 0.0, axis=-1)]).reshape(-1, 2)
        if len(logs) >= MIN_TREND_SHOTS and np.all(np.ptp(logs, axis=0) >= LEAST_RANGES):
            radii, values = map(_ranks, logs.T)
            rise = float(np.corrcoef(radii, values)[0, 1])
            freedom = len(logs) - 2
            ratio = rise * np.sqrt(freedom / max(1.0 - rise**2, 1e-12))  # Student's t if there is no trend
            if 2.0 * stdtr(freedom, -abs(ratio)) < CHANCE:
                trends.append(f"{symbol(name)} {'rises' if rise > 0 else 'falls'}")
    return trends


def _ranks(values: Floats) -> Floats:
    """(n,) ranks of the values, equal ones with their mean. scipy.stats has them, but takes half a second to load."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - 0.5 * (count - 1))[place])


def _of_material(material: Population) -> tuple[PopulationRecord, Systematic]:
    """The answer of a group by its material, and what common errors do to it; empty where that is not known."""
    from cavirheo.inference.population.material import slopes

    fields = same_fields(PopulationRecord, material)
    thins = material.material == "newtonian" and is_at_rate("newtonian", (), material.switches.get("thinning", 0.0))
    law = "newtonian or power-law" if thins else material.material
    fields |= {"model": f"{law}, {material.bubble.name}", "n": len(material.shots)}
    if not len(material.centre):
        return PopulationRecord(**fields), Systematic()
    values = {name: material.quantity(name) for name in material.quantities}
    if material.viscosity_at_rate:
        values[VISCOSITY_AT_RATE] = material.viscosity_at_rate
    fields |= PopulationRecord.fields_of(values)
    fields["spreads_decades"] = {name: Quantity.from_interval(*material.scatter(name)) for name in material.names}
    systematic = Systematic(errors=asdict(material.errors) if material.over_scale else {})
    for name in (name for name in material.determined if name in material.over_scale):
        low, high = material.statistical_interval(name)
        systematic.slopes[name] = slopes(name, material.over_scale[name])
        systematic.statistics[name] = Quantity(median=values[name].median, q05=low, q95=high)
    return PopulationRecord(**fields), systematic


def differences(materials: Mapping[str, Population]) -> list[MaterialRatio]:
    """Ratios of each two of the first _MAX_COMPARED materials with one model."""
    whole = [(name, material) for name, material in materials.items() if len(material.centre)]
    records = []
    for (earlier, first), (later, second) in combinations(whole[:_MAX_COMPARED], 2):
        ratios = second.against(first) if second.comparable(first) else {}
        for name, (ratio, higher) in ratios.items():
            both = {"first": later, "second": earlier, "parameter": name}
            records.append(MaterialRatio(**both, ratio=ratio, probability_higher=higher))
    return records


def laws_by_curve(rankings: Iterable[Ranking]) -> dict[int, LawsOfGroup]:
    """The laws of curves and groups by the index of their first curve; of two rankings with one, those of the later."""
    found = {}
    for ranking in rankings:
        laws = {}
        for name, evidence in ranking.evidence.items():
            law = {"log_evidence": evidence.log, "standard_error": evidence.error} if evidence else {}
            if len(ranking.members) == 1:
                said = _values_in_words(ranking.answers[name][0])
            else:
                material = ranking.populations.get(name)
                said = material.line if material and len(material.centre) else ""
            laws[name] = LawOfGroup(**law, probability=ranking.probability.get(name), material=said)
        found[ranking.members[0]] = LawsOfGroup(laws=laws, **same_fields(LawsOfGroup, ranking))
    return found


def _values_in_words(answer: Posterior) -> str:
    """'G 5.1 kPa (4.8 to 5.5), µ 0.021 Pa s (0.018 to 0.024), RMSE 1.2 %'."""
    values = {name: answer.quantity(name) for name in answer.parameters if is_law_parameter(name)}
    words = [digits.shown(name, value.largest).named(value) for name, value in values.items()]
    return ", ".join([*words, f"RMSE {digits.percent(answer.checks.rmse_over_rmax)} %"])

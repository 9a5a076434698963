"""The answer in words and tables, the same for the terminal, the report and the app: of a group G and mu, whether to
use them, what could be wrong, which model, and the command of the line `next`; the rows of shots; and the answers
beside values of other methods."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from cavirheo.messages import heaps_in_words
from cavirheo.parameters import BUBBLE, UNLIKELY, VISCOSITY_AT_RATE, is_at_rate, symbol
from cavirheo.reporting.documents import DECIDING_SHARE
from cavirheo.reporting.record import (
    MAIN_FIELDS,
    OUR_METHOD,
    CurveRecord,
    GroupRecord,
    LawsOfGroup,
    PopulationRecord,
    Result,
    parameters_of,
)
from cavirheo.writing import digits, terminal

Shots = Sequence[CurveRecord]
_LARGE_CHANGE = 15.0  # % of G by 1 % in scale or frame rate, from which on these should be measured better
_COMMON_SHARE = 1.2  # width of an interval over its part of statistics, from which on that part is shown
# doubts about a group of which the values may still be used, with care
_APART = ("group.doubt.heaps", "group.doubt.scatter")
_OF_MODEL = ("group.doubt.misfits", "group.doubt.switches", "group.doubt.trend")  # said in the line of the use
_DISAGREEMENTS = (*_APART, *_OF_MODEL)


class Line(NamedTuple):
    """A line of an answer: a value with what is said of it, clauses, or a command with its purpose."""

    label: str
    parts: list[str]
    kind: Literal["value", "clauses", "command"] = "clauses"


def answer_lines(result: Result, group: GroupRecord, shots: Shots, out: Path = Path()) -> list[Line]:
    """The answer of a group: G and mu, whether to use them, what could be wrong, which model, and what to do next. A
    page has the same lines. out: folder of the documents."""
    refused = refusal(group, shots)
    lines = list[Line]()
    uses: dict[str, list[str]] = {}
    for name in (*MAIN_FIELDS, *further_parameters(group.population)):
        short = result.shown(name).symbol
        line, notes, use = _value_line(result, group, shots, name)
        notes += ["not to be used yet"] if refused else []
        if line:
            lines.append(Line(short, [*line, f"({'; '.join(notes)})"] if notes else line, "value"))
        if use:
            uses.setdefault(use, []).append(short)
    lines.append(Line("use", [refused or _use(group, shots, uses)]))
    said = refused or any(message.code == "group.doubt.misfits" for message in group.doubts)  # which shots do not count
    known = {message.code for message in group.doubts} | ({"group.left_out"} if said else set())
    facts = [*_equal_laws(group.laws), *(message.text for message in group.messages if message.code not in known)]
    if facts:
        lines.append(Line("check", facts))
    if group.has_answer and group.population.switches:
        lines.append(Line("model", [model_in_words(group.population.switches)]))
    return [*lines, next_step(result, group, shots, out)]


def _equal_laws(laws: LawsOfGroup | None) -> list[str]:
    """What each other law says that the evidence does not reject, if laws were compared."""
    if laws is None:
        return []
    others = {name: laws.laws[name] for name in laws.contenders if name != laws.chosen}
    return [": ".join(filter(None, [f"{name} follows as well", law.material])) for name, law in others.items()]


def further_parameters(population: PopulationRecord) -> list[str]:
    """The parameters beside G and mu of a law that was asked for, and the exponent of a liquid that thins; of the rest
    of the default family the probabilities of its switches tell."""
    known = [name for name in parameters_of([population]) if name not in (*MAIN_FIELDS, VISCOSITY_AT_RATE)]
    return [name for name in known if name == "exponent"] if "liquid" in population.switches else known


def badge_of(group: GroupRecord, shots: Shots) -> str:
    """The verdict of a group in words; 'with care' of one with a doubt that may be used."""
    doubted = group.verdict in ("check_input", "does_not_fit") and not refusal(group, shots)
    return "with care" if doubted else digits.VERDICT_STYLES[group.verdict].words


def group_facts(group: GroupRecord, shots: Shots) -> list[str]:
    """How many shots there are and count, their sizes and collapses."""
    facts = [digits.counted(len(shots), "shot")]
    if group.n_counted < len(shots):
        facts.append(f"{group.n_counted} {'counts' if group.n_counted == 1 else 'count'}")
    if sizes := digits.ends([shot.max_radius_m for shot in shots], 1e6):
        facts.append(f"R_max {sizes} µm")
    return facts + windows(shots)


def windows(shots: Shots) -> list[str]:
    """How many collapses were compared: ['2 to 3 collapses each']; [] if that is not known."""
    counts = sorted({shot.window.collapses for shot in shots if shot.window.collapses is not None})
    if len(counts) > 1:
        return [f"{counts[0]} to {counts[-1]} collapses each"]
    return [digits.counted(count, "collapse") for count in counts]


def _value_line(result: Result, group: GroupRecord, shots: Shots, name: str) -> tuple[list[str], list[str], str]:
    """The parts of the line of a parameter, none of an unknown one; notes on it; how it may be used, "" of no value."""
    if heaps := group.population.heaps.get(name):
        return [heaps_in_words(name, heaps)], [], "not"
    value = group.population.main(name)
    liquid = name == "shear_modulus" and _is_liquid(group)
    if not value.known:
        return ["none: the material is a liquid"] if liquid and group.has_answer else [], [], ""
    _, factor, unit, _ = result.shown(name)
    middle, interval = digits.value_parts(value, factor)
    if value.bound == "undetermined":
        return [interval], [], "not"
    scatter = f"shots scatter by {digits.percent(group.population.scatter(name))} %"
    if group.population.has_no_one_value(name):
        return [f"no one value: the {scatter}"], [], "not"
    at_rate = name == "viscosity" and viscosity_name(group.population) == VISCOSITY_AT_RATE
    unit += " at 1e5/s" if at_rate else ""
    notes = list[str]()
    if not middle:
        if not value.is_zero:
            notes.append(f"{digits.SURE}, too wide for one value" if value.bound == "wide" else "95 % sure")
        notes += ["a liquid, if scale and rate are right"] if liquid else []
        if name in group.population.wide_scatters:
            notes.append(scatter)
        use = "as a bound, with care" if group.doubts else "as a bound"
        return [f"{interval} {unit}".rstrip()], notes, "" if value.is_zero else use
    if name in group.population.wide_scatters:
        notes.append(scatter)
    if name == "shear_modulus" and group.population.switches.get("stiffening", 0.0) >= 0.5:
        secants = [shot.diagnostics.secant_modulus for shot in shots if shot.trusted or len(shots) == 1]
        if ends := digits.ends([secant[1] for secant in secants if secant], factor, 2):
            notes.append(f"at small strain; at R_max it pulls like {ends} {unit}")
    statistics = group.systematic.statistics.get(name)
    if not notes and statistics and value.width > _COMMON_SHARE * statistics.width:
        notes.append(f"{digits.value_parts(statistics, factor)[1]} if scale and rate were exact")
    line = [f"{middle} {unit}".rstrip(), *([f"{digits.SURE}: {interval}"] if interval else [])]
    return line, notes, "with care" if group.doubts else "with interval"


def refusal(group: GroupRecord, shots: Shots) -> str:
    """Why no value of a group is to be used, in a sentence; "" if one may be."""
    serious = any(message.code not in _DISAGREEMENTS for message in group.doubts)
    if serious or len(group.population.heaps) == len(MAIN_FIELDS):
        others = [message.text for message in group.doubts if message.code not in _APART]
        return f"nothing yet: {'; '.join([*_disagreement(group), *others])}"
    misfits = group.verdicts.get("does_not_fit", 0)
    if group.verdict == "does_not_fit" and misfits > DECIDING_SHARE * len(shots):
        recordings = "the recording does" if len(shots) == 1 else f"{misfits} of {len(shots)} recordings do"
        return f"nothing: {recordings} not follow the law"
    if group.verdict == "check_input" and not group.doubts:
        names = digits.distinct_names([shot.name for shot in shots])
        for name, shot in zip(names, shots, strict=True):
            if shot.warnings:
                words = "; ".join(message.text for message in shot.warnings)
                return f"nothing yet: {words}" if len(shots) == 1 else f"nothing yet: {name}: {words}"
    return f"nothing: {shots[0].message}" if group.verdict == "failed" else ""


def _use(group: GroupRecord, shots: Shots, uses: Mapping[str, Sequence[str]]) -> str:
    """How the parameters may be used, in a sentence. uses: their symbols by how they may be."""
    if group.verdict == "unverified":
        return "as a first guess: a network gives one value, and no interval says how wrong it may be"
    if not uses:
        alone = group.population.line and len(shots) > 1
        return f"the value of each shot; {group.population.line}" if alone else "nothing: no value is known"
    reasons = _disagreement(group)
    reasons += [message.text for message in group.doubts if message.code in _OF_MODEL]
    parts = ", ".join(f"{' and '.join(symbols)} {use}" for use, symbols in uses.items())
    return parts + (f": {'; '.join(reasons)}" if reasons else "")


def _disagreement(group: GroupRecord) -> list[str]:
    """['the shots disagree in G and µ'] as the lines of these parameters show; [] if they agree."""
    apart = {*group.population.heaps, *group.population.wide_scatters}
    symbols = " and ".join(symbol(name) for name in MAIN_FIELDS if name in apart)
    return [f"the shots disagree in {symbols}"] if symbols else []


def viscosity_name(values: CurveRecord | PopulationRecord) -> str:
    """The name by which the viscosity of a shot or group is shown, which may be that at 1e5 1/s."""
    law = values.material if isinstance(values, CurveRecord) else values.model
    at_rate = is_at_rate(law, parameters_of([values]), values.switches.get("thinning", 0.0))
    return VISCOSITY_AT_RATE if at_rate else "viscosity"


def _is_liquid(group: GroupRecord) -> bool:
    """Whether the shots of a group have settled together that the material is a liquid."""
    return group.population.switches.get("liquid", 0.0) > 1.0 - UNLIKELY


def model_in_words(switches: Mapping[str, float]) -> str:
    """'gel 99 %, gel that stiffens 1 %; bubble: real (vapour condenses slowly) 100 %'; "" without switches."""
    parts = []
    if "liquid" in switches:
        liquid, stiffens = switches["liquid"], switches.get("stiffening", 0.0)
        thins = switches.get("thinning", 0.0)
        kinds = {"gel": 1.0 - liquid - stiffens, "gel that stiffens": stiffens}
        parts.append(_shares(kinds | {"liquid": liquid - thins, "liquid that thins": thins}))
    if "field_bubble" in switches:
        field = switches["field_bubble"]
        parts.append(f"bubble: {_shares({digits.BUBBLES['real']: 1.0 - field, digits.BUBBLES['field']: field})}")
    return "; ".join(parts)


def _shares(probabilities: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in probabilities.items() if share >= 0.005)


def next_step(result: Result, group: GroupRecord, shots: Shots, out: Path) -> Line:
    """The one command that helps, or what to do where no command does."""

    def command(words: str, *purpose: str) -> Line:
        return Line("next", [f"cavirheo {words}", *(f"({text})" for text in purpose)], "command")

    def advice(text: str) -> Line:
        return Line("next", [text])

    document = shlex.quote(str(out / "result.json"))
    codes = {message.code for message in group.doubts}
    if group.verdict == "check_input":
        warned = [{message.code for message in shot.warnings} for shot in shots if shot.verdict == "check_input"]
        if warned and all("check_input.density" in each for each in warned):
            return advice("the same command with --density and the true density in kg/m3")
        if not codes:
            return advice("the same command with what is asked for, or --trust-input if all is right")
    if group.verdict == "failed" and len(shots) == 1:
        return advice("the same command, when this is mended")
    if "group.doubt.input" in codes or group.verdict == "failed":
        return command(f"show {document}", "the messages of each shot")
    if "group.doubt.ends" in codes:
        return advice("the same command with the right --um-per-px (or --rmax-um) and --fps")
    misfits = [shot for shot in shots if shot.verdict == "does_not_fit"]
    if group.verdict == "does_not_fit" or (misfits and codes) or not codes.isdisjoint(_OF_MODEL):
        if group.laws:
            return advice("check scale, frame rate and walls: none of these laws explains the shots")
        return command(f"which-law {_files(misfits or shots)}", "with your options: whether another law follows")
    if codes:
        return advice(f"look at the shots in {out / 'report.html'} (which of them differ)")
    if group.verdict == "unverified":
        return command(f"infer {_files(shots)}")
    if group.n > 1 and not group.population.has_material:
        return advice("more shots of this material in the same command (for one G and µ)")
    liquid = group.population.switches.get("liquid", 0.0)
    limited = _is_liquid(group) and not group.population.viscosity_Pa_s.bound
    change = group.systematic.slopes.get("shear_modulus", {}).get("scale", 0.0)
    if group.systematic.errors and (limited or abs(change) >= _LARGE_CHANGE):
        return advice("for G: measure scale and rate better, then give --scale-error, --rate-error")
    alone = sum(group.verdicts.values()) == 1
    if group.verdict == "bound" and (alone or group.population.has_material):
        law = group.population.laws[0]
        law = "newtonian" if law == "auto" and liquid > 0.5 else law
        more = [] if law in ("auto", "nhkv") else ["--material", law]
        more += ["--group", group.name] if len(result.groups) > 1 else []
        return command(f"design {shlex.join([str(out / 'result.json'), *more])}", "what to record")
    return command(f"cite {document}", "after a look at report.html")


def _files(shots: Shots) -> str:
    """The files of these shots as words of a command, two at most."""
    sources = list(dict.fromkeys(shot.source for shot in shots if shot.source))
    return shlex.join(sources[:2]) + (" ..." if len(sources) > 2 else "")


def shots_table(result: Result, shots: Shots, names: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """(heads, rows) of shots that are called by these names. A bound stands in the place of the interval; G and µ have
    columns where a shot has them; the last cell is a verdict that is not ok."""
    G = result.shown("shear_modulus")
    mu_names = {viscosity_name(shot) for shot in shots if shot.main("viscosity").known} or {"viscosity"}
    mu = result.shown(mu_names.pop() if len(mu_names) == 1 else "viscosity")
    both = [(G, [shot.shear_modulus_Pa for shot in shots]), (mu, [shot.main("viscosity") for shot in shots])]
    shown = [(head, values) for head, values in both if any(value.known for value in values)] or both
    rows = []
    for k, (name, shot) in enumerate(zip(names, shots, strict=True)):
        stretch = shot.stretch
        ratio = digits.value_parts(stretch)[1] if stretch.bound else digits.number(stretch.median)
        size, rmse = digits.micrometres(shot.max_radius_m), digits.number(shot.rmse_over_rmax, 100.0)
        parts = [part for head, values in shown for part in head.parts(values[k])]
        rows.append([name, size, ratio, *parts, rmse, "" if shot.verdict == "ok" else shot.verdict_in_words])
    sizes = Counter((row.group, row.group_source) for row in result.curves)
    in_groups = any(sizes[shot.group, shot.group_source] > 1 for shot in shots)
    ends = digits.OWN if in_groups else digits.SURE
    heads = [text for head, _ in shown for text in (f"{head.symbol} {head.unit}", ends)]
    return ["shot", "R_max µm", "λ", *heads, "RMSE %", "verdict"], rows


def meaning_of(name: str) -> str:
    """Unit and meaning of a parameter of the bubble, 'no unit; confinement damping: ...'; "" for any other one."""
    return f"{digits.shown(name).si or 'no unit'}; {BUBBLE[name]}" if name in BUBBLE else ""


def curves_by_message(rows: Iterable[CurveRecord], names: Iterable[str]) -> dict[str, list[str]]:
    """The messages of all answers, each once, with the names of its curves."""
    named = zip(names, rows, strict=True)
    return terminal.names_by_text((name, message.text) for name, row in named for message in row.messages)


def comparison_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """(heads, rows) of the answers of groups beside values of other methods, a row for each group, quantity and method;
    of a group the answer is last."""
    rows = []
    for group in result.groups:
        for name in dict.fromkeys([*MAIN_FIELDS, *(name for values in group.published.values() for name in values)]):
            short, factor, unit, _ = result.shown(name)
            if name not in MAIN_FIELDS:  # of a rheometer, at one angular frequency
                short, unit = f"µ at {name.removeprefix('viscosity_at_').removesuffix('_rad_per_s')} rad/s", "Pa s"
            ours = group.value(name)
            for method, values in group.published.items():
                if value := values.get(name):
                    ratio = ours.median / value.mean if ours.median is not None and value.mean else None
                    words = digits.spread(value, factor)
                    rows.append([group.name, f"{short}, {unit}", method, words, digits.number(ratio)])
            if name in MAIN_FIELDS:
                rows.append([group.name, f"{short}, {unit}", OUR_METHOD, digits.quantity(ours, factor), ""])
    return ["group", "quantity", "method", "value", f"{OUR_METHOD}\nover it"], rows


def comparison_key(result: Result) -> str:
    """How to read the table of a comparison."""
    key = f"{OUR_METHOD}: the material of all shots that count, and its 90 % interval; others: mean ± deviation."
    if bubbles := ", ".join(dict.fromkeys(shot.bubble_title for shot in result.curves if shot.has_answer)):
        key += f" Our answers assume the {bubbles}."
    if any(method.startswith("rheometer") for group in result.groups for method in group.published):
        key += " A rheometer measures at small strain and low rates, a bubble at large strain and 1e5/s: unequal"
        key += " values are no contradiction."
    return key

"""The answer of a group in words, for the terminal and the report: G and mu, whether to use them, what could be wrong,
which model, and what to do next."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from cavirheo.messages import heaps_in_words
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import DECIDING_SHARE, GroupRecord
from cavirheo.reporting.record import Result
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

SYMBOLS = {"shear_modulus": "G", "viscosity": "µ"}  # parameters of the answer
LARGE_CHANGE = 15.0  # % of G by 1 % in scale or frame rate, from which on these should be measured better
COMMON_SHARE = 1.2  # width of an interval over its part of statistics, from which on that part is shown
# doubts about a group of which the values may still be used, with care
_DISAGREEMENTS = ("group.doubt.heaps", "group.doubt.scatter", "group.doubt.misfits", "group.doubt.trend")
_SURE = 0.95  # probability of a state of a switch of a group, from which on a shot that says otherwise is named


def answer_lines(
    result: Result, group: GroupRecord, shots: Sequence[CurveRecord], out: Path = Path()
) -> list[tuple[str, list[str]]]:
    """(label, parts of a line) of the answer of a group: G and mu, whether to use them, what could be wrong, which
    model, and what to do next. A page has the same lines. out: folder of the documents."""
    lines = list[tuple[str, list[str]]]()
    refusal = _refusal(group, shots)
    for name, symbol in SYMBOLS.items():
        line, notes = _value_line(result, group, shots, name) if group.has_answer else ([], [])
        if refusal:
            notes = [*notes, "not to be used yet"]
        if line:
            lines.append((symbol, [*line, f"({'; '.join(notes)})"] if notes else line))
    lines.append(("use", [refusal or _use(group, shots)]))
    if checks := "; ".join(message.text for message in group.facts):
        lines.append(("check", [checks]))
    if probabilities := _probabilities(group):
        lines.append(("model", [probabilities + _unlike(group, shots)]))
    lines.append(("next", [next_step(group, shots, out)]))
    return lines


def group_facts(group: GroupRecord, shots: Sequence[CurveRecord]) -> list[str]:
    """How many shots there are and count, their sizes and collapses."""
    facts = [digits.counted(len(shots), "shot")]
    if group.n_counted < len(shots):
        facts.append(f"{group.n_counted} of them {'counts' if group.n_counted == 1 else 'count'}")
    if sizes := digits.ends([shot.max_radius_m for shot in shots], 1e6):
        facts.append(f"R_max {sizes} µm")
    return facts + windows(shots)


def _secant_moduli(group: GroupRecord, shots: Sequence[CurveRecord]) -> list[float]:
    """Moduli of neo-Hookean gels that pull as strongly at R_max, Pa, one for each shot that counts, of a material that
    stiffens."""
    switches = group.population.switches
    if switches.get("stiffening", 0.0) < 0.5:
        return []
    known = [shot.diagnostics.secant_modulus for shot in shots if shot.trusted or len(shots) == 1]
    return [values[1] for values in known if values]


def _value_line(
    result: Result, group: GroupRecord, shots: Sequence[CurveRecord], name: str
) -> tuple[list[str], list[str]]:
    """The parts of the line of a parameter, none if nothing is known of it, and notes on it."""
    if heaps := group.population.heaps.get(name):
        return [heaps_in_words(name, heaps)], []
    value = group.viscosity if name == "viscosity" else group.value(name)
    if not value.known:
        return ["none: the material is a liquid"] if _is_liquid(group, name) else [], []
    factor, unit = result.modulus_unit if name == "shear_modulus" else (1.0, "Pa s")
    middle, interval = digits.value_parts(value, factor)
    if not middle:
        return [f"{interval} {unit}"], ["a liquid, if scale and rate are right"] if _is_liquid(group, name) else []
    line = [f"{middle} {unit}", f"90 %: {interval}"] if interval else [f"{middle} {unit}"]
    notes = list[str]()
    statistics = group.systematic.statistics.get(name)
    if scatter := group.population.wide_scatters.get(name):
        notes.append(f"scatter {digits.percent(scatter)} %")
    if name == "shear_modulus" and (secants := _secant_moduli(group, shots)):
        notes.append(f"at small strain; {digits.ends(secants, factor, 2)} {unit} at R_max")
    if not notes and statistics and _width_of(value) > COMMON_SHARE * _width_of(statistics):
        notes.append(f"exact scale: {digits.value_parts(statistics, factor)[1]}")
    return line, notes


def _width_of(value: Quantity) -> float:
    return (value.q95 or 0.0) - (value.q05 or 0.0)


def _is_liquid(group: GroupRecord, name: str) -> bool:
    """Whether a parameter is the modulus of a liquid."""
    return name == "shear_modulus" and group.population.switches.get("liquid", 0.0) > _SURE


def _refusal(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """Why no value of a group is to be used, in a sentence; "" if one may be."""
    serious = [message for message in group.doubts if message.code not in _DISAGREEMENTS]
    if serious or len(group.population.heaps) == len(SYMBOLS):
        return f"nothing yet: {'; '.join(message.text for message in group.doubts)}"
    misfits = sum(shot.verdict == "does_not_fit" for shot in shots)
    if group.verdict == "does_not_fit" and misfits > DECIDING_SHARE * len(shots):
        recordings = "the recording does" if len(shots) == 1 else f"{misfits} of {len(shots)} recordings do"
        return f"nothing: {recordings} not follow the law"
    if group.verdict == "check_input" and not group.doubts:
        return f"nothing yet: {'; '.join(message.text for message in shots[0].warnings)}"
    if group.verdict == "failed":
        return f"nothing: {shots[0].message}"
    return ""


def _use(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """How G and mu may be used, in a sentence."""
    if group.verdict == "unverified":
        return "as a first guess: a network gives one value, and no interval says how wrong it may be"
    uses: dict[str, list[str]] = {}
    for name, symbol in SYMBOLS.items():
        uses.setdefault(_use_of(group, name), []).append(symbol)
    parts = [f"{' and '.join(symbols)} {how}" for how, symbols in uses.items() if how]
    if not parts and group.population.line and len(shots) > 1:
        return f"each shot by itself; {group.population.line}"
    return ", ".join(parts) + _why(group) if parts else "nothing: no value is known"


def _why(group: GroupRecord) -> str:
    """Why the parameters of a group are to be used with care."""
    reasons = list[str]()
    if disagree := _disagreeing(group):
        reasons.append(f"the shots disagree in {' and '.join(disagree)}")
    named = ("group.doubt.misfits", "group.doubt.trend")
    reasons += [message.text for message in group.doubts if message.code in named]
    return f": {'; '.join(reasons)}" if reasons else ""


def _disagreeing(group: GroupRecord) -> list[str]:
    """Symbols of the parameters in which the shots disagree."""
    apart = {*group.population.heaps, *group.population.wide_scatters}
    return [symbol for name, symbol in SYMBOLS.items() if name in apart]


def _use_of(group: GroupRecord, name: str) -> str:
    """How a parameter may be used; "" where nothing is known of it."""
    value = group.viscosity if name == "viscosity" else group.value(name)
    if name in group.population.heaps:
        return "not"
    if value.is_zero or not value.known:
        return ""
    if value.bound:
        return "not" if value.bound == "undetermined" else "as a bound"
    return "with care" if group.doubts else "with interval"


def _probabilities(group: GroupRecord) -> str:
    """'probability: gel 99 %, gel that stiffens 1 %; real bubble 100 %'; "" for another law."""
    switches = group.population.switches if group.has_answer else {}
    parts = list[dict[str, float]]()
    if "liquid" in switches:
        liquid, stiffens = switches["liquid"], switches.get("stiffening", 0.0)
        parts.append({"gel": 1.0 - liquid - stiffens, "gel that stiffens": stiffens, "liquid": liquid})
    if "field_bubble" in switches:
        field = switches["field_bubble"]
        parts.append({"real bubble": 1.0 - field, "field's ideal bubble": field})
    words = [[f"{name} {100.0 * share:.0f} %" for name, share in part.items() if share >= 0.005] for part in parts]
    return f"probability: {'; '.join(', '.join(part) for part in words)}" if words else ""


def _unlike(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """'; alone, [1], [4] prefer the field's ideal bubble': shots that would have another bubble than their group."""
    if len(shots) == 1 or "field_bubble" not in group.population.switches:
        return ""
    shared = group.population.switches["field_bubble"]
    counted = {shot.name: shot.switches.get("field_bubble", shared) for shot in shots if shot.trusted}
    short = digits.distinct_names([shot.name for shot in shots])
    names = dict(zip((shot.name for shot in shots), short, strict=True))
    if shared < 1.0 - _SURE:
        others, bubble = [names[name] for name, alone in counted.items() if alone > 0.5], "field's ideal"
    elif shared > _SURE:
        others, bubble = [names[name] for name, alone in counted.items() if alone < 0.5], "real"
    else:
        others, bubble = [], ""
    verb = "prefers" if len(others) == 1 else "prefer"
    return f"; alone, {', '.join(others)} {verb} the {bubble} bubble" if others else ""


def next_step(group: GroupRecord, shots: Sequence[CurveRecord], out: Path) -> str:
    """The one command that helps."""
    document = shlex.quote(str(out / "result.json"))
    codes = [message.code for message in group.doubts]
    if group.verdict == "check_input" and len(shots) == 1:
        return "the same command with what is asked for, or with --trust-input"
    if "group.doubt.input" in codes or group.verdict == "failed":
        return f"cavirheo show {document}   (the messages of each shot)"
    if "group.doubt.ends" in codes:
        return "the same command with the right --um-per-px (or --rmax-um) and --fps"
    if "group.doubt.heaps" in codes:
        return f"cavirheo infer {_first_heap(group, shots)}   (then the others by themselves)"
    misfits = [shot for shot in shots if shot.verdict == "does_not_fit"]
    if group.verdict == "does_not_fit" or (misfits and codes):
        return f"cavirheo which-law {_files(misfits or shots, 2)}"
    if "group.doubt.trend" in codes:
        return f"cavirheo which-law {_files(shots, 2)}"
    if codes:
        return f"look at {out / 'report.html'}   (which shots lie apart)"
    if group.verdict == "unverified":
        return f"cavirheo infer {_files(shots, 2)}"
    limited = _is_liquid(group, "shear_modulus") and not group.viscosity.bound
    if limited or abs(group.change_by_scale or 0.0) >= LARGE_CHANGE:
        return "to narrow G, measure scale and frame rate better: --scale-error, --rate-error"
    if group.verdict == "bound":
        return f"cavirheo design {document}   (what to record)"
    return f"cavirheo cite {document}   (after a look at report.html)"


def _first_heap(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """The files of the shots in the first heap in which a group disagrees, or their numbers in the only file."""
    names = {name for heap in next(iter(group.population.heaps.values()), [])[:1] for name in heap.shots}
    heap = [shot for shot in shots if shot.name in names]
    sources = {shot.source for shot in heap}
    if any(shot.source in sources and shot.name not in names for shot in shots):
        numbers = [str(k) for k, shot in enumerate(shots, 1) if shot.name in names]
        return f"{shlex.quote(heap[0].source)} --shots {','.join(numbers)}"
    return _files(heap, 3)


def _files(shots: Sequence[CurveRecord], most: int) -> str:
    """The files of these shots, `most` of them at most, as words of a command."""
    sources = list(dict.fromkeys(shot.source for shot in shots if shot.source))
    words = [*map(shlex.quote, sources[:most]), *(["..."] if len(sources) > most else [])]
    return " ".join(words)


def windows(shots: Sequence[CurveRecord]) -> list[str]:
    counts = sorted({shot.window.collapses for shot in shots if shot.window.collapses is not None})
    if len(counts) > 1:
        return [f"{counts[0]} to {counts[-1]} collapses each"]
    return [digits.counted(count, "collapse") for count in counts]

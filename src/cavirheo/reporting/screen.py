"""The result of a run on a terminal: for each group at most ten lines and one for each shot, the answer last."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from cavirheo.messages import constants_in_words, heaps_in_words
from cavirheo.parameters import parameter_of
from cavirheo.posterior import TRUSTED
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity

MOST_ROWS = 12  # shots of a group that all have a row; of a larger one the exceptions have
MOST_EXCEPTIONS = 11  # rows of exceptions
WIDTH = 80  # columns of a terminal that is not wider
MOST_NOTES = 3  # notes on the run; the report has all
LARGE_CHANGE = 15.0  # % of G by 1 % in scale or frame rate, from which on G is to be used with care
WIDE_SCATTER = 0.4  # standard deviation from shot to shot over the material; one batch of gel has less
_NAME = 28  # most characters of the name of a shot; in a table that is too wide SHORT_NAME
_LABEL = 5  # columns before the text of a line below the shots
_SWITCHES = {"liquid": "liquid", "stiffening": "stiffens", "field_bubble": "field's bubble"}
_VALUES = {"shear_modulus": "G", "viscosity": "µ"}  # parameters of the answer and their labels
_OTHERS = {"shear_modulus": "viscosity", "viscosity": "shear_modulus"}


class ShotCells(NamedTuple):
    """The cells of a shot in every table: R_max (µm), stretch, G and its interval, µ (Pa s) and its interval, misfit
    (%). A bound stands in the place of the interval."""

    size: str
    stretch: str
    modulus: str
    modulus_interval: str
    viscosity: str
    viscosity_interval: str
    misfit: str


def shot_cells(shot: CurveRecord, factor: float) -> ShotCells:
    """The cells of a shot. factor: from Pa to the unit of G."""
    stretch = " ".join(value_parts(shot.stretch, 1.0)).strip()
    if shot.stretch.median is not None:
        stretch = digits.number(shot.stretch.median)
    modulus, viscosity = value_parts(shot.shear_modulus_Pa, factor), value_parts(shot.viscosity, 1.0)
    misfit = digits.percent(shot.rmse_over_rmax)
    return ShotCells(digits.micrometres(shot.max_radius_m), stretch, *modulus, *viscosity, misfit)


def value_parts(value: Quantity, factor: float) -> tuple[str, str]:
    """(value, interval) in words; a bound has no value."""
    if value.bound == "undetermined":
        return "", "not known"
    middle, ends = digits.value_parts(value, factor)
    return middle, " to ".join(ends)


def print_result(
    result: Result, *, out: Path = Path(), every_shot: bool = False, printed_notes: Collection[str] = ()
) -> None:
    """Print the shots and the answer of each group. out: folder of the run, for the next command. every_shot: a row for
    each shot, not for exceptions alone. printed_notes: notes that were already printed on stderr."""
    singles = [(group, shots[0]) for group, shots in result.rows_by_group() if len(shots) == 1]
    for group, shots in result.rows_by_group():
        if len(shots) > 1:
            _print_title(group.name, group_facts(group, shots))
            _print_rows(result, shots, group, every_shot)
            _print_answer(result, group, shots, out)
    if len(singles) == 1:
        ((group, shot),) = singles
        _print_title(shot.name, _shot_facts(shot) if shot.has_answer else [])
        _print_answer(result, group, [shot], out)
    elif singles:
        shots = [shot for _, shot in singles]
        _print_title(digits.counted(len(shots), "shot"), ["each by itself", *_windows(shots)])
        _print_rows(result, shots, None, every_shot)
        doubtful = [group for group, _ in singles if group.verdict != "ok"]
        _say("next", _next_step(doubtful[0] if doubtful else singles[0][0], shots, out))
    notes = [note for note in result.notes if note not in printed_notes]
    for note in notes[:MOST_NOTES]:
        _say("note", note)
    if len(notes) > MOST_NOTES:
        _say("note", f"{digits.counted(len(notes) - MOST_NOTES, 'more note')} in the report")


def _width() -> int:
    return max(terminal.console().width, WIDTH)


def _print_title(name: str, facts: Sequence[str]) -> None:
    words = ", ".join(facts)
    short = digits.elide(name, max(_width() - len(words) - 2, digits.SHORT_NAME))
    _print([(short, "bold"), (f"  {words}", "")])


def _shot_facts(shot: CurveRecord) -> list[str]:
    facts = [f"R_max {digits.micrometres(shot.max_radius_m)} µm", f"λ {digits.quantity(shot.stretch)}"]
    return [*facts, *_windows([shot]), f"misfit {digits.percent(shot.rmse_over_rmax)} %"]


def _windows(shots: Sequence[CurveRecord]) -> list[str]:
    counts = sorted({shot.window.collapses for shot in shots if shot.window.collapses is not None})
    if len(counts) > 1:
        return [f"{counts[0]} to {counts[-1]} collapses each"]
    return [digits.counted(count, "collapse") for count in counts]


def _print_rows(result: Result, shots: Sequence[CurveRecord], group: GroupRecord | None, every_shot: bool) -> None:
    """A row for each shot; of many, for the exceptions, and how many there are. The stretch is left out, and names are
    shortened, where they are too wide."""
    names = dict(zip((shot.name for shot in shots), digits.distinct_names([shot.name for shot in shots]), strict=True))
    shown = list(shots)
    if len(shots) > MOST_ROWS and not every_shot:
        outliers = group.population.outliers if group and group.population else {}
        exceptions = [shot for shot in shots if shot.verdict not in TRUSTED or shot.name in outliers]
        shown = exceptions[:MOST_EXCEPTIONS]
    factor, unit = result.modulus_unit
    rows = [["shot", "R_max", "λ", f"G {unit}", "90 %", "µ Pa s", "90 %", "misfit %", ""]] if shown else []
    for shot in shown:
        mark = "" if shot.verdict == "ok" else digits.VERDICT_WORDS[shot.verdict]
        rows.append([digits.elide(names[shot.name], _NAME), *shot_cells(shot, factor), mark])
    if _table_width(rows) > _width():
        rows = [[digits.elide(cells[0], digits.SHORT_NAME), *cells[1:]] for cells in rows]
    if _table_width(rows) > _width():
        rows = [[*cells[:2], *cells[3:]] for cells in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    verdicts = [None, *(shot.verdict for shot in shown)]
    for (name, *numbers, mark), verdict in zip(rows, verdicts, strict=False):
        cells = [name.ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(numbers, widths[1:-1], strict=True)]
        look = digits.VERDICT_STYLES[verdict].terminal if verdict else ""
        _print([("  ".join(cells), "" if verdict else "dim"), (f"  {mark}".rstrip(), look)])
    if len(shown) < len(shots):
        hidden = Counter(digits.VERDICT_WORDS[shot.verdict] for shot in shots if shot not in shown)
        counts = ", ".join(f"{count} {words}" for words, count in hidden.items())
        _say("", f"{digits.counted(hidden.total(), 'more shot')}: {counts} (--all)")


def _table_width(rows: Sequence[Sequence[str]]) -> int:
    return sum(max(map(len, column)) + 2 for column in zip(*rows, strict=True))


def _print_answer(result: Result, group: GroupRecord, shots: Sequence[CurveRecord], out: Path) -> None:
    for label, parts in answer_lines(result, group, shots, out):
        if label == "use":
            _say(label, parts[0], style=digits.VERDICT_STYLES[group.verdict].terminal, most=3)
        else:
            _say(label, "   ".join(parts), style="bold" if label in _VALUES.values() else "")


def answer_lines(
    result: Result, group: GroupRecord, shots: Sequence[CurveRecord], out: Path = Path()
) -> list[tuple[str, list[str]]]:
    """(label, parts of a line) of the answer of a group: G and mu, whether to use them, facts on it, and what to do
    next. A page has the same lines. out: folder of the documents."""
    lines = list[tuple[str, list[str]]]()
    for name, symbol in _VALUES.items():
        if group.has_answer and (line := _value_line(result, group, name)):
            lines.append((symbol, line))
    lines.append(("use", [_use(group, shots)]))
    lines += [("", [line]) for line in _facts(group, shots)]
    lines.append(("next", [_next_step(group, shots, out)]))
    return lines


def group_facts(group: GroupRecord, shots: Sequence[CurveRecord]) -> list[str]:
    """How many shots there are and count, their sizes and collapses."""
    facts = [digits.counted(len(shots), "shot")]
    if group.n_counted < len(shots):
        facts.append(f"{group.n_counted} of them {'counts' if group.n_counted == 1 else 'count'}")
    if sizes := digits.ends([shot.max_radius_m for shot in shots], 1e6):
        facts.append(f"R_max {sizes} µm")
    return facts + _windows(shots)


def _value_line(result: Result, group: GroupRecord, name: str) -> list[str]:
    if heaps := group.heaps.get(name):
        return [f"shots disagree: {heaps_in_words(name, heaps)}"]
    value = group.viscosity if name == "viscosity" else group.value(name)
    if not value.known:
        switches = group.population.switches if group.population else {}
        is_liquid = name == "shear_modulus" and switches.get("liquid", 0.0) > 0.5
        return ["none: the material is a liquid"] if is_liquid else []
    factor, unit = result.modulus_unit if name == "shear_modulus" else (1.0, "Pa s")
    middle, interval = value_parts(value, factor)
    line = [f"{middle} {unit}", interval] if middle else [f"{interval} {unit}"]
    statistics = group.systematic.statistics.get(name) if group.systematic else None
    if scatter := _scatter(group, name):
        line.append(f"(shots disagree: scatter {scatter} %)")
    elif statistics and value.median is not None:
        line.append(f"(statistics alone {value_parts(statistics, factor)[1]})")
    return line


def _scatter(group: GroupRecord, name: str) -> str:
    """The standard deviation of the shots over the material, %, where it is wide and no chance; else ""."""
    from cavirheo.inference.population import relative_scatter

    material = group.material
    decades = material.spreads_decades.get(name) if material else None
    if material is None or decades is None or (material.log_evidence_of_scatter or 0.0) < 0.0:
        return ""
    scatter = relative_scatter(decades.median or 0.0)
    return digits.significant(100.0 * scatter, 2) if scatter > WIDE_SCATTER else ""


def _use(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """Whether G and mu may be used, in a sentence."""
    change = _change_by_scale(group, shots)
    moved = "" if change is None else f"1 % in scale or frame rate moves G by {digits.significant(change, 2)} %"
    disagreeing = list(group.heaps)
    if len(group.doubts) == len(disagreeing) == 1 and disagreeing[0] in _OTHERS:
        symbol, other = parameter_of(disagreeing[0]).symbol, parameter_of(_OTHERS[disagreeing[0]]).symbol
        return "; ".join(filter(None, [f"{other} with care, not {symbol}, in which the shots disagree", moved]))
    if group.doubts:
        more = f"; {digits.counted(len(group.doubts) - 1, 'more doubt')} in the report" if len(group.doubts) > 1 else ""
        return f"nothing yet: {group.doubts[0].text}{more}"
    if group.verdict == "does_not_fit":
        count = sum(shot.verdict == "does_not_fit" for shot in shots)
        recordings = "the recording does" if len(shots) == 1 else f"{count} of {len(shots)} recordings do"
        return f"nothing: {recordings} not follow the law"
    if group.verdict == "check_input":
        return f"nothing yet: {'; '.join(message.text for message in shots[0].warnings)}"
    if group.verdict == "failed":
        return f"nothing: {shots[0].message}"
    if group.verdict == "unverified":
        return "with care: a network gives one value, without an interval"
    if abs(change or 0.0) >= LARGE_CHANGE:
        moved = f"G with care, for {moved}"
    uses = "the values" if group.verdict == "ok" else "values as values, bounds as bounds"
    return "; ".join(filter(None, [uses, moved]))


def _change_by_scale(group: GroupRecord, shots: Sequence[CurveRecord]) -> float | None:
    """Change of G, %, by 1 % in scale or frame rate; None where it is not known, or of a single shot small."""
    if group.systematic:
        return group.systematic.slopes.get("shear_modulus", {}).get("scale")
    change = shots[0].diagnostics.modulus_over_scale if len(shots) == 1 else None
    return change if abs(change or 0.0) >= LARGE_CHANGE else None


def _facts(group: GroupRecord, shots: Sequence[CurveRecord]) -> list[str]:
    """Constants that were not given, and the switches; in one line if there is room."""
    values = {name: value for shot in shots for name, value in shot.provenance.get("assumed", {}).items()}
    switches = group.population.switches if group.population and group.has_answer else {}
    facts = [f"assumed, as none is given: {constants_in_words(values)}"] if values else []
    if shares := [f"{_SWITCHES[name]} {100.0 * share:.0f} %" for name, share in switches.items() if name in _SWITCHES]:
        facts.append(f"probabilities: {', '.join(shares)}")
    line = ".   ".join(facts)
    return [line] if line and len(line) + _LABEL <= WIDTH else facts


def _next_step(group: GroupRecord, shots: Sequence[CurveRecord], out: Path) -> str:
    """The one command that helps."""
    document = shlex.quote(str(out / "result.json"))
    codes = [message.code for message in group.doubts]
    if "group.doubt.input" in codes or (group.verdict == "check_input" and not codes) or group.verdict == "failed":
        return f"cavirheo show {document}   (the warning of each shot)"
    if "group.doubt.ends" in codes:
        return "the same command with the right --um-per-px (or --rmax-um) and --fps"
    if "group.doubt.walls" in codes:
        return "the same command with --wall-distance-um, or the right --um-per-px and --fps"
    if "group.doubt.heaps" in codes:
        return f"cavirheo infer {_first_heap(group, shots)}   (each part by itself)"
    if group.verdict == "does_not_fit":
        return f"cavirheo which-law {_files(shots, 2)}"
    if group.verdict == "unverified":
        return f"cavirheo infer {_files(shots, 2)}"
    if abs(_change_by_scale(group, shots) or 0.0) >= LARGE_CHANGE:
        return "check scale and frame rate, then the same command with --scale-error and --rate-error"
    if group.verdict == "bound":
        return f"cavirheo design {document}   (what to record)"
    return f"cavirheo cite {document}   (after a look at the pictures)"


def _first_heap(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """The files of the shots in the first heap in which a group disagrees, or their numbers in the only file."""
    names = {name for heap in next(iter(group.heaps.values()), [])[:1] for name in heap.shots}
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


def _say(label: str, text: str, *, style: str = "", most: int = 1) -> None:
    """Print a label and a text in at most `most` lines of the terminal, broken between words; a single line is not
    broken."""
    lines = terminal.lines_of(text, _width() - _LABEL, most) if most > 1 else [text]
    for k, line in enumerate(lines):
        head = label if k == 0 else ""
        _print([(head.ljust(_LABEL), "bold"), (line, style)])


def _print(parts: Sequence[tuple[str, str]]) -> None:
    from rich.text import Text

    line = Text.assemble(*((digits.printable(words), style) for words, style in parts))
    terminal.console().print(line, soft_wrap=True)

"""The result of a run on a terminal: for each group at most ten lines and one for each shot, the answer last."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from cavirheo.messages import heaps_in_words
from cavirheo.posterior import TRUSTED
from cavirheo.reporting.answer import CurveRecord, parameter_key
from cavirheo.reporting.comparison import print_comparison
from cavirheo.reporting.group import MOST, GroupRecord
from cavirheo.reporting.laws import LAW_HEADS, LAWS_TITLE
from cavirheo.reporting.record import Result
from cavirheo.reporting.table import curves_by_message, parameters_table, shots_table
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity

MOST_ROWS = 12  # shots of a group that all have a row; of a larger one the exceptions have
MOST_EXCEPTIONS = 11  # rows of exceptions
WIDTH = 80  # columns of a terminal that is not wider
MOST_NOTES = 3  # notes on the run; the report has all
LARGE_CHANGE = 15.0  # % of G by 1 % in scale or frame rate, from which on these should be measured better
COMMON_SHARE = 1.2  # width of an interval over its part of statistics, from which on that part is shown
_NAME = 28  # most characters of the name of a shot; in a table that is too wide SHORT_NAME
_LABEL = 6  # columns before the text of a line below the shots
_SYMBOLS = {"shear_modulus": "G", "viscosity": "µ"}  # parameters of the answer
# doubts about a group of which the values may still be used, with care
_DISAGREEMENTS = ("group.doubt.heaps", "group.doubt.scatter", "group.doubt.misfits", "group.doubt.trend")
_SURE = 0.95  # probability of a state of a switch of a group, from which on a shot that says otherwise is named


def print_result(
    result: Result, *, out: Path = Path(), every_shot: bool = False, printed_notes: Collection[str] = ()
) -> None:
    """Print the shots and the answer of each group. out: folder of the run, for the next command. every_shot: a row for
    each shot, not for exceptions alone. printed_notes: notes that were already printed on stderr."""
    notes = [note for note in result.notes if note not in printed_notes]
    for note in notes[:MOST_NOTES]:
        _say("note", note)
    if len(notes) > MOST_NOTES:
        _say("note", f"{digits.counted(len(notes) - MOST_NOTES, 'more note')} in the report")
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
    if any(group.published for group in result.groups):
        print_comparison(result)


def _width() -> int:
    return max(terminal.console().width, WIDTH)


def _print_title(name: str, facts: Sequence[str]) -> None:
    words = ", ".join(facts)
    short = digits.elide(name, max(_width() - len(words) - 2, digits.SHORT_NAME))
    _print([(short, "bold"), (f"  {words}", "")])


def _shot_facts(shot: CurveRecord) -> list[str]:
    facts = [f"R_max {digits.micrometres(shot.max_radius_m)} µm", f"λ {digits.quantity(shot.stretch)}"]
    return [*facts, *_windows([shot]), f"RMSE {digits.percent(shot.rmse_over_rmax)} %"]


def _windows(shots: Sequence[CurveRecord]) -> list[str]:
    counts = sorted({shot.window.collapses for shot in shots if shot.window.collapses is not None})
    if len(counts) > 1:
        return [f"{counts[0]} to {counts[-1]} collapses each"]
    return [digits.counted(count, "collapse") for count in counts]


def _print_rows(result: Result, shots: Sequence[CurveRecord], group: GroupRecord | None, every_shot: bool) -> None:
    """A row for each shot; of many, for the exceptions, and how many there are. The stretch is left out, and names are
    shortened, where they are too wide."""
    visible = list(shots)
    if len(shots) > MOST_ROWS and not every_shot:
        outliers = group.population.outliers if group else {}
        exceptions = [shot for shot in shots if shot.verdict not in TRUSTED or shot.name in outliers]
        visible = exceptions[:MOST_EXCEPTIONS]
    names = dict(zip((shot.name for shot in shots), digits.distinct_names([shot.name for shot in shots]), strict=True))
    heads, rows = shots_table(result, visible, [digits.elide(names[shot.name], _NAME) for shot in visible])
    marks = ["", *map(_mark, visible)]
    rows = [[*cells[:-1], mark] for cells, mark in zip([heads, *rows] if visible else [], marks, strict=False)]
    if _table_width(rows) > _width():
        rows = [[digits.elide(cells[0], digits.SHORT_NAME), *cells[1:]] for cells in rows]
    if _table_width(rows) > _width():
        rows = [[*cells[:2], *cells[3:]] for cells in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row, verdict in zip(rows, [None, *(shot.verdict for shot in visible)], strict=False):
        name, *numbers, mark = row
        cells = [name.ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(numbers, widths[1:-1], strict=True)]
        look = digits.VERDICT_STYLES[verdict].terminal if verdict else ""
        _print([("  ".join(cells), "" if verdict else "dim"), (f"  {mark}".rstrip(), look)])
    if len(visible) < len(shots):
        hidden = [shot for shot in shots if shot not in visible]
        counts = Counter(shot.verdict for shot in hidden)
        words = {verdict: f"{count} {digits.VERDICT_WORDS[verdict]}" for verdict, count in counts.items()}
        counted = ", ".join(words.pop(verdict) for verdict in counts if verdict in TRUSTED)
        if ranges := ", ".join(_ranges(result, hidden)):
            counted += f" ({ranges})"
        listed = ", ".join(filter(None, [counted, *words.values()]))
        _say("", f"{digits.counted(len(hidden), 'more shot')}: {listed}; --all")


def _ranges(result: Result, shots: Sequence[CurveRecord]) -> Iterator[str]:
    """'µ 0.0042 to 0.035 Pa s' of the shots that count."""
    for name, symbol in _SYMBOLS.items():
        factor, unit = result.modulus_unit if name == "shear_modulus" else (1.0, "Pa s")
        values = [shot.value(name) for shot in shots if shot.trusted]
        medians = [value.median for value in values if value.median is not None and not value.is_zero]
        if medians:
            yield f"{symbol} {digits.ends(medians, factor, 2)} {unit}"


def _mark(shot: CurveRecord) -> str:
    """What is written behind the row of a shot: "" if it is ok, 'bound', 'check input: walls'."""
    if shot.verdict == "ok":
        return ""
    about = [message.code.split(".")[1].replace("_", " ") for message in shot.warnings]
    return f"{digits.VERDICT_WORDS[shot.verdict]}{': ' if about else ''}{', '.join(about[:1])}"


def _table_width(rows: Sequence[Sequence[str]]) -> int:
    return sum(max(map(len, column)) + 2 for column in zip(*rows, strict=True))


def _print_answer(result: Result, group: GroupRecord, shots: Sequence[CurveRecord], out: Path) -> None:
    for label, parts in answer_lines(result, group, shots, out):
        if label in ("use", "check", "model"):
            style = digits.VERDICT_STYLES[group.verdict].terminal if label == "use" else ""
            _say(label, parts[0], style=style, most=3)
        else:
            _say(label, "   ".join(parts), style="bold" if label in _SYMBOLS.values() else "")


def answer_lines(
    result: Result, group: GroupRecord, shots: Sequence[CurveRecord], out: Path = Path()
) -> list[tuple[str, list[str]]]:
    """(label, parts of a line) of the answer of a group: G and mu, whether to use them, what could be wrong, which
    model, and what to do next. A page has the same lines. out: folder of the documents."""
    lines = list[tuple[str, list[str]]]()
    refusal = _refusal(group, shots)
    for name, symbol in _SYMBOLS.items():
        if group.has_answer and (line := _value_line(result, group, shots, name)):
            lines.append((symbol, [*line, "(not to be used yet)"] if refusal else line))
    lines.append(("use", [refusal or _use(group, shots)]))
    if checks := "; ".join(message.text for message in group.facts):
        lines.append(("check", [checks]))
    if probabilities := _probabilities(group):
        lines.append(("model", [probabilities + _unlike(group, shots)]))
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


def _secant_moduli(group: GroupRecord, shots: Sequence[CurveRecord]) -> list[float]:
    """Moduli of neo-Hookean gels that pull as strongly at R_max, Pa, one for each shot that counts, of a material that
    stiffens."""
    switches = group.population.switches
    if switches.get("stiffening", 0.0) < 0.5:
        return []
    known = [shot.diagnostics.secant_modulus for shot in shots if shot.trusted or len(shots) == 1]
    return [values[1] for values in known if values]


def _value_line(result: Result, group: GroupRecord, shots: Sequence[CurveRecord], name: str) -> list[str]:
    if heaps := group.population.heaps.get(name):
        return [heaps_in_words(name, heaps)]
    value = group.viscosity if name == "viscosity" else group.value(name)
    if not value.known:
        return ["none: the material is a liquid"] if name == "shear_modulus" and _is_liquid(group) else []
    factor, unit = result.modulus_unit if name == "shear_modulus" else (1.0, "Pa s")
    middle, interval = digits.value_parts(value, factor)
    if not middle:
        return [f"{interval} {unit}"]
    line = [f"{middle} {unit}", f"90 %: {interval}"] if interval else [f"{middle} {unit}"]
    notes = list[str]()
    statistics = group.systematic.statistics.get(name)
    if scatter := group.population.wide_scatters.get(name):
        notes.append(f"scatter {digits.percent(scatter)} %")
    if name == "shear_modulus" and (secants := _secant_moduli(group, shots)):
        notes.append(f"at small strain; {digits.ends(secants, factor, 2)} {unit} at R_max")
    if not notes and statistics and _width_of(value) > COMMON_SHARE * _width_of(statistics):
        notes.append(f"exact scale: {digits.value_parts(statistics, factor)[1]}")
    return [*line, f"({'; '.join(notes)})"] if notes else line


def _width_of(value: Quantity) -> float:
    return (value.q95 or 0.0) - (value.q05 or 0.0)


def _is_liquid(group: GroupRecord) -> bool:
    return group.population.switches.get("liquid", 0.0) > 0.5


def _refusal(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """Why no value of a group is to be used, in a sentence; "" if one may be."""
    serious = [message for message in group.doubts if message.code not in _DISAGREEMENTS]
    if serious or len(group.population.heaps) == len(_SYMBOLS):
        return f"nothing yet: {'; '.join(message.text for message in group.doubts)}"
    misfits = sum(shot.verdict == "does_not_fit" for shot in shots)
    if group.verdict == "does_not_fit" and misfits > MOST * len(shots):
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
    for name, symbol in _SYMBOLS.items():
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
    return [symbol for name, symbol in _SYMBOLS.items() if name in apart]


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


def _next_step(group: GroupRecord, shots: Sequence[CurveRecord], out: Path) -> str:
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
    if abs(group.change_by_scale or 0.0) >= LARGE_CHANGE:
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


def print_line(record: CurveRecord) -> None:
    """Print an answer in one line, first its verdict, then its numbers: 'ok  gel_07: G 6.4 kPa (5.9 to 7.0), µ 0.029 Pa
    s (0.026 to 0.033), λ 6.1 (5.9 to 6.3), R_max 152 µm, RMSE 1.2 %'."""
    from rich.text import Text

    look, unit = digits.VERDICT_STYLES[record.verdict], digits.modulus_unit([record.shear_modulus_Pa.largest])
    values = [("G", record.shear_modulus_Pa, *unit), ("µ", record.viscosity, 1.0, "Pa s"), ("λ", record.stretch, 1, "")]
    parts = [
        f"{symbol} {digits.quantity(value, scale, unit=name)}" for symbol, value, scale, name in values if value.known
    ]
    parts.append(f"R_max {digits.micrometres(record.max_radius_m)} µm, RMSE {digits.percent(record.rmse_over_rmax)} %")
    line = f"{record.name}: {', '.join(parts) if record.has_answer else record.message}"
    terminal.console().print(Text(f"{look.words}  ", look.terminal).append(digits.printable(line), "default"))


def print_all(result: Result, *, out: Path = Path()) -> None:
    """Print further parameters, the laws that were compared, and all messages; then the result, with a row for each
    shot. A shot is called by what distinguishes it."""
    console = terminal.console()
    names = digits.distinct_names([row.name for row in result.curves])
    rows = [row.model_copy(update={"name": name}) for row, name in zip(result.curves, names, strict=True)]
    terminal.print_table(console, *parameters_table(rows, result))
    for line in [*result.model_key, *parameter_key(result.parameters)]:
        terminal.print_text(console, line, style="dim")
    terminal.print_remarks(console, curves_by_message(rows))
    for group in result.groups:
        if group.laws:
            title = f"{group.name}, {digits.counted(group.laws.shots, 'shot')}: {LAWS_TITLE}"
            terminal.print_table(console, LAW_HEADS, group.laws.rows, title=title)
            terminal.print_remarks(console, {}, group.laws.sentences)
    terminal.print_remarks(console, {}, [row.words for row in result.differences])
    print_result(result, out=out, every_shot=True)

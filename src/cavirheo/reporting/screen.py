"""The result of a run on a terminal: for each group at most ten lines and one for each shot, the answer last."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.messages import constants_in_words, heaps_in_words
from cavirheo.parameters import parameter_of
from cavirheo.posterior import TRUSTED
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity

if TYPE_CHECKING:
    from rich.text import Text

MOST_ROWS = 12  # shots of a group that all have a row; of a larger one the exceptions have
MOST_EXCEPTIONS = 11  # rows of exceptions
WIDTH = 80  # columns of a terminal that is not wider
MOST_NOTES = 3  # notes on the run; the report has all
_NAME = 28  # most characters of the name of a shot; in a table that is too wide SHORT_NAME
_LABEL = 5  # columns before the text of a line below the shots
_SWITCHES = {"liquid": "liquid", "stiffening": "stiffens", "field_bubble": "field's bubble"}
_VALUES = {"shear_modulus": "G", "viscosity": "µ"}  # parameters of the answer and their labels
_OTHERS = {"shear_modulus": "viscosity", "viscosity": "shear_modulus"}
Row = tuple[list[str], str]  # cells, verdict


def print_result(
    result: Result, *, out: Path = Path(), every_shot: bool = False, printed_notes: Collection[str] = ()
) -> None:
    """Print the shots and the answer of each group. out: folder of the run, for the next command. every_shot: a row for
    each shot, not for exceptions alone. printed_notes: notes that were already printed on stderr."""
    several = [(group, shots) for group, shots in result.rows_by_group() if len(shots) > 1]
    singles = [(group, shots[0]) for group, shots in result.rows_by_group() if len(shots) == 1]
    for group, shots in several:
        _print_group(result, group, shots, out, every_shot)
    if len(singles) == 1:
        ((group, shot),) = singles
        _print_single(result, group, shot, out)
    elif singles:
        _print_singles(result, singles, out, every_shot)
    notes = [note for note in result.notes if note not in printed_notes]
    for note in notes[:MOST_NOTES]:
        _say("note", note)
    if len(notes) > MOST_NOTES:
        _say("note", f"{digits.counted(len(notes) - MOST_NOTES, 'more note')} in the report")


def _print_group(result: Result, group: GroupRecord, shots: Sequence[CurveRecord], out: Path, every_shot: bool) -> None:
    _title(group.name, group_facts(group, shots))
    _print_rows(result, shots, group, every_shot)
    _print_answer(result, group, shots, out)


def _print_single(result: Result, group: GroupRecord, shot: CurveRecord, out: Path) -> None:
    facts = [f"R_max {digits.micrometres(shot.max_radius_m)} µm", f"λ {digits.quantity(shot.stretch)}"]
    facts += [*_windows([shot]), f"misfit {digits.percent(shot.rmse_over_rmax)} %"]
    _title(shot.name, facts if shot.has_answer else [])
    _print_answer(result, group, [shot], out)


def _print_singles(
    result: Result, singles: Sequence[tuple[GroupRecord, CurveRecord]], out: Path, every_shot: bool
) -> None:
    shots = [shot for _, shot in singles]
    _title(digits.counted(len(shots), "shot"), ["each by itself", *_windows(shots)])
    _print_rows(result, shots, None, every_shot)
    doubtful = [group for group, _ in singles if group.verdict != "ok"]
    _say("next", _next_step(doubtful[0] if doubtful else singles[0][0], shots, out))


def _windows(shots: Sequence[CurveRecord]) -> list[str]:
    counts = sorted({shot.window.collapses for shot in shots if shot.window.collapses is not None})
    if not counts:
        return []
    few = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else ""
    return [f"{few} collapses each" if few else digits.counted(counts[0], "collapse")]


def _title(name: str, facts: Sequence[str]) -> None:
    words = ", ".join(facts)
    console = terminal.console()
    room = max(console.width, WIDTH) - len(words) - 2
    console.print(
        _text([(digits.elide(name, max(room, digits.SHORT_NAME)), "bold"), ("  " + words, "")]), soft_wrap=True
    )


def _print_rows(result: Result, shots: Sequence[CurveRecord], group: GroupRecord | None, every_shot: bool) -> None:
    """A row for each shot; of many, for the exceptions, and how many there are."""
    names = dict(zip((shot.name for shot in shots), digits.distinct_names([shot.name for shot in shots]), strict=True))
    shown = list(shots)
    if len(shots) > MOST_ROWS and not every_shot:
        outliers = group.population.outliers if group and group.population else {}
        exceptions = [shot for shot in shots if shot.verdict not in TRUSTED or shot.name in outliers]
        shown = exceptions[:MOST_EXCEPTIONS]
    factor, unit = result.modulus_unit
    head = ["shot", "R_max", "λ", f"G {unit}", "90 %", "µ Pa s", "90 %", "misfit", ""]
    rows: list[Row] = [(_cells(shot, names[shot.name], factor), shot.verdict) for shot in shown]
    if rows:
        _print_table(head, rows)
    if len(shown) < len(shots):
        hidden = len(shots) - len(shown)
        _say("", f"{digits.counted(hidden, 'more shot')}: {_verdicts([s for s in shots if s not in shown])} (--all)")


def _verdicts(shots: Sequence[CurveRecord]) -> str:
    counts: dict[str, int] = {}
    for shot in shots:
        counts[digits.VERDICT_WORDS[shot.verdict]] = counts.get(digits.VERDICT_WORDS[shot.verdict], 0) + 1
    return ", ".join(f"{count} {words}" for words, count in counts.items())


def _cells(shot: CurveRecord, name: str, factor: float) -> list[str]:
    stretch = shot.stretch
    mark = "" if shot.verdict == "ok" else digits.VERDICT_WORDS[shot.verdict]
    return [
        digits.elide(name, _NAME),
        digits.micrometres(shot.max_radius_m),
        digits.number(stretch.median) if stretch.median is not None else " ".join(value_parts(stretch, 1.0)).strip(),
        *value_parts(shot.shear_modulus_Pa, factor),
        *value_parts(shot.viscosity, 1.0),
        digits.percent(shot.rmse_over_rmax),
        mark,
    ]


def value_parts(value: Quantity, factor: float) -> tuple[str, str]:
    """(value, interval) in words; a bound has no value."""
    if not value.known:
        return digits.MISSING, ""
    if value.bound is None:
        number, _, interval = digits.quantity(value, factor).partition(" ")
        return number, interval.strip("[]").replace(", ", " to ")
    if value.bound == "undetermined":
        return "", "not known"
    return "", digits.quantity(value, factor).removesuffix(" (95 %)")


def _print_table(head: list[str], rows: Sequence[Row]) -> None:
    """Columns as wide as their cells; the stretch is left out, and names are shortened, where they are too wide."""
    console = terminal.console()
    width = max(console.width, WIDTH)
    table = [head, *(cells for cells, _ in rows)]
    if _width(table) > width:
        table = [[digits.elide(cells[0], digits.SHORT_NAME), *cells[1:]] for cells in table]
    if _width(table) > width:
        table = [[*cells[:2], *cells[3:]] for cells in table]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for cells, verdict in zip(table, ["", *(verdict for _, verdict in rows)], strict=True):
        *numbers, mark = cells
        first = numbers[0].ljust(widths[0])
        line = "  ".join([first, *(cell.rjust(wide) for cell, wide in zip(numbers[1:], widths[1:-1], strict=True))])
        look = digits.VERDICT_STYLES[verdict].terminal if verdict else ""
        console.print(_text([(line, "" if verdict else "dim"), (f"  {mark}".rstrip(), look)]), soft_wrap=True)


def _width(table: Sequence[Sequence[str]]) -> int:
    return sum(max(map(len, column)) + 2 for column in zip(*table, strict=True))


def _print_answer(result: Result, group: GroupRecord, shots: Sequence[CurveRecord], out: Path) -> None:
    for label, parts in answer_lines(result, group, shots, out):
        text = "   ".join(parts)
        if label == "use":
            _say(label, text, style=digits.VERDICT_STYLES[group.verdict].terminal, most=2)
        else:
            _say(label, text, style="bold" if label in _VALUES.values() else "")


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
    sizes = [shot.max_radius_m for shot in shots if shot.max_radius_m]
    ends = dict.fromkeys([digits.micrometres(min(sizes)), digits.micrometres(max(sizes))]) if sizes else {}
    facts = [digits.counted(len(shots), "shot")]
    facts += [f"{group.n_counted} of them count"] if group.n_counted < len(shots) else []
    facts += [f"R_max {' to '.join(ends)} µm"] if ends else []
    return facts + _windows(shots)


def _value_line(result: Result, group: GroupRecord, name: str) -> list[str]:
    heaps = group.population.heaps.get(name) if group.population else None
    if heaps:
        words = heaps_in_words(name, [(heap.low, heap.high, heap.shots) for heap in heaps])
        return [f"shots disagree: {words.partition(' ')[2]}"]
    value = group.viscosity if name == "viscosity" else group.value(name)
    if not value.known:
        return []
    factor, unit = result.modulus_unit if name == "shear_modulus" else (1.0, "Pa s")
    number, interval = value_parts(value, factor)
    line = [f"{number} {unit}", interval] if number else [f"{interval} {unit}"]
    alone = group.systematic.statistics.get(name) if group.systematic else None
    if alone and value.median is not None:
        line.append(f"(statistics alone {value_parts(alone, factor)[1]})")
    return line


def _use(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """Whether G and mu may be used, in a sentence."""
    change = group.systematic.slopes.get("shear_modulus", {}).get("scale") if group.systematic else None
    moved = "" if change is None else f"; 1 % in scale or frame rate moves G by {digits.significant(change, 2)} %"
    disagreeing = list(group.population.heaps) if group.population else []
    if len(group.doubts) == len(disagreeing) == 1 and disagreeing[0] in _OTHERS:
        symbol, other = parameter_of(disagreeing[0]).symbol, parameter_of(_OTHERS[disagreeing[0]]).symbol
        return f"{other} with care, {symbol} not: the shots disagree{moved}"
    if group.doubts:
        more = f" (and {len(group.doubts) - 1} more)" if len(group.doubts) > 1 else ""
        return f"nothing yet: {group.doubts[0].text}{more}"
    if group.verdict == "ok":
        return f"the values{moved}"
    if group.verdict == "bound":
        return f"values as values, bounds as bounds{moved}"
    if group.verdict == "does_not_fit":
        return f"nothing: the law does not follow {_count(shots, 'does_not_fit')}"
    if group.verdict == "check_input":
        return f"nothing yet: {'; '.join(message.text for message in shots[0].warnings)}"
    if group.verdict == "unverified":
        return "with care: a network gives one value, without an interval"
    return f"nothing: {shots[0].message}"


def _count(shots: Sequence[CurveRecord], verdict: str) -> str:
    count = sum(shot.verdict == verdict for shot in shots)
    return "the recording" if len(shots) == 1 else f"{count} of {len(shots)} recordings"


def _facts(group: GroupRecord, shots: Sequence[CurveRecord]) -> list[str]:
    """Constants that were not given, and the switches; in one line if there is room."""
    values = {name: value for shot in shots for name, value in shot.provenance.get("assumed", {}).items()}
    constants = f"{constants_in_words(values)}: not given" if values else ""
    switches = group.population.switches if group.population and group.has_answer else {}
    words = ", ".join(
        f"{_SWITCHES[name]} {100.0 * share:.0f} %" for name, share in switches.items() if name in _SWITCHES
    )
    both = ".   ".join(filter(None, [constants, words]))
    return [both] if len(both) + _LABEL <= WIDTH and both else [line for line in (constants, words) if line]


def _next_step(group: GroupRecord, shots: Sequence[CurveRecord], out: Path) -> str:
    """The one command that helps."""
    document = shlex.quote(str(out / "result.json"))
    sources = list(dict.fromkeys(shot.source for shot in shots if shot.source))
    files = " ".join(map(shlex.quote, sources[:2])) + (" ..." if len(sources) > 2 else "")
    codes = [message.code for message in group.doubts]
    if "group.doubt.input" in codes or (group.verdict == "check_input" and not codes) or group.verdict == "failed":
        return f"cavirheo show {document}   (the warning of each shot)"
    if "group.doubt.ends" in codes:
        return "the same command with the right --um-per-px (or --rmax-um) and --fps"
    if "group.doubt.heaps" in codes:
        return f"cavirheo infer {_first_heap(group, shots)}   (each heap by itself)"
    if group.verdict in ("does_not_fit", "unverified"):
        verb = "which-law" if group.verdict == "does_not_fit" else "infer"
        return f"cavirheo {verb} {files}"
    if group.verdict == "bound":
        return f"cavirheo design {document}   (what to record)"
    return f"cavirheo cite {document}   (after a look at the pictures)"


def _first_heap(group: GroupRecord, shots: Sequence[CurveRecord]) -> str:
    """The files of the shots in the first heap in which a group disagrees, or their numbers in the only file."""
    heaps = next(iter(group.population.heaps.values())) if group.population else []
    names = set(heaps[0].shots) if heaps else set()
    sources = list(dict.fromkeys(shot.source for shot in shots if shot.name in names))
    if any(shot.source in sources and shot.name not in names for shot in shots):
        numbers = [str(k) for k, shot in enumerate(shots, 1) if shot.name in names]
        return f"{shlex.quote(sources[0])} --shots {','.join(numbers)}"
    return " ".join(map(shlex.quote, sources[:3])) + " ..." * (len(sources) > 3)


def _say(label: str, text: str, *, style: str = "", most: int = 1) -> None:
    """Print a label and a text in at most `most` lines of the terminal, broken between words; a single line is not
    broken."""
    console = terminal.console()
    width = max(console.width, WIDTH) - _LABEL
    lines = textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False, max_lines=most, placeholder=" …")
    for k, line in enumerate(lines if most > 1 else [text]):
        head = label if k == 0 else ""
        console.print(_text([(head.ljust(_LABEL), "bold"), (line, style)]), soft_wrap=True)


def _text(parts: Sequence[tuple[str, str]]) -> Text:
    from rich.text import Text

    return Text.assemble(*((digits.printable(words), style) for words, style in parts))

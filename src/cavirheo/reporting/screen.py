"""The result of a run on a terminal: for each group at most ten lines and one for each shot, the answer last."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path

from cavirheo.errors import listed
from cavirheo.posterior import SEVERITY
from cavirheo.reporting import advice
from cavirheo.reporting.record import MAIN_FIELDS, CurveRecord, GroupRecord, Result
from cavirheo.writing import digits, terminal

MOST_ROWS = 12  # shots of a group that all have a row; of a larger one the exceptions have
MOST_EXCEPTIONS = 11  # rows of exceptions
WIDTH = 80  # columns of a terminal that is not wider
MOST_NOTES = 3  # notes on the run; the report has all
_NAME = 28  # most characters of the name of a shot; in a table that is too wide SHORT_NAME
_FEWER = ("λ", "R_max µm", "RMSE %")  # columns that a table that is too wide leaves out, in this order
_LABEL = 6  # columns before the text of a line below the shots
_MOST_LINES = 3  # of the terminal, for each label below the shots


def print_result(
    result: Result, *, out: Path = Path(), every_shot: bool = False, printed_notes: Collection[str] = ()
) -> None:
    """Print the laws that were compared, the shots and the answer of each group. out: folder of the run, for the next
    command. every_shot: a row for each shot, and all that is known of each law, not exceptions and the best law alone.
    printed_notes: notes that were already printed on stderr."""
    notes = [note for note in result.notes if note not in printed_notes]
    for note in notes[:MOST_NOTES]:
        _say("note", note, most=None)
    if len(notes) > MOST_NOTES:
        _say("note", f"{digits.counted(len(notes) - MOST_NOTES, 'more note')} in the report")
    _print_laws(result, every_pair=every_shot)
    by_itself = [(group, shots) for group, shots in result.rows_by_group() if len(shots) == 1]
    for group, shots in result.rows_by_group():
        if len(shots) > 1:
            _print_title(group.name, advice.group_facts(group, shots))
            _print_rows(result, shots, group.population.outliers, every_shot)
            _print_answer(result, group, shots, out)
    if len(by_itself) == 1:
        ((group, (shot,)),) = by_itself
        facts = [f"R_max {digits.micrometres(shot.max_radius_m)} µm", f"λ {digits.quantity(shot.stretch)}"]
        facts += [*advice.windows([shot]), f"RMSE {digits.percent(shot.rmse_over_rmax)} %"]
        _print_title(shot.name, facts if shot.has_answer else [])
        _print_answer(result, group, [shot], out)
    elif by_itself:
        shots = [shot for _, (shot,) in by_itself]
        _print_title(digits.counted(len(shots), "shot"), ["each by itself", *advice.windows(shots)])
        _print_rows(result, shots, (), every_shot)
        names = digits.distinct_names([shot.name for shot in shots])
        answers = [(name, advice.answer_lines(result, *one)) for name, one in zip(names, by_itself, strict=True)]
        for label in ("use", "check"):
            lines = [(name, line) for name, answer in answers for line in answer if line.label == label]
            said = [(name, text) for name, line in lines for text in line.parts]
            texts = terminal.names_by_text(said).items()
            clauses = [text if len(of) == len(shots) else f"{listed(of)}: {text}" for text, of in texts]
            if clauses:
                _say(label, _fitting(clauses), most=_MOST_LINES)
        worst = max((group for group, _ in by_itself), key=lambda group: SEVERITY.index(group.verdict))
        alike = [shot for group, (shot,) in by_itself if group.verdict == worst.verdict]
        _print_answer_line(advice.next_step(result, worst, alike, out))
    if any(group.published for group in result.groups):
        print_comparison(result)


def print_all(result: Result, *, out: Path = Path()) -> None:
    """Print all messages, and the result with a row for each shot. A shot is called by what distinguishes it."""
    names = digits.distinct_names([row.name for row in result.curves])
    remarks = advice.curves_by_message(result.curves, names)
    terminal.print_remarks(remarks, limit=len(remarks))
    terminal.print_remarks({}, [row.words for row in result.differences])
    print_result(result, out=out, every_shot=True)


def print_comparison(result: Result) -> None:
    """Print the answers of groups beside values of other methods, and how to read them."""
    heads, rows = advice.comparison_table(result)
    groups = ["", *(row[0] for row in rows)]
    rows = [["" if row[0] == above else row[0], *row[1:]] for above, row in zip(groups, rows, strict=False)]
    terminal.print_table(heads, rows, left=("quantity", "method"))
    terminal.print_text(advice.comparison_key(result), style="dim")


def print_line(record: CurveRecord) -> None:
    """Print an answer, first its verdict, then its numbers: 'ok  gel_07: G 6.4 kPa (5.9 to 7.0), µ 0.029 Pa
    s (0.026 to 0.033), λ 6.1 (5.9 to 6.3), R_max 152 µm, RMSE 1.2 %'."""
    values = {name: record.main(name) for name in (*MAIN_FIELDS, "stretch")}
    names = {name: advice.viscosity_name(record) if name == "viscosity" else name for name in values}
    parts = [digits.shown(names[name], value.largest).named(value) for name, value in values.items() if value.known]
    parts.append(f"R_max {digits.micrometres(record.max_radius_m)} µm, RMSE {digits.percent(record.rmse_over_rmax)} %")
    line = f"  {record.name}: {', '.join(parts) if record.has_answer else record.message}"
    style = digits.VERDICT_STYLES[record.verdict].terminal
    terminal.print_text(line, first=record.verdict_in_words, look=style)


def _print_laws(result: Result, *, every_pair: bool) -> None:
    """Print the laws of each group, and by how much the best one is preferred to the next; or all that is known."""
    for group in result.groups:
        if group.laws:
            title = f"{group.name}, {digits.counted(group.laws.shots, 'shot')}: {group.laws.TITLE}"
            terminal.print_table(group.laws.HEADS, group.laws.rows, title=title)
            terminal.print_remarks({}, group.laws.sentences if every_pair else group.laws.preferences[:1])


def _width() -> int:
    return max(terminal.console().width, WIDTH)


def _print_title(name: str, facts: Sequence[str]) -> None:
    words = ", ".join(facts)
    short = digits.elide(name, max(_width() - len(words) - 2, digits.SHORT_NAME))
    terminal.print_line((short, "bold"), (f"  {words}".rstrip(), ""))


def _print_rows(result: Result, shots: advice.Shots, outliers: Collection[str], every_shot: bool) -> None:
    """A row for each shot; of many, for the exceptions, and what the shots are that count."""
    visible = list(shots)
    if len(shots) > MOST_ROWS and not every_shot:
        visible = [shot for shot in shots if not shot.trusted or shot.name in outliers][:MOST_EXCEPTIONS]
    if visible:
        _print_table(result, visible, [shot.name for shot in shots])
    if len(visible) < len(shots):
        hidden = [shot for shot in shots if shot not in visible]
        verdicts = Counter(shot.verdict_in_words for shot in hidden).most_common()
        words = "; ".join(f"{count} {verdict}" for verdict, count in verdicts)
        _say("", f"{digits.counted(len(hidden), 'more shot')}: {words} (--all shows them)", most=2)
        ranges = []
        for name in MAIN_FIELDS:
            shown = result.shown(name)
            medians = [shot.main(name).median for shot in shots if shot.trusted]
            if ends := digits.ends(medians, shown.factor, 2):
                ranges.append(f"{shown.symbol} {ends} {shown.unit}")
        if ranges:
            _say("", f"values of those that count: {'; '.join(ranges)}")


def _print_table(result: Result, shots: advice.Shots, names: Sequence[str]) -> None:
    """A row for each of these shots. names: of all shots of their group. Where rows are too wide, names are shortened,
    then columns are left out, then verdicts have lines of their own."""
    gap = "  "
    for width, count in ((_NAME, 0), *((digits.SHORT_NAME, count) for count in range(len(_FEWER) + 1))):
        short = dict(zip(names, digits.short_names(names, width), strict=True))
        heads, rows = advice.shots_table(result, shots, [digits.spaced(short[shot.name]) for shot in shots])
        marks = ["", *(row[-1] for row in rows)]
        columns = [column for column in zip(heads[:-1], *rows, strict=False) if column[0] not in _FEWER[:count]]
        first, *widths = (max(map(len, column)) for column in columns)
        if first + sum(widths) + 2 * len(columns) + max(map(len, marks)) <= _width():
            break
    else:
        gap = "\n  "
    styles = ["", *(digits.VERDICT_STYLES[shot.verdict].terminal for shot in shots)]
    for (name, *cells), mark, style in zip(zip(*columns, strict=True), marks, styles, strict=True):
        line = [name.ljust(first), *(cell.rjust(width) for cell, width in zip(cells, widths, strict=True))]
        text = "  ".join(line).replace(digits.FILLER, "")
        terminal.print_line((text, "" if style else "dim"), (f"{gap}{mark}".rstrip(), style))


def _print_answer(result: Result, group: GroupRecord, shots: advice.Shots, out: Path) -> None:
    for line in advice.answer_lines(result, group, shots, out):
        _print_answer_line(line, digits.VERDICT_STYLES[group.verdict].terminal if line.label == "use" else "")


def _print_answer_line(line: advice.Line, style: str = "") -> None:
    """Print a value in bold type; as many clauses as fit; or an unbroken command, its purpose beside or below it."""
    text = "   ".join(line.parts)
    if line.kind == "value":
        _say(line.label, text, style="bold", most=2)
    elif line.kind == "clauses":
        _say(line.label, _fitting(line.parts), style=style, most=_MOST_LINES)
    elif len(text) <= _width() - _LABEL:
        _say(line.label, text)
    else:
        for label, part in zip((line.label, ""), line.parts, strict=False):
            _say(label, part)


def _fitting(clauses: Sequence[str]) -> str:
    """The first of these clauses, as many as fit in the lines of a label; a first one that is too long is cut."""
    for count in range(len(clauses), 0, -1):
        text = "; ".join(clauses[:count]) + ("" if count == len(clauses) else "; more in the report")
        if len(terminal.lines_of(text, _width() - _LABEL)) <= _MOST_LINES:
            return text
    return clauses[0]


def _say(label: str, text: str, *, style: str = "", most: int | None = 1) -> None:
    """Print a label and a text in at most `most` lines, broken between words; a single line is not broken."""
    head = f"{label} ".ljust(_LABEL)
    lines = terminal.lines_of(text, _width() - len(head), most) if most != 1 else [text]
    for k, line in enumerate(lines):
        terminal.print_line((head if k == 0 else " " * len(head), "bold"), (line, style))

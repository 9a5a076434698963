"""Tables of curves and their answers for the terminal (rich) and for spreadsheets (CSV); and the remarks below them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.messages import Message, title
from cavirheo.parameters import CAMERA, VISCOSITY_AT_RATE, column_name, is_law_parameter
from cavirheo.physics.media import WATER
from cavirheo.reporting.answer import (
    CurveRecord,
    OtherModel,
    Sentence,
    display_unit,
    log_evidence_key,
    parameter_key,
    parameters_of,
)
from cavirheo.reporting.group import OUR_METHOD, GroupRecord
from cavirheo.reporting.material import KEYS
from cavirheo.reporting.record import Result
from cavirheo.reporting.screen import print_result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity, Spread, write_rows

if TYPE_CHECKING:
    from rich.console import Console


_ENDS = {"median": "", "q05": "_q05", "q95": "_q95", "bound": "_bound"}  # columns of a quantity in CSV


def summary_cells(curve: RadiusCurve) -> tuple[str, ...]:
    """Cells of a curve: R_max (µm), frame rate (kHz), frames with a radius, recorded time (µs), number of collapses."""
    top, collapses = digits.MISSING, digits.MISSING
    with suppress(InputError):
        top, collapses = digits.micrometres(curve.max_radius), str(len(curve.collapse_times()))
    frames = f"{np.isfinite(curve.radius).sum()} of {len(curve.time)}"
    recorded = f"{1e6 * np.ptp(curve.time):.4g}" if len(curve.time) else digits.MISSING
    return top, digits.number(curve.frame_rate, 1e-3), frames, recorded, collapses


def names_by_sentence(messages: Sequence[tuple[str, Message | Sentence]]) -> dict[str, list[str]]:
    """The names by sentence, of (name, message). Different sentences with the same code are replaced by what they have
    in common, if the code has such a title."""
    texts: dict[str, set[str]] = {}
    for _, message in messages:
        texts.setdefault(message.code, set()).add(message.text)
    common = {code: title(code) for code, different in texts.items() if len(different) > 1}
    return terminal.names_by_message((name, common.get(message.code) or message.text) for name, message in messages)


def curve_warnings(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """The warnings on scales and settings, and why a curve has no R_max, each with the names of its curves."""
    from cavirheo.inference import checks  # imports the solver, which is not needed to show a document

    warnings = [(curve.name, warning) for curve in curves for warning in checks.curve_warnings(curve, WATER)]
    for curve in curves:
        try:
            _ = curve.max_radius
        except InputError as error:
            warnings.append((curve.name, Message(error.code, {"text": error.message})))
    return names_by_sentence(warnings)


def curves_by_note(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """Notes on what was recognised, converted or left out in the files, each once, with the names of its curves."""
    return terminal.names_by_message((curve.name, note) for curve in curves for note in curve.notes)


def input_warnings(records: Iterable[CurveRecord]) -> dict[str, list[str]]:
    """The input warnings of all answers, each with the names of its curves."""
    return names_by_sentence([(record.name, warning) for record in records for warning in record.warnings])


def curves_by_remark(records: Sequence[CurveRecord]) -> dict[str, list[str]]:
    """The remarks of all answers, the most frequent first, each with the names of its curves."""
    names = names_by_sentence([(record.name, message) for record in records for message in record.remarks])
    return dict(sorted(names.items(), key=lambda item: len(item[1]), reverse=True))


def print_line(record: CurveRecord) -> None:
    """Print an answer in one line, first its verdict, then its numbers: 'ok  gel_07: G 6.4 kPa [5.9, 7.0], µ 0.029 Pa s
    [0.026, 0.033], λ 6.1 [5.9, 6.3], R_max 152 µm, RMSE 1.2 %'."""
    from rich.text import Text

    look, unit = digits.VERDICT_STYLES[record.verdict], digits.modulus_unit([record.shear_modulus_Pa.largest])
    values = [("G", record.shear_modulus_Pa, *unit), ("µ", record.viscosity, 1.0, "Pa s"), ("λ", record.stretch, 1, "")]
    parts = [
        f"{symbol} {digits.quantity(value, scale, unit=name)}" for symbol, value, scale, name in values if value.known
    ]
    parts.append(f"R_max {digits.micrometres(record.max_radius_m)} µm, RMSE {digits.percent(record.rmse_over_rmax)} %")
    line = f"{record.name}: {', '.join(parts) if record.has_answer else record.message}"
    terminal.console().print(Text(f"{look.words}  ", look.terminal).append(digits.printable(line), "default"))


def print_all(result: Result) -> None:
    """Print all parameters, the remarks and the answers of other models; then the result, with a row for each shot, and
    the comparison with published values. A shot is called by what distinguishes it."""
    console = terminal.console()
    names = digits.distinct_names([row.name for row in result.curves])
    rows = [row.model_copy(update={"name": name}) for row, name in zip(result.curves, names, strict=True)]
    _print_parameters(console, result, rows)
    for line in result.model_key:
        terminal.print_text(console, line, style="dim")
    terminal.print_warnings(console, input_warnings(rows))
    terminal.print_remarks(console, curves_by_remark(rows))
    for group in result.groups:
        terminal.print_remarks(console, {remark: [group.name] for remark in group.remarks})
    terminal.print_remarks(console, {}, [row.words for row in result.differences])
    factor, unit = result.modulus_unit
    heads = [f"G\n{unit}", "µ\nPa s", "λ", "RMSE\n%", "log\nevidence"]
    for row in rows:
        if row.other_models:
            table = terminal.table("model", heads, title=f"{row.name}: the answer, then other models")
            for cells in model_rows(row, factor, joint="\n"):
                table.add_row(*cells)
            console.print(table)
    print_result(result, every_shot=True)
    if any(group.published for group in result.groups):
        print_comparison(result)


def model_rows(record: CurveRecord, factor: float, joint: str = " ") -> list[list[str]]:
    """Rows of the answer and of other models, by evidence: model, G, µ, λ, RMSE, log evidence minus the answer's.
    joint: stands before the interval."""
    own = record.evidence.log if record.evidence else None
    rows = []
    others = sorted(record.other_models, key=log_evidence_key, reverse=True)
    models: list[CurveRecord | OtherModel] = [record, *others]
    for model in models:
        values = (model.shear_modulus_Pa, factor), (model.viscosity, 1.0), (model.stretch, 1.0)
        above = digits.MISSING
        if isinstance(model, CurveRecord):
            above = "0"
        elif model.log_evidence is not None and own is not None:
            above = f"{model.log_evidence - own:+.1f}"
        texts = [digits.quantity(value, scale, joint=joint) for value, scale in values]
        rows.append([model.model, *texts, digits.percent(model.rmse_over_rmax), above])
    return rows


def _print_parameters(console: Console, result: Result, rows: Sequence[CurveRecord]) -> None:
    """Print the parameters that were inferred or given, without G, µ, λ and those of the camera."""
    of_laws, excluded = parameters_of(rows), (*CAMERA, VISCOSITY_AT_RATE)
    names = [name for name in result.parameters if name in of_laws or not is_law_parameter(name)]
    units = {name: display_unit(name) for name in names if name not in excluded}
    if not units:
        return
    table = terminal.table("shot", [f"{symbol}\n{unit}".strip() for symbol, _, unit in units.values()])
    for row in rows:
        if any(name in row.other_parameters for name in units):
            table.add_row(row.name, *(digits.quantity(row.value(n), factor) for n, (_, factor, _) in units.items()))
    console.print(table)
    for line in parameter_key(result.parameters):
        terminal.print_text(console, line, style="dim")


def csv_rows(result: Result) -> tuple[list[str], list[dict[str, Any]]]:
    """(column names of result.csv, which contain the SI units; a row for each curve, None for a missing number). A
    bound has no median, so that a mean of medians is one of values."""
    first, further = ["stretch", "shear_modulus", "viscosity"], result.parameters
    columns = {name: column_name(name, digits.symbol_and_unit(name)[1]) for name in (*first, *further)}
    head = ["name", "group", "source", "material", "method", "max_radius_m"]
    head += [columns[name] + end for name in first for end in _ENDS.values()]
    head += ["rmse_over_rmax", "collapses", "t_star_end", "verdict", "message", "bubble"]
    head += [columns[name] + end for name in further for end in _ENDS.values()]
    rows = []
    for record in result.curves:
        row = vars(record) | {"message": record.message, "bubble": record.bubble.name} | vars(record.window)
        for name, column in columns.items():
            row |= {column + end: getattr(record.value(name), part) for part, end in _ENDS.items()}
        rows.append(row)
    return head, rows


def compared(group: GroupRecord, shots: Sequence[CurveRecord]) -> Iterator[tuple[str, str, Spread | Quantity]]:
    """Yield (parameter, method, value) of each value of a group by other methods and of its answer, which is last."""
    for name in dict.fromkeys([*KEYS, *(name for values in group.published.values() for name in values)]):
        for method, values in group.published.items():
            if name in values:
                yield name, method, values[name]
        if name in KEYS and any(shot.value(name).known for shot in shots):
            yield name, OUR_METHOD, group.value(name)


def _references(result: Result) -> list[str]:
    """The methods relative to which errors are given."""
    return list(dict.fromkeys(method for group in result.groups for method in group.errors))


def _error(group: GroupRecord, reference: str, method: str, name: str) -> float | None:
    return group.errors.get(reference, {}).get(method, {}).get(name)


def write_comparison(path: Path, result: Result) -> None:
    """Write CSV with a line for each group, quantity and method: SI, errors as fractions, empty cells for missing
    numbers. A group without any value has one line."""
    references = _references(result)
    columns = ["set", "quantity", "method", "value", "std", "q05", "q95", "bound"]
    columns += [*(f"error_to_{reference}" for reference in references), "n_shots", "n_counted", "verdict"]
    lines = list[dict[str, Any]]()
    for group, shots in result.rows_by_group():
        facts = {"set": group.name, "n_shots": len(shots), "n_counted": group.n_counted, "verdict": group.verdict}
        of_group = [
            {
                **vars(value),
                **facts,
                **{f"error_to_{reference}": _error(group, reference, method, name) for reference in references},
                "quantity": KEYS.get(name, name),
                "method": method,
                "value": value.mean if isinstance(value, Spread) else value.median,
            }
            for name, method, value in compared(group, shots)
        ]
        lines += of_group or [facts]
    write_rows(path, columns, lines)


def print_comparison(result: Result) -> None:
    """Print the comparison of each group; then the key, remarks on each group, and notes."""
    console = terminal.console()
    print_comparison_tables(console, result)
    key = f"{OUR_METHOD}: the material of all shots that count, with its 90 % interval; others: mean ± deviation."
    if references := " or ".join(_references(result)):
        key += f" Error to {references}: |value − its mean| / its mean, in %."
    if bubbles := ", ".join(dict.fromkeys(shot.bubble.title for shot in result.curves if shot.has_answer)):
        key += f" Our answers assume the {bubbles}."
    terminal.print_text(console, key, style="dim")
    for group, shots in result.rows_by_group():
        reasons = [f"{shot.name}: {shot.message}" for shot in shots if not shot.has_answer]
        remarks = [*(message.text for message in group.messages), *reasons]
        terminal.print_remarks(console, {remark: [group.name] for remark in remarks})
    terminal.print_remarks(console, {}, result.notes)


def print_comparison_tables(console: Console, result: Result) -> None:
    """Print a line for each parameter and method of each group, below its name and its shots."""
    references = _references(result)
    heads = ["method", "value", *(f"error to\n{reference}, %" for reference in references)]
    for group, shots in result.rows_by_group():
        table, previous = terminal.table("", heads, left=heads[:1]), ""
        for name, method, value in compared(group, shots):
            factor, label = 1.0, name.replace("viscosity_at_", "µ at ").replace("_rad_per_s", " rad/s (Pa s)")
            if name in KEYS:
                symbol, factor, unit = display_unit(name, result.modulus_unit)
                label = f"{symbol} ({unit})"
            words = digits.spread(value, factor) if isinstance(value, Spread) else digits.quantity(value, factor)
            errors = [digits.percent(_error(group, to, method, name)) if method != to else "" for to in references]
            style = "bold" if method == OUR_METHOD else None
            table.add_row("" if label == previous else label, method, words, *errors, style=style)
            previous = label
        facts = f"  {group.n} of {digits.counted(len(shots), 'shot')} answered, {group.n_counted} in the material"
        terminal.print_text(console, facts if shots else "", first=group.name, look="bold")
        console.print(table)

"""The answers as a table: for the terminal (rich) and for spreadsheets (CSV)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.parameters import AT_RATE, CAMERA, of_the_law
from cavirheo.reporting.answer import CurveRecord, OtherModel, Unit, evidence, in_unit, parameter_key, parameters_of
from cavirheo.reporting.comparison import print_comparison
from cavirheo.reporting.group import TOGETHER, GroupRecord
from cavirheo.reporting.input_remarks import causes, next_step
from cavirheo.reporting.material import KEYS
from cavirheo.reporting.record import Result
from cavirheo.writing import digits, export, terminal
from cavirheo.writing.document import spread_of, write_rows

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from cavirheo.inference.analysis import Analysis

MOST = 10  # lines on groups and curves below the table, but at least half as many on curves
FITS = ("least_squares", "laplace")  # methods whose answer is a maximum
_WINDOWS = {"1": "1 collapse", "2": "2 collapses", "3": "3 collapses", "all": "whole recording"}
_WIDE = 110  # columns; below this an interval stands under its median, and only those of G and mu are shown


def print_table(
    result: Result,
    console: Console | None = None,
    *,
    analysis: Analysis | None = None,
    out: Path = Path(),
    notes_shown: Collection[str] = (),
) -> None:
    """One row per curve, one per group (mean ± standard deviation), what is said of groups and curves, and the next
    step, where the analysis and the folder of the run are given. notes_shown: those that stderr has already."""
    from rich.text import Text

    console = console or terminal.console()
    wide, answers = console.width >= _WIDE, [record for record in result.curves if record.has_answer]
    parts: list[Callable[[Any], str]] = [lambda row: row.material, lambda row: row.bubble.name]
    mixed = [name for name in parts if len({name(row) for row in answers}) > 1]
    factor, unit = result.modulus_unit
    heads = [*(["model"] if mixed else []), "R_max\nµm", "λ", f"G\n{unit}", "µ\nPa s", "RMSE\n%"]
    heads += ["collapses" if wide else "col-\nlapses", "verdict"]
    table = terminal.table("curve", heads, left=("model", "verdict"), gap=int(wide))
    rows: list[tuple[str, Sequence[Any], str]] = []
    for record in result.curves:
        look, model = digits.LOOKS[record.verdict], [", ".join(name(record) for name in mixed)] if mixed else []
        rows.append((record.name, [*model, *_texts(record, factor, wide), Text(look.words, look.terminal)], ""))
    terminal.add_rows(table, rows)
    for group in result.groups:
        if group.headline:
            console.print(f"{group.name}: {group.headline}", style="bold")
    table.add_section()
    blank = [""] * bool(mixed)
    terminal.add_rows(table, [(row.name, [*blank, *_group_cells(row, factor)], "bold") for row in result.groups])
    console.print(table)
    key = "RMSE: measured minus simulated, % of R_max"
    if any(record.viscosity.q05 is not None for record in result.curves):
        key += "; [ , ]: central 90 % interval"
    if any(value.bound for record in result.curves for value in (record.shear_modulus_Pa, record.viscosity)):
        key += "; below, above: a bound (95 %) and no value"
    console.print("\n".join([key, *result.model_key]), style="dim")
    _print_parameters(console, result)
    _print_windows(console, result)
    terminal.print_warnings(console, warnings(result.curves))
    remarks = []
    for group in result.groups:
        lines = [*group.remarks, *(group.population.below if group.population else [])]
        remarks += [(group.name, line) for line in lines]
    notes = [note for note in result.notes if note not in notes_shown]
    _print_most(console, remarks, MOST)
    terminal.print_remarks(console, {}, [*(row.words for row in result.differences), *notes])
    whole, several = digits.counted(len(result.curves), "curve"), causes(result.curves).items()
    curves = [(f"{len(of)} of {whole}" if len(of) > 2 else ", ".join(of), cause) for cause, of in several]
    _print_most(console, curves, max(MOST - len(remarks), MOST // 2))
    if analysis and (step := next_step(result, analysis, out)):
        console.print(Text(digits.printable(step), "bold"), soft_wrap=True)  # a command that can be copied


def _print_most(console: Console, remarks: Sequence[tuple[str, str]], most: int) -> None:
    """A line for each (who, sentence), at most so many; the rest is counted."""
    for who, sentence in remarks[:most]:
        terminal.print_remarks(console, {sentence: [who]})
    if (more := len(remarks) - most) > 0:
        terminal.print_remarks(console, {}, [f"{digits.counted(more, 'more remark')} in the report"])


def print_line(record: CurveRecord) -> None:
    """A row as soon as it is found: its verdict, then its numbers: 'ok  gel_07: G 6.4 kPa [5.9, 7.0], µ 0.029 Pa s
    [0.026, 0.033], λ 6.1 [5.9, 6.3], R_max 152 µm, RMSE 1.2 %'."""
    from rich.text import Text

    look, factor, unit = digits.LOOKS[record.verdict], *digits.modulus_unit([record.shear_modulus_Pa.median])
    values = (record.shear_modulus_Pa, factor, unit), (record.viscosity, 1.0, "Pa s"), (record.stretch, 1.0, "")
    parts = [
        f"{symbol} {digits.quantity(value, scale, unit=name)}"
        for symbol, (value, scale, name) in zip("Gµλ", values, strict=True)
        if value.median is not None
    ]
    parts.append(f"R_max {digits.micrometres(record.max_radius_m)} µm, RMSE {digits.percent(record.rmse_over_rmax)} %")
    line = f"{record.name}: {', '.join(parts) if record.has_answer else record.message}"
    terminal.console().print(Text(f"{look.words}  ", look.terminal).append(digits.printable(line), "default"))


def print_all(result: Result) -> None:
    """`print_table`, what other models and modes answer, and values of other methods."""
    console = terminal.console()
    print_table(result, console)
    if any(group.published for group in result.groups):
        print_comparison(result)
    for record in result.curves:
        if record.other_models:
            console.print(models_table(record, *result.modulus_unit))


def warnings(records: Iterable[CurveRecord]) -> Iterator[tuple[str, str]]:
    """(name, sentence) of those whose recording or settings are to be checked."""
    return ((record.name, warning.text) for record in records for warning in record.warnings)


def model_rows(record: CurveRecord, factor: float) -> list[list[str]]:
    """The answer, then those of the others by evidence: model, G, µ, λ, RMSE and log evidence above the answer's."""
    log_evidence, rows = record.evidence.log if record.evidence else None, []
    models: list[tuple[CurveRecord | OtherModel, float | None]] = [(record, log_evidence)]
    models += [(model, model.log_evidence) for model in sorted(record.other_models, key=evidence, reverse=True)]
    for model, log in models:
        above = digits.MISSING if log is None or log_evidence is None else f"{log - log_evidence:+.1f}"
        values = (model.shear_modulus_Pa, factor), (model.viscosity, 1.0), (model.stretch, 1.0)
        texts = [digits.quantity(value, scale) for value, scale in values]
        rows.append([model.model, *texts, digits.percent(model.rmse_over_rmax), "0" if model is record else above])
    return rows


def models_table(record: CurveRecord, factor: float, unit: str) -> Table:
    """For the terminal: the answers of all models of a curve."""
    heads = [f"G\n{unit}", "µ\nPa s", "λ", "RMSE\n%", "log\nevidence"]
    table = terminal.table("model", heads, title=f"{record.name}: the answer, then other models and solutions")
    for row in model_rows(record, factor):
        table.add_row(*(cell.replace(" [", "\n[").replace(" (", "\n(") for cell in row))
    return table


def _texts(record: CurveRecord, factor: float, wide: bool) -> list[str]:
    joint = " " if wide else "\n"
    collapses, end = record.window.collapses, record.window.t_star_end
    window = digits.MISSING if collapses is None else str(collapses)
    window += f", t* ≤ {digits.significant(end, 2)}" if wide and end is not None else ""
    return [
        digits.micrometres(record.max_radius_m),
        digits.quantity(record.stretch, joint=joint).split("\n")[0],
        digits.quantity(record.shear_modulus_Pa, factor, joint=joint),
        digits.quantity(record.viscosity, joint=joint),
        digits.percent(record.rmse_over_rmax),
        window,
    ]


def _group_cells(group: GroupRecord, factor: float) -> list[str]:
    counts = [f"{n} other model preferred" for n in [sum(group.preferred.values())] if n]
    counts += TOGETHER if group.preferred_together else []  # in two lines
    counts += [group.basis or f"n = {group.n}", *([f"{group.n_failed} failed"] if group.n_failed else [])]
    means = [group.mean(group.shear_modulus_Pa, factor), group.mean(group.viscosity)]
    return ["", "", *(mean.replace(" (", "\n(") for mean in means), "", "", "\n".join(counts)]


def write_csv(path: str | Path, result: Result) -> None:
    """One line per curve; SI units in the names of the columns; empty where there is no number."""
    write_rows(path, *rows_of(result))


def rows_of(result: Result) -> tuple[list[str], list[dict[str, Any]]]:
    """(names of the columns, a row for each curve)."""
    first, further = ["stretch", "shear_modulus", "viscosity"], result.parameters
    columns = {name: export.column(name, digits.described(name)[1]) for name in (*first, *further)}
    ends = {"median": "", "q05": "_q05", "q95": "_q95", "bound": "_bound"}
    head = ["name", "group", "source", "material", "method", "max_radius_m"]
    head += [columns[name] + end for name in first for end in ends.values()]
    head += ["rmse_over_rmax", "collapses", "t_star_end", "verdict", "message", "bubble"]
    head += [columns[name] + end for name in further for end in ends.values()]
    rows = []
    for record in result.curves:
        values = {column: record.value(name) for name, column in columns.items()}
        numbers = {column + end: getattr(value, part) for column, value in values.items() for part, end in ends.items()}
        words = {"message": record.message, "bubble": record.bubble.name}
        rows.append(vars(record) | words | vars(record.window) | numbers)
    return head, rows


def _print_parameters(console: Console, result: Result) -> None:
    """What was inferred or given besides G, µ and λ, without the camera's."""
    of_laws, excluded = parameters_of(result.curves), (*CAMERA, AT_RATE)
    names = [name for name in result.parameters if name in of_laws or not of_the_law(name)]
    if not (names := [name for name in names if name not in excluded]):
        return
    symbols, factors, units = zip(*map(in_unit, names), strict=True)
    table = terminal.table("curve", [f"{symbol}\n{unit}".strip() for symbol, unit in zip(symbols, units, strict=True)])
    rows = []
    for record in result.curves:
        if any(name in record.other_parameters for name in names):
            values = zip(map(record.value, names), factors, strict=True)
            rows.append((record.name, [digits.quantity(value, factor) for value, factor in values], ""))
    terminal.add_rows(table, rows)
    console.print(table)
    for line in parameter_key(result.parameters):
        console.print(line, style="dim")


def _windowed(records: Sequence[CurveRecord]) -> list[str]:
    """The parameters by window: G and the viscosity, or what a law has instead."""
    of_laws = ([name for name in parameters_of([record]) if name != AT_RATE] for record in records)
    return list(dict.fromkeys(name for law in of_laws for name in [n for n in law if n in KEYS] or law))


def windows(records: Sequence[CurveRecord], unit: Unit) -> tuple[str, list[dict[str, str]]]:
    """'G (kPa), µ (Pa s)', and '6.44, 0.0295' of each record for windows of 1, 2, 3 and all collapses; * where one is
    at a bound. Nothing of a record that no fit answers."""
    texts_of_records = []
    for record in records:
        fitted = record.method in FITS and record.has_answer
        windows = {key: window for key, window in record.windows.items() if fitted and key in _WINDOWS}
        texts = dict.fromkeys(_WINDOWS.values() if windows else (), digits.MISSING)
        for key, window in windows.items():
            values = [(window.best.get(name), in_unit(name, unit)[1]) for name in _windowed([record])]
            numbers = [digits.significant(value * scale) for value, scale in values if value is not None]
            texts[_WINDOWS[key]] = (", ".join(numbers) or digits.MISSING) + ("*" if window.at_bound else "")
        texts_of_records.append(texts)
    names = _windowed([record for record, texts in zip(records, texts_of_records, strict=True) if texts])
    parts = (in_unit(name, unit) for name in names)
    return ", ".join(f"{symbol} ({written})" if written else symbol for symbol, _, written in parts), texts_of_records


def _print_windows(console: Console, result: Result) -> None:
    """G and mu of every curve for windows of 1, 2, 3 and all collapses; of every group mean ± standard deviation over
    the trusted curves that have the window, and how many they are."""
    unit, heads, curves = result.modulus_unit, list(_WINDOWS.values()), result.curves
    values, texts_of_records = windows(curves, unit)
    windowed = zip(curves, texts_of_records, strict=True)
    rows = [(curve.name, list(texts.values()), "") for curve, texts in windowed if texts]
    if not rows:
        return
    for group, shots in result.shots():
        trusted = [shot for shot in shots if shot.trusted and shot.method in FITS]
        means = []
        for key in _WINDOWS:
            having = [curve.windows[key].best for curve in trusted if key in curve.windows]
            spreads = {name: spread_of([best.get(name) for best in having]) for name in _windowed(trusted)}
            texts = [digits.spread(mean, in_unit(name, unit)[1]) for name, mean in spreads.items() if mean.n]
            means.append(f"{', '.join(texts)} (n = {len(having)})" if texts else digits.MISSING)
        rows += [(group.name, means, "bold")] if len(shots) > 1 else []
    title = f"{values} by the window that is fitted; *: a parameter at its bound"
    table = terminal.table("curve", heads, left=heads, title=title)
    terminal.add_rows(table, rows)
    console.print(table)

"""What an answer says besides its values: other windows that were fitted, what was freed, correlations, its draws."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cavirheo.posterior import WindowAnswer
from cavirheo.reporting.record import CurveRecord, Result
from cavirheo.writing import digits
from cavirheo.writing.document import spread_of

if TYPE_CHECKING:
    from rich.table import Table

_FITS = ("least_squares", "laplace")  # methods whose answer is a maximum
_SYMBOLS = {"shear_modulus": "G", "viscosity": "µ", "stretch": "λ", "time_origin": "t_0", "radius_scale": "scale"}
_HEADS = {"1": "1 collapse", "2": "2 collapses", "3": "3 collapses", "all": "whole recording"}


def windows(record: CurveRecord) -> dict[str, WindowAnswer]:
    """The answers of the windows "1", "2", "3", "all" (collapses) that were fitted."""
    return record.windows if record.method in _FITS and record.answered else {}


def window_cells(record: CurveRecord, factor: float) -> list[str]:
    """'6.44, 0.0295' (G, mu) for each of the four windows; an asterisk where a parameter ended at a bound."""
    return [_pair(windows(record).get(key), factor) for key in _HEADS]


def mean_cells(records: list[CurveRecord], factor: float) -> list[str]:
    """Mean ± standard deviation of G and mu over the trusted curves that have the window, and how many they are."""
    cells = []
    for key in _HEADS:
        having = [found[key].best for record in records if record.trusted and key in (found := windows(record))]
        parts = [
            digits.spread(spread_of([best.get(name) for best in having]), scale)
            for name, scale in (("shear_modulus", factor), ("viscosity", 1.0))
        ]
        known = ", ".join(part for part in parts if part != digits.MISSING)
        cells.append(f"{known} (n = {len(having)})" if known else digits.MISSING)
    return cells


def windows_table(result: Result) -> Table | None:
    """For the terminal: G and mu of every curve and group for windows of 1, 2, 3 and all collapses."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    if not any(windows(record) for record in result.curves):
        return None
    factor, unit = result.modulus_unit
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, title_justify="left", title_style="dim")
    table.title = f"G ({unit}), µ (Pa s) by the window that is fitted; *: a parameter at its bound"
    for head in ("curve", *_HEADS.values()):
        table.add_column(head)
    for record in result.curves:
        if windows(record):
            table.add_row(digits.elide(record.name, 24), *window_cells(record, factor))
    table.add_section()
    for group, members in result.members():
        if len(members) > 1:
            cells = mean_cells([result.curves[i] for i in members], factor)
            table.add_row(digits.elide(group.name, 24), *cells, style="bold")
    return table


def facts(record: CurveRecord, factor: float, unit: str) -> dict[str, str]:
    """Plain text for the report of one curve, by heading."""
    if not record.answered:
        return {}
    about = record.diagnostics
    found = {"stretch": about.stretch_source}
    if windows(record):
        cells = zip(_HEADS.values(), window_cells(record, factor), strict=True)
        found["windows"] = f"G ({unit}), µ (Pa s): " + "; ".join(f"{head} {cell}" for head, cell in cells)
    if record.method in _FITS:
        found["freed"] = ", ".join(f"{_SYMBOLS.get(name, name)} = {value:.4g}" for name, value in about.free.items())
        found["correlations"] = ", ".join(
            f"{' and '.join(_SYMBOLS.get(name, name) for name in pair.split(', '))} {value:+.2f}"
            for pair, value in about.correlations.items()
        )
        if about.frames and about.frames_per_independent_residual:
            worth = about.frames / about.frames_per_independent_residual
            found["residuals"] = f"{about.frames} frames, worth {worth:.0f} independent ones"
    if about.effective_sample_size is not None:
        found["posterior"] = f"{about.draws} weighted draws, worth {about.effective_sample_size:.0f} effective draws"
    if about.predictive and about.predictive.get("p_value") is not None:
        found["predictive check"] = (
            f"p = {about.predictive['p_value']:.2g} that the law and noise alone leave such residuals; systematic "
            f"misfit {digits.percent(about.systematic_misfit_over_rmax)} % of R_max"
        )
    return {key: text for key, text in found.items() if text}


def _pair(found: WindowAnswer | None, factor: float) -> str:
    if found is None:
        return digits.MISSING
    values = [(found.best.get("shear_modulus"), factor), (found.best.get("viscosity"), 1.0)]
    text = ", ".join(digits.significant(value * scale) for value, scale in values if value is not None)
    return (text or digits.MISSING) + ("*" if found.at_bound else "")

"""What an answer says besides its values: other windows that were fitted, what was freed, correlations, its draws."""

from __future__ import annotations

from collections.abc import Iterator
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


def window_cells(record: CurveRecord, factor: float) -> list[str]:
    """'6.44, 0.0295' (G, mu) for windows of 1, 2, 3 and all collapses, if a fit answers; * where one is at a bound."""
    found = record.windows if record.method in _FITS and record.answered else {}
    return [_pair(found[key], factor) if key in found else digits.MISSING for key in _HEADS] if found else []


def _pair(window: WindowAnswer, factor: float) -> str:
    values = [(window.best.get("shear_modulus"), factor), (window.best.get("viscosity"), 1.0)]
    text = ", ".join(digits.significant(value * scale) for value, scale in values if value is not None)
    return (text or digits.MISSING) + ("*" if window.at_bound else "")


def _mean_cells(records: list[CurveRecord], factor: float) -> Iterator[str]:
    """Mean ± standard deviation of G and mu over the trusted curves that have the window, and how many they are."""
    for key in _HEADS:
        trusted = [record for record in records if record.trusted and record.method in _FITS]
        having = [record.windows[key].best for record in trusted if key in record.windows]
        G, mu = (spread_of([best.get(name) for best in having]) for name in ("shear_modulus", "viscosity"))
        known = [text for text in (digits.spread(G, factor), digits.spread(mu)) if text != digits.MISSING]
        yield f"{', '.join(known)} (n = {len(having)})" if known else digits.MISSING


def windows_table(result: Result) -> Table | None:
    """For the terminal: G and mu of every curve and group for windows of 1, 2, 3 and all collapses."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    factor, unit = result.modulus_unit
    rows = [(record.name, cells) for record in result.curves if (cells := window_cells(record, factor))]
    if not rows:
        return None
    table = Table("curve", *_HEADS.values(), box=SIMPLE_HEAD, pad_edge=False, show_edge=False, title_justify="left")
    table.title, table.title_style = (
        f"G ({unit}), µ (Pa s) by the window that is fitted; *: a parameter at its bound",
        "dim",
    )
    for name, cells in rows:
        table.add_row(digits.elide(name, 24), *cells)
    table.add_section()
    for group, members in result.members():
        if len(members) > 1:
            means = _mean_cells([result.curves[i] for i in members], factor)
            table.add_row(digits.elide(group.name, 24), *means, style="bold")
    return table


def facts(record: CurveRecord, factor: float, unit: str) -> dict[str, str]:
    """Plain text for the report of one curve, by heading."""
    if not record.answered:
        return {}
    about = record.diagnostics
    found = {"stretch": about.stretch_source}
    if cells := window_cells(record, factor):
        found["windows"] = f"G ({unit}), µ (Pa s): " + "; ".join(
            map(" ".join, zip(_HEADS.values(), cells, strict=True))
        )
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

"""What a least-squares fit says besides its answer: other windows, what was freed, correlations.

All of it stands in the provenance of a row (inference/fit); rows of other methods have none and give nothing here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cavirheo.reporting.record import CurveRecord, Result
from cavirheo.writing import digits
from cavirheo.writing.document import spread_of

if TYPE_CHECKING:
    from rich.table import Table

_SYMBOLS = {"shear_modulus": "G", "viscosity": "µ", "stretch": "λ", "time_origin": "t_0", "radius_scale": "scale"}
_HEADS = {"1": "1 collapse", "2": "2 collapses", "3": "3 collapses", "all": "whole recording"}


def windows(record: CurveRecord) -> dict[str, dict[str, Any]]:
    """The answers of the windows "1", "2", "3", "all" (collapses) that were fitted."""
    found = record.provenance.get("windows") if record.method == "least_squares" and record.answered else None
    return found if isinstance(found, dict) else {}


def window_cells(record: CurveRecord, factor: float) -> list[str]:
    """'6.44, 0.0295' (G, mu) for each of the four windows; an asterisk where a parameter ended at a bound."""
    return [_pair(windows(record).get(key), factor) for key in _HEADS]


def mean_cells(records: list[CurveRecord], factor: float) -> list[str]:
    """Mean ± standard deviation of G and mu over the curves that have the window, and how many they are."""
    cells = []
    for key in _HEADS:
        having = [found[key] for record in records if key in (found := windows(record))]
        parts = [
            digits.spread(spread_of([one.get(name) for one in having]), scale)
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
    about = record.provenance
    found: dict[str, str] = {}
    if windows(record):
        cells = zip(_HEADS.values(), window_cells(record, factor), strict=True)
        found["windows"] = f"G ({unit}), µ (Pa s): " + "; ".join(f"{head} {cell}" for head, cell in cells)
    if record.method == "least_squares" and record.answered:
        freed = about.get("free") or {}
        found["freed"] = ", ".join(f"{_SYMBOLS.get(name, name)} = {value:.4g}" for name, value in freed.items())
        found["correlations"] = ", ".join(
            f"{' and '.join(_SYMBOLS.get(name, name) for name in pair.split(', '))} {value:+.2f}"
            for pair, value in (about.get("correlations") or {}).items()
        )
        tau, frames = about.get("frames_per_independent_residual"), about.get("frames")
        if tau and frames:
            found["residuals"] = f"{frames} frames, worth {frames / tau:.0f} independent ones"
    if (ess := about.get("effective_sample_size")) is not None and record.answered:
        found["posterior"] = f"{about.get('draws')} weighted draws, worth {ess:.0f} effective draws"
    if isinstance(check := about.get("predictive"), dict) and record.answered:
        found["predictive check"] = (
            f"p = {check['p_value']:.2g} that the law and noise alone leave such residuals; systematic misfit "
            f"{digits.percent(about.get('systematic_misfit_over_rmax'))} % of R_max"
        )
    return {key: text for key, text in found.items() if text}


def _pair(found: dict[str, Any] | None, factor: float) -> str:
    if not found:
        return digits.MISSING
    values = [(found.get("shear_modulus"), factor), (found.get("viscosity"), 1.0)]
    text = ", ".join(digits.significant(value * scale) for value, scale in values if value is not None)
    return (text or digits.MISSING) + ("*" if found.get("at_bound") else "")

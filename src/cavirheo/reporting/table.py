"""The tables of shots: `shots_table` has the columns of a terminal, a report and the app, `csv_rows` those of
result.csv; and the table of further parameters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.parameters import CAMERA, VISCOSITY_AT_RATE, column_name, is_law_parameter
from cavirheo.physics.media import WATER
from cavirheo.reporting.answer import (
    CurveRecord,
    display_unit,
    parameters_of,
)
from cavirheo.reporting.record import Result
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Quantity

_ENDS = {"median": "", "q05": "_q05", "q95": "_q95", "bound": "_bound"}  # columns of a quantity in CSV


def summary_cells(curve: RadiusCurve) -> tuple[str, ...]:
    """Cells of a curve: R_max (µm), frame rate (kHz), frames with a radius, recorded time (µs), number of collapses."""
    top, collapses = digits.MISSING, digits.MISSING
    with suppress(InputError):
        top, collapses = digits.micrometres(curve.max_radius), str(len(curve.collapse_times()))
    frames = f"{np.isfinite(curve.radius).sum()} of {len(curve.time)}"
    recorded = f"{1e6 * np.ptp(curve.time):.4g}" if len(curve.time) else digits.MISSING
    return top, digits.number(curve.frame_rate, 1e-3), frames, recorded, collapses


def curve_warnings(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """The warnings on scales and settings, and why a curve has no R_max, each with the names of its curves."""
    from cavirheo.inference.input_warnings import curve_warnings as of_curve  # imports the solver

    warnings = [(curve.name, warning.text) for curve in curves for warning in of_curve(curve, WATER)]
    for curve in curves:
        try:
            _ = curve.max_radius
        except InputError as error:
            warnings.append((curve.name, error.message))
    return terminal.names_by_text(warnings)


def curves_by_note(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """Notes on what was recognised, converted or left out in the files, each once, with the names of its curves."""
    return terminal.names_by_text((curve.name, note) for curve in curves for note in curve.notes)


def curves_by_message(records: Iterable[CurveRecord]) -> dict[str, list[str]]:
    """The messages of all answers, each once, with the names of its curves."""
    return terminal.names_by_text((record.name, message.text) for record in records for message in record.messages)


def shots_table(
    result: Result, shots: Sequence[CurveRecord], names: Sequence[str]
) -> tuple[list[str], list[list[str]]]:
    """(heads, rows) of shots that are called by these names. A bound stands in the place of the interval."""
    factor, unit = result.modulus_unit
    has_rate = any(shot.viscosity.known and not shot.viscosity_Pa_s.known for shot in shots)
    viscosity = f"{digits.symbol_and_unit(VISCOSITY_AT_RATE)[0] if has_rate else 'µ'} Pa s"
    heads = ["shot", "R_max µm", "λ", f"G {unit}", "90 %", viscosity, "90 %", "RMSE %", "verdict"]
    rows = []
    for name, shot in zip(names, shots, strict=True):
        stretch = " ".join(digits.value_parts(shot.stretch)).strip()
        if shot.stretch.median is not None:
            stretch = digits.number(shot.stretch.median)
        values = *digits.value_parts(shot.shear_modulus_Pa, factor), *digits.value_parts(shot.viscosity)
        rmse, verdict = digits.number(shot.rmse_over_rmax, 100.0), digits.VERDICT_WORDS[shot.verdict]
        rows.append([name, digits.micrometres(shot.max_radius_m), stretch, *values, rmse, verdict])
    return heads, rows


def parameters_table(rows: Sequence[CurveRecord], result: Result) -> tuple[list[str], list[list[str]]]:
    """(heads, rows) of the parameters that were inferred or given, without G, µ, λ and those of the camera."""
    of_laws = parameters_of(rows)
    names = [name for name in result.parameters if name in of_laws or not is_law_parameter(name)]
    units = {name: display_unit(name) for name in names if name not in (*CAMERA, VISCOSITY_AT_RATE)}
    heads = ["shot", *(f"{symbol}\n{unit}".strip() for symbol, _, unit in units.values())]
    short = digits.distinct_names([row.name for row in rows])
    cells = [
        [shot, *(_in_a_cell(row.value(name), factor) for name, (_, factor, _) in units.items())]
        for shot, row in zip(short, rows, strict=True)
        if any(name in row.other_parameters for name in units)
    ]
    return heads, cells


def _in_a_cell(value: Quantity, factor: float) -> str:
    """'0.069 (0.056 to 0.080)', 'below 0.015'."""
    middle, interval = digits.value_parts(value, factor)
    return f"{middle} ({interval})" if middle and interval else middle or interval


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

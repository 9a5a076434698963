"""Tables of shots (`shots_table` for people, `csv_rows` for programs), and remarks with the names of their curves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.parameters import BUBBLE, VISCOSITY_AT_RATE, column_name, is_law_parameter
from cavirheo.physics.media import WATER
from cavirheo.reporting.record import MAIN_FIELDS, CurveRecord, ParameterValues, Result
from cavirheo.writing import digits, terminal

_ENDS = {"median": "", "q05": "_q05", "q95": "_q95", "bound": "_bound"}  # columns of a quantity in CSV


def shots_table(
    result: Result, shots: Sequence[CurveRecord], names: Sequence[str]
) -> tuple[list[str], list[list[str]]]:
    """(heads, rows) of shots that are called by these names. A bound stands in the place of the interval."""
    G = result.shown("shear_modulus")
    has_rate = any(shot.viscosity.known and not shot.viscosity_Pa_s.known for shot in shots)
    mu = result.shown(VISCOSITY_AT_RATE if has_rate else "viscosity")
    heads = ["shot", "R_max µm", "λ"]
    for shown in (G, mu):
        heads += [f"{shown.symbol} {shown.unit}", digits.SURE]
    heads += ["RMSE %", "verdict"]
    rows = []
    for name, shot in zip(names, shots, strict=True):
        stretch, bound = digits.value_parts(shot.stretch)
        if shot.stretch.median is not None:
            stretch, bound = digits.number(shot.stretch.median), ""
        size, rmse = digits.micrometres(shot.max_radius_m), digits.number(shot.rmse_over_rmax, 100.0)
        values = *G.parts(shot.shear_modulus_Pa), *mu.parts(shot.viscosity)
        rows.append([name, size, stretch or bound, *values, rmse, shot.verdict_in_words])
    return heads, rows


def meaning_of(name: str) -> str:
    """Unit and meaning of a parameter of the bubble, 'no unit; confinement damping: ...'; "" for any other one."""
    return f"{digits.shown(name).si or 'no unit'}; {BUBBLE[name]}" if name in BUBBLE else ""


def parameters_of(records: Sequence[ParameterValues]) -> list[str]:
    """Law parameters that are known in these records, G and µ first; a reference viscosity only with a yield stress."""
    names = dict.fromkeys([*MAIN_FIELDS, *(name for record in records for name in record.other_parameters)])
    inferred = [name for name in names if any(record.value(name).known for record in records)]
    excluded = () if "yield_stress" in inferred else ("reference_viscosity",)
    return [name for name in inferred if is_law_parameter(name) and name not in excluded]


def csv_rows(result: Result) -> tuple[list[str], list[dict[str, Any]]]:
    """(column names of result.csv, which contain the SI units; a row for each curve, None for a missing number). A
    bound has no median, so that a mean of medians is one of values."""
    first = ["stretch", "shear_modulus", "viscosity"]
    further = list(dict.fromkeys(name for curve in result.curves for name in curve.other_parameters))
    columns = {name: column_name(name, digits.shown(name).si) for name in (*first, *further)}
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
    from cavirheo.inference import input_warnings  # imports the solver

    warnings = []
    for curve in curves:
        warnings += [(curve.name, warning.text) for warning in input_warnings.curve_warnings(curve, WATER)]
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

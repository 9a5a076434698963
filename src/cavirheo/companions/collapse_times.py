"""Tables of collapse times, or curves -> G and mu of each material (inference/collapse_time).

Inputs: docs/how-to/collapse-time.md. shots.csv has a line per shot. Every number in collapse-time.json
(`CollapseTimes`) is SI and finite, or null if it was not found; `message` then gives the reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError, printable
from cavirheo.inference.collapse_time import CollapseEstimate, Shots, estimate, shot, unusable
from cavirheo.inference.input_warnings import curve_warnings
from cavirheo.io.files import guarded
from cavirheo.io.matlab import opened
from cavirheo.io.named_arrays import Numbers
from cavirheo.io.shots import Chosen, read_shots, selected
from cavirheo.io.tables import Term, Vocabulary, read_columns
from cavirheo.physics.media import CONSTANTS, Medium
from cavirheo.units import LENGTH_UNITS, TIME_UNITS
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Finite, Record, write_rows

VARIABLE = "pIMR_array"
VOCABULARY = Vocabulary(
    {
        "R_max": Term("rmax maxradius maximumradius largestradius", LENGTH_UNITS),
        "lambda": Term("stretch lambda λ lmax lambdamax λmax rmaxr0 rmaxreq"),
        "t_1": Term("t1 collapsetime tcollapse firstcollapse", TIME_UNITS),
        "name": Term("shot curve name"),
    },
    "expected a header such as rmax_um,stretch,t1_us",
    ("R_max", "t_1"),
    dict.fromkeys(("no_unit", "unit"), "collapse_time.unit")
    | {"twice": "collapse_time.twice", "rows": "collapse_time.no_rows"},
)
# codes of errors in a table of collapse times; after any other error the file may hold curves
_TABLE_ERRORS = ("limits.", "tabular.width", "tabular.units", "collapse_time.")


class CollapseShot(Record):
    """One shot.

    Attributes:
        name: name of the shot.
        max_radius_m: R_max, m.
        stretch: lambda = R_max/R_0.
        stretch_from: origin of lambda: "table", "given", "late plateau" or "stated in the file".
        collapse_time_s: t_1, time from R_max to the first minimum of the radius, s.
        measured: measured t_1 over the Rayleigh collapse time t_RC; null without an estimate.
        model: t_1/t_RC of the model; null without an estimate.
        message: reason why the shot cannot be used; empty if it can.
    """

    name: str
    max_radius_m: Finite = None
    stretch: Finite = None
    stretch_from: str = ""
    collapse_time_s: Finite = None
    measured: Finite = None
    model: Finite = None
    message: str = ""


class CollapseGroup(Record):
    """The shots of one material, and the estimate from their collapse times.

    Attributes:
        name: name of the table, or of the file or folder of curves.
        source: path of this file or folder.
        source_sha256: SHA-256 of the file; empty for a folder.
        n: number of shots.
        unusable: number of shots that could not be used; their `message` says why.
        notes: remarks on the group as a whole.
        warnings: input warnings on the recordings and their settings.
        estimate: estimate of G and mu; null without a usable shot.
        model: model of the collapse times: "analytic" or "exact" (simulated).
        shots: R_max, lambda, t_1 and t_1/t_RC of each shot.
    """

    name: str
    source: str
    source_sha256: str
    n: int = 0
    unusable: int = 0
    notes: list[str] = []
    warnings: list[str] = []
    estimate: CollapseEstimate | None = None
    model: Literal["analytic", "exact"] = "analytic"
    shots: list[CollapseShot]

    def model_post_init(self, _: Any) -> None:
        self.n, self.unusable = len(self.shots), len(self.shots) - len(self.usable)

    @property
    def usable(self) -> list[CollapseShot]:
        return [shot for shot in self.shots if not shot.message]

    @property
    def incomplete(self) -> bool:
        """Whether a shot was left out, its input has a warning, or there is no answer."""
        return bool(self.unusable or self.warnings) or self.estimate is None or not self.estimate.complete

    def answer(self, material: str, medium: Medium, *, exact: bool = False, **given: Any) -> None:
        """Estimate G and mu from the usable shots, if any; given: one of them, as in `estimate`. If a simulation fails,
        the analytic answer stays, with a note."""
        if not self.usable:
            return
        values = [(shot.max_radius_m, shot.stretch, shot.collapse_time_s) for shot in self.usable]
        radius, stretch, time = np.array(values, dtype=float).T
        measured = Shots(radius, stretch, time, [shot.name for shot in self.usable])
        self.estimate = estimate(measured, material, medium=medium, **given)
        if exact:
            try:
                self.estimate = estimate(measured, material, medium=medium, exact=True, **given)
                self.model = "exact"
            except SolverError as error:
                self.notes.append(f"no exact answer: {error}")
        ratios = measured.ratio(medium).tolist()
        for record, ratio, model in zip(self.usable, ratios, self.estimate.model, strict=True):
            record.measured = ratio
            record.model = model


class CollapseTimes(Document):
    """G and mu of each material from collapse times.

    Attributes:
        material: name of the law: "nhkv", "nh" (mu = 0) or "newtonian" (G = 0).
        medium: constants of the medium, SI.
        groups: the groups: one for each table, and for each file or folder of curves.
    """

    kind: Literal["collapse-time"] = "collapse-time"
    material: str
    medium: dict[str, Any]
    groups: list[CollapseGroup]


def read_groups(
    files: Sequence[str | Path], medium: Medium, stretch: float | None = None, group: str = "auto", shots: Chosen = None
) -> tuple[list[CollapseGroup], list[str], list[str]]:
    """(the groups of all files, the reason for each file that could not be read, remarks on repeated curves and hints).

    stretch: lambda of curves, and of tables without a column for it. group, shots: as in `read_shots`.
    """
    groups, problems, curves = list[CollapseGroup](), list[str](), list[Path]()
    for path in map(Path, files):
        try:
            table = read_table(path, stretch, shots)
        except InputError as error:
            problems.append(str(error))
            continue
        if table is None:
            curves.append(path)
        else:
            groups.append(table)
    constants: Any = {"density": medium.density, "pressure": medium.pressure}
    read, unread, repeated, hints = read_shots(curves, group=group, shots=shots, **constants)
    members: dict[tuple[str, str], list[RadiusCurve]] = {}
    for curve in read:
        members.setdefault((curve.group, curve.group_source), []).append(curve)
    for (name, source), group_curves in members.items():
        digest = group_curves[0].source_sha256 or "" if source == group_curves[0].source else ""
        warnings = [f"{each.name}: {warning.text}" for each in group_curves for warning in curve_warnings(each, medium)]
        for curve in group_curves:
            other = {key: value for key, value in curve.medium.items() if getattr(medium, key) != value}
            words = [f"{key.replace('_', ' ')} {value:.6g} {CONSTANTS[key].unit}" for key, value in other.items()]
            hints += [f"{curve.name}: the file states {', '.join(words)}, which is not used: give it"] if words else []
        head: Any = {"source": source, "source_sha256": digest, "warnings": warnings}
        groups.append(CollapseGroup(name=name, shots=[_curve_shot(curve, stretch) for curve in group_curves], **head))
    return groups, problems + unread, repeated + hints


def _curve_shot(curve: RadiusCurve, stretch: float | None) -> CollapseShot:
    try:
        read, origin = shot(curve, stretch)
    except InputError as error:
        return CollapseShot(name=curve.name, message=error.message)
    return _shot(curve.name, origin, "", read.max_radius[0], read.stretch[0], read.time[0])


def _shot(name: str, origin: str, message: str, R: float, stretch: float, t: float) -> CollapseShot:
    """A shot from R_max, lambda and t_1 in SI. origin: where lambda comes from. message: why it cannot be used."""
    values = {"max_radius_m": R, "stretch": stretch, "collapse_time_s": t}
    return CollapseShot(name=name, stretch_from=origin, message=message, **values)


def read_table(path: Path, stretch: float | None = None, chosen: Chosen = None) -> CollapseGroup | None:
    """Read the table of collapse times in a file; None if the file holds none and may hold curves.

    Raises InputError: the table lacks a unit or lambda, a cell is not a number, or the file cannot be read.
    """
    with guarded(path) as source:
        with opened(source) as arrays:
            leaf = arrays.get(VARIABLE)
            array: Any = leaf.read() if isinstance(leaf, Numbers) else None
        if leaf is not None:
            shape = np.shape(array)
            if len(shape) != 2 or 3 not in shape or 0 in shape:
                expected = f"{VARIABLE} must be an array (n, 3) of numbers: R_max in m, lambda, t_1 in s"
                got = f"the shape {shape}" if shape else "a cell array"
                raise InputError(f"{expected}; got {got}", "collapse_time.variable")
            radius, stretches, time = array.T if shape[1] == 3 else array
            name, notes = None, [f"variable {VARIABLE}: R_max in m, lambda, t_1 in s"]
        else:
            try:
                (table,) = read_columns(source, VOCABULARY)
            except InputError as error:
                if error.code.startswith(_TABLE_ERRORS):
                    raise
                return None  # the reader of curves knows more kinds of files and reports errors
            radius, stretches, time = (column and column.si for column in map(table.find, ("R_max", "lambda", "t_1")))
            name, notes = table.find("name"), table.notes
        origin = "table" if stretches is not None else "given"
        if stretches is None and stretch is None:
            missing = f"no column for lambda = R_max/R_0; {VOCABULARY.expected}, or give --stretch"
            raise InputError(missing, "collapse_time.no_stretch")
        if stretches is None:
            stretches = np.full(len(time), stretch)
        elif stretch is not None:
            notes = [*notes, "lambda of the table used, not the one given"]
        rows = np.column_stack([radius, stretches, time]).tolist()
        names = name.text if name else map(str, range(1, len(rows) + 1))
        shots = [_shot(text, origin, unusable(*row), *row) for text, row in zip(names, rows, strict=True)]
        head: Any = {"source": printable(str(path)), "source_sha256": source.sha256, "notes": notes}
        return CollapseGroup(name=printable(path.stem), shots=selected(shots, chosen), **head)


def write_csv(path: Path, document: CollapseTimes) -> None:
    """Write one line per shot of every group."""
    rows = ({"group": group.name, **shot.model_dump()} for group in document.groups for shot in group.shots)
    write_rows(path, ["group", *CollapseShot.model_fields], rows)


def print_table(document: CollapseTimes) -> None:
    """Print a row per group, then remarks on the groups."""
    console = terminal.console()
    estimates = [group.estimate for group in document.groups if group.estimate]
    factor, unit = digits.modulus_unit(found.shear_modulus_Pa.largest for found in estimates)
    heads = ["material", "n", "model", f"G (90 %)\n{unit}", "µ (90 %)\nPa s", "scatter\n% of t₁"]
    rows = []
    for who, group in zip(digits.distinct_names([each.name for each in document.groups]), document.groups, strict=True):
        n = f"{group.n - group.unusable}/{group.n}" if group.unusable else f"{group.n}"
        value = group.estimate or CollapseEstimate()
        G = digits.quantity(value.shear_modulus_Pa, factor, joint="\n")
        mu = digits.quantity(value.viscosity_Pa_s, joint="\n")
        rows.append([who, n, group.model, G, mu, digits.percent(value.scatter)])
    terminal.print_table(console, heads, rows, left=("model",))
    remarks = terminal.names_by_text(remark for group in document.groups for remark in _remarks(group, factor, unit))
    terminal.print_remarks(console, remarks, most=5)
    changes = [abs(change) for found in estimates if (change := found.modulus_per_percent_Pa)]
    if moves := digits.ends(changes, factor, 2):
        common = f"t₁ of all shots 1 % longer (R_max, frame rate, density) lowers G by {moves} {unit}"
        console.print(f"intervals: from the scatter of the shots alone; {common}", style="dim")
    terminal.print_remarks(console, {}, document.notes)


def _remarks(group: CollapseGroup, factor: float, unit: str) -> Iterator[tuple[str, str]]:
    """(name of a group or shot, remark on it)."""
    if value := group.estimate:
        yield group.name, value.message
        if value.downweighted:
            yield group.name, f"weighted down: {', '.join(value.downweighted)}"
        if value.pairs:
            pairs = "; ".join(f"{G * factor:.3g}, {mu:.2g}" for G, mu in value.pairs)
            yield group.name, f"equally good pairs (G {unit}, µ Pa s): {pairs}"
    for record in group.shots:
        if record.message:
            who = record.name if record.name.startswith(group.name) else f"{group.name} {record.name}"
            yield who, f"left out: {record.message}"
    for note in (*group.warnings, *group.notes):
        yield group.name, note
    if origins := sorted({record.stretch_from for record in group.shots} - {"", "table"}):
        yield group.name, f"lambda: {', '.join(origins)}"

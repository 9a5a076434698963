"""Tables of collapse times -> G and mu of each material (inference/collapse_time).

Inputs: docs/how-to/collapse-time.md. shots.csv has a line per shot. Every number in collapse-time.json
(`CollapseTimes`) is SI and finite, or null if it was not found; `message` then gives the reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cavirheo.errors import InputError, SolverError, listed, printable
from cavirheo.inference.collapse_time import CollapseEstimate, estimate, unusable
from cavirheo.io.files import guarded
from cavirheo.io.shots import Chosen, selected
from cavirheo.io.tables import Term, Vocabulary, read_columns
from cavirheo.parameters import LENGTH_UNITS, TIME_UNITS
from cavirheo.physics.collapse import rayleigh_time
from cavirheo.physics.media import Medium
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Finite, Record, write_rows

VOCABULARY = Vocabulary(
    {
        "R_max": Term("rmax maxradius maximumradius largestradius", LENGTH_UNITS),
        "lambda": Term("stretch lambda λ lmax lambdamax λmax rmaxr0 rmaxreq"),
        "t_1": Term("t1 collapsetime tcollapse firstcollapse", TIME_UNITS),
        "name": Term("shot curve name"),
    },
    "expected a header such as rmax_um,stretch,t1_us (curves R(t) are for `infer`)",
    ("R_max", "t_1"),
    dict.fromkeys(("no_unit", "unit"), "collapse_time.unit")
    | {"twice": "collapse_time.twice", "rows": "collapse_time.no_rows"},
)


class CollapseShot(Record):
    """One shot."""

    name: str
    """Name of the shot."""
    max_radius_m: Finite = None
    """R_max, m."""
    stretch: Finite = None
    """R_max/R_0."""
    collapse_time_s: Finite = None
    """t_1, time from R_max to the first minimum of the radius, s."""
    measured: Finite = None
    """Measured t_1 over the Rayleigh collapse time t_RC; null without an estimate."""
    model: Finite = None
    """t_1/t_RC of the model; null without an estimate."""
    message: str = ""
    """Reason why the shot cannot be used; empty if it can."""


class CollapseGroup(Record):
    """The shots of one material, and the estimate from their collapse times."""

    name: str
    """Name of the table."""
    source: str
    """Path of its file."""
    source_sha256: str
    """SHA-256 of the file."""
    notes: list[str] = []
    """Remarks on the group as a whole."""
    estimate: CollapseEstimate | None = None
    """Estimate of G and mu; null without a usable shot."""
    model: Literal["analytic", "exact"] = "analytic"
    """Model of the collapse times: "analytic" or "exact" (simulated)."""
    shots: list[CollapseShot]
    """R_max, lambda, t_1 and t_1/t_RC of each shot."""

    @property
    def usable(self) -> list[CollapseShot]:
        return [shot for shot in self.shots if not shot.message]

    @property
    def incomplete(self) -> bool:
        """Whether a shot was left out, or there is no answer."""
        return len(self.usable) < len(self.shots) or self.estimate is None or not self.estimate.complete

    def answer(self, material: str, medium: Medium, *, exact: bool = False, **given: Any) -> None:
        """Estimate G and mu from the usable shots, if any; given: one of them, as in `estimate`. If a simulation fails,
        the analytic answer stays, with a note."""
        if not self.usable:
            return
        values = [(shot.max_radius_m, shot.stretch, shot.collapse_time_s) for shot in self.usable]
        radius, stretch, time = np.array(values, dtype=float).T
        how: Any = {"material": material, "medium": medium, **given}
        self.estimate = estimate(radius, stretch, time, **how)
        if exact:
            try:
                self.estimate = estimate(radius, stretch, time, exact=True, **how)
                self.model = "exact"
            except SolverError as error:
                self.notes.append(f"no exact answer: {error}")
        ratios = (time / rayleigh_time(radius, medium)).tolist()
        for record, ratio, model in zip(self.usable, ratios, self.estimate.model, strict=True):
            record.measured = ratio
            record.model = model


class CollapseTimes(Document):
    """G and mu of each material from collapse times."""

    kind: Literal["collapse-time"] = "collapse-time"
    material: str
    """Name of the law: "nhkv", "nh" (mu = 0) or "newtonian" (G = 0)."""
    medium: dict[str, Any]
    """Constants of the medium, SI."""
    groups: list[CollapseGroup]
    """A group for each table."""


def read_table(path: str | Path, stretch: float | None = None, chosen: Chosen = None) -> CollapseGroup:
    """Read the table of collapse times in a file. stretch: lambda, if it has no column for it. chosen: numbers of its
    shots, as of `read_shots`.

    Raises InputError: the file cannot be read or holds no table, the table lacks a unit or lambda, or a cell is not a
    number.
    """
    path = Path(path)
    with guarded(path) as source:
        (table,) = read_columns(source, VOCABULARY)
        radius, time = table.column("R_max").si, table.column("t_1").si
        given, names, notes = table.find("lambda"), table.find("name"), table.notes
        if given is None and stretch is None:
            missing = f"no column for lambda = R_max/R_0; {VOCABULARY.expected}, or give --stretch"
            raise InputError(missing, "collapse_time.no_stretch")
        if given and stretch is not None:
            notes = [*notes, f"lambda of the table is used, not --stretch {stretch:g}"]
        stretches = given.si if given else np.full(len(time), stretch)
        rows = np.column_stack([radius, stretches, time]).tolist()
        texts = names.text if names else map(str, range(1, len(rows) + 1))
        shots = [
            CollapseShot(name=text, max_radius_m=R, stretch=ratio, collapse_time_s=t, message=unusable(R, ratio, t))
            for text, (R, ratio, t) in zip(texts, rows, strict=True)
        ]
        head: Any = {"source": printable(str(path)), "source_sha256": source.sha256, "notes": notes}
        group = CollapseGroup(name=printable(path.stem), shots=selected(shots, chosen), **head)
        seen, again = set[tuple[float | None, ...]](), list[str]()
        for one in group.usable:
            numbers = one.max_radius_m, one.stretch, one.collapse_time_s
            if numbers in seen:
                again.append(one.name)
            seen.add(numbers)
        if again:
            said = f"with the numbers of an earlier shot: {listed(again)}"
            group.notes.append(f"{said}; copies narrow the interval, leave them out with --shots")
        return group


def write_csv(path: Path, document: CollapseTimes) -> None:
    """Write one line per shot of every group."""
    rows = ({"group": group.name, **shot.model_dump()} for group in document.groups for shot in group.shots)
    write_rows(path, ["group", *CollapseShot.model_fields], rows)


def print_table(document: CollapseTimes) -> None:
    """Print a row per group, then remarks on the groups."""
    estimates = [group.estimate for group in document.groups if group.estimate]
    _, factor, unit, _ = digits.shown("shear_modulus", *(found.shear_modulus_Pa.largest for found in estimates))
    heads = ["material", "n", "model", f"G (90 %)\n{unit}", "µ (90 %)\nPa s", "scatter\n% of t₁"]
    rows = []
    for who, group in zip(digits.distinct_names([each.name for each in document.groups]), document.groups, strict=True):
        used, total = len(group.usable), len(group.shots)
        n = str(total) if used == total else f"{used}/{total}"
        value = group.estimate or CollapseEstimate()
        G = digits.quantity(value.shear_modulus_Pa, factor, joint="\n")
        mu = digits.quantity(value.viscosity_Pa_s, joint="\n")
        rows.append([who, n, group.model, G, mu, digits.percent(value.scatter)])
    terminal.print_table(heads, rows, left=("model",))
    remarks = terminal.names_by_text(remark for group in document.groups for remark in _remarks(group))
    terminal.print_remarks(remarks, most=5)
    changes = [abs(change) for found in estimates if (change := found.modulus_per_percent_Pa)]
    if moves := digits.ends(changes, factor, 2):
        common = f"t₁ of all shots 1 % longer (R_max, frame rate, density) lowers G by {moves} {unit}"
        terminal.print_text(f"intervals: from the scatter of the shots alone; {common}", style="dim")
    terminal.print_remarks({}, document.notes)


def _remarks(group: CollapseGroup) -> Iterator[tuple[str, str]]:
    """(name of a group or shot, remark on it)."""
    if value := group.estimate:
        yield group.name, value.message
    for record in group.shots:
        if record.message:
            yield f"{group.name} {record.name}", f"left out: {record.message}"
    for note in group.notes:
        yield group.name, note

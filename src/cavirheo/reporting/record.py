"""result.json: the answers as a document for other programs (schema 1), made and read.

Every number is SI and finite, or null: q05 and q95 are null for a method without an interval; all values of the answer
are null for a curve without one, and `messages` say why. A bound has no median. The answer of a group is that of the
population of its shots.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import model_validator

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, expect
from cavirheo.parameters import VISCOSITY_AT_RATE
from cavirheo.posterior import Posterior
from cavirheo.reporting.answer import CurveRecord, curve_record
from cavirheo.reporting.group import GroupRecord, Published, group_record
from cavirheo.reporting.laws import LawsOfGroup
from cavirheo.reporting.material import (
    MaterialRatio,
    cached_material_of,
    differences,
    material_of,
)
from cavirheo.writing import digits, document
from cavirheo.writing.document import Document
from cavirheo.writing.export import dataframe

if TYPE_CHECKING:
    from cavirheo.inference.population import CommonErrors, Population

Pairs = Sequence[tuple[RadiusCurve, Posterior]]


MAX_CACHED_CURVES = 500  # most curves of a run whose materials are kept in memory


class Result(Document):
    """The answers of a run.

    Attributes:
        curves: the answer for each curve.
        groups: the shots of each file or folder, with the answer for their material. A group of published values
            without recordings has no shots.
        differences: ratios of each parameter of each two of the first 6 groups that have a material, where both have
            the same model and determine it; left out where there is none.
    """

    kind: Literal["result"] = "result"
    curves: list[CurveRecord]
    groups: list[GroupRecord]
    differences: list[MaterialRatio] = []
    _omitted_if_empty = ("differences",)

    @model_validator(mode="after")
    def _each_curve_in_a_group(self) -> Result:
        if sum(group.n + group.n_failed > 0 for group in self.groups) != len(_members(self.curves)):
            raise ValueError("its groups are not those of its curves")
        return self

    @property
    def modulus_unit(self) -> tuple[float, str]:
        """(factor from Pa, name) of the unit of G in all tables and pictures of this document."""
        return digits.modulus_unit(curve.shear_modulus_Pa.largest for curve in self.curves)

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that were inferred, or given for the bubble, without G, mu and the stretch."""
        return list(dict.fromkeys(name for curve in self.curves for name in curve.other_parameters))

    @property
    def model_key(self) -> list[str]:
        """Lines below a table on the models of the answers, and on a viscosity at a shear rate."""
        models = dict.fromkeys((curve.material, curve.bubble.sentence) for curve in self.curves if curve.has_answer)
        lines = list(dict.fromkeys(sentence for _, sentence in models))
        if len(models) == 1:
            titles = {name: f" ({title})" for name, title in digits.MATERIAL_TITLES.items()}
            lines = [f"model: {material}{titles.get(material, '')}. {sentence}" for material, sentence in models]
        if VISCOSITY_AT_RATE in self.parameters:
            lines.append("µ of a law that thins or yields: at a shear rate of 1e5 1/s")
        return lines

    def to_dataframe(self) -> Any:
        """The rows of result.csv as a pandas.DataFrame, a row for each curve. Raises InputError without pandas."""
        from cavirheo.reporting.table import csv_rows

        head, rows = csv_rows(self)
        columns = {name: [np.nan if row.get(name) is None else row[name] for row in rows] for name in head}
        return dataframe(columns, {"command": self.command})

    def indices_by_group(self) -> list[tuple[GroupRecord, list[int]]]:
        """Each group with the indices of its curves."""
        members = iter(_members(self.curves).values())
        return [(group, next(members) if group.n + group.n_failed else []) for group in self.groups]

    def rows_by_group(self) -> list[tuple[GroupRecord, list[CurveRecord]]]:
        """Each group with its rows."""
        return [(group, [self.curves[i] for i in indices]) for group, indices in self.indices_by_group()]

    def add_laws(self, laws: Mapping[int, LawsOfGroup]) -> None:
        """Add the laws that were compared to the groups whose first curve has this index."""
        for group, indices in self.indices_by_group():
            group.laws = laws.get(indices[0]) if indices else None

    def add_published(self, published: Mapping[str, Published]) -> None:
        """Add published values to the groups with these names. Any other name becomes a group without shots, in the
        order of the names."""
        for k, name in enumerate(published):
            if name not in [group.name for group in self.groups]:
                self.groups.insert(k, group_record(name, []))
        for group in self.groups:
            group.published |= {method: dict(values) for method, values in published.get(group.name, {}).items()}


def result(
    pairs: Pairs,
    command: str,
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
    errors: CommonErrors | None = None,
) -> Result:
    """The document of all curves, in the given order, and of their groups.

    Args:
        pairs: (curve, answer), in the order of the rows.
        command: the command that was run, as text.
        date: date of the run; default: the present time.
        notes: notes on the run as a whole (files that could not be read, ...).
        errors: relative standard deviations of the errors that all shots of a group share; default: those of
            `population`.
    """
    rows = [curve_record(curve, answer) for curve, answer in pairs]
    title = _column_title(rows)
    material = cached_material_of if len(rows) <= MAX_CACHED_CURVES else material_of
    materials: list[Population | None] = []
    for indices in _members(rows).values():
        answers = tuple(pairs[i][1] for i in indices)
        names = tuple(rows[i].name for i in indices)
        along = tuple(rows[i].column.get(title, np.nan) for i in indices) if title else None
        materials.append(material(answers, names, along, errors))
    date = date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    return result_of(rows, command, materials, date=date, notes=notes)


def result_of(
    rows: Sequence[CurveRecord],
    command: str,
    materials: Sequence[Population | None] = (),
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
) -> Result:
    """The result of these records of curves, and of their groups. materials: those of the groups; default: none."""
    members, names, title = _members(rows), group_names(rows), _column_title(rows)
    materials = materials or [None] * len(members)
    groups = [
        group_record(name, [rows[i] for i in indices], material, title)
        for name, indices, material in zip(names, members.values(), materials, strict=True)
    ]
    differing = differences(dict(zip(names, materials, strict=True)))
    return Result(
        command=command, date=date, notes=list(notes), curves=list(rows), groups=groups, differences=differing
    )


def table(answers: Sequence[Posterior]) -> Any:
    """The answers as a pandas.DataFrame: a row for each, with the columns of result.csv in SI ("name", "max_radius_m",
    "shear_modulus_Pa", "shear_modulus_Pa_q05", ..., "verdict", "message").

    A failed answer has NaN. So has the median of a bound: its limit is in the column _q95 if the value is below it, in
    _q05 if above, and _bound says which.

    Args:
        answers: as `infer_many` or `fit_many` give them.

    Raises:
        InputError: no answers, an answer without its curve, or pandas is missing.
    """
    rows = []
    for answer in answers:
        expect(answer, Posterior, "a list of answers of infer_many or fit_many")
        if answer.curve is None:
            message = "an answer has no curve to name its row: set one, dataclasses.replace(answer, curve=curve)"
            raise InputError(message, "posterior.no_curve")
        rows.append(curve_record(answer.curve, answer))
    return result_of(rows, "cavirheo.table").to_dataframe()


def group_names(curves: Iterable[CurveRecord | RadiusCurve]) -> list[str]:
    """Names of the groups of curves, in order; groups with the same name have the path that was read instead."""
    members = list(_members(curves))
    stems = [group for group, _ in members]
    return [group if stems.count(group) == 1 or not source else source for group, source in members]


def _column_title(rows: Iterable[CurveRecord]) -> str:
    """The title of the column that the user declared; "" if there is none."""
    return next((title for row in rows for title in row.column), "")


def read_json(path: str | Path) -> Result:
    """Read a result.json. Raises InputError: there is no such file, or it is not a result of cavirheo."""
    return document.read_json(path, Result)


def _members(curves: Iterable[CurveRecord | RadiusCurve]) -> dict[tuple[str, str], list[int]]:
    """Indices of the curves of each group; two files of one name in different folders are two groups."""
    members: dict[tuple[str, str], list[int]] = {}
    for index, curve in enumerate(curves):
        members.setdefault((curve.group, curve.group_source), []).append(index)
    return members

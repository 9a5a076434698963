"""result.json: the answers as a document that other programs read (schema 1), and back.

Every number is SI and finite, or null: a method without an interval has null q05 and q95, a curve without an answer
has null everywhere and says why in `messages`. Means of a group are over its trusted curves, those with verdict ok.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import model_validator

from cavirheo.curve import RadiusCurve
from cavirheo.parallel import processes
from cavirheo.parameters import AT_RATE
from cavirheo.posterior import Posterior
from cavirheo.reporting.answer import CurveRecord, curve_record
from cavirheo.reporting.group import REFERENCES, GroupRecord, Published, group_of
from cavirheo.reporting.material import GroupDifference, differences, kept_material_of, material_of, population_record
from cavirheo.writing import digits, document
from cavirheo.writing.document import Document
from cavirheo.writing.export import dataframe

if TYPE_CHECKING:
    from cavirheo.inference.population import Population

Pairs = Sequence[tuple[RadiusCurve, Posterior]]


class Answered(Pairs):
    """Curves with their answers. These may be read from a file each time that they are asked for, so that thousands of
    them need not be held: no more are in use at once than a group has."""

    def __init__(self, curves: Sequence[RadiusCurve], answers: Sequence[Posterior]) -> None:
        self.curves: Sequence[RadiusCurve] = curves
        self.answers: Sequence[Posterior] = answers

    @classmethod
    def of(cls, pairs: Pairs) -> Answered:
        """These, as they are."""
        if isinstance(pairs, Answered):
            return pairs
        return cls([curve for curve, _ in pairs], [answer for _, answer in pairs])

    def __len__(self) -> int:
        return len(self.curves)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(len(self))[index]]
        return self.curves[index], self.answers[index]


KEPT = 500  # curves of a run whose materials are kept


class Result(Document):
    """The answers of a run.

    Attributes:
        curves: a row for each curve.
        groups: the shots of each file or folder, with their means and their material; those of published values that
            have no recording have no shot.
        differences: of the materials of each two groups, where there are several; left out where there is none.
    """

    kind: Literal["result"] = "result"
    curves: list[CurveRecord]
    groups: list[GroupRecord]
    differences: list[GroupDifference] = []
    _if_any = ("differences",)

    @model_validator(mode="after")
    def _each_curve_in_a_group(self) -> Result:
        if sum(group.n + group.n_failed > 0 for group in self.groups) != len(_members(self.curves)):
            raise ValueError("its groups are not those of its curves")
        return self

    @property
    def modulus_unit(self) -> tuple[float, str]:
        """(factor from Pa, its name) of G in all tables and pictures of this document."""
        return digits.modulus_unit(curve.shear_modulus_Pa.median for curve in self.curves)

    @property
    def parameters(self) -> list[str]:
        """Names of what was inferred, or given of the bubble, besides G, mu and the stretch."""
        return list(dict.fromkeys(name for curve in self.curves for name in curve.other_parameters))

    @property
    def model_key(self) -> list[str]:
        """What is to be said of them below a table."""
        answered = {curve.model: curve for curve in self.curves if curve.answered}
        lines = list(dict.fromkeys(curve.bubble.sentence for curve in answered.values()))
        if len(answered) == 1:
            (curve,) = answered.values()
            lines = [f"model: {curve.material}. {curve.bubble.sentence}"]
        return lines + ["µ of a law that thins or yields: at a shear rate of 1e5 1/s"] * (AT_RATE in self.parameters)

    def to_dataframe(self) -> Any:
        """The rows of result.csv as a pandas.DataFrame, a row for each curve. Raises InputError without pandas."""
        from cavirheo.reporting.table import rows_of

        head, rows = rows_of(self)
        return dataframe({name: [row.get(name) for row in rows] for name in head}, {"command": self.command})

    def members(self) -> list[tuple[GroupRecord, list[int]]]:
        """Each group with the indices of its curves."""
        members = iter(_members(self.curves).values())
        return [(group, next(members) if group.n + group.n_failed else []) for group in self.groups]

    def put_beside(self, published: Mapping[str, Published], references: Sequence[str] = REFERENCES) -> None:
        """Add values of other methods to the groups of these names; a name that is no group's becomes a group without
        shots, in the order of the names."""
        for k, name in enumerate(published):
            if name not in [group.name for group in self.groups]:
                self.groups.insert(k, group_of(name, []))
        for group in self.groups:
            group.put_beside(published.get(group.name, {}), references)


Group = tuple[list[CurveRecord], "Population | None"]  # rows and material


def result(
    pairs: Pairs, command: str, *, date: str | None = None, notes: Sequence[str] = (), workers: int = 1
) -> Result:
    """The record of all curves and of their groups (the files they came from), in the order given. So many processes
    make that of thousands of curves."""
    answered = Answered.of(pairs)
    members = list(_members(answered.curves).values())
    groups = list(_groups(answered, members, workers))
    rows = {
        i: row for indices, (some, _) in zip(members, groups, strict=True) for i, row in zip(indices, some, strict=True)
    }
    materials = [material for _, material in groups]
    return _document([rows[i] for i in range(len(rows))], materials, command, date=date, notes=notes)


def result_of(
    rows: Sequence[CurveRecord],
    command: str,
    answers: Sequence[Posterior] = (),
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
) -> Result:
    """The record of rows that are made already, and of their groups; without the answers, these have no material."""
    members, title = _members(rows).values(), _title(rows)
    materials = [_material([(rows[i], answers[i]) for i in of], title) if answers else None for of in members]
    return _document(rows, materials, command, date=date, notes=notes)


def _groups(answered: Answered, members: Sequence[list[int]], workers: int) -> Iterator[Group]:
    """One after the other, so that no more answers are held than those of the groups in work."""
    title, keep, count = _title(answered.curves), len(answered) <= KEPT, 0

    def job(indices: list[int]) -> tuple[list[RadiusCurve], list[Posterior], str, bool]:
        return [answered.curves[i] for i in indices], [answered.answers[i] for i in indices], title, keep

    if workers > 1 and not keep:
        with suppress(OSError), processes(workers) as pool:
            for start in range(0, len(members), workers):
                for group in pool.map(_group, [job(indices) for indices in members[start : start + workers]], 1):
                    yield group
                    count += 1
    for indices in members[count:]:
        yield _group(job(indices))


def _group(job: tuple[list[RadiusCurve], list[Posterior], str, bool]) -> Group:
    curves, answers, title, keep = job
    rows = [curve_record(curve, answer) for curve, answer in zip(curves, answers, strict=True)]
    return rows, _material(list(zip(rows, answers, strict=True)), title, keep=keep)


def _document(
    rows: Sequence[CurveRecord],
    materials: Sequence[Population | None],
    command: str,
    *,
    date: str | None,
    notes: Sequence[str],
) -> Result:
    members, title = _members(rows), _title(rows)
    stems = [group for group, _ in members]
    names = [group if stems.count(group) == 1 or not source else source for group, source in members]
    groups = [
        group_of(name, [rows[i] for i in indices], population_record(material, title))
        for name, indices, material in zip(names, members.values(), materials, strict=True)
    ]
    return Result(
        command=command,
        date=date,
        notes=list(notes),
        curves=list(rows),
        groups=groups,
        differences=differences(dict(zip(names, materials, strict=True))),
    )


def read_json(path: str | Path) -> Result:
    """A result.json as it was written. Raises InputError if there is none or it is not one of ours."""
    return document.read_json(path, Result)


def _material(shots: Sequence[tuple[CurveRecord, Posterior]], column: str, *, keep: bool = True) -> Population | None:
    """Of a group, with its slope along the column where there is one; kept for the next time, with its answers."""
    along = tuple(row.column.get(column, np.nan) for row, _ in shots) if column else None
    material = kept_material_of if keep else material_of
    return material(tuple(answer for _, answer in shots), tuple(row.name for row, _ in shots), along)


def _title(curves: Iterable[CurveRecord | RadiusCurve]) -> str:
    """Of the column that the user declared; "" where there is none."""
    return next((title for curve in curves for title in curve.column), "")


def _members(curves: Iterable[CurveRecord | RadiusCurve]) -> dict[tuple[str, str], list[int]]:
    """Indices of the curves of each group; two files of one name in different folders are two groups."""
    members: dict[tuple[str, str], list[int]] = {}
    for index, curve in enumerate(curves):
        members.setdefault((curve.group, curve.group_source), []).append(index)
    return members

"""Values of materials by other methods beside our answers: published values, in a CSV file that is written by hand
(docs/how-to/compare.md), and sweeps of a rheometer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePath

from cavirheo.companions import rheometer
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, is_float, listed
from cavirheo.io.files import guarded
from cavirheo.io.tables import Term, Vocabulary, read_columns
from cavirheo.reporting import comparison
from cavirheo.reporting.record import OUR_METHOD, Published, PublishedValue, Result
from cavirheo.writing.document import Outputs

TABLE = "comparison.csv"
NO_SETS = "references.no_set_column"  # error code for a table without sets, such as one of sweeps
_RANGE = (1e-18, 1e18)  # of a value in SI; beyond these limits ratios would overflow
_UNITS = {
    **dict.fromkeys(("G_Pa", "shear_modulus_Pa"), ("shear_modulus", 1.0)),
    **dict.fromkeys(("G_kPa", "shear_modulus_kPa"), ("shear_modulus", 1e3)),
    **dict.fromkeys(("mu_Pa_s", "viscosity_Pa_s"), ("viscosity", 1.0)),
    **dict.fromkeys(("mu_mPa_s", "viscosity_mPa_s"), ("viscosity", 1e-3)),
}
_COLUMNS = ("set", "method", "quantity", "mean", "std", "files", "source", "note")
_VOCABULARY = Vocabulary(
    {name: Term(name) for name in _COLUMNS},
    f"expected a first line of the titles {','.join(_COLUMNS)}, of which set is needed",
    ["set"],
    {"columns": NO_SETS, "empty": NO_SETS, "rows": "references.no_set", "width": "references.cells"},
)


@dataclass
class ReferenceSet:
    """A set of recordings and its values by method and parameter. files: pattern of the paths of its recordings;
    source: the file that has it."""

    name: str
    source: str = ""
    files: str = ""
    values: dict[str, dict[str, PublishedValue]] = field(default_factory=dict)

    def holds(self, curve: RadiusCurve) -> bool:
        """Whether the file of the curve, or a folder that holds it, has the path that `files` describes."""
        path, pattern = PurePath(curve.source or ""), self.files or self.name
        with suppress(ValueError):  # a name that no file has, such as "."
            return any(place.name and place.match(pattern) for place in (path, *path.parents))
        return False


def read_references(path: str | Path) -> list[ReferenceSet]:
    """Read the sets, in the order of their first lines.

    Raises InputError: the file cannot be read or has a mistake (line, column, what was expected).
    """
    sets: dict[str, ReferenceSet] = {}
    with guarded(Path(path)) as source:
        (table,) = read_columns(source, _VOCABULARY)
        names = [_VOCABULARY.name(title) for title in table.titles]
        unknown = [title for title, name in zip(table.titles, names, strict=True) if not name.kind or name.unit]
        if unknown or len({*names}) < len(names):
            expected = f"expected each of {', '.join(_COLUMNS)} at most once, and no other"
            message = f"line {table.line}: the columns {listed(table.titles, 8)}; {expected}"
            raise InputError(message, "references.head")
        for number, texts in table.rows:
            row = {name.kind: cell for name, cell in zip(names, texts, strict=False) if cell}
            _add_line(row, f"line {number}", sets, str(path))
    return list(sets.values())


def _add_line(row: Mapping[str, str], where: str, sets: dict[str, ReferenceSet], source: str) -> None:
    """Add the content of one line to its set. Raises InputError: it has a mistake."""

    def expect(fine: bool, column: str, expected: str) -> None:
        if not fine:
            message = f"{where}, column {column}: {row.get(column, '')!r}; expected: {expected}"
            raise InputError(message, f"references.{column}")

    expect("set" in row, "set", "a name")
    reference = sets.setdefault(row["set"], ReferenceSet(row["set"], source))
    if files := row.get("files"):
        expect(reference.files in ("", files), "files", f"{reference.files} as above, or an empty cell")
        reference.files = files
    if not row.keys() & {"method", "quantity", "mean", "std"}:
        return
    method = row.get("method", "")
    expect(method != "", "method", "who measured, such as IMR or rheometer")
    expect(method.casefold() != OUR_METHOD, "method", "another name: this one is of our own answers")
    quantity, factor = _UNITS.get(row.get("quantity", ""), ("", 1.0))
    expect(quantity != "", "quantity", f"one of {', '.join(_UNITS)}")
    mean, std = (float(row[name]) if is_float(row.get(name, "")) else None for name in ("mean", "std"))
    expect(mean is not None and _RANGE[0] <= mean <= _RANGE[1], "mean", f"a number above 0 ({row['quantity']})")
    expect("std" not in row or (std is not None and 0.0 <= std <= _RANGE[1]), "std", "a number from 0 up")
    values = reference.values.setdefault(method, {})
    expect(quantity not in values, "quantity", f"one {quantity} of {reference.name!r} by {method}")
    in_si = [None if value is None else float(f"{value * factor:.12g}") for value in (mean, std)]
    values[quantity] = PublishedValue(mean=in_si[0], std=in_si[1], source=row.get("source", ""))


def read_sets(paths: Iterable[str | Path]) -> list[list[ReferenceSet]]:
    """Read the sets of the tables; and those of all other files, which must hold sweeps of one material: a single set.

    Raises InputError: a file cannot be read, or holds neither sets nor sweeps.
    """
    sets, files = list[ReferenceSet](), list[Path]()
    for path in map(Path, paths):
        try:
            sets += read_references(path)
        except InputError as error:
            if error.code != NO_SETS:
                raise
            files.append(path)
    sources = [sets] if sets else []
    if files:
        sweeps = [sweep for path in files for sweep in rheometer.read_sweeps(path)]
        rheometry = rheometer.rheometry(sweeps, rheometer.shared_name(files), command="")
        sources.append([ReferenceSet(rheometry.material, values=rheometry.published)])
    return sources


def in_sets(curves: Iterable[RadiusCurve], sources: Sequence[Sequence[ReferenceSet]]) -> list[RadiusCurve]:
    """The curves, each in the group of its set if `files` of a set, or the name of the set, is its path.

    Raises InputError: two sets have the same recording.
    """
    grouped = []
    for curve in curves:
        names = [reference.name for sets in sources for reference in sets if reference.holds(curve)]
        if len(names) > 1:
            message = f"{curve.source} is a recording of several sets ({', '.join(names)}): mend the column files"
            raise InputError(message, "references.several")
        grouped.append(curve.with_group(names[0], "") if names else curve)
    return grouped


def by_group(names: Iterable[str], sources: Iterable[Sequence[ReferenceSet]]) -> dict[str, Published]:
    """The values of each set by the group of the same name; those of a source with one set that has no such group, by
    all groups.

    Raises InputError: a source has several sets, and no group has the name of one.
    """
    names, merged = list(names), dict[str, Published]()
    for sets in sources:
        values: dict[str, Published] = {reference.name: reference.values for reference in sets}
        if values.keys().isdisjoint(names) and len(sets) > 1:
            message = f"{sets[0].source}: no set has the name of a group (sets {listed(list(values))}; groups "
            message += f"{listed(names)}): give both the same name, or write into the column files what is answered"
            raise InputError(message, "references.groups")
        if values.keys().isdisjoint(names):
            values = dict.fromkeys(names, sets[0].values)
        for group, published in values.items():
            merged[group] = {**merged.get(group, {}), **published}
    return merged


def joined(results: Sequence[Result], *, command: str, date: str, notes: Sequence[str]) -> Result:
    """The answers of several results as one, without their sets that have no recording. Raises InputError: two of them
    have a group of the same name."""
    groups = [group for result in results for group in result.groups if group.n + group.n_failed or len(results) < 2]
    twice = [name for name, count in Counter(group.name for group in groups).items() if count > 1]
    if twice and len(results) > 1:
        message = f"two results have a group {twice[0]!r}: give one of them, or answer both materials by one command"
        raise InputError(message, "references.twice")
    curves = [curve for result in results for curve in result.curves]
    notes = [*notes, *(note for result in results for note in result.notes)]
    return Result(command=command, date=date, notes=notes, curves=curves, groups=groups)


def write_comparison(folder: Path, document: Result, inputs: Iterable[str | Path]) -> None:
    """Write the table of the comparison beside result.json. Raises InputError: as `Outputs`."""
    outputs = Outputs(folder, TABLE, inputs=inputs)
    outputs.write(TABLE, comparison.write_comparison, document)
    outputs.finish()

"""Values of materials by other methods beside our answers: published values, in a CSV file that is written by hand
(docs/how-to/compare.md), and sweeps of a rheometer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from cavirheo.companions import rheometer
from cavirheo.errors import InputError, is_float, listed
from cavirheo.io.files import guarded
from cavirheo.io.tables import Term, Vocabulary, read_columns
from cavirheo.reporting.record import OUR_METHOD, Published, PublishedValue

NO_SETS = "references.no_set_column"  # error code for a table without sets, such as one of sweeps
_RANGE = (1e-18, 1e18)  # of a value in SI; beyond these limits ratios would overflow
_UNITS = {
    "G_Pa": ("shear_modulus", 1.0),
    "G_kPa": ("shear_modulus", 1e3),
    "mu_Pa_s": ("viscosity", 1.0),
    "mu_mPa_s": ("viscosity", 1e-3),
}
_COLUMNS = ("set", "method", "quantity", "mean", "std", "source", "note")
_VOCABULARY = Vocabulary(
    {name: Term(name) for name in _COLUMNS},
    f"expected a first line of the titles {','.join(_COLUMNS)}, of which set is needed",
    ["set"],
    {"columns": NO_SETS, "empty": NO_SETS, "rows": "references.no_set", "width": "references.cells"},
)
Sets = dict[str, dict[str, dict[str, PublishedValue]]]  # values, SI, by set, method and parameter


def read_references(path: str | Path) -> Sets:
    """Read the sets, in the order of their first lines.

    Raises InputError: the file cannot be read or has a mistake (line, column, what was expected).
    """
    sets: Sets = {}
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
            _add_line(row, f"line {number}", sets)
    return sets


def _add_line(row: Mapping[str, str], where: str, sets: Sets) -> None:
    """Add the content of one line to its set. Raises InputError: it has a mistake."""

    def expect(fine: bool, column: str, expected: str) -> None:
        if not fine:
            message = f"{where}, column {column}: {row.get(column, '')!r}; expected: {expected}"
            raise InputError(message, f"references.{column}")

    expect("set" in row, "set", "a name")
    method = row.get("method", "")
    expect(method != "", "method", "who measured, such as IMR or rheometer")
    expect(method.casefold() != OUR_METHOD, "method", "another name: this one is of our own answers")
    quantity, factor = _UNITS.get(row.get("quantity", ""), ("", 1.0))
    expect(quantity != "", "quantity", f"one of {', '.join(_UNITS)}")
    mean, std = (float(row[name]) if is_float(row.get(name, "")) else None for name in ("mean", "std"))
    expect(mean is not None and _RANGE[0] <= mean <= _RANGE[1], "mean", f"a number above 0 ({row['quantity']})")
    expect("std" not in row or (std is not None and 0.0 <= std <= _RANGE[1]), "std", "a number from 0 up")
    values = sets.setdefault(row["set"], {}).setdefault(method, {})
    expect(quantity not in values, "quantity", f"one {quantity} of {row['set']!r} by {method}")
    in_si = [None if value is None else float(f"{value * factor:.12g}") for value in (mean, std)]
    values[quantity] = PublishedValue(mean=in_si[0], std=in_si[1], source=row.get("source", ""))


def read_sets(paths: Iterable[str | Path]) -> list[tuple[str, Sets]]:
    """Read the sets of the tables; and those of all other files, which must hold sweeps of one material: a single set.
    Both with the names of their files.

    Raises InputError: a file cannot be read, or holds neither sets nor sweeps.
    """
    sets, tables, files = Sets(), list[Path](), list[Path]()
    for path in map(Path, paths):
        try:
            sets |= read_references(path)
            tables.append(path)
        except InputError as error:
            if error.code != NO_SETS:
                raise
            files.append(path)
    sources = [(listed(map(str, tables)), sets)] if sets else []
    if files:
        sweeps = [sweep for path in files for sweep in _sweeps(path)]
        rheometry = rheometer.rheometry(sweeps, rheometer.shared_name(files), command="")
        sources.append((listed(map(str, files)), {rheometry.material: rheometry.published}))
    return sources


def _sweeps(path: Path) -> list[rheometer.Sweep]:
    """The sweeps of a file that holds no sets. Raises InputError: as `read_sweeps`."""
    try:
        return rheometer.read_sweeps(path)
    except InputError as error:
        if error.code != "rheometer.no_moduli":
            raise
        sets, sweeps = ",".join(_COLUMNS), "G', G'' over strain or frequency"
        message = f"{path}: neither published values (columns {sets}) nor a sweep of a rheometer ({sweeps})"
        raise InputError(message, error.code) from None


def by_group(names: Iterable[str], sources: Iterable[tuple[str, Sets]]) -> dict[str, Published]:
    """The values of each set by the group of the same name; those of a source with one set that has no such group, by
    all groups. sources: as of `read_sets`.

    Raises InputError: a source has several sets, and no group has the name of one.
    """
    names, merged = list(names), dict[str, Published]()
    for files, sets in sources:
        values: Mapping[str, Published] = sets
        if sets.keys().isdisjoint(names):
            if len(sets) > 1:
                message = f"no set of published values has the name of a group (sets {listed(sets)}; groups "
                raise InputError(f"{message}{listed(names)}): give both the same name", "references.groups", files)
            values = dict.fromkeys(names, next(iter(sets.values())))
        for group, published in values.items():
            merged[group] = {**merged.get(group, {}), **published}
    return merged

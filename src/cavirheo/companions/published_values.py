"""Values of materials by other methods: published values, and sweeps of a rheometer.

Published values are a CSV file that is written by hand (docs/how-to/compare.md). One line per set, method and quantity,
so that a method is added by adding lines:

    set,files,density,method,quantity,mean,std,source
    gel 1 %,gel_1/*.mat,1004,IMR,G_kPa,6.44,1.64,doi:...
    gel 1 %,,,IMR,mu_Pa_s,0.020,0.009,
    gel 1 %,,,rheometer,G_kPa,1.30,,

A line without method, quantity, mean and std only names a set. `-` in the column files: the set has no recordings, only
published values. Settings may stand on any lines of a set. Empty lines and lines that begin with # are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pydantic
from pydantic import Field, NonNegativeFloat, PositiveFloat, TypeAdapter

from cavirheo.errors import InputError, require
from cavirheo.io.files import guarded
from cavirheo.io.tables import Term, Vocabulary, read_columns
from cavirheo.physics.media import CONSTANTS, Medium, medium
from cavirheo.reporting.group import OUR_METHOD, GroupRecord, Published, PublishedValue

NO_SETS = "references.no_set_column"  # error code for a table without sets, such as one of sweeps
_MOST_SETS = 500  # largest number of sets in one file
NO_FILES = "-"  # in the column files: a set with published values alone
_UNITS = {
    **dict.fromkeys(("G_Pa", "shear_modulus_Pa"), ("shear_modulus", 1.0)),
    **dict.fromkeys(("G_kPa", "shear_modulus_kPa"), ("shear_modulus", 1e3)),
    **dict.fromkeys(("mu_Pa_s", "viscosity_Pa_s"), ("viscosity", 1.0)),
    **dict.fromkeys(("mu_mPa_s", "viscosity_mPa_s"), ("viscosity", 1e-3)),
}


class _ReferenceLine(pydantic.BaseModel):
    """One line of the file: its columns and their allowed values. Settings are as the options of `infer`, SI."""

    model_config = pydantic.ConfigDict(allow_inf_nan=False)

    set: str
    method: str | None = None
    quantity: str | None = None
    mean: Annotated[float, Field(ge=1e-18, le=1e18)] | None = None  # beyond these limits ratios would overflow
    std: Annotated[float, Field(ge=0, le=1e18)] | None = None
    files: str | None = None  # file, subfolder or glob in the folder, or NO_FILES; default: the name of the set
    shots: str | None = None  # numbers of the shots to use of every file, "1,4-7"
    model: str | None = None
    material: str | None = None
    medium: str | None = None
    window: pydantic.PositiveInt | None = None
    stretch: PositiveFloat | None = None
    rmax_um: PositiveFloat | None = None
    density: PositiveFloat | None = None
    sound_speed: PositiveFloat | None = None
    surface_tension: NonNegativeFloat | None = None
    pressure: PositiveFloat | None = None
    temperature: PositiveFloat | None = None
    source: str = ""
    note: str = ""


_COLUMNS = tuple(_ReferenceLine.model_fields)
_SETTINGS = _COLUMNS[_COLUMNS.index("files") : _COLUMNS.index("source")]
_CONSTANTS = _SETTINGS[_SETTINGS.index("density") :]
_VALUES_BY_SOURCE = TypeAdapter(list[dict[str, Published]])
_VOCABULARY = Vocabulary(
    {name: Term(name) for name in _COLUMNS},
    f"expected a first line of the titles {','.join(_COLUMNS)}, of which set is needed",
    ["set"],
    {"columns": NO_SETS, "empty": NO_SETS, "rows": "references.no_set", "width": "references.cells"},
)


@dataclass
class ReferenceSet:
    """A set of the file. where: its first line. lines: the line of each setting. values: by method and parameter."""

    name: str
    where: str
    settings: dict[str, Any] = field(default_factory=dict)
    lines: dict[str, str] = field(default_factory=dict)
    values: dict[str, dict[str, PublishedValue]] = field(default_factory=dict)
    medium: Medium = field(default_factory=Medium)

    @property
    def given(self) -> list[str]:
        """Names of the constants of the medium that the set gives; with a medium, of all."""
        return [name for name in CONSTANTS if name in self.settings or "medium" in self.settings]

    @property
    def recorded(self) -> bool:
        """Whether the set has recordings, which can be answered."""
        return self.settings.get("files") != NO_FILES

    @property
    def solid(self) -> bool:
        """Whether the material may have a modulus: one is published, or no value at all is."""
        return not self.values or any("shear_modulus" in values for values in self.values.values())


def read_references(path: str | Path) -> list[ReferenceSet]:
    """Read the sets, in the order of their first lines.

    Raises InputError: the file cannot be read or has a mistake (line, column, what was expected).
    """
    with guarded(Path(path)) as source:
        (table,) = read_columns(source, _VOCABULARY)
    names = [_VOCABULARY.name(title) for title in table.titles]
    for title, (kind, unit, _) in zip(table.titles, names, strict=True):
        place = f"{path}, line {table.line}, column {title or '(empty)'}"
        message = f"{place}: not known; expected one of {', '.join(_COLUMNS)}"
        require(bool(kind) and unit is None, message, "references.head")
        require(len(table.all(kind)) == 1, f"{place}: {len(table.all(kind))} times; expected once", "references.head")
    sets, methods = dict[str, ReferenceSet](), dict[str, tuple[str, str]]()
    for number, texts in table.rows:
        row = {name.kind: cell for name, cell in zip(names, texts, strict=False) if cell}
        _add_line(row, f"{path}, line {number}", sets, methods)
    message = f"{path}: {len(sets)} sets; more than {_MOST_SETS} are not compared at once; split the file"
    require(len(sets) <= _MOST_SETS, message, "references.sets")
    for reference in sets.values():
        constants = {name: reference.settings[name] for name in _CONSTANTS if name in reference.settings}
        try:
            reference.medium = medium(reference.settings.get("medium", "water"), **constants)
        except InputError as error:
            raise error.within(f"{reference.where}, set {reference.name!r}") from None
    return list(sets.values())


def _add_line(
    row: dict[str, str], where: str, sets: dict[str, ReferenceSet], methods: dict[str, tuple[str, str]]
) -> None:
    """Add the content of one line to its set. methods: first spelling of each method's name, and its line."""

    def expect(fine: bool, column: str, expected: str) -> None:
        message = f"{where}, column {column}: {row.get(column, '')!r}; expected: {expected}"
        require(fine, message, f"references.{column}")

    try:
        line = _ReferenceLine.model_validate(row)
    except pydantic.ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        column = str(wrong["loc"][0])
        expect(False, column, "a name" if column == "set" else wrong["msg"].removeprefix("Input should be "))
        raise
    reference = sets.setdefault(line.set, ReferenceSet(line.set, where))
    for name, value in line.model_dump(include=set(_SETTINGS), exclude_none=True).items():
        first = reference.lines.setdefault(name, where)
        earlier = reference.settings.setdefault(name, value)
        expect(earlier == value, name, f"{earlier} as in {first}, or an empty cell")
    if not any((line.method, line.quantity, line.mean, line.std is not None)):
        return
    method, (quantity, factor) = line.method or "", _UNITS.get(line.quantity or "", ("", 1.0))
    spelled, first = methods.setdefault(method.casefold(), (method, where))
    expect(method != "", "method", "who measured, such as IMR or rheometer")
    expect(method.casefold() != OUR_METHOD, "method", "another name: this one is of our own answers")
    expect(quantity != "", "quantity", f"one of {', '.join(_UNITS)}")
    expect(line.mean is not None, "mean", f"a number above 0 ({line.quantity})")
    values = reference.values.setdefault(method, {})
    expect(quantity not in values, "quantity", f"one {quantity} of {reference.name!r} by {method}")
    expect(method == spelled, "method", f"{spelled!r} as in {first}")
    mean, std = (None if value is None else float(f"{value * factor:.12g}") for value in (line.mean, line.std))
    values[quantity] = PublishedValue(mean=mean, std=std, source=line.source)


def read_values(_: object, *paths: str) -> list[dict[str, Any]]:
    """Read values by set, method and parameter, in the form that `published` takes: those of the files with sets, and
    those of the other files, which must hold sweeps of one material. A function for `Reader`.

    Raises InputError: a file cannot be read, or holds neither sets nor sweeps.
    """
    from cavirheo.companions import rheometer

    values, sweep_values, files = dict[str, Published](), dict[str, Published](), list[Path]()
    for path in map(Path, paths):
        try:
            values |= {reference.name: reference.values for reference in read_references(path)}
        except InputError as error:
            if error.code != NO_SETS:
                raise
            files.append(path)
    if files:
        sweeps = [sweep for path in files for sweep in rheometer.read_sweeps(path)]
        rheometry = rheometer.rheometry(sweeps, rheometer.shared_name(files), command="")
        sweep_values = {rheometry.material: rheometry.published}
    return _VALUES_BY_SOURCE.dump_python([each for each in (values, sweep_values) if each])


def published(values: list[dict[str, Any]]) -> list[dict[str, Published]]:
    """Check the output of `read_values`. Raises ValueError: it has another form."""
    return _VALUES_BY_SOURCE.validate_python(values)


def by_group(names: Iterable[str], sets: Mapping[str, Published], pairs: Sequence[str] = ()) -> dict[str, Published]:
    """The values of each set by the group of the same name; those of a single set without such a group, by all groups.
    pairs: the groups of sets with other names, each as "GROUP=SET", or "SET" for a single group.

    Raises InputError: several sets, and no group has the name of one; or no such group or set.
    """
    names, groups_of = list(names), dict[str, list[str]]()
    known = f"sets {', '.join(sets)}; groups {', '.join(names)}"
    for pair in pairs:
        chosen = [(group, name) for group in names for name in sets if pair == f"{group}={name}"]
        chosen = chosen or [(group, pair) for group in names if pair in sets and len(names) == 1]
        require(bool(chosen), f"{pair!r} is no group with its set, GROUP=SET: {known}", "references.pair")
        ((group, name),) = chosen
        groups_of.setdefault(name, []).append(group)
    if not groups_of and sets.keys().isdisjoint(names):
        message = f"no set has the name of a group ({known}): give both the same name, or pair them by --set GROUP=SET"
        require(len(sets) < 2, message, "references.groups")
        groups_of = {name: names for name in sets}
    return {group: values for name, values in sets.items() for group in groups_of.get(name, [name])}


def add_to_groups(groups: Sequence[GroupRecord], sets: Mapping[str, Published]) -> None:
    """Add to each group the values that `by_group` finds for it. Raises InputError: as `by_group`."""
    values = by_group((group.name for group in groups), sets)
    for group in groups:
        group.add_published(values.get(group.name, {}))

"""What other methods say of materials, from files of published values and from the sweeps of a rheometer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from cavirheo.companions.published.references import NO_SETS, read_references
from cavirheo.companions.rheometer import document
from cavirheo.companions.rheometer.read import read_sweeps
from cavirheo.errors import InputError, require
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Published


def values_of(_: object, *paths: str) -> dict[str, Any]:
    """By set, method and parameter, as `published` takes them. Files without a column of sets are the sweeps of one
    material: work for a `Reader`.

    Raises InputError: a file cannot be read, or is neither.
    """
    found: dict[str, Published] = {}
    sweeps: list[Path] = []
    for path in map(Path, paths):
        try:
            found |= {about.name: about.published() for about in read_references(path)}
        except InputError as error:
            if error.code != NO_SETS:
                raise
            sweeps.append(path)
    if sweeps:
        known = [sweep for path in sweeps for sweep in read_sweeps(path)]
        head: dict[str, Any] = {"command": "", "date": None, "notes": []}
        made = document.rheometry(known, document.shared_name(sweeps), **head)
        found[made.material] = {**found.get(made.material, {}), **document.published(made)}
    return TypeAdapter(dict[str, Published]).dump_python(found)


def published(values: dict[str, Any]) -> dict[str, Published]:
    """What `values_of` found, checked. Raises ValueError: something else."""
    return TypeAdapter(dict[str, Published]).validate_python(values)


def set_beside(groups: Sequence[GroupRecord], sets: Mapping[str, Published]) -> None:
    """Each group gets the values of the set of its name, too; all get those of a set that is the only one and has no
    group's name.

    Raises InputError: no set has the name of a group.
    """
    names = {group.name for group in groups}
    named = f"no set has the name of a group: sets {', '.join(sets)}; groups {', '.join(names)}"
    require(len(sets) < 2 or not names.isdisjoint(sets), named, "references.groups")
    for group in groups:
        alone = sets if len(sets) == 1 and names.isdisjoint(sets) else {}
        values = sets.get(group.name) or next(iter(alone.values()), {})
        group.published |= {method: dict(known) for method, known in values.items()}

"""Which shots of a file: "1,4-7", numbered from 1 in the order of the file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar

from cavirheo.errors import numbered, require

Chosen = str | Iterable[int] | None
_Item = TypeVar("_Item")


def shot_numbers(shots: Chosen) -> list[int] | None:
    """Sorted, each once; None for all. Raises InputError: no such list, or a number below 1."""
    return None if shots is None else numbered(shots, "shots", "option.shots")


def selected(items: Sequence[_Item], shots: Chosen) -> list[_Item]:
    """Those with these numbers, in their order. Raises InputError: as `shot_numbers`, or there are not so many."""
    if (numbers := shot_numbers(shots)) is None:
        return list(items)
    beyond = ", ".join(str(number) for number in numbers if number > len(items))
    message = f"shot {beyond} is asked for, and the file has {len(items)}: give numbers from 1 to {len(items)}"
    require(not beyond, message, "reading.shots")
    return [items[number - 1] for number in numbers]

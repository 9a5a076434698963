"""Which shots of a file: "1,4-7", numbered from 1 in the order of the file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TypeVar

from cavirheo.errors import require

Chosen = str | Iterable[int] | None
_Item = TypeVar("_Item")


def shot_numbers(shots: Chosen) -> list[int] | None:
    """Sorted, each once; None for all. Raises InputError: no such list, or a number below 1."""
    if shots is None:
        return None
    told = f'shots must be numbers from 1 up and ranges of them, such as "1,4-7", got {shots!r}'
    found: set[int] = set()
    for part in shots.split(",") if isinstance(shots, str) else map(str, shots):
        match = re.fullmatch(r"\s*(\d{1,6})\s*(?:-\s*(\d{1,6})\s*)?", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        require(0 < first <= last, told, "option.shots")
        found.update(range(first, last + 1))
    require(bool(found), told, "option.shots")
    return sorted(found)


def selected(items: Sequence[_Item], shots: Chosen) -> list[_Item]:
    """Those with these numbers, in their order. Raises InputError: as `shot_numbers`, or there are not so many."""
    if (numbers := shot_numbers(shots)) is None:
        return list(items)
    beyond = ", ".join(str(number) for number in numbers if number > len(items))
    told = f"shot {beyond} is asked for, and the file has {len(items)}: give numbers from 1 to {len(items)}"
    require(not beyond, told, "reading.shots")
    return [items[number - 1] for number in numbers]

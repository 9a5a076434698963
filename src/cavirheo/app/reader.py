"""Read the files of a visitor in a process of its own, which imports this module alone."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import listed
from cavirheo.io import apart
from cavirheo.io.shots import CurveSet, read_shots
from cavirheo.messages import Message

MEMORY = 4 << 30  # bytes that reading may take
KINDS: dict[str, Any] = {kind.__name__: kind for kind in (RadiusCurve, Message, CurveSet)}  # what is sent


class Reader:
    """Reads files, each call in a process of its own, at most so many at a time."""

    def __init__(self, seconds: float, *, processes: int = 1) -> None:
        """seconds: time limit of a call."""
        self.seconds = seconds
        self._free = BoundedSemaphore(processes)

    def read(
        self, folder: Path, contents: Sequence[str | RadiusCurve], **options: Any
    ) -> tuple[list[RadiusCurve], list[str]]:
        """Return (the curves, all problems and remarks) of `read_shots` of files in one folder, in which the child
        works: no message names it. contents: names of files, and curves that were measured in some.

        Raises InputError: as `apart.call`.
        """
        name = listed([one if isinstance(one, str) else one.source for one in contents], 3)
        how: dict[str, Any] = {"memory": MEMORY, "seconds": self.seconds, "name": name, "kept": False}
        with self._free:
            answer = apart.call(read_in_folder, str(folder), [*contents], options, **how)
        curves = []
        for curve in answer.curves:
            group: dict[str, Any] = {"group_source": curve.group} if "group_source" in curve.meta else {}
            curves.append(curve.labelled(source=Path(curve.source).name, **group))
        return curves, answer.problems + answer.remarks


def read_in_folder(folder: str, files: list[str | RadiusCurve], options: dict[str, Any]) -> CurveSet:
    """Read files that have names without their folder; in the child."""
    os.chdir(folder)
    return read_shots(files, **options)

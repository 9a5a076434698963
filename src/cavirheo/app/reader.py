"""Read the files of a visitor in a process of its own."""

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
KINDS: dict[str, Any] = {kind.__name__: kind for kind in (RadiusCurve, Message, CurveSet)}


class Reader:
    """Reads files, each call in a process of its own, at most so many at a time."""

    def __init__(self, seconds: float, *, processes: int = 1) -> None:
        """seconds: time limit of a call."""
        self.seconds = seconds
        self._free = BoundedSemaphore(processes)

    def read(self, files: Sequence[Path | RadiusCurve], **options: Any) -> tuple[list[RadiusCurve], list[str]]:
        """Return (the curves, all problems and remarks) of `read_shots` of files in one folder, in which the
        child works: no message names it.

        Raises InputError: as `apart.call`.
        """
        paths = [Path(file.source) if isinstance(file, RadiusCurve) else file for file in files]
        contents = [
            file.labelled(source=path.name) if isinstance(file, RadiusCurve) else path.name
            for file, path in zip(files, paths, strict=True)
        ]
        folder = str(paths[0].parent) if paths else "."
        name = listed([path.name for path in paths], 3)
        with self._free:
            answer = apart.call(
                read_in_folder, folder, contents, options, memory=MEMORY, seconds=self.seconds, name=name, kept=False
            )
        curves = []
        for curve in answer.curves:
            group: dict[str, Any] = {"group_source": curve.group} if "group_source" in curve.meta else {}
            curves.append(curve.labelled(source=Path(curve.source).name, **group))
        return curves, answer.problems + answer.remarks


def read_in_folder(folder: str, files: list[str | RadiusCurve], options: dict[str, Any]) -> CurveSet:
    """Read files that have names without their folder; in the child."""
    os.chdir(folder)
    return read_shots(files, **options)

"""What is said of a recording's camera: typed by a person, checked field by field, written as options."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from cavirheo.errors import InputError, number_of
from cavirheo.video.frames import CAMERAS, STACKS


class Camera(NamedTuple):
    """Frames per s, um per pixel, exposure in us; None: not given."""

    frame_rate: float | None = None
    um_per_px: float | None = None
    exposure_us: float | None = None

    @property
    def options(self) -> str:
        """Of `cavirheo infer`, that mean the same."""
        values = zip(("fps", "um-per-px", "exposure-us"), self, strict=True)
        return "".join(f" --{name} {value:.10g}" for name, value in values if value is not None)


def typed(texts: Sequence[str], ending: str, *, unscaled: bool = False) -> tuple[Camera, list[str]]:
    """The camera that these texts say; why a recording with this ending cannot be measured so, field by field, empty
    where it can. unscaled: its file is known to state no scale."""
    values: list[float | None] = []
    wrong = []
    for text, field in zip(texts, Camera._fields, strict=True):
        value, why = None, ""
        try:
            value = number_of(text, field.replace("_", " "))
        except InputError as error:
            why = str(error)
        values.append(value)
        wrong.append(why if value is None or 0 < value < inf else "must be a positive number")
    if values[0] is None and ending not in CAMERAS:
        wrong[0] = wrong[0] or "missing: type the rate of the camera; the file states only how fast it is played"
    if values[1] is None and (ending not in STACKS or unscaled):
        wrong[1] = wrong[1] or "missing: type how many micrometres a pixel shows"
    return Camera(*values), wrong
